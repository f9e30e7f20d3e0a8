"""Filtered PCG against a dense direct solve, and its named failures."""

import numpy as np
import pytest
from conftest import FULL
from test_forces import irregular

import taichi_cloth as tc
from taichi_cloth.backend.rows import read


def build(rng, K="projected", **kwargs):
    mesh, x, v = irregular(rng)
    scene = tc.Scene(air=tc.Air(1.0, 0.2, (2, 0, 1)))
    scene.add_cloth(mesh, FULL, x, v)
    return tc.Simulation(scene, K=K, **{"cg_tol": 1e-13, **kwargs})


def random_constraints(rng, n):
    """0 to 3 directions on some vertices, any z and y."""
    out = []
    for vertex in rng.permutation(n)[: n // 2]:
        d = int(rng.integers(0, 4))
        if d:
            out.append(tc.Constraint(int(vertex), rng.normal(size=(d, 3)), rng.normal(size=3), 0.01 * rng.normal(size=3)))
    return out


def dense_system(sim, h):
    """A (3n, 3n), K (3n, 3n) and b of eq. (18) without y."""
    n = sim.vertex_count
    A = np.stack([sim.product(e.reshape(n, 3), h).ravel() for e in np.eye(3 * n)], axis=1)
    A2 = np.stack([sim.product(e.reshape(n, 3), 2 * h).ravel() for e in np.eye(3 * n)], axis=1)
    m = np.zeros(n)
    m[sim.model.user] = sim.model.mass
    M = np.diag(np.repeat(m, 3))
    K = ((M - A2) - 2 * (M - A)) / (2 * h * h)
    return A, K, sim.right_hand_side(h).ravel()


def dense_solution(sim, h, constraints):
    """By elimination in a basis of free and held directions; also the constraint force."""
    A, K, b = dense_system(sim, h)
    n3 = len(b)
    held, z = np.zeros((0, n3)), np.zeros(n3)
    for c in constraints:
        rows = np.zeros((len(c.basis), n3))
        rows[:, 3 * c.vertex: 3 * c.vertex + 3] = c.basis
        held = np.vstack([held, rows])
        z[3 * c.vertex: 3 * c.vertex + 3] = c.basis.T @ c.basis @ c.z
        b = b + h * K[:, 3 * c.vertex: 3 * c.vertex + 3] @ c.y
    free = np.linalg.svd(np.vstack([held, np.zeros((1, n3))]))[2][len(held):].T
    dv = z + free @ np.linalg.solve(free.T @ A @ free, free.T @ (b - A @ z))
    return dv.reshape(-1, 3), ((A @ dv - b) / h).reshape(-1, 3)


@pytest.mark.parametrize("K", ["projected", "gauss_newton"])
@pytest.mark.slow
def test_against_dense(rng, K):
    sim = build(rng, K)
    n, h = sim.vertex_count, 0.02
    for case in range(4):
        constraints = random_constraints(rng, n) if case else []
        dv = sim.solve(h, constraints)
        expected, force = dense_solution(sim, h, constraints)
        sim.solve(h, constraints)  # the dense products above linearized anew
        assert np.abs(dv - expected).max() < 1e-8 * np.abs(expected).max()
        assert sim.solution.iterations < 2 * 3 * n  # conjugate directions end, steepest descent does not
        assert np.abs(sim.constraint_forces() - force).max() < 1e-7 * max(np.abs(force).max(), 1e-3)
        for c in constraints:
            assert np.abs(c.basis @ (dv[c.vertex] - c.z)).max() < 1e-13 * np.linalg.norm(c.z)


@pytest.mark.parametrize("precision, rounding", [("f64", 2e-15), ("f32", 1e-6)])
@pytest.mark.slow
def test_constraints_are_exact_at_any_iteration_count(rng, precision, rounding):
    sim = build(rng, precision=precision, cg_tol=1e-30)
    constraints = random_constraints(rng, sim.vertex_count)
    for iterations in (1, 2, 5, 17):
        sim.integrator.system.solver.max_iterations = iterations
        with pytest.raises(tc.SimulationError, match="MAX_ITERATIONS"):
            sim.solve(0.02, constraints)
        assert sim.solution.iterations == iterations
        dv = sim.model.to_user(read(sim.integrator.system.solver.dv))
        for c in constraints:
            assert np.abs(c.basis @ (dv[c.vertex] - c.z)).max() < rounding * (1 + np.linalg.norm(c.z))


@pytest.mark.slow
def test_residual_history_and_tolerance(rng):
    sim = build(rng, cg_tol=1e-6)
    sim.solve(0.02, random_constraints(rng, sim.vertex_count))
    s, history = sim.solution, sim.integrator.system.solver.residual_history()
    assert s.status == "CONVERGED" and len(history) == s.iterations
    assert s.residual <= 2e-6 and history[-1] < 1e-4 * history[0]


@pytest.mark.slow
def test_indefinite_matrix_is_a_breakdown_not_an_answer(rng):
    mesh = tc.grid(1.0, 4)
    scene = tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1e4), tc.Shear(1e3)), mesh.x * 0.5 + 0.002 * rng.normal(size=mesh.x.shape))
    exact = tc.Simulation(scene, K="paper")
    with pytest.raises(tc.SimulationError, match="BREAKDOWN") as caught:
        exact.solve(1 / 60, [])
    assert caught.value.reason == "SOLVER"
    projected = tc.Simulation(scene)
    projected.solve(1 / 60, [])
    assert projected.solution.status == "CONVERGED"


