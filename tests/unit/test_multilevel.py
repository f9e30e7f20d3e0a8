"""The multilevel preconditioner: positive definite on any mesh, the same answers, far fewer iterations."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.rows import read, write
from taichi_cloth.solver import multilevel
from taichi_cloth.solver.coarse import Drift
from taichi_cloth.solver.lattice import levels, squares
from taichi_cloth.solver.multilevel import COUNTS, FADE
from taichi_cloth.system.held import Held
from taichi_cloth.system.operator import Probe

FABRIC = tc.Fabric(0.15, tc.Stretch(5000), tc.Shear(500), tc.Bend(5e-5))


def slit(cells: int = 10) -> tc.TriMesh:
    """A sheet with a hole, and cut half through."""
    mesh = tc.grid(1.0, cells)
    centre = mesh.uv[mesh.faces].mean(axis=1)
    hole = np.linalg.norm(centre - [0.3, 0.3], axis=1) < 0.12
    cut = (np.abs(centre[:, 1] - 0.75) < 0.5 / cells) & (centre[:, 0] > 0.5)
    return tc.TriMesh(mesh.x, mesh.faces[~hole & ~cut], mesh.uv)


MESHES = {"sheet": [tc.grid(1.0, 9)], "hole and slit": [slit()], "two pieces": [tc.grid(0.5, 5), tc.disk(0.3, 4)],
          "tube": [tc.cylinder(0.2, 0.5, (12, 5))], "one triangle": [tc.TriMesh(np.eye(3), [[0, 1, 2]])],
          "slivers": [tc.grid((1.0, 0.02), (8, 4))]}


def simulation(meshes, **kwargs) -> tc.Simulation:
    scene = tc.Scene()
    for k, mesh in enumerate(meshes):
        cloth = scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0, k, 0])
        scene.pin(cloth, [int(mesh.faces[0, 0])])
        if mesh.vertex_count > 3:
            scene.pin(cloth, [int(mesh.faces[-1, 2])], "xz")
    return tc.Simulation(scene, h=1 / 60, **{"preconditioner": "multilevel", **kwargs})


@pytest.mark.parametrize("name, layout", [*((name, "cpu") for name in MESHES), ("hole and slit", "device"),
                                          ("one triangle", "device")])  # which shares no kernel: each compiles all of them
@pytest.mark.slow
def test_it_is_symmetric_and_positive_on_what_is_free(monkeypatch, name, layout):
    monkeypatch.setenv(runtime.LAYOUT, layout)
    sim = simulation(MESHES[name])
    sim.solve(1 / 60)
    solver, n = sim.integrator.system.solver, sim.model.n
    P = np.empty((3 * n, 3 * n))
    for k, e in enumerate(np.eye(3 * n)):  # s = P^-1 S (b - A 0)
        write(sim.integrator.system.operator.b, e.reshape(n, 3))
        solver.solve(1e30, zero=True)
        P[:, k] = read(solver.s)[:n].ravel()
    assert np.abs(P - P.T).max() <= 1e-12 * np.abs(P).max()
    values = np.linalg.eigvalsh((P + P.T) / 2)
    held = 3 + 2 if n > 3 else 3
    zero = np.sum(np.abs(values) < 1e-12 * values.max())
    assert zero == held * len(MESHES[name]) and values.min() > -1e-12 * values.max()


@pytest.mark.parametrize("name", ["sheet", "hole and slit", "two pieces", "tube"])
@pytest.mark.slow
def test_same_answer_with_all_preconditioners(name):
    answers = []
    for preconditioner in ("multilevel", "block_jacobi") if name != "tube" else ("jacobi", "none"):
        sim = simulation(MESHES[name], preconditioner=preconditioner, cg_tol=1e-12)
        for _ in range(3):
            sim.step()
        answers.append(sim.solve(1 / 60))
    assert np.abs(answers[0] - answers[1]).max() < 1e-8 * np.abs(answers[1]).max()


@pytest.mark.parametrize("mesh", [tc.grid(1.0, 40), slit(40)], ids=["sheet", "hole and slit"])
@pytest.mark.slow
def test_iterations(mesh):
    count = {}
    for preconditioner in ("multilevel", "block_jacobi"):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, FABRIC)
        scene.pin(cloth, np.unique(mesh.faces)[[0, 40]])
        sim = tc.Simulation(scene, h=1 / 60, cg_tol=1e-4, preconditioner=preconditioner)
        for _ in range(8):
            sim.step()
        count[preconditioner] = sim.log[-1].iterations / sim.log[-1].solves
    assert count["multilevel"] < 110 and count["block_jacobi"] > 3 * count["multilevel"], count


@pytest.mark.restarts
@pytest.mark.parametrize("n", [46, 67, 74])
@pytest.mark.slow
def test_in_f32_at_sizes_whose_spacing_is_no_binary_number(n):
    """Hats that meet a point by a rounding only once had blocks whose determinant was none in f32."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, n), FABRIC)
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    sim = tc.Simulation(scene, h=1 / 60, precision="f32", cg_tol=1e-4)
    assert sim.step().rejections == {} and np.isfinite(read(sim.integrator.system.preconditioner.inverse_l)).all()
    sim.close()


