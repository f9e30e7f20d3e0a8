"""How often a solve launches kernels and waits for numbers: what it would cost where each goes to a device and back.

Runs scenes to where they are in contact and counts a few steps from there. Waits are as on a GPU: at a number that comes back,
at an array that is handed over, at a field that is read or written.

    python scripts/count_launches.py
    python scripts/count_launches.py --scenes "layers cells=50" --kernels 30 --json launches.json
    python scripts/count_launches.py --states out/states                                # and from the same states:
    TAICHI_CLOTH_LAYOUT=device python scripts/count_launches.py --states out/states
"""

import argparse
import pathlib
from collections import Counter

import numpy as np
import results

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.backend.counting import Counts, counted

CASES = {"hang cells=50": 0.25, "sphere_drape cells=50 itself=1": 0.5, "layers cells=24": 0.45,  # s to begin at
         "dress_up spacing=0.03": 0.6}


def simulation(text: str, **options: object) -> tc.Simulation:
    """A scene by its name and settings, run as its file says but for some options."""
    name, *settings = text.split()
    module = scenefile.read(f"scenes/{name}.py")
    plan = {key: value for key, value in module.run.items() if key not in ("duration", "fps")}
    return tc.Simulation(module.make(dict(setting.split("=") for setting in settings)), **{**plan, **options})


def measured(text: str, begin: float, steps: int, states: pathlib.Path | None) -> tuple[dict, Counter]:
    """(a row, launches by kernel) over some steps from a time [s] on.

    Args:
        states: folder with the state then, by the first who needs it; two steps from there are not counted. None: from 0 s.
    """
    sim = simulation(text)
    kept = None if states is None else states / f"{text.replace(' ', '_')}.npz"
    if kept is None or not kept.exists():
        while sim.time < begin:
            sim.step()
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            np.savez(kept, x=sim.positions(), v=sim.velocities())
    if kept is not None:
        sim.close()
        sim = simulation(text)
        with np.load(kept) as state:
            sim.set_state(state["x"], state["v"])
        for _ in range(2):
            sim.step()
    with counted() as counts:
        log = [sim.step() for _ in range(steps)]
    row = row_of(counts, log)
    seconds = float(np.mean([r.seconds["total"] for r in log]))
    row = {"scene": text, "vertices": sim.vertex_count, **row, "step_ms": 1e3 * seconds}
    sim.close()
    return row, counts.kernels


def row_of(counts: Counts, log: list) -> dict:
    """Counts for each solve of some steps."""
    solves = max(sum(r.solves for r in log), 1)
    return {"solves": solves / len(log), "iterations": sum(r.iterations for r in log) / solves,
            "launches": counts.launches / solves, "with arrays": counts.with_arrays / solves, "arrays": counts.arrays / solves,
            "numbers back": counts.returned / solves, "fields read": counts.reads / solves,
            "fields written": counts.writes / solves, "single numbers": counts.singles / solves,
            "waits": counts.waits / solves, "MB": counts.size / solves / 1e6}


def main() -> None:
    """Prints the tables, writes the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--scenes", nargs="*", default=list(CASES), help="each a name and settings in one text")
    parser.add_argument("--begin", type=float, help="s to count from")
    parser.add_argument("--steps", type=int, default=8, help="that are counted")
    parser.add_argument("--states", type=pathlib.Path, help="folder of states to count from, for layouts to be compared")
    parser.add_argument("--kernels", type=int, default=0, help="print so many kernels by launches a solve")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    rows = []
    for text in args.scenes:
        begin = CASES.get(text, 0.4) if args.begin is None else args.begin
        row, kernels = measured(text, begin, args.steps, args.states)
        rows.append(row)
        print(", ".join(f"{key} {value:.4g}" for key, value in row.items() if key != "scene"), text, sep=": ", flush=True)
        for name, count in kernels.most_common(args.kernels):
            print(f"    {count / args.steps / row['solves']:6.2f} {name}")
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
