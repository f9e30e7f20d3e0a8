"""Seams: sewn cloth is as cloth that was never cut; what seams carry, how they bend, gather and close."""

import re
import warnings

import numpy as np
import pytest
from reference.geometry import against_solids, cloth_crossings

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.recording import record

FABRIC = tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100, 0.1), tc.Bend(1e-4, 1e-6))


def cut(mesh: tc.TriMesh, at: float, axis: int = 0):
    """The mesh cut along a line of its pattern: (mesh, row, row beyond the cut, vertex of the whole mesh of each)."""
    beyond = mesh.uv[mesh.faces].mean(axis=1)[:, axis] > at
    row = np.flatnonzero(np.abs(mesh.uv[:, axis] - at) < 1e-9)
    row = row[np.argsort(mesh.uv[row, 1 - axis])]
    n = mesh.vertex_count
    of, new = np.concatenate([np.arange(n), row]), np.arange(n)
    new[row] = n + np.arange(len(row))
    faces = np.where(beyond[:, None], new[mesh.faces], mesh.faces)
    return tc.TriMesh(mesh.x[of], faces, mesh.uv[of]), row, n + np.arange(len(row)), of


def side_of(mesh: tc.TriMesh, vertex: int) -> np.ndarray:
    """(n,) whether a vertex hangs together with the given one."""
    label = np.arange(mesh.vertex_count)
    for _ in range(mesh.vertex_count):
        low = label[mesh.faces].min(axis=1)
        before = label.copy()
        for k in range(3):
            np.minimum.at(label, mesh.faces[:, k], low)
        if (label == before).all():
            break
    return label == label[vertex]


@pytest.mark.parametrize("integrator", ["backward_euler", "safe", "newton_euler"])
@pytest.mark.parametrize("preconditioner", ["block_jacobi", "multilevel"])
@pytest.mark.slow
def test_cut_and_sewn_again(integrator, preconditioner):
    whole = tc.grid(1.0, 12)
    parts, a, b, of = cut(whole, 0.5)
    ends = []
    for mesh in (whole, parts):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, FABRIC, positions=mesh.x * [1.02, 1, 1])  # stretched over the cut from the start
        scene.pin(cloth, [0, 12])
        if mesh is parts:
            scene.sew(cloth, a, b)
        sim = tc.Simulation(scene, h=1 / 100, integrator=integrator, preconditioner=preconditioner, cg_tol=1e-9)
        sim.run(0.5, fps=20)
        ends.append((sim.positions(), sim.velocities()))
        sim.close()
    (x, v), (sewn, sewn_v) = ends
    assert np.abs(sewn - x[of]).max() < 1e-8 and np.abs(sewn_v - v[of]).max() < 1e-6
    assert (sewn[a] == sewn[b]).all() and (sewn_v[a] == sewn_v[b]).all()
    assert np.abs(x - whole.x).max() > 0.3


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_three_layers_on_one_edge_stay_together(precision):
    """A pleat: three strips on one row, the middle one sewn to both."""
    strip, n = tc.grid((0.4, 0.1), (8, 2)), 27
    x = np.concatenate([strip.x + [0, y, 0] for y in (0.0, 0.0, 0.0)])
    mesh = tc.TriMesh(x, np.concatenate([strip.faces + k * n for k in range(3)]), np.tile(strip.uv, (3, 1)))
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC)
    row = np.arange(9)
    scene.sew(cloth, row, row + n)
    scene.sew(cloth, row + n, row + 2 * n)
    scene.pin(cloth, 0)
    scene.pin(cloth, 2 * n + 8)
    sim, kind = tc.Simulation(scene, h=1 / 60, precision=precision), {"f32": np.float32, "f64": float}[precision]
    for _ in range(20):
        sim.step()
        x, v = sim.positions(), sim.velocities()
        assert (x[row] == x[row + n]).all() and (x[row] == x[row + 2 * n]).all() and (v[row] == v[row + 2 * n]).all()
        f = sim.seam_forces().reshape(3, n, 3)
        assert np.abs(f.sum(axis=0)).max() < (1e-9 if precision == "f64" else 1e-3) < np.abs(f[:, :9]).max()
        for pinned in (0, 8):
            assert (x[[pinned, pinned + n, pinned + 2 * n]] == mesh.x[pinned].astype(kind)).all()
    assert np.ptp(x[:, 1]) > 0.05


