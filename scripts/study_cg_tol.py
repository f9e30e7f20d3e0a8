"""Error that the solver's tolerance leaves in a motion, next to the error of the step size: where further digits buy nothing.

For each scene and tolerance: RMS distance of the vertices at the end from a run with the tightest tolerance, CG iterations
and wall time; and the same distance between steps h and h/2, which no tolerance takes away.

    python scripts/study_cg_tol.py --scenes swing flag sphere_drape --until 0.4
"""

import argparse
import time

import numpy as np
import results

import taichi_cloth as tc
from taichi_cloth.app import scenefile

TIGHT = 1e-9


def run(scene: scenefile.SceneFile, until: float, tolerance: float, h: float) -> tuple[np.ndarray, int, float]:
    """(positions at the end, CG iterations, wall seconds without the first step)."""
    sim = tc.Simulation(scene.make({}), h=h, cg_tol=tolerance, integrator="backward_euler", adaptive=False)
    sim.step()
    start = time.perf_counter()
    sim.run(until - sim.time, 1 / (until - sim.time))
    wall = time.perf_counter() - start
    out = sim.positions(), sum(r.iterations for r in sim.log), wall
    sim.close()
    return out


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=["swing", "flag", "sphere_drape"])
    parser.add_argument("--tolerances", type=float, nargs="+", default=[1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
    parser.add_argument("--until", type=float, default=0.4, help="simulated seconds")
    parser.add_argument("--h", type=float, default=1 / 60)
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    rows = []
    for name in args.scenes:
        scene = scenefile.read(name)
        exact, _, _ = run(scene, args.until, TIGHT, args.h)
        finer, _, _ = run(scene, args.until, TIGHT, args.h / 2)
        step_error = float(np.sqrt(np.mean(np.sum((exact - finer) ** 2, axis=1))))
        print(f"{name}: error of the step size itself about {step_error:.2e} m")
        print("  cg_tol   RMS error [m]  of the step's  iterations  wall s")
        for tolerance in args.tolerances:
            x, iterations, wall = run(scene, args.until, tolerance, args.h)
            error = float(np.sqrt(np.mean(np.sum((x - exact) ** 2, axis=1))))
            rows.append({"scene": name, "cg_tol": tolerance, "error": error, "step_error": step_error,
                         "iterations": iterations, "wall_s": wall})
            print(f"  {tolerance:6.0e}   {error:13.2e}  {error / step_error:13.1e}  {iterations:10}  {wall:6.2f}", flush=True)
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
