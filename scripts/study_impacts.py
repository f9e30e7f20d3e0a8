"""Why contact is of first order: the time of an impact within its step is not known.

A sheet swings against a ball, and one falls on another. For each method and step size: RMS distance [m] of the vertices at the
end from a run with steps of 1/3840 s, steps and solves. `refined` is BDF2 at 1/60 s where only steps in which something new is
touched are made again with a part of that, and those after it grow again; `tolerance` is what a user asks for.

    python scripts/study_impacts.py --scenes swing sheets
"""

import argparse
from collections.abc import Callable

import numpy as np
import results

import taichi_cloth as tc

SOFT = tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100, 0.1), tc.Bend(5e-5))
H, FINE = 1 / 60, 1 / 3840  # s
AFTER = 1 / 240  # s for which steps stay small after something new was touched


def swing() -> tc.Scene:
    """A sheet that is held along one side swings down against a ball, and past it."""
    mesh, scene = tc.grid(0.5, 12), tc.Scene()
    side = mesh.x[:, 2].max()
    scene.pin(scene.add_cloth(mesh, SOFT, positions=mesh.x), np.flatnonzero(mesh.x[:, 2] > side - 1e-6))
    scene.add_solid(tc.Sphere(0.1), 0.3, 0.005, position=(0.25, -0.45, side - 0.12))
    return scene


def sheets() -> tc.Scene:
    """A sheet falls on one that is held at two sides."""
    scene, contact = tc.Scene(), tc.ClothContact(0.005, 0.3)
    wide, small = tc.grid(0.5, 6), tc.grid(0.4, 5)
    below = scene.add_cloth(wide, SOFT, positions=wide.x, contact=contact)
    scene.pin(below, "top")
    scene.pin(below, "bottom")
    scene.add_cloth(small, SOFT, positions=small.x + [0.05, 0.03, -0.05], contact=contact)
    return scene


SCENES: dict[str, tuple[Callable[[], tc.Scene], float]] = {"swing": (swing, 0.5), "sheets": (sheets, 0.3)}


def touched(sim: tc.Simulation) -> set:
    """What holds particles at solids, and pairs of cloth in reach of each other, after the last step."""
    layers = sim.contacts.layers
    pairs = [] if layers is None else layers.near.pair.tolist()
    return {*sim.contacts.solids.accepted.key.tolist(), *map(tuple, pairs)}


def advance(sim: tc.Simulation, until: float, part: int) -> int:
    """Steps of 1/60 s to a time; those in which something new is touched are made again as a `part` of that.

    Returns:
        How many were kept.
    """
    h, last, count, before = H, -1.0, 0, touched(sim)
    while sim.time < until - 1e-9:
        state = sim.checkpoint() if part > 1 else None
        sim.step(min(h, until - sim.time))
        now = touched(sim)
        new = part > 1 and bool(now - before)
        if new and h > 1.01 * H / part:
            sim.resume(state)
            h = H / part
            continue
        count += 1
        before, last = now, sim.time if new else last
        if sim.time - last > AFTER:
            h = min(H, 2 * h)
    return count


def run(scene: tc.Scene, until: float, part: int = 1, **options: object) -> tuple[np.ndarray, int, int]:
    """(positions (n, 3) at the end, steps, solves)."""
    with tc.Simulation(scene, threads=1, **options) as sim:
        if part > 1:
            count = advance(sim, until, part)
        else:
            sim.run(until, 1 / until)
            count = len(sim.log)
        return sim.positions().copy(), count, sum(r.solves for r in sim.log)


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="+", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--steps", type=int, nargs="+", default=[60, 120, 240, 480], help="a second")
    parser.add_argument("--parts", type=int, nargs="+", default=[4, 8, 16], help="of 1/60 s at impacts")
    parser.add_argument("--tolerances", type=float, nargs="+", default=[3e-2, 1e-2, 3e-3])
    parser.add_argument("--fine", type=float, default=FINE, help="steps of the reference [s]")
    parser.add_argument("--until", type=float, help="simulated seconds, for a short try")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    rows = []
    for name in args.scenes:
        make, until = SCENES[name]
        until = args.until or until

        def error(x: np.ndarray, fine: np.ndarray) -> float:
            return float(np.sqrt(np.mean(np.sum((x - fine) ** 2, axis=1))))

        fine = run(make(), until, h=args.fine, integrator="bdf2", cg_tol=1e-6)[0]
        other = run(make(), until, h=args.fine, integrator="newton_euler", cg_tol=1e-6)[0]
        print(f"{name}, {until} s: BDF2 and newton_euler with steps of {args.fine:.1g} s differ by {error(other, fine):.1e} m")
        print("method                     RMS error [m]   steps  solves")
        ways = [(f"{method} 1/{n}", {"h": 1 / n, "integrator": method}) for method in ("backward_euler", "bdf2")
                for n in args.steps]
        ways += [(f"bdf2 1/60, refined 1/{60 * part}", {"h": H, "integrator": "bdf2", "part": part}) for part in args.parts]
        ways += [(f"tolerance {value:g} m", {"tolerance": value}) for value in args.tolerances]
        for way, options in ways:
            x, steps, solves = run(make(), until, **options)  # type: ignore[arg-type]
            rows.append({"scene": name, "way": way, "error": error(x, fine), "steps": steps, "solves": solves})
            print(f"{way:26} {rows[-1]['error']:13.2e}  {steps:6} {solves:7}", flush=True)
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
