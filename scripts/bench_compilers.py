"""What the installed compilers of kernels take: a cold start, a warm start and a step, and whether their positions agree.

    python scripts/bench_compilers.py
    python scripts/bench_compilers.py --rounds 5 --json out/compilers.json

All is CPU time, which other programs disturb least: a start from Python's to the end of the first step, and a step, the
least of those that processes make in turns. On one thread, as threads that wait for each other take CPU time, too.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

from taichi_cloth.backend import compiler

SCENES = {"hang": {"cells": 40}, "sphere_drape": {}}
CODE = """
import json, sys, time
import numpy as np
import taichi_cloth as tc
from taichi_cloth.app import scenefile

name, settings, threads, steps, out = sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5]
scene = scenefile.read(name)
options = {key: value for key, value in scene.run.items() if key not in ("duration", "fps")}
sim = tc.Simulation(scene.build(**settings), threads=threads, **options)
sim.step()
start, times = time.process_time(), []
for _ in range(steps):
    begun = time.process_time()
    sim.step()
    times.append(time.process_time() - begun)
np.savez(out, x=sim.positions(), start=start, times=times)
"""


def ran(name: str, scene: str, cache: str, threads: int, steps: int) -> dict[str, np.ndarray]:
    """A run of a scene by a compiler, with its kernels kept in a folder."""
    with tempfile.TemporaryDirectory() as folder:
        script, out = pathlib.Path(folder) / "run.py", pathlib.Path(folder) / "out.npz"
        script.write_text(CODE)
        environment = os.environ | {compiler.VARIABLE: name, "TI_OFFLINE_CACHE_FILE_PATH": cache}
        words = [scene, json.dumps(SCENES[scene]), str(threads), str(steps), str(out)]
        subprocess.run([sys.executable, str(script), *words], env=environment, check=True, capture_output=True)
        return dict(np.load(out))


def measure(scene: str, names: list[str], rounds: int, threads: int, steps: int) -> dict[str, dict]:
    """Figures of each compiler in a scene: [s], [s] and [ms]; the largest distance to the first one's positions [m]."""
    found: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as cache:
        runs: dict[str, list] = {name: [] for name in names}
        for k in range(1 + rounds):
            for name in names[:: 1 if k % 2 else -1]:
                runs[name].append(ran(name, scene, cache, threads, steps))
    for name, (cold, *warm) in runs.items():
        times = np.min([run["times"] for run in warm], axis=0)
        found[name] = {"cold": float(cold["start"]), "warm": min(float(run["start"]) for run in warm),
                       "step": 1e3 * float(np.mean(times)), "apart": float(np.abs(cold["x"] - runs[names[0]][0]["x"]).max())}
    return found


def main() -> None:
    """Prints a table for the pages."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3, help="warm runs of each compiler and scene")
    parser.add_argument("--steps", type=int, default=30)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--json", type=pathlib.Path, help="writes the figures, too")
    args = parser.parse_args()
    names = [known.name for known in compiler.COMPILERS.values() if known.installed]
    print("| scene | compiler | cold start [s] | warm start [s] | step [ms] | positions apart [m] |\n" + 6 * "|---" + "|")
    found = {scene: measure(scene, names, args.rounds, args.threads, args.steps) for scene in SCENES}
    for scene, rows in found.items():
        for name, row in rows.items():
            print(f"| `{scene}` | {name} | {row['cold']:.1f} | {row['warm']:.1f} | {row['step']:.1f} | {row['apart']:.2g} |")
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
