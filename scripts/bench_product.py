"""Matrix-free product and CG iteration against SciPy's block CSR product of the assembled matrix, in one run.

Prints a table and writes JSON: medians over interleaved rounds, of times and of ratios. The product is that of a solve: many
in one launch; `launched` is one in a launch of its own.
Needs the extra `bench` (SciPy).

    python scripts/bench_product.py --sizes 51 100 224 --json product.json
"""

import argparse
import time

import numpy as np
import results
import scipy
import scipy.sparse

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.system.operator import Probe

H = 1 / 60
ITERATIONS = 10  # of a phase scheduler in one launch
REPEAT = 20  # products a timing: a solve makes hundreds in a row, in one launch
FABRIC = tc.Fabric(0.15, tc.Stretch(5000), tc.Shear(500), tc.Bend(5e-5))


def sheet(n: int, shuffled: bool) -> tc.Scene:
    """n x n vertices on a square metre that hangs by two corners; its vertices in order or at random."""
    mesh = tc.grid(1.0, n - 1)
    corners = mesh.select("top_left").tolist() + mesh.select("top_right").tolist()
    if shuffled:
        place = np.random.default_rng(5).permutation(mesh.vertex_count)
        x, uv = np.empty_like(mesh.x), np.empty_like(mesh.uv)
        x[place], uv[place] = mesh.x, mesh.uv
        corners = place[corners]
        mesh = tc.TriMesh(x, place[mesh.faces], uv)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.pin(cloth, corners)
    return scene


def assembled(sim: tc.Simulation) -> scipy.sparse.bsr_matrix:
    """A as 3x3 block CSR in particle order, by products with a colouring of its columns."""
    n = sim.model.n
    pattern = scipy.sparse.csr_matrix((n, n))
    for force in sim.force_terms:
        if hasattr(force, "elements"):
            e = force.elements
            vertices = read(e.vertices)[e.entries.primary]
            k = vertices.shape[1]
            pattern = pattern + scipy.sparse.csr_matrix((np.ones(len(vertices) * k * k), (
                np.repeat(vertices, k, axis=1).ravel(), np.tile(vertices, k).ravel())), shape=(n, n))
    pattern.sort_indices()
    color = greedy_coloring((pattern @ pattern).tocsr())
    values = np.zeros((pattern.nnz, 3, 3), dtype=np.float32 if sim.runtime.precision == "f32" else np.float64)
    rows = np.repeat(np.arange(n), np.diff(pattern.indptr))
    for c in range(color.max() + 1):
        mine = color[pattern.indices] == c
        for d in range(3):
            p = np.zeros((n, 3))
            p[color == c, d] = 1
            q = sim._probe.product(p.astype(sim.model.exchange))
            values[mine, :, d] = q[rows[mine]]
    return scipy.sparse.bsr_matrix((values, pattern.indices, pattern.indptr), shape=(3 * n, 3 * n))


def greedy_coloring(graph: scipy.sparse.csr_matrix) -> np.ndarray:
    """Colours so that no two neighbours share one."""
    color = np.full(graph.shape[0], -1)
    for i in range(graph.shape[0]):
        taken = set(color[graph.indices[graph.indptr[i]:graph.indptr[i + 1]]].tolist())
        color[i] = next(c for c in range(len(taken) + 1) if c not in taken)
    return color


def timings(actions: dict, prepare: dict, rounds: int, together: tuple = ()) -> dict[str, np.ndarray]:
    """Milliseconds of each action in each of the interleaved rounds, after a warm-up.

    Args:
        together: those that take a number of times, and do it all in one call.
    """
    times: dict[str, list[float]] = {name: [] for name in actions}
    for k in range(rounds + 2):
        for name, action in actions.items():
            if name in prepare:
                prepare[name]()
            time.sleep(0.01)  # the threads of whoever was before stop spinning
            once = name in together
            for _ in range(1 if once else 3):  # caches and threads as they are inside a solve
                action(3) if once else action()
            start = time.perf_counter()
            for _ in range(1 if once else REPEAT):
                action(REPEAT) if once else action()
            if k >= 2:
                times[name].append((time.perf_counter() - start) / REPEAT)
    return {name: 1e3 * np.array(t) for name, t in times.items()}