@pytest.mark.slow
def test_a_strip_of_four_pieces_hangs_as_one():
    """sigma g L^2 / 2k longer, and each seam bears what hangs below it."""
    length, k, density = 1.0, 400.0, 0.3
    mesh = tc.grid((0.1, length), (2, 40), plane="xy")
    seams = []
    for at in (0.25, 0.5, 0.75):
        mesh, a, b, _ = cut(mesh, at, axis=1)
        seams.append((a, b))
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(density, tc.Stretch(k, 4), tc.Shear(k, 4)))
    for a, b in seams:
        scene.sew(cloth, a, b)
    top = np.flatnonzero(mesh.uv[:, 1] > length - 1e-9)
    scene.pin(cloth, top)
    sim = tc.Simulation(scene, h=0.05, integrator="backward_euler", cg_tol=1e-9)
    sim.run(10.0, fps=1)
    x, f = sim.positions(), sim.seam_forces()
    assert np.ptp(x[:, 1]) - length == pytest.approx(density * 9.81 * length**2 / (2 * k), rel=1e-3)
    for (a, b), at in zip(seams, (0.25, 0.5, 0.75)):
        weight = density * 9.81 * 0.1 * at
        below = sum(f[row, 1].sum() for row in (a, b) if side_of(mesh, row[0])[mesh.uv[:, 1].argmin()] or row is a)
        assert abs(below) == pytest.approx(weight, rel=1e-3)
        assert np.abs(f[a].sum(axis=0) + f[b].sum(axis=0)).max() < 1e-9
        length_of, tension = record.geometry(sim)["seam_length"], record.frame(sim)["seam"]
        for row in (a, b):  # N/m, as heat maps show it
            assert length_of[row].sum() == pytest.approx(0.1) and tension[row] == pytest.approx(weight / 0.1, rel=0.05)
    assert np.count_nonzero(tension) == 6 * len(a)


@pytest.mark.parametrize("rest", [0.7, -0.4, "flat", "given"])
def test_a_seam_comes_to_its_angle(rest):
    """A number, none, or that of the mesh as it was made, half a radian, wherever the cloth starts."""
    mesh, a, b, _ = cut(tc.grid((0.4, 0.2), (4, 2)), 0.2)
    if rest == "given":
        out = np.where(side_of(mesh, b[0]), mesh.uv[:, 0] - 0.2, 0.0)
        up = out[:, None] * [np.cos(0.5) - 1, np.sin(0.5), 0]
        mesh = tc.TriMesh(mesh.x + up, mesh.faces, mesh.uv)
    scene = tc.Scene(gravity=None)
    stiff = tc.Fabric(0.2, tc.Stretch(1000, 10), tc.Shear(1000, 10), tc.Bend(1e-2, 1e-2))
    start = mesh.x + np.where(side_of(mesh, b[0]), 0.2, 0.0)[:, None] * (mesh.uv[:, :1] - 0.2) * [0, 1, 0]
    cloth = scene.add_cloth(mesh, stiff, positions=start)
    scene.sew(cloth, a, b, rest=rest, stiffness=2.0)
    sim = tc.Simulation(scene, h=0.05, integrator="backward_euler", cg_tol=1e-10)
    sim.run(30.0, fps=1)
    x = sim.positions()
    normals = [np.cross(x[f[1]] - x[f[0]], x[f[2]] - x[f[0]]) for f in mesh.faces]
    normals = np.array([n / np.linalg.norm(n) for n in normals])
    beyond = side_of(mesh, b[0])[mesh.faces[:, 0]]
    left, right = normals[~beyond].mean(axis=0), normals[beyond].mean(axis=0)
    along = x[a[-1]] - x[a[0]]
    angle = np.arctan2(np.cross(left, right) @ along / np.linalg.norm(along), left @ right)
    if rest == "given":
        assert abs(angle) == pytest.approx(0.5, abs=1e-4) and np.ptp(x[:, 1]) > 0.05  # and to the side of the mesh:
        assert np.sign(angle) == np.sign(np.cross(*(np.cross(mesh.x[f[1]] - mesh.x[f[0]], mesh.x[f[2]] - mesh.x[f[0]])
                                                    for f in (mesh.faces[~beyond][0], mesh.faces[beyond][0]))) @ along)
        return
    assert abs(angle) == pytest.approx(0.0 if rest == "flat" else abs(rest), abs=1e-4)
    assert rest == "flat" or np.sign(angle) == np.sign(rest)


