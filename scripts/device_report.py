"""What a device makes of this package, in one run of a few minutes: where the time goes first, then steps, then answers.

Parts run one after the other, each in a process of its own, while the budget lasts; the file is written after each. In order:
how fast memory is copied; kernels by time of a free sheet and of layers; milliseconds a step of free sheets; a step of
layers from a state that the CPU made, with launches, transfers and waits a solve, and how far the CPU's positions are from
there; checks of scenes.

    python scripts/device_report.py --arch cuda --json device.json
    python scripts/device_report.py --arch cpu --small --json dry.json      # a rehearsal without a device, two minutes
"""

import argparse
import contextlib
import io
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np
import results
from bench_scaling import measure
from count_launches import row_of, simulation

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.counting import counted
from taichi_cloth.backend.language import ti

BEGIN = 0.45  # s of `layers` at which sheets lie on each other
ROWS = 30  # of a profile
SIZES = {"copied": 1024, "free": [101, 401], "layers": [50, 100],
         "scenes": ["hang", "sphere_drape", "layers", "balloon", "skirt_pleats"]}
SMALL = {"copied": 64, "free": [15], "layers": [8], "scenes": ["hang"]}
PROFILED = {**os.environ, "TI_KERNEL_PROFILER": "1"}


def sheet(cells: int, args: argparse.Namespace, arch: str) -> tc.Simulation:
    """Three sheets over a ball, as they start."""
    return simulation(f"layers cells={cells}", arch=arch, precision=args.precision)


def make_state(cells: int, args: argparse.Namespace) -> dict:
    """The CPU's state at `BEGIN`, into a file."""
    sim = sheet(cells, args, "cpu")
    while sim.time < BEGIN:
        sim.step()
    np.savez(state_file(cells, args), x=sim.positions(), v=sim.velocities())
    return {"steps": len(sim.log), "contacts": sim.log[-1].contacts, "pairs": sim.log[-1].layers}


def state_file(cells: int, args: argparse.Namespace) -> pathlib.Path:
    """Where `make_state` leaves it."""
    return pathlib.Path(args.folder) / f"layers{cells}.npz"


def step_from(sim: tc.Simulation, path: pathlib.Path, steps: int) -> list:
    """Records of steps from a state, after one that compiles."""
    with np.load(path) as state:
        for count in (1, steps):
            sim.set_state(state["x"], state["v"])
            log = [sim.step() for _ in range(count)]
    return log


def layers(cells: int, args: argparse.Namespace) -> dict:
    """Two steps of layers from the state, on the arch and on the CPU."""
    out, x = {}, {}
    for arch in dict.fromkeys((args.arch, "cpu")):
        sim = sheet(cells, args, arch)
        with counted() as counts:
            log = step_from(sim, state_file(cells, args), 2)
        x[arch] = sim.positions()
        out[f"{arch}_ms"] = 1e3 * float(np.mean([r.seconds["total"] for r in log]))
        if arch == args.arch:
            parts = ("EVAL", "CG", "C-C", "C-S")
            out |= {"vertices": sim.vertex_count, "solves": sum(r.solves for r in log), "its": sum(r.iterations for r in log)}
            out |= {f"{part}_ms": 1e3 * float(np.mean([r.seconds.get(part, 0.0) for r in log])) for part in parts}
            asked = row_of(counts, [*log, *log[:1]])  # the step that compiles is as the first
            out |= {key: asked[key] for key in ("launches", "with arrays", "fields read", "fields written", "waits", "MB")}
        sim.close()
    return {**out, "off_m": float(np.abs(x[args.arch] - x["cpu"]).max())}


def free(n: int, args: argparse.Namespace) -> dict:
    """Milliseconds a step of a hanging sheet of n x n vertices in mid-swing."""
    return measure(n, args.precision, args.arch, None, 4, 5000.0)


def bandwidth(megabytes: int, args: argparse.Namespace) -> dict:
    """Gigabytes a second that a loop reads and writes where it copies an array of so many megabytes."""
    runtime.start(args.arch, "f32")
    one, other = (ti.ndarray(ti.f32, megabytes << 18) for _ in range(2))
    times = []
    for _ in range(5):
        ti.sync()
        start = time.perf_counter()
        copy(one, other)
        ti.sync()
        times.append(time.perf_counter() - start)
    return {"gb_s": 2 * megabytes / 1024 / min(times)}


@ti.kernel
def copy(one: ti.types.ndarray(), other: ti.types.ndarray()):
    """other = one"""
    for k in range(one.shape[0]):
        other[k] = one[k]