def measure(n: int, precision: str, arch: str, rounds: int) -> dict:
    """One row of the table."""
    actions, prepare, check = {}, {}, 0.0
    keep = []
    for shuffled in (False, True):
        sim = tc.Simulation(sheet(n, shuffled), precision=precision, arch=arch, integrator="backward_euler",
                            preconditioner="block_jacobi")
        for _ in range(3):
            sim.step()
        p = np.random.default_rng(11).normal(size=(sim.vertex_count, 3))
        sim.product(p, H)
        probe: Probe = sim._probe
        keep.append(sim)
        actions["shuffled" if shuffled else "product"] = probe.apply
        if not shuffled:
            actions["launched"] = lambda probe=probe: probe.apply(1)
            A = assembled(sim)
            q = sim.product(p, H)
            flat = np.ascontiguousarray(p[sim.model.user].ravel().astype(A.dtype))
            check = float(np.abs((A @ flat).reshape(-1, 3) - q[sim.model.user]).max() / np.abs(q).max())
            actions["scipy"] = lambda A=A, flat=flat: A @ flat
            solver = sim.integrator.system.solver
            # from Delta v = 0 every time: iterations beyond convergence would be on denormal numbers
            if not solver.together:
                prepare["cg"] = lambda solver=solver: solver._residual(1)
                actions["cg"] = lambda solver=solver: solver._step(0.0, 1)
            else:
                actions["cg"] = lambda solver=solver: solver._together(0.0, 0.0, 0.0, 1, ITERATIONS)
    ms = timings(actions, prepare, rounds, ("product", "shuffled"))
    if solver.together:
        ms["cg"] /= ITERATIONS + 2  # with the residuals before and after

    def ratio(a: str, b: str) -> float:
        """Median over rounds, so that a machine that is busy for a while slows both sides alike."""
        return float(np.median(ms[a] / ms[b]))

    for sim in keep:
        sim.close()
    return {"vertices": n * n, "precision": precision, "arch": arch, "threads": keep[0].runtime.threads, "mismatch": check,
            **{f"{name}_ms": float(np.median(t)) for name, t in ms.items()},
            **{f"{a}/{b}": ratio(a, b) for a, b in (("scipy", "product"), ("cg", "product"), ("shuffled", "product"))}}


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--sizes", type=int, nargs="+", default=[51, 100, 224], help="vertices a side")
    parser.add_argument("--precision", nargs="+", default=["f32", "f64"])
    parser.add_argument("--arch", default="cpu")
    parser.add_argument("--rounds", type=int, default=41)
    parser.add_argument("--json", help="file to write")
    args = parser.parse_args()
    print(f"{'vertices':>8} {'prec':>4} {'product':>9} {'launched':>9} {'SciPy BSR':>9} {'CG iter':>9} "
          f"{'SciPy/prod':>10} {'CG/prod':>8} {'shuffled/prod':>13}   (median ms)")
    rows = []
    for precision in args.precision:
        for n in args.sizes:
            r = measure(n, precision, args.arch, args.rounds)
            rows.append(r)
            print(f"{r['vertices']:8} {precision:>4} {r['product_ms']:9.3f} {r['launched_ms']:9.3f} "
                  f"{r['scipy_ms']:9.3f} {r['cg_ms']:9.3f} "
                  f"{r['scipy/product']:10.2f} {r['cg/product']:8.2f} {r['shuffled/product']:13.2f}", flush=True)
    results.write(args.json, rows, scipy=scipy.__version__)


if __name__ == "__main__":
    main()