@pytest.mark.parametrize("k, band", [((300, 300), 1.0), ((500, 200), 1.0), ((300, 500), 0.85)])
@pytest.mark.slow
def test_gathered_lengths(k, band):
    """Strips of .5 and .4 m held flat and sewn along a side: it is (k1 + k2)/(k1/L1 + k2/L2) long. And an elastic band, whose
    rest is b of its pattern: (k1 + b k2)/(k1/L1 + k2/L2)."""
    long, short = tc.grid((0.5, 0.05), (20, 2)), tc.grid((0.4, 0.05), (20, 2))
    n = long.vertex_count
    x = np.concatenate([long.x, short.x + [0.05, 0, 0.05]])
    mesh = tc.TriMesh(x, np.concatenate([long.faces, short.faces + n]), np.concatenate([long.uv, short.uv + [0, 1]]),
                      {"short": np.arange(n, 2 * n)})
    scene = tc.Scene(gravity=None)
    fabrics = [tc.Fabric(0.2, tc.Stretch((warp, 1e-3), (warp / 100, 0), (b, 1.0))) for warp, b in zip(k, (1.0, band))]
    cloth = scene.add_cloth(mesh, fabrics[0], panels={"short": fabrics[1]})
    a, b = np.arange(21), n + 42 + np.arange(21)
    scene.sew(cloth, a, b)
    scene.pin(cloth, np.arange(2 * n), "y")
    sim = tc.Simulation(scene, h=0.02, integrator="backward_euler", cg_tol=1e-9)
    sim.run(4.0, fps=1)
    x = sim.positions()
    assert (x[a] == x[b]).all() and (x[:, 1] == 0).all()
    assert np.ptp(x[a, 0]) == pytest.approx((k[0] + band * k[1]) / (k[0] / 0.5 + k[1] / 0.4), rel=1e-3)
    assert np.linalg.norm(np.diff(x[a], axis=0), axis=1).sum() == pytest.approx(np.ptp(x[a, 0]), rel=1e-3)


@pytest.mark.slow
def test_what_is_apart_is_led_together_and_stays_so():
    """At .5 m/s at most, whatever step; energy is that of the seam's work."""
    mesh, a, b, _ = cut(tc.grid(0.5, 10), 0.25)
    away = side_of(mesh, b[0])
    x = mesh.x + away[:, None] * [0.1, 0.15, 0.05]
    for integrator in ("backward_euler", "safe"):
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(mesh, FABRIC, positions=x)
        scene.pin(cloth, [0, *np.flatnonzero((mesh.uv[:, 0] < 1e-9) | (mesh.uv[:, 0] > 0.4999))])  # closing has to stretch it
        scene.sew(cloth, a, b)
        sim = tc.Simulation(scene, h=1 / 60, integrator=integrator)
        gaps = [np.linalg.norm(x[a] - x[b], axis=1).max()]
        assert sim.seam_gaps() == pytest.approx(gaps)
        for _ in range(20):
            sim.step()
            now = sim.positions()
            gaps.append(np.linalg.norm(now[a] - now[b], axis=1).max())
            assert sim.seam_gaps() == pytest.approx(gaps[-1:], abs=1e-12)
            assert gaps[-1] == pytest.approx(max(0.0, gaps[-2] - 2 * 0.5 / 60), abs=1e-6)
            assert gaps[-1] == 0 or gaps[-1] > 1e-7  # apart, or in one place
            if gaps[-2] == 0:
                assert (sim.velocities()[a] == sim.velocities()[b]).all()
        assert gaps[5] < gaps[0] and gaps[-1] == 0.0 and (sim.velocities()[a] == sim.velocities()[b]).all()
        assert (now[0] == x[0]).all() and (integrator == "backward_euler" or sim.log[-1].fallback_reason != "TOUCH")
        sim.close()