def profile(what: str, size: int, args: argparse.Namespace) -> dict:
    """Kernels by time, of a few steps; in a process with `PROFILED`."""
    if what == "free":
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(1.0, size - 1), tc.Fabric(0.15, tc.Stretch(5000), tc.Shear(500), tc.Bend(5e-5)))
        scene.pin(cloth, ["top_left", "top_right"])
        sim = tc.Simulation(scene, arch=args.arch, precision=args.precision, integrator="backward_euler")
        for _ in range(3):
            sim.step()
    else:
        sim = sheet(size, args, args.arch)
        step_from(sim, state_file(size, args), 1)
    ti.profiler.clear_kernel_profiler_info()
    start = time.perf_counter()
    records = [sim.step() for _ in range(2)]
    wall, words = time.perf_counter() - start, io.StringIO()
    ti.sync()
    with contextlib.redirect_stdout(words):
        ti.profiler.print_kernel_profiler_info("count")
    lines = [line for line in words.getvalue().splitlines() if "%" in line]
    return {"wall_ms": 1e3 * wall, "solves": sum(r.solves for r in records), "its": sum(r.iterations for r in records),
            "kernels_ms": 1e3 * ti.profiler.get_kernel_profiler_total_time(), "kernels": lines[:ROWS]}


def check(name: str, args: argparse.Namespace) -> dict:
    """A scene's own check, small."""
    precision = "f64" if args.arch in ("cpu", "cuda") else "f32"
    command = [sys.executable, "-m", "taichi_cloth", "check", name, "--small", "--arch", args.arch, "--precision", precision]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return {"passed": done.returncode == 0, "last": (done.stdout.strip() or done.stderr.strip()).splitlines()[-1:]}


def parts(args: argparse.Namespace) -> list[tuple]:
    """(function, its values), in order."""
    sizes = SMALL if args.small else SIZES
    out: list[tuple] = [("bandwidth", sizes["copied"]), ("profile", "free", sizes["free"][0]),
                        ("make_state", sizes["layers"][0]),
                        ("profile", "layers", sizes["layers"][0])]
    out += [("free", n) for n in sizes["free"]] + [("layers", sizes["layers"][0])]
    out += [("check", name) for name in sizes["scenes"]]
    out += [part for cells in sizes["layers"][1:] for part in (("make_state", cells), ("layers", cells))]
    return out + ([("free", 1001)] if args.large else [])


def run(part: tuple, args: argparse.Namespace, seconds: float) -> dict:
    """A part's row, from a process of its own."""
    command = [sys.executable, __file__, "--arch", args.arch, "--precision", args.precision, "--folder", args.folder]
    started = time.perf_counter()
    try:
        done = subprocess.run([*command, "--one", json.dumps(part)], capture_output=True, text=True, check=False,
                              timeout=max(seconds, 1.0), env=PROFILED if part[0] == "profile" else None)
        row = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {"failed": done.stderr[-600:]}
    except subprocess.TimeoutExpired:
        row = {"failed": f"not within {seconds:.0f} s"}
    return {"part": " ".join(map(str, part)), "took_s": time.perf_counter() - started, **row}


def main() -> None:
    """Runs the parts, prints and writes rows as they come."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--arch", default="cuda")
    parser.add_argument("--precision", default="f32", help="of steps; checks run in f64 where there is one")
    parser.add_argument("--small", action="store_true", help="sizes of a rehearsal")
    parser.add_argument("--large", action="store_true", help="a free sheet of a million vertices too, last")
    parser.add_argument("--budget", type=float, default=340.0, help="s for all parts")
    parser.add_argument("--json", help="file to write")
    parser.add_argument("--folder", default="", help=argparse.SUPPRESS)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.one:
        name, *values = json.loads(args.one)
        print(json.dumps(globals()[name](*values, args)))
        return
    end, rows = time.perf_counter() + args.budget, []
    with tempfile.TemporaryDirectory() as args.folder:
        for part in parts(args):
            rows.append(run(part, args, end - time.perf_counter()))
            kernels = rows[-1].get("kernels", [])
            told = [f"{key} {value:.4g}" if isinstance(value, float) else f"{key} {value}"
                    for key, value in rows[-1].items() if key != "kernels"]
            print(", ".join(told), *kernels, sep="\n    ", flush=True)
            results.write(args.json, rows, arch=args.arch, precision=args.precision)


if __name__ == "__main__":
    main()
