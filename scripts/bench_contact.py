"""What contact with solids costs: its share of a step, and how detection grows with the cloth.

A sheet drapes on a ball and on a mesh (a file, or the lump of scenes/bunny_drape.py). Prints a table and writes JSON.

    python scripts/bench_contact.py --cells 50 100 200 --mesh bunny.obj --json contact.json
"""

import argparse
import time

import numpy as np
import results

import taichi_cloth as tc
from taichi_cloth.app import scenefile


def scene_of(name: str, cells: int, mesh: str) -> tc.Scene:
    """The scene of a file in scenes/ at a resolution."""
    values = {"cells": str(cells), **({"mesh": mesh} if mesh and name == "bunny_drape" else {})}
    return scenefile.read(f"scenes/{name}.py").make(values)


def measure(name: str, cells: int, mesh: str, until: float, args: argparse.Namespace) -> dict:
    """One row: the scene run to `until` [s], then detection alone, again and again."""
    sim = tc.Simulation(scene_of(name, cells, mesh), integrator="backward_euler", precision=args.precision, arch=args.arch)
    sim.run(until, 30)
    steps = sim.log[1:]  # the first compiles
    total = {part: sum(r.seconds.get(part, 0) for r in steps) for part in ("total", "C-S", "CG", "EVAL")}
    contacts = sim.contacts
    times = []
    for _ in range(args.rounds):
        start = time.perf_counter()
        contacts.detector.detect()
        if contacts.detector.pairs is not None:
            contacts.detector.pairs.near.forget()  # as in a step's first look
        contacts.detector.find_pairs()
        times.append(time.perf_counter() - start)
    row = {"scene": name, "vertices": sim.vertex_count, "contacts": sim.log[-1].contacts,
           "share": total["C-S"] / total["total"], "rounds": float(np.mean([r.solves for r in steps])),
           "seconds_per_second": total["total"] / (sim.time - sim.log[0].h), "detect_ms": 1e3 * float(np.median(times))}
    sim.close()
    return row


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--cells", type=int, nargs="+", default=[50, 100, 223])
    parser.add_argument("--scenes", nargs="+", default=["sphere_drape", "bunny_drape"])
    parser.add_argument("--mesh", default="", help="file for bunny_drape")
    parser.add_argument("--until", type=float, default=0.5, help="simulated seconds")
    parser.add_argument("--rounds", type=int, default=11)
    parser.add_argument("--precision", default="f64")
    parser.add_argument("--arch", default="cpu")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    print(f"{'scene':>14} {'vertices':>8} {'contacts':>8} {'C-S share':>9} {'solves':>7} {'s per s':>8} {'detect ms':>9}")
    rows, fits = [], {}
    for name in args.scenes:
        mine = []
        for cells in args.cells:
            r = measure(name, cells, args.mesh, args.until, args)
            mine.append(r)
            print(f"{name:>14} {r['vertices']:8} {r['contacts']:8} {r['share']:9.1%} {r['rounds']:7.2f} "
                  f"{r['seconds_per_second']:8.2f} {r['detect_ms']:9.2f}", flush=True)
        if len(mine) > 1:
            n, t = (np.log([r[key] for r in mine]) for key in ("vertices", "detect_ms"))
            fits[name] = float(np.polyfit(n, t, 1)[0])
            print(f"{name:>14} detection grows as n^{fits[name]:.2f}")
        rows += mine
    results.write(args.json, rows, arch=args.arch, precision=args.precision, exponents=fits)


if __name__ == "__main__":
    main()