@pytest.mark.slow
def test_seams_close_by_as_much_in_steps_that_need_more_solves(rng):
    """Cloth pressed to half its size, that one solve would blow up: that it is mended does not hold back the seam."""
    mesh, a, b, _ = cut(tc.grid(1.0, 10), 0.5)
    x = 0.5 * mesh.x + side_of(mesh, b[0])[:, None] * [0.1, 0.05, 0.02] + 1e-4 * rng.normal(size=mesh.x.shape)
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, FABRIC, positions=x)
    scene.sew(cloth, a, b)
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", stretch_limit=1e9, adaptive=False, threads=1)
    gaps = [np.linalg.norm(x[a] - x[b], axis=1)]
    for _ in range(8):
        sim.step()
        now = sim.positions()
        gaps.append(np.linalg.norm(now[a] - now[b], axis=1))
        assert gaps[-1] == pytest.approx(np.maximum(gaps[-2] - 2 * 0.5 / 60, 0.0), abs=1e-12)
    assert max(r.solves for r in sim.log) > 1 and {r.status for r in sim.log} == {"CONVERGED"} and gaps[-1].max() == 0.0


@pytest.mark.slow
def test_a_run_that_is_sewn_goes_on_bit_for_bit():
    """From before its gaps are closed; the coarsest level that was found goes on too."""
    mesh, a, b, _ = cut(tc.grid(0.5, 14), 0.25)
    x = mesh.x + side_of(mesh, b[0])[:, None] * [0.05, 0.02, 0]

    def make() -> tc.Simulation:
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, FABRIC, positions=x)
        scene.pin(cloth, [0, 14])
        scene.sew(cloth, a, b)
        return tc.Simulation(scene, h=1 / 60, preconditioner="multilevel", threads=1)

    for steps in (2, 8):
        with make() as sim:
            for _ in range(steps):
                sim.step()
            state = sim.checkpoint()
            for _ in range(4):
                sim.step()
            x, v = sim.positions(), sim.velocities()
        with make() as again:
            again.resume(state)
            for _ in range(4):
                again.step()
            assert (again.positions() == x).all() and (again.velocities() == v).all()


@pytest.mark.slow
def test_sewn_cloth_in_contact():
    """A sheet of six pieces falls on a ball and itself: no crossing, seams closed; until it folds as the whole one."""
    whole = tc.grid(0.6, 12)
    mesh, seams, of = whole, [], np.arange(whole.vertex_count)
    for at, axis in ((0.2, 0), (0.4, 0), (0.3, 1)):
        mesh, a, b, here = cut(mesh, at, axis)
        of = of[here]
        seams.append((a, b))
    ends = []
    for m in (whole, mesh):
        scene = tc.Scene()
        cloth = scene.add_cloth(m, FABRIC, positions=m.x + [-0.27, 0.02, 0.31], contact=tc.ClothContact(0.004, 0.3))
        scene.add_solid(tc.Sphere(0.1), friction=0.4, thickness=0.004, position=(0, -0.1, 0))
        if m is mesh:
            for a, b in seams:
                scene.sew(cloth, a, b)
        sim = tc.Simulation(scene, h=1 / 60, cg_tol=1e-7, contact_tol=1e-3)
        for k in range(24):
            sim.step()
            if k == 11:
                ends.append(sim.positions())
            if sim.log[-1].contacts == 0:
                continue
            assert all(crossed == 0 and least > 0.15 for least, crossed in against_solids(sim).values())
            assert cloth_crossings(sim) == 0
        x = sim.positions()
        load = sum(force for force, _ in sim.solid_loads().values())
        assert np.abs(sim.contact_forces().sum(axis=0) + load).max() < 1e-6
        if m is mesh:
            assert all((x[a] == x[b]).all() for a, b in seams)
        sim.close()
    assert np.sqrt(np.mean(np.sum((ends[1] - ends[0][of]) ** 2, axis=1))) < 2e-3


