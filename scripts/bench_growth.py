"""How steps in contact grow with the mesh: CPU seconds and CG iterations of a solve, memory, set-up, and their exponents.

Each size runs in a process of its own on one thread, so that its memory and its CPU time are its own. Steps in which a kernel
is built are left out of seconds. The serial part is the CPU time of the thread that launches kernels, which no other shares.
Memory is the peak, beside that of a process that has run the scene's smallest mesh.

    python scripts/bench_growth.py --cells 50 101 160 --until 0.3333 --json growth.json
    python scripts/bench_growth.py --cells 50 101 --until 0.25 --over-cells thickness=0.3       # as many pairs a vertex
    python scripts/bench_growth.py --scene sphere_drape --set itself=1 --cells 200 500 --until 0 --json setup.json
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
from taichi_cloth.app import scenefile

GROWING = {"solve_s": "a solve", "iterations": "CG iterations a solve", "iteration_s": "an iteration",
           "pairs": "pairs at most", "setup_s": "set-up"}


def peak() -> float:
    """The most memory [MB] that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1024.0 if sys.platform != "darwin" else 1024.0**2)


def simulation(name: str, settings: dict, cells: int, precision: str) -> tc.Simulation:
    """A scene on one thread, with so many cells along a side."""
    module = scenefile.read(name)
    plan = {key: value for key, value in module.run.items() if key not in ("duration", "fps")}
    return tc.Simulation(module.make({**settings, "cells": cells}), precision=precision, threads=1, **plan)


def measured(name: str, settings: dict, cells: int, until: float, precision: str) -> dict:
    """One row, in this process: `until` [s] of a scene after one step of its smallest mesh."""
    small = simulation(name, settings, 10, precision)
    small.step()
    small.close()
    before, start = peak(), time.process_time()
    sim = simulation(name, settings, cells, precision)
    setup = time.process_time() - start
    timed, serial = [], []
    while sim.time < until - 1e-9:
        start, own = time.process_time(), time.thread_time()
        record = sim.step()
        timed.append((time.process_time() - start, record))
        serial.append(time.thread_time() - own)
        print(f"{record.t:.4f} s: {record.solves} solves, {timed[-1][0]:.1f} s, {peak() - before:.0f} MB", file=sys.stderr)
    counts = [not r.seconds["compiling"] and r.layers + r.contacts > 0 for _, r in timed]
    plain = [both for both, counted in zip(timed, counts) if counted]
    alone = sum(s for s, counted in zip(serial, counts) if counted)
    log, solves = [r for _, r in timed], max(sum(r.solves for _, r in plain), 1)
    wall = max(sum(r.seconds["total"] for _, r in plain), 1e-9)
    iterations, cg = sum(r.iterations for _, r in plain), sum(r.seconds["CG"] * s / r.seconds["total"] for s, r in plain)
    rejected = sum(sum(r.rejections.values()) for r in log)
    return {"vertices": sim.vertex_count, "setup_s": setup, "steps": len(log), "rejected": rejected,
            "step_s": sum(s for s, _ in plain) / max(len(plain), 1), "solve_s": sum(s for s, _ in plain) / solves,
            "solves": solves / max(len(plain), 1), "iterations": iterations / solves, "iteration_s": cg / max(iterations, 1),
            "serial_part": alone / max(sum(s for s, _ in plain), 1e-9),
            "layers_share": sum(r.seconds["C-C"] for _, r in plain) / wall, "pairs": max((r.layers for r in log), default=0),
            "memory_mb": peak() - before, "bytes_a_vertex": 1e6 * (peak() - before) / sim.vertex_count}


def main() -> None:
    """Prints the table, writes the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scene", default="layers", help="one with the option `cells`")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE", help="its other options")
    parser.add_argument("--over-cells", nargs="*", default=[], metavar="NAME=VALUE", help="more of them, each over the cells")
    parser.add_argument("--cells", type=int, nargs="+", default=[50, 101], help="along a side")
    parser.add_argument("--until", type=float, default=1 / 3, help="s; 0: set-up alone")
    parser.add_argument("--precision", default="f64")
    parser.add_argument("--json", help="file to write")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        settings = dict(s.split("=", 1) for s in args.set)
        print(json.dumps(measured(args.scene, settings, args.cells[0], args.until, args.precision)))
        return
    rows = []
    for cells in args.cells:
        scaled = [f"{name}={float(value) / cells}" for name, value in (s.split("=", 1) for s in args.over_cells)]
        settings = args.set + scaled
        command = [sys.executable, __file__, "--one", "--scene", args.scene, "--cells", str(cells), "--until", str(args.until),
                   "--precision", args.precision, *(["--set", *settings] if settings else [])]
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.returncode)
        rows.append(json.loads(done.stdout.splitlines()[-1]))
        print(", ".join(f"{key} {value:.4g}" for key, value in rows[-1].items()), flush=True)
    exponents = {}
    for key, words in GROWING.items():
        if len(rows) > 1 and all(r[key] for r in rows):
            exponents[key] = float(np.polyfit(np.log([r["vertices"] for r in rows]), np.log([r[key] for r in rows]), 1)[0])
            print(f"{words} grows as n^{exponents[key]:.2f}")
    results.write(args.json, rows, exponents=exponents)


if __name__ == "__main__":
    main()