@pytest.mark.restarts
@pytest.mark.slow
def test_threads_agree():
    answers = []
    for threads in (2, 1):
        sim = simulation(MESHES["sheet"], cg_tol=1e-12, threads=threads, integrator="backward_euler")
        for _ in range(3):
            sim.step()
        assert sim.model.blocks.count == threads
        answers.append(sim.positions())
        sim.close()
    assert np.abs(answers[0] - answers[1]).max() < 1e-10


@pytest.mark.slow
def test_levels_that_last_are_made_anew_when_they_have_aged(monkeypatch):
    monkeypatch.setattr(multilevel, "WORTH", 500)
    sim = simulation(MESHES["sheet"], integrator="backward_euler")
    levels, made = sim.integrator.system.preconditioner, []
    build = levels._make_levels
    levels._make_levels = lambda span, anew: (made.extend(anew * [len(sim.log)]), build(span, anew))
    h = 1 / 60
    for excess, step, anew in ((0, h, True), (0, h, False), (1000, h, True), (0, h, False), (0, h / 2, True)):
        levels.age.excess, levels.age.wait = excess, 0  # the last one has another matrix
        before = len(made)
        sim.step(step)
        assert len(made) == before + anew
    levels.age.excess, levels.age.kept, levels.age.wait = 1000, 1, 0
    before = len(made)
    for _ in range(3):
        sim.step(h / 2)
        levels.age.excess = 0
    assert len(made) >= before + 2 and levels.age.pause > 0  # they did not last: not tried again at once


def test_a_lasting_rise_of_iterations_is_told_from_what_comes_and_goes(rng):
    """Solves of 60 +- 20 iterations stay 60 +- 20 for 200 solves; then they are 20 more, which is noticed in 60."""
    drift, late = Drift(), 0
    for noise in 20 * rng.permutation(np.tile([-1.0, 1.0], 100)):
        drift.count_iterations(60 + noise)
        late = max(late, drift.excess)
    assert drift.solves == 200 and late < 300, late
    for noise in 20 * rng.permutation(np.tile([-1.0, 1.0], 30)):
        drift.count_iterations(80 + noise)
    assert drift.excess > 600, drift.excess
    drift.begin()
    assert drift.solves == 0 and drift.age == 260 and drift.excess > 600


@pytest.mark.parametrize("integrator", ["backward_euler", "newton_euler"])
@pytest.mark.slow
def test_a_run_goes_on_with_the_levels_that_it_had(integrator):
    """Bit for bit: levels that were made a few steps ago are part of what a checkpoint has."""
    def mid_fall():
        return simulation([tc.grid(1.0, 9)], integrator=integrator, threads=1)

    sim = mid_fall()
    for _ in range(8):
        sim.step()
    assert sim.integrator.system.preconditioner.age.kept > 0
    state, went = sim.checkpoint(), []
    for _ in range(4):
        sim.step()
        went.append((sim.positions(), sim.velocities()))
    sim.close()
    resumed = mid_fall()
    resumed.resume(state)
    for x, v in went:
        resumed.step()
        assert (resumed.positions() == x).all() and (resumed.velocities() == v).all()
    resumed.close()