def test_what_holds_a_cluster_is_shared_by_masses(rng):
    """And what members put on each other is what is left."""
    mesh, a, b, _ = cut(tc.grid((0.4, 0.2), (4, 2)), 0.1)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.add_mass(cloth, int(a[1]), 0.01)
    scene.sew(cloth, a, b)
    sim = tc.Simulation(scene)
    model = sim.model
    index = model.particle[np.concatenate([a[1:], b[1:], [0]])]
    rows = rng.normal(size=(len(index), 3))
    shared, k = model.sewn.shared(index, rows), len(a) - 1
    part = model.mass[index[:k]] / (model.mass[index[:k]] + model.mass[index[k:-1]])
    total = rows[:k] + rows[k:-1]
    assert np.abs(shared[:k] - part[:, None] * total).max() < 1e-14 and np.ptp(part) > 0.3
    assert np.abs(shared[:k] + shared[k:-1] - total).max() < 1e-14 and (shared[-1] == rows[-1]).all()


@pytest.mark.slow
def test_the_coarsest_level_is_q_a_q():
    """As found by products with hats that have nothing in common, against dense matrices; a stiffness holds what is held."""
    mesh, seams = tc.grid(1.0, 24), []
    for at, axis in ((0.25, 0), (0.75, 0), (0.5, 1)):
        mesh, a, b, _ = cut(mesh, at, axis)
        seams.append((a, b))
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100), tc.Bend(1e-2)))
    for a, b in seams:
        scene.sew(cloth, a, b)
    scene.pin(cloth, [0, 1])
    scene.pin(cloth, 280, "y")
    scene.pin(cloth, int(seams[0][0][3]))
    sim = tc.Simulation(scene, preconditioner="multilevel")
    sim.solve(1 / 60)
    coarse, model = sim.integrator.system.preconditioner.coarsest, sim.model
    n, k = model.n, coarse.count
    node, weight = read(coarse.node), read(coarse.weight)
    Q = np.zeros((n, k))
    for c in range(node.shape[1]):
        Q[np.arange(n), node[:, c]] += weight[:, c]
    label = model.sewn.label
    mean = np.eye(n)
    for c in range(label.max() + 1):
        mine = np.flatnonzero(label == c)
        mean[np.ix_(mine, mine)] = 1 / len(mine)
    columns = np.einsum("ik,de->idke", mean @ Q, np.eye(3)).reshape(n, 3, 3 * k)  # along each axis
    A = np.stack([model.to_particles(sim.product(model.to_user(columns[:, :, j]), 1 / 60)) for j in range(3 * k)], axis=2)
    dense = columns.reshape(3 * n, -1).T @ A.reshape(3 * n, -1)
    found = coarse._matrix()
    assert 20 < k <= 128 and coarse.colors.max() + 1 < k
    assert np.abs(found - dense).max() < 1e-10 * np.abs(dense).max()
    held = np.zeros((n, 3))
    held[model.particle[[0, 1]]] = 1
    held[model.particle[280], 1] = 1
    held[label == label[model.particle[seams[0][0][3]]]] = 1
    dense += np.trace(dense) / (3 * k) * np.einsum("idk,id,idl->kl", columns, held, columns)
    inverse = read(coarse.inverse).reshape(k, k, 3, 3).transpose(0, 2, 1, 3).reshape(3 * k, 3 * k)
    assert np.abs(dense @ inverse @ dense - dense).max() < 1e-6 * np.abs(dense).max()


@pytest.mark.slow
def test_the_coarsest_level_follows_the_step():
    """For another size of step it takes as many iterations as one that is found for it."""
    mesh, a, b, _ = cut(tc.grid(0.8, 32), 0.4)
    scene, count = tc.Scene(), []
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.pin(cloth, [0, 32])
    scene.sew(cloth, a, b)
    for sizes in ((1 / 240, 1 / 60), (1 / 60,)):
        with tc.Simulation(scene, preconditioner="multilevel") as sim:
            for h in sizes:
                solution = sim._linearized(h).solve(1e-6, sim.prescribed.at(0.0, h), h)
        count.append(solution.iterations)
    assert abs(count[0] - count[1]) <= 0.1 * count[1], count


