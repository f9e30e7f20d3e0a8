"""The product of a step's matrix against a scalar C++ OpenMP one of the same algorithm, in one run.

Compiles scripts/baselines/product.cpp with g++ -O3 -march=native. Prints a table and writes JSON: many products a call on
both sides, as a solve makes them, and the ratio where each is a call (and, of Taichi, a launch) of its own.

    python scripts/bench_baseline.py --sizes 100 224 --json baseline.json
"""

import argparse
import ctypes
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np
import results
from bench_product import REPEAT, sheet, timings

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.forces.bend import Bend
from taichi_cloth.forces.membrane import Membrane

H = 1 / 60
SOURCE = pathlib.Path(__file__).parent / "baselines" / "product.cpp"


def compiled(real: str, folder: str) -> ctypes.CDLL:
    """The baseline as a library, for float or double."""
    out = pathlib.Path(folder) / f"product_{real}.so"
    flags = ["-O3", "-march=native", "-fopenmp", "-shared", "-fPIC", f"-DREAL={real}"]
    subprocess.run(["g++", *flags, str(SOURCE), "-o", str(out)], check=True)
    library = ctypes.CDLL(str(out))
    library.product.restype = ctypes.c_double
    return library


def measure(n: int, precision: str, rounds: int, folder: str) -> dict:
    """One row of the table."""
    sim = tc.Simulation(sheet(n, False), precision=precision, integrator="backward_euler", preconditioner="block_jacobi")
    for _ in range(3):
        sim.step()
    p = np.random.default_rng(11).normal(size=(sim.vertex_count, 3))
    wanted = sim.product(p, H)
    dtype = np.float32 if precision == "f32" else np.float64
    model = sim.model
    membrane, bend = (next(f for f in sim.force_terms if isinstance(f, kind)) for kind in (Membrane, Bend))
    arrays = [model.blocks.bounds.astype(np.int32), model.mass.astype(dtype)]
    for force, values in ((membrane, membrane.A), (bend, bend.g)):
        arrays += [force.elements.entries.first.astype(np.int32), force.elements.host_vertices.astype(np.int32),
                   read(values)[: force.elements.count].astype(dtype)]
    x = p[model.user].astype(dtype)
    q = np.empty_like(x)
    arrays = [np.ascontiguousarray(a) for a in [*arrays, x]]
    library = compiled("float" if precision == "f32" else "double", folder)

    def baseline(repeat: int = 1) -> float:
        pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in [*arrays, q]]
        return library.product(ctypes.c_int32(model.blocks.count), *pointers, ctypes.c_int32(repeat))

    baseline()
    mismatch = float(np.abs(q - wanted[model.user]).max() / np.abs(wanted).max())
    probe = sim._probe
    ms = timings({"taichi": probe.apply, "c++": baseline, "launched": lambda: probe.apply(1), "called": baseline}, {}, rounds,
                 ("taichi", "c++"))
    sim.close()
    return {"vertices": n * n, "precision": precision, "arch": "cpu", "threads": sim.runtime.threads, "mismatch": mismatch,
            "taichi_ms": float(np.median(ms["taichi"])), "c++_ms": float(np.median(ms["c++"])),
            "taichi/c++": float(np.median(ms["taichi"] / ms["c++"])),
            "launched/called": float(np.median(ms["launched"] / ms["called"]))}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[100, 224], help="vertices a side")
    parser.add_argument("--precision", nargs="+", default=["f32", "f64"])
    parser.add_argument("--rounds", type=int, default=31)
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    if shutil.which("g++") is None:
        sys.exit("bench_baseline needs g++")
    rows = []
    print(f"{'vertices':>8} {'prec':>4} {'taichi':>8} {'C++':>8} {'ratio':>6} {'one a call':>10} {'mismatch':>9}   "
          f"(median ms of {REPEAT})")
    with tempfile.TemporaryDirectory() as folder:
        for precision in args.precision:
            for n in args.sizes:
                r = measure(n, precision, args.rounds, folder)
                rows.append(r)
                print(f"{r['vertices']:8} {precision:>4} {r['taichi_ms']:8.3f} {r['c++_ms']:8.3f} {r['taichi/c++']:6.2f} "
                      f"{r['launched/called']:10.2f} {r['mismatch']:9.1e}", flush=True)
    results.write(args.json, rows)


if __name__ == "__main__":
    main()