@pytest.mark.slow
def test_levels_in_contact():
    """What contact adds to the matrix changes from solve to solve, and is in levels that last; where it holds many others than
    when they were made, they do not."""
    mesh, scene = tc.grid(0.5, 7), tc.Scene()
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0, 0.006, 0])
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.005)
    sim = tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", integrator="backward_euler")
    levels, summed, inverted = sim.integrator.system.preconditioner, [], []
    make = levels._make_levels
    levels._make_levels = lambda span, anew: (summed.extend(anew * [len(sim.log)]), inverted.append(len(sim.log)),
                                              make(span, anew))
    while not sim.log or sim.log[-1].contacts < 64:
        sim.step()
    landed = len(sim.log)
    assert landed - 1 in summed
    for _ in range(4):
        sim.step()
    assert summed.count(landed) <= 1 and not any(step > landed for step in summed)
    assert len(inverted) == sum(r.solves for r in sim.log) >= 4


def test_levels_do_not_last_where_much_of_what_was_held_comes_free():
    """At most a tenth of it, and 2 % of all."""
    mesh, scene = tc.grid(1.0, 24), tc.Scene()
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0, 0.1, 0])
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.005)
    with tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", integrator="backward_euler") as sim:
        sim.step()
        levels, summed = sim.integrator.system.preconditioner, []
        make = levels._make_levels
        levels._make_levels = lambda span, anew: (summed.extend(anew * [1]), make(span, anew))

        def anew(first: int, held: range) -> bool:
            """Whether levels made with the first few particles held are not used with others."""
            for some in (range(first), held):
                summed.clear()
                k = len(some)
                if some is not held:
                    levels.forget()
                levels.make(1 / 60, Held.of(some, np.tile(np.eye(3), (k, 1, 1)), np.zeros((k, 3)), False, np.zeros((k, 3)),
                                            sim.model.exchange), reuse_levels=True)
            return len(summed) == 1

        assert sim.model.n * 0.02 > 10
        assert not anew(40, range(40)) and not anew(40, range(4, 40)) and not anew(40, range(44))
        assert anew(40, range(5, 40)) and anew(40, range(45))
        assert not anew(200, range(10, 200)) and anew(200, range(15, 200))


def test_held_patches_of_fine_meshes(rng):
    """Hats end at a patch that a solid holds, and bend the cloth there: 82 iterations, 123 if nodes. blocks lack it."""
    cells = 48
    mesh, scene = tc.grid(1.0, cells), tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(7e4), tc.Shear(7e3), tc.Bend(0.1)), positions=mesh.x + [0, 1, 0])
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.005)
    with tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", integrator="backward_euler") as sim:
        sim.step()
        system, x = sim.integrator.system, read(sim.model.x)[:sim.model.n]
        some = np.flatnonzero(np.linalg.norm((x - x.mean(axis=0))[:, [0, 2]], axis=1) < 8.5 / cells)
        k = len(some)
        write(system.operator.b, rng.normal(size=((cells + 1) ** 2, 3)))
        system.preconditioner.forget()
        held = Held.of(some, np.tile(np.diag([0.0, 1, 0]), (k, 1, 1)), np.zeros((k, 3)), False, np.zeros((k, 3)),
                       sim.model.exchange)
        assert system.solve(1e-3, held).status == "CONVERGED" and system.preconditioner.age.cost < 100


def test_hats_add_up_and_nest(rng):
    """Every level's hats sum to 1 at every particle, and reproduce linear functions of the material."""
    points = rng.uniform(size=(200, 2))
    links = np.stack([np.arange(199), np.arange(1, 200)], axis=1)
    near = np.argwhere(np.linalg.norm(points[:, None] - points[None], axis=2) < 0.2)
    made = levels(points, np.zeros(200, dtype=np.int64), 0.03, np.concatenate([links, near]))
    assert len(made) >= 3 and made[-1].count <= 40
    for level in made:
        assert np.allclose(level.weight.sum(axis=1), 1)
        used = np.zeros(level.count)
        np.add.at(used, level.node.ravel(), level.weight.ravel())
        assert (used > 0).all()