@pytest.mark.slow
def test_the_coarsest_level_is_found_anew_when_iterations_rise_or_it_is_old(monkeypatch):
    """And not while neither is the case."""
    mesh, a, b, _ = cut(tc.grid(0.8, 32), 0.4)
    scene, found = tc.Scene(), []
    cloth = scene.add_cloth(mesh, FABRIC)
    scene.pin(cloth, [0, 32])
    scene.sew(cloth, a, b)
    with tc.Simulation(scene, preconditioner="multilevel", integrator="backward_euler") as sim:
        coarse = sim.integrator.system.preconditioner.coarsest
        whole = coarse._matrix
        monkeypatch.setattr(coarse, "_matrix", lambda: (found.append(len(sim.log)), whole())[1])
        for excess, old in ((0, 0), (0, 0), (coarse.worth + 1, 0), (0, 0), (0, 100), (0, 0)):
            coarse.drift.excess += excess
            coarse.drift.age += old
            sim.step(1 / 60)
        steps = len(sim.log)
    assert steps == 6 and found == [0, 2, 4], found


@pytest.mark.slow
def test_iterations_of_sewn_cloth():
    """Six strips take no more than 1.4 times the iterations of a sheet."""
    count = []
    for pieces in (1, 6):
        mesh, seams = tc.grid(1.0, 42), []
        for k in range(1, pieces):
            mesh, a, b, _ = cut(mesh, k / pieces)
            seams.append((a, b))
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, FABRIC)
        scene.pin(cloth, [0, 42])
        for a, b in seams:
            scene.sew(cloth, a, b)
        sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", cg_tol=1e-4, preconditioner="multilevel")
        for _ in range(4):
            sim.step()
        count.append(np.mean([r.iterations / r.solves for r in sim.log]))
        sim.close()
    assert count[1] < 1.4 * count[0], count


@pytest.mark.slow
def test_iterations_of_sewn_cloth_in_contact():
    """A tight tube of four pieces settles round a capsule: no solve takes more than 50 iterations, where 194 were needed with
    contact left out of the coarsest level."""
    n, width, radius = 40, 2 * np.pi * 0.079, 0.08
    mesh, seams = tc.grid((width, 0.4), (n, n)), []
    for k in (10, 20, 30):
        mesh, a, b, _ = cut(mesh, k * width / n)
        seams.append((a, b))
    ends = [np.flatnonzero(np.abs(mesh.uv[:, 0] - at) < 1e-9) for at in (0, width)]
    seams.append(tuple(row[np.argsort(mesh.uv[row, 1])] for row in ends))
    angle, r = mesh.uv[:, 0] / width * 2 * np.pi, radius + 0.0045
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC, contact=tc.ClothContact(0.003, 0.3), positions=np.stack(
        [r * np.cos(angle), mesh.uv[:, 1] - 0.2, r * np.sin(angle)], axis=1))
    scene.add_solid(tc.Capsule((0, -0.4, 0), (0, 0.4, 0), radius), friction=0.3, thickness=0.004)
    for a, b in seams:
        scene.sew(cloth, a, b)
    with tc.Simulation(scene, h=1 / 60, preconditioner="multilevel") as sim:
        for _ in range(8):
            sim.step()
        assert all(r.contacts > 1000 for r in sim.log) and max(r.iterations / r.solves for r in sim.log) < 50


