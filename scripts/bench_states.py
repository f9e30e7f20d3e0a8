"""What steps cost from the same states, by one version of the package or another: runs part, since contact is chaotic.

`save` runs a scene and keeps its state at some frames; `time` takes from each of them one step of 1/60 s that is not counted,
and two that are. To compare versions, time the same file by each, one after the other.

    python scripts/bench_states.py save layers --set cells=100 --frames 14 18 22 26 --file states.npz
    python scripts/bench_states.py time states.npz
"""

import argparse
import time

import numpy as np
import results

import taichi_cloth as tc
from taichi_cloth.app import scenefile

FPS = 60
PARTS = {"C-S": "solids", "C-C": "layers", "CG": "CG", "EVAL": "forces"}


def simulation(name: str, settings: list[str], threads: int | None) -> tc.Simulation:
    """The scene of a file in scenes/, run as it says."""
    module = scenefile.read(f"scenes/{name}.py")
    plan = {key: value for key, value in module.run.items() if key not in ("duration", "fps")}
    return tc.Simulation(module.make(dict(text.split("=") for text in settings)), threads=threads, **plan)


def save(args: argparse.Namespace) -> None:
    """Runs the scene to the last of the frames."""
    sim, out = simulation(args.scene, args.set, args.threads), {}

    def keep(sim: tc.Simulation, frame: int) -> None:
        if frame in args.frames:
            out[f"x{frame}"], out[f"v{frame}"] = sim.positions(), sim.velocities()

    sim.run(max(args.frames) / FPS, FPS, keep)
    np.savez(args.file, scene=args.scene, settings=np.array(args.set, dtype=str), frames=np.array(args.frames), **out)


def measure(args: argparse.Namespace) -> list[dict]:
    """A row for each state, and one of their sums."""
    rows = []
    with np.load(args.file) as states:
        sim = simulation(str(states["scene"]), states["settings"].tolist(), args.threads)
        sim.step(1 / FPS)  # compiles
        for frame in states["frames"].tolist():
            sim.set_state(states[f"x{frame}"], states[f"v{frame}"])
            sim.step(1 / FPS)
            first, start = len(sim.log), time.perf_counter()
            for _ in range(2):
                sim.step(1 / FPS)
            row, log = {"wall": time.perf_counter() - start}, sim.log[first:]
            row |= {"steps": len(log), "solves": sum(r.solves for r in log), "iterations": sum(r.iterations for r in log)}
            rows.append(row | {word: sum(r.seconds.get(part, 0.0) for r in log) for part, word in PARTS.items()})
        rows = [{"frame": k, **row} for k, row in zip(states["frames"].tolist(), rows)]
    rows.append({"frame": "all", **{key: sum(row[key] for row in rows) for key in rows[0] if key != "frame"}})
    sim.close()
    return rows


def main() -> None:
    """Keeps states, or prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--threads", type=int)
    commands = parser.add_subparsers(dest="command", required=True)
    saves = commands.add_parser("save")
    saves.add_argument("scene")
    saves.add_argument("--set", nargs="*", default=[], help="NAME=VALUE of the scene")
    saves.add_argument("--frames", type=int, nargs="+", required=True, help=f"{FPS} a second")
    saves.add_argument("--file", required=True)
    times = commands.add_parser("time")
    times.add_argument("file")
    times.add_argument("--json", help="file to write")
    args = parser.parse_args()
    if args.command == "save":
        save(args)
        return
    rows = measure(args)
    print(" ".join(f"{key:>10}" for key in rows[0]))
    for row in rows:
        print(" ".join(f"{v:>10.2f}" if isinstance(v, float) else f"{v:>10}" for v in row.values()))
    results.write(args.json, rows, file=args.file)


if __name__ == "__main__":
    main()