def test_a_slit_parts_hats():
    """Two strips side by side, closer than a lattice is wide, that are joined at one end only."""
    y, x = np.meshgrid([0.0, 0.01], np.linspace(0, 1, 41), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    along = np.concatenate([np.stack([np.arange(40), np.arange(1, 41)], axis=1) + k for k in (0, 41)])
    joined = np.concatenate([along, [[0, 41]]])
    zeros = np.zeros(82, dtype=np.int64)
    for level in levels(points, zeros, 0.025, joined):
        for node in range(level.count):
            members = np.flatnonzero(((level.node == node) & (level.weight > 0)).any(axis=1))
            assert members.max() < 41 or members.min() > 40 or {0, 41} <= set(members.tolist())
    closed = levels(points, zeros, 0.025, np.concatenate([along, np.stack([np.arange(41), np.arange(41, 82)], axis=1)]))
    assert closed[0].count < levels(points, zeros, 0.025, joined)[0].count


def test_what_auto_takes():
    small, large = tc.Scene(), tc.Scene()
    small.add_cloth(tc.grid(1.0, 5), FABRIC)
    large.add_cloth(tc.grid(1.0, 30), FABRIC)
    for scene, K, wanted in ((small, "projected", "Pointwise"), (large, "projected", "Multilevel"),
                             (large, "paper", "Pointwise")):
        assert type(tc.Simulation(scene, K=K).integrator.system.preconditioner).__name__ == wanted
    with pytest.raises(tc.SceneError, match="multilevel"):
        tc.Simulation(small, preconditioner="multilvl")


@pytest.mark.slow
def test_levels_have_the_diagonal_of_what_is_free():
    """D_l is the block diagonal of (S Q_l)^T A S Q_l, particles held by pins and by contacts taken into account, hinges
    apart; see the next test for them. To these come the blocks of held particles in the directions that are held."""
    mesh = tc.grid(0.5, 7)
    scene = tc.Scene()
    scene.add_cloth(mesh, replace(FABRIC, bend=tc.Bend(1e-2)), velocities=(0.5, 0, 0),
                    positions=mesh.x + np.outer(mesh.x[:, 0] + mesh.x[:, 2], [0, 0.1, 0]) + [0, 0.06, 0])
    scene.add_solid(tc.Plane((0.3, 1, 0)), friction=0.1, thickness=0.005)
    scene.pin(scene.cloths[0], [0])
    sim = tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", cg_tol=1e-8, contact_tol=None)
    for _ in range(9):
        sim.step()
    method, n = sim.integrator.system, sim.model.n
    method.preconditioner._make_levels(1 / 60, 1)
    levels, jacobi = method.preconditioner, method.preconditioner.jacobi
    probe = sim._later(Probe, method.operator)
    A = np.array([probe.product(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
    next(f for f in levels.forces if f.multirate).g.fill(0)
    bend = A - np.array([probe.product(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
    assert np.abs(bend).max() > 1e-3 * np.abs(A).max()
    held, packed = read(jacobi.is_held)[:n], read(jacobi.S)[:n]
    S = np.zeros((3 * n, 3 * n))
    for i in range(n):
        xx, xy, xz, yy, yz, zz = packed[i]
        S[3 * i:3 * i + 3, 3 * i:3 * i + 3] = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]] if held[i] else np.eye(3)
    traces = [np.trace(S[3 * i:3 * i + 3, 3 * i:3 * i + 3]) for i in range(n)]
    assert any(1.5 < t < 2.5 for t in traces) and any(t < 0.5 for t in traces)
    inverse, rows, first = read(levels.inverse_l), read(levels.hats.row), levels.hats.start
    nodes, weights = read(levels.hats.node), read(levels.hats.weight)
    bent = read(next(f for f in levels.forces if f.multirate).bent)
    whole = np.zeros_like(A)
    for i in range(n):
        own = slice(3 * i, 3 * i + 3)
        whole[own, own] = (np.eye(3) - S[own, own]) @ A[own, own] @ (np.eye(3) - S[own, own])
    for level, (start, end) in enumerate(zip(first, first[1:])):
        assert (rows[start:end] == level * n).all()
        here = slice(level * n, (level + 1) * n)
        Q = np.zeros((n, first[-1]))
        np.add.at(Q, (np.repeat(np.arange(n), levels.hats.width), nodes[here].ravel()), weights[here].ravel())
        assert np.allclose(Q.sum(axis=1), 1) and not Q[:, :start].any() and not Q[:, end:].any()
        for k in range(start, end):
            hat = np.kron(Q[:, k:k + 1], np.eye(3))
            D = (S @ hat).T @ (A - bend) @ S @ hat + hat.T @ whole @ hat + bent[k] @ [1 / 60**2, 1 / 60] * np.eye(3)
            if np.trace(D) > 1e-12:
                xx, xy, xz, yy, yz, zz = inverse[k]
                mine = COUNTS * FADE**level * np.linalg.inv([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
                assert np.abs(mine - D).max() < 1e-5 * np.abs(D).max()


@pytest.mark.parametrize("which", ["within a cell", "across cells", "all", "none"])
def test_squares_of_sums_of_hats_are_those_of_the_dense_matrix(rng, which):
    mesh = tc.grid(1.0, 8)
    points, zeros = mesh.uv, np.zeros(mesh.vertex_count, dtype=np.int64)
    corners = mesh.faces[:, [0, 1, 2, 0]]
    weights, factor = rng.normal(size=corners.shape), rng.uniform(size=(len(corners), 2))
    for level in levels(points, zeros, 1 / 8, mesh.faces[:, :2]):
        Q = np.zeros((mesh.vertex_count, level.count))
        np.add.at(Q, (np.repeat(zeros + np.arange(len(zeros)), level.node.shape[1]), level.node.ravel()), level.weight.ravel())
        same = (level.node[corners] == level.node[corners[:, :1]]).all(axis=(1, 2))
        rows = np.flatnonzero({"within a cell": same, "across cells": ~same, "all": same | True, "none": same & False}[which])
        wanted = (np.einsum("mk,mkn->mn", weights, Q[corners]) ** 2)[rows].T @ factor[rows]
        np.testing.assert_allclose(squares(level, corners[rows], weights[rows], factor[rows]), wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.slow
def test_levels_have_the_trace_of_hinges_in_flat_cloth(rng):
    """`bent` of a node is the trace of Q_l^T A_bend Q_l of the flat sheet, whatever the mesh and its state now."""
    sheet = slit(6)
    inner = np.ones((sheet.vertex_count, 1))
    uv = sheet.uv + inner * rng.uniform(-0.03, 0.03, sheet.uv.shape)
    flat = np.column_stack([uv[:, 0], np.zeros(len(uv)), uv[:, 1]])
    fabric, h = replace(FABRIC, bend=tc.Bend((1e-2, 3e-2), k_d=(1e-3, 2e-3))), 1 / 60
    built = []
    for x in (flat, rng.uniform(-0.5, 0.5, flat.shape)):
        scene = tc.Scene()
        scene.add_cloth(tc.TriMesh(flat, sheet.faces, uv), fabric, positions=x)
        sim = tc.Simulation(scene, h=h, preconditioner="multilevel")
        method, n = sim._linearized(h), sim.model.n
        levels_, hats = method.preconditioner, method.preconditioner.hats
        built.append(read(next(f for f in levels_.forces if f.multirate).bent)[:hats.start[-1]])
        if x is flat:
            probe = sim._later(Probe, method.operator)
            A = np.array([probe.product(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
            next(f for f in levels_.forces if f.multirate).g.fill(0)
            bend = A - np.array([probe.product(e.reshape(n, 3)).ravel() for e in np.eye(3 * n)])
            nodes, weights, width = read(hats.node), read(hats.weight), hats.width
            for level in range(len(hats.start) - 1):
                here = slice(level * n, (level + 1) * n)
                Q = np.zeros((n, hats.start[-1]))
                np.add.at(Q, (np.repeat(np.arange(n), width), nodes[here].ravel()), weights[here].ravel())
                for k in range(hats.start[level], hats.start[level + 1]):
                    free = np.kron(Q[:, k:k + 1], np.eye(3))
                    wanted = np.trace(free.T @ bend @ free)
                    assert wanted > 0 and abs(built[0][k] @ [h * h, h] - wanted) < 1e-9 * wanted
        sim.close()
    assert np.array_equal(*built)
