"""Preconditioners against each other and against a sparse direct solve, on the system of a step in mid-swing.

Time to the tolerance includes set-up: inverting the diagonal blocks of every level, or factorising the assembled
matrix (whose assembly is given for free). Prints a table and writes JSON. Needs the extra `bench` (SciPy; with
scikit-sparse the direct solve is its Cholesky, else SuperLU).

    python scripts/bench_solver.py --sizes 51 100 224 --json solver.json
"""

import argparse
import time

import numpy as np
import results
import scipy.sparse
import scipy.sparse.linalg
from bench_product import FABRIC, assembled

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.system.operator import Probe

H = 1 / 60


def irregular(n: int, rng: np.random.Generator) -> tc.TriMesh:
    """A square metre with moved vertices, diagonals at random, a hole, and a slit from one side to the middle."""
    mesh = tc.grid(1.0, n - 1, diagonals="alternating")
    uv = mesh.uv.copy()
    inner = ((uv > 1e-9) & (uv < 1 - 1e-9)).all(axis=1)
    uv[inner] += rng.uniform(-0.25, 0.25, size=(int(inner.sum()), 2)) / (n - 1)
    centre = mesh.uv[mesh.faces].mean(axis=1)
    hole = np.linalg.norm(centre - [0.35, 0.4], axis=1) < 0.12
    faces = mesh.faces[~hole]
    slit = np.flatnonzero((np.abs(mesh.uv[:, 1] - mesh.uv[np.argmin(np.abs(mesh.uv[:, 1] - 0.7)), 1]) < 1e-9)
                          & (mesh.uv[:, 0] > 0.5 + 1e-9))
    twin = np.full(len(uv), -1)
    twin[slit] = len(uv) + np.arange(len(slit))
    above = mesh.uv[faces].mean(axis=1)[:, 1] > mesh.uv[slit[0], 1]
    faces[above] = np.where(twin[faces[above]] >= 0, twin[faces[above]], faces[above])
    uv = np.concatenate([uv, uv[slit]])
    used = np.unique(faces)
    place = np.full(len(uv), -1)
    place[used] = np.arange(len(used))
    uv = uv[used]
    return tc.TriMesh(np.column_stack([uv[:, 0], np.zeros(len(uv)), -uv[:, 1]]), place[faces], uv)


def swinging(mesh: tc.TriMesh, preconditioner: str, precision: str, arch: str) -> tc.Simulation:
    """The sheet hung by two corners, a quarter of a second after it was dropped from horizontal."""
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC)
    corners = [int(np.argmin(np.linalg.norm(mesh.uv - c, axis=1))) for c in ((0, 1), (1, 1))]
    scene.pin(cloth, corners)
    sim = tc.Simulation(scene, h=H, precision=precision, arch=arch, integrator="backward_euler", preconditioner=preconditioner)
    return sim


def direct(sim: tc.Simulation):
    """A function that factorises and solves the assembled system of the free particles, and its name."""
    sim._probe = sim._later(Probe, sim.integrator.system.operator)
    A = assembled(sim).tocsc()
    held = sim.prescribed.at(sim.time, H).index
    free = np.setdiff1d(np.arange(sim.model.n), held)
    rows = (3 * free[:, None] + np.arange(3)).ravel()
    A, b = A[rows][:, rows].tocsc(), read(sim.integrator.system.operator.b)[: sim.model.n].ravel()[rows]
    try:
        from sksparse.cholmod import cholesky

        return "Cholesky", lambda: cholesky(A)(b)
    except ImportError:
        options = {"SymmetricMode": True}
        return "SuperLU", lambda: scipy.sparse.linalg.splu(A, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options).solve(b)


def measure(kind: str, n: int, args: argparse.Namespace) -> dict:
    """One row of the table."""
    mesh = tc.grid(1.0, n - 1) if kind == "sheet" else irregular(n, np.random.default_rng(3))
    names = ["multilevel", "block_jacobi"]
    reference = swinging(mesh, "multilevel", args.precision, args.arch)
    for _ in range(15):
        reference.step()
    x, v, t = reference.positions(), reference.velocities(), reference.time
    actions, iterations = {}, {}
    sims = []
    for name in names:
        sim = swinging(mesh, name, args.precision, args.arch)
        sim.set_state(x, v)
        sim.time = t
        method = sim._linearized(H)
        held = sim.prescribed.at(t, H)

        def solve(method=method, held=held, name=name):
            solution = method.solve(1e-4, held, H)
            assert solution.status == "CONVERGED", solution
            iterations[name] = solution.iterations

        actions[name] = solve
        sims.append(sim)
    if not args.no_direct:
        direct_name, actions["direct"] = direct(sims[0])
    times: dict[str, list[float]] = {name: [] for name in actions}
    for k in range(args.rounds + 1):
        for name, action in actions.items():
            if name == "direct" and k > args.direct_rounds:
                continue
            start = time.perf_counter()
            action()
            if k:
                times[name].append(time.perf_counter() - start)
    ms = {name: 1e3 * float(np.median(t)) for name, t in times.items() if t}
    for sim in [*sims, reference]:
        sim.close()
    return {"mesh": kind, "vertices": mesh.vertex_count, "precision": args.precision, "arch": args.arch,
            "iterations": iterations, "ms": ms, "direct": "" if args.no_direct else direct_name}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[51, 100, 224], help="vertices a side")
    parser.add_argument("--meshes", nargs="+", default=["sheet", "slit"])
    parser.add_argument("--precision", default="f64")
    parser.add_argument("--arch", default="cpu")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--direct-rounds", type=int, default=2)
    parser.add_argument("--no-direct", action="store_true")
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    print(f"{'mesh':>6} {'vertices':>8} {'its block':>9} {'its multi':>9} {'fewer':>6} {'block ms':>9} {'multi ms':>9} "
          f"{'faster':>6} {'direct ms':>9} {'faster':>6}")
    rows = []
    for kind in args.meshes:
        for n in args.sizes:
            r = measure(kind, n, args)
            rows.append(r)
            its, ms = r["iterations"], r["ms"]
            direct_ms = ms.get("direct", float("nan"))
            print(f"{kind:>6} {r['vertices']:8} {its['block_jacobi']:9} {its['multilevel']:9} "
                  f"{its['block_jacobi'] / its['multilevel']:6.1f} {ms['block_jacobi']:9.1f} {ms['multilevel']:9.1f} "
                  f"{ms['block_jacobi'] / ms['multilevel']:6.1f} {direct_ms:9.1f} {direct_ms / ms['multilevel']:6.1f}",
                  flush=True)
    results.write(args.json, rows, scipy=scipy.__version__)


if __name__ == "__main__":
    main()
