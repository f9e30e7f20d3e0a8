"""Particles between two plates, one step at a time: where they are led, when they are free, and who minds them meanwhile."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.contact.solid.facing import Sides
from taichi_cloth.contact.solid.pinch import CREEP, FREE, PRESSURE, SLOWLY, Pinched
from taichi_cloth.contact.solid.vertices import VertexContacts
from taichi_cloth.contact.step_start import StepContext
from taichi_cloth.scene.intersections import count_crossings
from taichi_cloth.system.held import Held

H, THICK, KEEPS, GAP = 1 / 60, 0.005, 0.003, 0.01
NEEDED = 2 * THICK + KEEPS
DOWN, UP = np.array([0.0, -1.0, 0.0]), np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def between():
    """A sheet of nine vertices between plates that stand still, GAP from each other: less than is needed."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.2, 2)
    scene.add_solid(tc.Plane(), 0.3, thickness=THICK, name="floor")
    scene.add_solid(tc.Plane(DOWN), 0.3, thickness=THICK, position=lambda t: (0.0, GAP, 0.0), name="ceiling")
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x + [0, 0.002, 0], contact=tc.ClothContact(KEEPS, 0.3))
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        yield sim.contacts


def held_at(contacts, height, share=0.5):
    """(n, 3) places of particles at heights (n,) [m] above the floor, all pinched since the last step."""
    x = contacts.solids.model.read_particles()[0].copy()
    n = len(x)
    x[:, 1] = height - contacts.solids.model.origin[1]
    above = np.stack([x[:, 1], GAP - x[:, 1]], axis=1)
    contacts.solids.pinches.accepted = Pinched(np.arange(n), np.tile([0, 1], (n, 1)), np.tile([UP, DOWN], (n, 1, 1)), above,
                                               np.full(n, share), np.zeros((n, 3)))
    return x


def begin(contacts, x, h=H, pins=None):
    """An attempt at a step from there, of size h [s]; what begins."""
    contacts.solids.pinches.begin(StepContext(h, H, x, 0 * x, pins), VertexContacts.none())
    return contacts.solids.pinches


@pytest.mark.parametrize("h, share, height", [(H, 0.5, 0.002 + SLOWLY * H), (1.0, 0.5, GAP / 2), (1.0, 0.3, 0.3 * GAP)])
def test_it_goes_to_its_share_of_the_room_slowly(between, h, share, height):
    x = held_at(between, 0.002, share)
    target = begin(between, x, h).target
    assert np.abs(target[:, 1] + between.solids.model.origin[1] - height).max() < 1e-6
    assert np.abs((target - x)[:, [0, 2]]).max() < 1e-9


def test_it_is_free_where_there_is_room_and_it_is_outside(between, monkeypatch):
    """With a quarter more room than needed: but not inside one of the plates."""
    pinches = between.solids.pinches
    monkeypatch.setattr(pinches, "between", pinches.between - KEEPS)
    monkeypatch.setattr(pinches, "thickness", pinches.thickness * (GAP / FREE) / (2 * THICK) * 0.99)
    height = np.full(9, GAP / 2)
    height[[1, 5]] = -0.001, GAP + 0.001
    assert begin(between, held_at(between, height)).trial.index.tolist() == [1, 5]
    monkeypatch.setattr(pinches, "thickness", pinches.thickness * 1.02)
    assert len(begin(between, held_at(between, height)).trial.index) == 9


def test_it_is_held_across_and_rubs_along(between):
    """S = n n^T; friction of both sides on what moves against their mean is 2 mu p A, less only below CREEP."""
    x = held_at(between, 0.002)
    pinches = begin(between, x)
    held = pinches.with_pins(None)
    assert np.abs(held.projector - np.outer(UP, UP)).max() < 1e-6
    most = 2 * 0.3 * PRESSURE * pinches.area
    assert pinches.area.sum() == pytest.approx(0.2 * 0.2)
    for speed, part in ((2 * CREEP, 1.0), (0.3, 1.0), (0.1 * CREEP, 0.1)):
        there = x + H * speed * np.array([0.6, 0.0, 0.8])
        points = pinches.rub(StepContext(H, H, x, 0 * x), there, 0 * x)
        force = points.forces(there - x, H)
        assert force == pytest.approx(-part * most[:, None] * [0.6, 0.0, 0.8], rel=1e-9, abs=1e-12)
        assert not pinches.lags(StepContext(H, H, x, 0 * x), there)
    assert pinches.lags(StepContext(H, H, x, 0 * x), x + [0.3 * H, 0.0, 0.0])


