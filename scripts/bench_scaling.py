"""Whole steps of a hanging sheet from 2,600 vertices up: time, set-up, iterations, memory, and the exponent of growth.

Each size runs in a process of its own, so that its memory is its own. Prints a table and writes JSON.

    python scripts/bench_scaling.py --sizes 51 101 224 500 --precision f32 --json scaling.json
"""

import argparse
import json
import resource
import subprocess
import sys
import time

import numpy as np
import results

import taichi_cloth as tc

FABRIC = tc.Fabric(0.15, tc.Stretch(5000), tc.Shear(500), tc.Bend(5e-5))


def measure(n: int, precision: str, arch: str, threads: int | None, steps: int, stretch: float) -> dict:
    """One row, in this process."""
    mesh = tc.grid(1.0, n - 1)
    scene = tc.Scene()
    fabric = FABRIC if stretch == 5000 else tc.Fabric(0.15, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(5e-5))
    cloth = scene.add_cloth(mesh, fabric)
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    start = time.perf_counter()
    sim = tc.Simulation(scene, h=1 / 60, precision=precision, arch=arch, threads=threads, integrator="backward_euler")
    made = time.perf_counter()
    sim.step()
    first = time.perf_counter()
    while sim.time < 0.25:  # mid-swing
        sim.step()
    log = [sim.step() for _ in range(steps)]
    usage = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)
    ms = [1e3 * r.seconds["total"] for r in log]
    parts = {name: 1e3 * float(np.median([r.seconds[name] for r in log])) for name in ("EVAL", "CG")}
    return {"vertices": n * n, "precision": precision, "arch": arch, "threads": sim.runtime.threads,
            "step_ms": float(np.median(ms)), **{f"{k}_ms": v for k, v in parts.items()},
            "iterations": float(np.median([r.iterations for r in log])), "setup_s": made - start, "first_step_s": first - made,
            "memory_mb": usage}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[51, 101, 224, 500], help="vertices a side")
    parser.add_argument("--precision", default="f32")
    parser.add_argument("--arch", default="cpu")
    parser.add_argument("--threads", type=int, nargs="+", help="counts to compare; all cores otherwise")
    parser.add_argument("--steps", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=1, help="runs of each, in turns")
    parser.add_argument("--stretch", type=float, default=5000.0, help="N/m; shear is a tenth of it")
    parser.add_argument("--json", help="file to write")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    threads = args.threads or [None]
    if args.one:
        print(json.dumps(measure(args.sizes[0], args.precision, args.arch, threads[0], args.steps, args.stretch)))
        return
    rows = []
    print(f"{'vertices':>8} {'threads':>7} {'step ms':>9} {'EVAL':>8} {'CG':>8} {'its':>5} {'set-up s':>8} {'first s':>8} "
          f"{'memory MB':>9} {'speed-up':>8}")
    for n in args.sizes:
        for r in compared(n, args, threads):
            rows.append(r)
            print(f"{r['vertices']:8} {r['threads']:7} {r['step_ms']:9.2f} {r['EVAL_ms']:8.2f} {r['CG_ms']:8.2f} "
                  f"{r['iterations']:5.0f} {r['setup_s']:8.2f} {r['first_step_s']:8.2f} {r['memory_mb']:9.0f} "
                  f"{r['speedup']:8.2f}", flush=True)
    exponent = None
    of_most = [r for r in rows if r["threads"] == max(r["threads"] for r in rows)]
    if len(of_most) > 1:
        n, t = np.log([r["vertices"] for r in of_most]), np.log([r["step_ms"] for r in of_most])
        exponent = float(np.polyfit(n, t, 1)[0])
        print(f"a step grows as n^{exponent:.2f}")
    results.write(args.json, rows, exponent=exponent)


def compared(n: int, args: argparse.Namespace, threads: list) -> list[dict]:
    """A size's rows, one for each number of threads: medians over rounds; speed-ups against the first, likewise."""
    runs: list[list[dict]] = [[] for _ in threads]
    for _ in range(args.rounds):
        for count, of_count in zip(threads, runs):
            command = [sys.executable, __file__, "--one", "--sizes", str(n), "--precision", args.precision,
                       "--arch", args.arch, "--steps", str(args.steps), "--stretch", str(args.stretch)]
            command += ["--threads", str(count)] if count else []
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                print(f"{n * n:8} failed: {done.stderr.strip().splitlines()[-1]}")
                return []
            of_count.append(json.loads(done.stdout.splitlines()[-1]))
    first = np.array([r["step_ms"] for r in runs[0]])
    return [{**of_count[0], **{k: float(np.median([r[k] for r in of_count])) for k in of_count[0]
                               if k.endswith(("_ms", "_s", "_mb", "iterations"))},
             "speedup": float(np.median(first / [r["step_ms"] for r in of_count]))} for of_count in runs]


if __name__ == "__main__":
    main()