def test_what_cannot_be_sewn():
    mesh, a, b, _ = cut(tc.grid(0.4, 4), 0.2)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC)
    for rows, what in (((a, b[:-1]), "as long as each other"), ((a, a), "nothing to sew"), (("left", b), "in order"),
                       ((a[[0, 0, 1]], b[:3]), "named twice"), (([99], [0]), "99")):
        with pytest.raises((tc.SceneError, tc.MeshError), match=what):
            scene.sew(cloth, *rows)
    for rest in ("bent", 4.0, float("nan")):
        with pytest.raises(tc.SceneError, match="rest"):
            scene.sew(cloth, a, b, rest=rest)
    with pytest.raises(tc.SceneError, match="stiffness"):
        scene.sew(cloth, a, b, stiffness=-1)
    scene.sew(cloth, a, b)
    with pytest.raises(tc.SceneError, match="seams are constraints"):
        tc.Simulation(scene, integrator="verlet")
    scene.sew(cloth, a[1:], b[:-1])
    with pytest.raises(tc.SceneError, match="sew two corners of face"):
        tc.Simulation(scene)


@pytest.mark.slow
def test_a_band_round_a_cylinder():
    """A strip, sewn to a ring and 5 % too short, presses with T/R an area, in all 2 pi T times its width."""
    radius, thickness, width, k = 0.1, 0.004, 0.05, 400.0
    around = 2 * np.pi * (radius + thickness)
    mesh = tc.grid((around / 1.05, width), (60, 3))
    angle = 2 * np.pi * mesh.uv[:, 0] / (around / 1.05)
    r = radius + thickness
    scene = tc.Scene(gravity=None)
    fabric = tc.Fabric(0.2, tc.Stretch(k, 4.0), tc.Shear(100, 1.0), tc.Bend(1e-6))
    cloth = scene.add_cloth(mesh, fabric, positions=np.column_stack([r * np.cos(angle), mesh.uv[:, 1], -r * np.sin(angle)]))
    first, last = (np.flatnonzero(np.abs(mesh.uv[:, 0] - u) < 1e-9) for u in (0.0, around / 1.05))
    scene.sew(cloth, first, last)
    scene.add_solid(tc.Cylinder(radius, 0.4), friction=0.0, thickness=thickness)
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", threads=1)
    for _ in range(60):
        sim.step()
    x, force = sim.positions(), sim.contact_forces()
    out = x * [1, 0, 1] / np.linalg.norm(x * [1, 0, 1], axis=1)[:, None]
    ring = x[np.abs(mesh.uv[:, 1]) < 1e-9][:-1]
    stretch = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum() / (around / 1.05)
    assert (x[first] == x[last]).all() and stretch == pytest.approx(1.05, abs=0.005)
    pressed = np.einsum("ni,ni->n", force, out)
    assert pressed.sum() == pytest.approx(2 * np.pi * k * (stretch - 1) * width, rel=0.03)
    assert np.linalg.norm(force - pressed[:, None] * out, axis=1).max() < 0.02 * pressed.max()
    sim.close()


@pytest.mark.parametrize("pinned", [True, False])
def test_what_solids_hold_at_two_places_is_not_told(pinned):
    """As in an armpit, where nobody can let go of anything; with a pin at one of the places it is."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.3, 4), tc.Fabric(0.2, tc.Stretch(1000, 1)))
    scene.sew(cloth, [0], [24])
    if pinned:
        scene.pin(cloth, 24)
    with tc.Simulation(scene) as sim:
        seams = sim.model.sewn
        rows = np.array([seams.model.particle[0], seams.model.particle[24]])
        seams._tell(rows, np.tile(np.eye(3), (2, 1, 1)), np.array([[0.0, 0, 0], [0.1, 0, 0]]), np.array([0, 0]),
                    np.eye(3)[None] / 2)
        assert len(seams.notes) == pinned


def test_what_is_sewn_and_held_at_two_places_is_told():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.3, 4), tc.Fabric(0.2, tc.Stretch(1000, 1)))
    scene.sew(cloth, [0], [24])
    scene.pin(cloth, 0)
    with tc.Simulation(scene) as sim:
        sim.step()
        assert not any("led to one place" in note for note in sim.notes)
    scene.pin(cloth, 24)
    with tc.Simulation(scene) as sim, warnings.catch_warnings():
        warnings.simplefilter("error")
        sim.step()
        assert any(re.match("vertex 0 of 'cloth0' is held.* by 0.21 m", note) for note in sim.notes)