def test_scripts_have_their_way_with_what_they_hold_whole(between):
    x = held_at(between, 0.002)
    pinches = begin(between, x)
    there = x[:2] + [0.01, 0.0, 0.02]
    P = np.stack([np.eye(3), np.diag([1.0, 0.0, 0.0])])
    held = pinches.with_pins(Held.of([0, 1], P, there, True, 0 * there, pinches.detector.exchange))
    order = np.argsort(held.index)
    assert held.index[order].tolist() == list(range(9))
    assert np.abs(held.projector[order][:2] - np.eye(3)).max() == 0  # what is held in part is held whole
    assert np.abs(held.projector[order][2:] - np.outer(UP, UP)).max() < 1e-6
    at = held.target[order]
    assert np.abs(at[0] - there[0]).max() < 1e-6 and np.abs(at[1:] - pinches.target[1:]).max() < 1e-6
    pinches.rub(StepContext(H, H, x, 0 * x), x + [1.0, 0.0, 0.0], 0 * x)
    pinches.record_forces(held, np.ones((9, 3)), 0 * x, H)  # what a pin bears is no solid's
    assert (pinches.forces[0] == 0).all() and (pinches.forces[1:] == 1).all()


def test_nothing_else_minds_it(between):
    """No contact with solids, no pairs of layers, no depth; it counts as contact all the same, until the state is changed."""
    x = held_at(between, 0.002)
    solids, layers = between.solids, between.layers
    solids.model.save()
    assert between.meets(H, None, x, 0 * x) and between.touching
    assert not len(solids.near.vertices.index) and not solids.touching
    assert not solids.penetration.minded.any()
    assert layers.detector.resting and layers.detector.tangled.to_numpy()[:9].all()
    between.clear()
    assert between.meets(H, None, x, 0 * x) and len(solids.near.vertices.index) and solids.penetration.minded.all()
    assert not solids.pinches.where.any() and not between.touching


def test_layers_are_looked_at_again_when_it_is_free(between):
    layers, n = between.layers, len(between.solids.pinches.where)
    for after, freed in ((np.ones(n, dtype=bool), False), (np.zeros(n, dtype=bool), True)):
        layers.waive(after, np.arange(n))
        assert layers.freed == freed and (layers.detector.tangled.to_numpy()[:n] == after).all()
    layers.waive(np.zeros(n, dtype=bool), np.arange(0))
    assert not layers.freed


def test_an_edge_rests_by_its_own_vertices(rng):
    """Whatever face speaks for it: where an edge of a solid is near one of cloth, both of whose vertices are free, it counts,
    as a crossing of either of that edge's faces would."""
    scene, mesh = tc.Scene(), tc.grid(0.2, 30)
    scene.add_solid(tc.Box((0.1, 0.1, 0.1)), 0.3, 0.001, name="box", rotation=(0.0, 0.0, np.pi / 4))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x - mesh.x.mean(axis=0) + [0.003, 0.0709, 0])
    with tc.Simulation(scene, h=H) as sim:
        sim.model.save()
        near = sim.contacts.detector.look(H)
        edges = near.pairs.take(near.pairs.weights[:, 2] == 0)
        edges = edges.take((edges.weights[:, :2] > 0.02).all(axis=1))
        around = rng.uniform(size=sim.vertex_count) < 0.3
        free, third = ~around[edges.vertices[:, :2]].any(axis=1), around[edges.vertices[:, 2]]
        assert (free & third).sum() > 3 and (free & ~third).sum() > 3 and (~free).sum() > 3
        kept = np.isin(edges.key, near.without(around, around).pairs.key)
        assert (kept == free).all()
        penetration = sim.contacts.solids.penetration
        penetration.pinched = around
        deep = replace(near, pairs=replace(edges, distance=0 * edges.distance))
        assert (penetration.below_least(deep) == free).all()
        assert penetration.left(deep, near.vertices.take(near.vertices.gap > 1), None)[0] == free.sum()