def test_no_free_direction_left():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 2), FULL)
    scene.pin(cloth, np.arange(9))
    sim = tc.Simulation(scene)
    sim.step()
    assert (sim.positions() == cloth.mesh.x).all() and sim.log[-1].iterations == 0
    assert sim.constraint_forces()[:, 1].sum() == pytest.approx(0.2 * 9.81)


def test_bad_constraints(rng):
    sim = build(rng)
    for constraints, words in (([tc.Constraint(99)], "vertex 99 is not simulated"),
                               ([tc.Constraint(1), tc.Constraint(1)], "named twice")):
        with pytest.raises(tc.SceneError, match=words):
            sim.solve(0.01, constraints)
    with pytest.raises(tc.SceneError, match="needs three finite numbers"):
        tc.Constraint(0, z=(0, np.nan, 0))


@pytest.mark.slow
def test_mass_modification_gives_the_same_answer(rng):
    """[BW98 (14)]: (I - h W D - h^2 W K) dv = W b + z with W = S/m, not symmetric, by GMRES, against the filtered CG."""
    sim = build(rng)
    n, h = sim.vertex_count, 0.02
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    held = [tc.Constraint(0, z=rng.normal(size=3)), tc.Constraint(5, [normal], z=0.3 * normal)]
    dv = sim.solve(h, held)
    mass, W, z = np.zeros((n, 1)), np.zeros((n, 3, 3)), np.zeros((n, 3))
    mass[sim.model.user, 0] = sim.model.mass
    for i in range(n):
        W[i] = np.eye(3) / mass[i]
    for c in held:
        projector = c.basis.T @ c.basis
        W[c.vertex] = (np.eye(3) - projector) / mass[c.vertex]
        z[c.vertex] = projector @ c.z

    def modified(p):
        p = p.reshape(n, 3)
        return (p + np.einsum("nij,nj->ni", W, sim.product(p, h) - mass * p)).ravel()

    b = (np.einsum("nij,nj->ni", W, sim.right_hand_side(h)) + z).ravel()
    Q, H = [b / np.linalg.norm(b)], np.zeros((3 * n + 2, 3 * n + 1))
    for k in range(3 * n):  # Arnoldi
        w = modified(Q[k])
        for j, q in enumerate(Q):
            H[j, k] = q @ w
            w = w - H[j, k] * q
        H[k + 1, k] = np.linalg.norm(w)
        e = np.zeros(k + 2)
        e[0] = np.linalg.norm(b)
        y, rest, *_ = np.linalg.lstsq(H[: k + 2, : k + 1], e, rcond=None)
        if np.linalg.norm(H[: k + 2, : k + 1] @ y - e) < 1e-12 * e[0]:
            break
        Q.append(w / H[k + 1, k])
    answer = (np.array(Q[: len(y)]).T @ y).reshape(n, 3)
    assert np.abs(answer - dv).max() < 1e-8 * np.abs(dv).max()


def test_what_two_pins_hold_in_one_direction_each_stays_in_both():
    """The position that suits them all; and what is half held is preconditioned by its block on what is free."""
    scene, mesh = tc.Scene(), tc.grid(0.5, 4)
    cloth = scene.add_cloth(mesh, FULL, mesh.x + [0.7, 0.2, -0.3])
    scene.pin(cloth, [3], (1.0, 1.0, 0.0))
    scene.pin(cloth, [3], (0.0, 1.0, 1.0))
    scene.pin(cloth, [20], "y")
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", preconditioner="block_jacobi", threads=1)
    for _ in range(3):
        sim.step()
    moved = sim.positions() - cloth.positions
    assert np.abs(moved[3] @ [[1, 0], [1, 1], [0, 1]]).max() < 1e-12 and np.abs(moved[3]).max() > 1e-5
    assert abs(moved[20, 1]) < 1e-12
    blocks, inverse = (unpacked(read(a)) for a in (sim.integrator.system.operator.P,
                                                        sim.integrator.system.preconditioner.inverse))
    held = np.array([[1.0, 1, 0], [0, 1, 1]])
    free = {3: np.eye(3) - np.linalg.pinv(held) @ held, 20: np.diag([1.0, 0, 1]), 7: np.eye(3)}
    for vertex, S in free.items():
        i = sim.model.particle[vertex]
        np.testing.assert_allclose(inverse[i], np.linalg.pinv(S @ blocks[i] @ S, rcond=1e-9), rtol=1e-8, atol=1e-8)


def unpacked(rows: np.ndarray) -> np.ndarray:
    """(n, 3, 3) from (n, 6) xx xy xz yy yz zz."""
    return rows[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3)