def test_no_step_is_cut_for_the_stretch_of_what_solids_lead():
    """Two pairs of jaws bite the ends of a strip, one cell long between them, and go apart across it: the cell follows."""
    scene, mesh = tc.Scene(gravity=None), tc.grid((0.2, 0.1), (1, 1))
    for x, way in ((0.0, -1), (0.2, 1)):
        for side in (-1, 1):
            def where(t, x=x, way=way, side=side):
                return x, side * (0.021 + max(0.004 - 0.1 * t, 0.0)) + way * 4 * max(t - 0.1, 0.0), -0.05

            scene.add_solid(tc.Box((0.04, 0.04, 0.2)), 0.3, THICK, position=where)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100, 1)), mesh.x)
    with tc.Simulation(scene, h=H, integrator="backward_euler", stretch_limit=0.1) as sim:
        sim.step(0.15)
        assert sim.log[-1].pinched == 4 and not sum((list(r.rejections) for r in sim.log), [])
        x = sim.positions()
        assert np.ptp(x[:, 1]) == pytest.approx(0.4, abs=0.02)
        assert max(np.diff([np.hypot(1, 40 * max(t - 0.1, 0)) for t in np.arange(0, 0.151, H)])) > 0.1  # of |w| in a step


@pytest.mark.slow
def test_an_edge_that_is_left_across_a_solid_comes_out():
    """A sheet whose vertices are all outside a box, and whose edges pass through its edge: it is raised until they do not,
    no faster than it may, then let down again; and what is pinched there stays. Steps that are solved keep what the raised
    edges' neighbours gain, .1 m/s, and are looked at apart."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.2, 31)
    scene.add_solid(tc.Box((0.1, 0.1, 0.3)), 0.0, 0.002, name="box", rotation=(0.0, 0.0, np.pi / 4))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x - mesh.x.mean(axis=0) + [0, 0.1, 0])
    with tc.Simulation(scene, h=H, integrator="backward_euler", contact_tol=None) as sim:
        x = mesh.x - mesh.x.mean(axis=0) + [0, 0.05 * np.sqrt(2) - 0.0005, 0]
        sim.set_state(x, 0 * x)
        corners, faces = box_surface()
        assert count_crossings(x, mesh.faces, corners, faces) > 20
        penetration = sim.contacts.solids.penetration
        penetration.pinched = np.ones(sim.vertex_count, dtype=bool)
        penetration.pass_time(H, VertexContacts.none())
        assert not penetration.raised.any()
        before, left = x, []
        for _ in range(30):
            sim.step()
            now = sim.positions()
            assert (now - before)[:, 1].max() < 0.05 * H * np.sqrt(2) + 1e-4
            before = now
            left.append(count_crossings(now, mesh.faces, corners, faces))
            if len(left) == 1:
                assert penetration.raised.any()
                state = sim.checkpoint()
        assert left[-1] == 0 and not any(left[left.index(0):]) and not penetration.raised.any()
        assert not sum((list(r.rejections) for r in sim.log), [])
    with tc.Simulation(scene, h=H, integrator="backward_euler", contact_tol=None) as sim:
        sim.resume(state)
        for _ in range(29):
            sim.step()
        assert (sim.positions() == now).all()
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        sim.set_state(x, 0 * x)
        for _ in range(30):
            sim.step(H)
            assert sim.velocities()[:, 1].max() < 0.15
        assert count_crossings(sim.positions(), mesh.faces, corners, faces) == 0


def test_raised_edges_are_without_pairs_only_across():
    """While their triangles cross a solid: new crossings of theirs do not count then. Pairs that come back have as much of
    their thickness as there is room."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.2, 31)
    scene.add_solid(tc.Box((0.1, 0.1, 0.3)), 0.0, 0.002, name="box", rotation=(0.0, 0.0, np.pi / 4))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x - mesh.x.mean(axis=0) + [0, 0.1, 0])
    with tc.Simulation(scene, h=H) as sim:
        detector, penetration = sim.contacts.detector, sim.contacts.solids.penetration
        x = mesh.x - mesh.x.mean(axis=0) + [0, 0.05 * np.sqrt(2) + 0.0002, 0]
        sim.set_state(x, 0 * x)
        detector.thickness_ramp.part[:] = 1.0
        sim.model.save()
        near, none = detector.look(H), np.zeros((0, 3), dtype=np.int64)
        assert len(near.pairs.key) > 20 and near.pairs.distance == pytest.approx(0.0002, rel=0.01)
        penetration.raised[:] = 0.001
        kept = penetration.raise_from(near)
        assert (kept.pairs.key == near.pairs.key).all() and kept.vertices.gap == pytest.approx(near.vertices.gap - 0.001)
        penetration.before, penetration.crossed = none, detector.faces[:4]
        assert penetration.more_crossed
        penetration.across[:] = True
        assert not len(penetration.raise_from(near).pairs.key) and not penetration.more_crossed
        penetration.pass_time(H, VertexContacts.none())
        assert (np.flatnonzero(penetration.across) == np.unique(detector.faces[:4])).all()
        rests = penetration.across[near.pairs.own_vertices].all(axis=1)
        assert penetration.raise_from(near).pairs.key.tolist() == near.pairs.key[~rests].tolist()
        own = near.pairs.vertices[~rests][near.pairs.weights[~rests] > 0]
        assert detector.thickness_ramp.part[own] == pytest.approx(0.2, rel=0.01)


def test_no_small_step_is_refused_beside_what_is_pinched():
    """Crossings that a step leaves have to find room, however small it is, but for those next to pinched particles."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.2, 9)
    scene.add_solid(tc.Box((0.1, 0.1, 0.3)), 0.0, 0.002, name="box")
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x - mesh.x.mean(axis=0) + [0, 0.1, 0])
    with tc.Simulation(scene, h=H) as sim:
        solids, detector = sim.contacts.solids, sim.contacts.detector
        penetration, x = solids.penetration, sim.model.read_particles()[0]
        face = detector.faces[len(detector.faces) // 2]
        penetration.crossed, none = face[None], np.zeros(0, dtype=np.int64)
        near = detector.look(H)

        def may_shrink(h: float) -> bool:
            return penetration.may_shrink(StepContext(h, H, x, 0 * x), near, none, None)

        assert may_shrink(H) and may_shrink(H / 128)
        beside = np.setdiff1d(detector.faces[np.isin(detector.faces, face).any(axis=1)], face)
        penetration.spared[np.setdiff1d(np.arange(sim.vertex_count), np.append(face, beside))[0]] = 0.1
        assert may_shrink(H / 128)
        penetration.spared[beside[0]] = 0.1
        assert may_shrink(H) and not may_shrink(H / 128)


def test_what_is_past_the_border_of_a_surface_is_not_below_it():
    """Of a closed mesh: within its border, whatever its depth; to the side by up to 1.7 times the depth below its plane."""
    x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * [0.1, 0.05, 0.15]
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.03, 1)
    scene.add_solid(tc.SolidMesh(np.stack([x, x + 0.01]), box_surface()[1], fps=1), 0.3, 0.002, name="box")
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100, 1)), mesh.x + [-0.015, 0.1, 0.015])
    with tc.Simulation(scene, h=H) as sim:
        deep, aside = np.array([0.003, 0.003, 0.04, 0.02, 0.02, 0.001]), np.array([-0.05, -0.001, -0.05, 0.03, 0.04, 0.5])
        at = np.column_stack([0.1 + aside, 0.05 - deep, 0 * deep]) - sim.model.origin
        side = Sides(np.zeros(6, dtype=np.int64), np.tile(UP, (6, 1)), -deep, np.zeros((6, 3)), np.zeros(6))
        below = sim.contacts.solids.pinches._below(at, side)
        assert below.tolist() == [True, True, True, True, False, True]  # the last is no deeper than the thickness


@pytest.mark.slow
@pytest.mark.parametrize("sought", [True, False])
def test_what_was_pinched_and_is_inside_comes_out(sought):
    """However deep, at a quarter of an edge in a step, and without a step that is refused; what was not pinched is not seen
    there. Once out it is looked for no longer."""
    x = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * [0.1, 0.05, 0.15]
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.03, 1)
    scene.add_solid(tc.SolidMesh(np.stack([x, x]), box_surface()[1], fps=1), 0.3, 0.002, name="box")
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100, 1)), mesh.x + [-0.015, 0.1, 0.015])
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        deep = mesh.x - mesh.x.mean(axis=0) + [0, 0.02, 0]
        sim.set_state(deep, 0 * deep)
        penetration = sim.contacts.solids.penetration
        if sought:
            penetration.spare(np.arange(sim.vertex_count))
        height = []
        for _ in range(12):
            sim.step(H)
            height.append(sim.positions()[:, 1].min())
        assert not sum((list(r.rejections) for r in sim.log), [])
        most = 0.25 * sim.contacts.detector.edge
        assert np.diff([0.02, *height]).max() < 1.01 * most
        assert height[-1] == pytest.approx(0.052 if sought else 0.02, abs=2e-4)
        assert not penetration.sought.any() and not penetration.spared.any()


def box_surface():
    """Corners and triangles of that box, computed here."""
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)], dtype=float)
    turn = np.array([[1, -1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    faces = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
             [1, 5, 7], [1, 7, 3]]
    return signs * [0.05, 0.05, 0.15] @ turn.T, np.array(faces)
