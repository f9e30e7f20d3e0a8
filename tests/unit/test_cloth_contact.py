"""Cloth against cloth: what is found, how far the way is free, the law, tangles, and what costs nothing."""

import dataclasses
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from reference.geometry import boxes_within

import taichi_cloth as tc
from taichi_cloth.backend import rows, runtime
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.timing import Clock
from taichi_cloth.contact import points as contact_points
from taichi_cloth.contact.cloth import barrier as repulsion
from taichi_cloth.contact.cloth.barrier import FLOOR, SHALLOW
from taichi_cloth.contact.cloth.contact_pairs import ContactPairs
from taichi_cloth.contact.cloth.narrow_phase import PINCHED, LayerDetector
from taichi_cloth.contact.cloth.pair_kernels import MU, NOW, POTENTIAL, STIFF
from taichi_cloth.contact.cloth.untangle import Intersections
from taichi_cloth.contact.geometry import VERTEX_FACE
from taichi_cloth.contact.points import ContactRows
from taichi_cloth.contact.step_start import ForcingTerms
from taichi_cloth.scene.intersections import self_crossings
from taichi_cloth.step.nonlinear.layer_contact import LATER, LayerStep
from taichi_cloth.system.state import ParticleState

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))
THICKNESS = 0.05


def soup(rng, count: int, spread: float = 10.0) -> tc.Scene:
    """Triangles of 0.2 m thrown into a box of 1 m, `spread` times as large at rest."""
    x = (rng.uniform(size=(count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    mesh = tc.TriMesh(spread * x, np.arange(3 * count).reshape(-1, 3))
    scene = tc.Scene()
    scene.add_cloth(mesh, FABRIC, positions=x, contact=tc.ClothContact(THICKNESS))
    return scene


def detector(scene: tc.Scene, precision: str = "f64") -> LayerDetector:
    run = runtime.start("cpu", precision)
    fields = Fields(run.exchange, pooled=True)
    model = ParticleState(fields, scene, run)
    made = LayerDetector(fields, model, scene, True, FLOOR)
    fields.allocate()
    made.model.save()
    return made


def segment_distance(a, b, c, d) -> float:
    """By clamped minimisation on each side in turn, from many starts: slow and independent of the kernels."""
    best = np.inf
    for s in (0.0, 0.5, 1.0):
        for _ in range(200):
            p = a + s * (b - a)
            t = np.clip((p - c) @ (d - c) / ((d - c) @ (d - c)), 0, 1)
            q = c + t * (d - c)
            before, s = s, np.clip((q - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
            if s == before:
                break
        best = min(best, float(np.linalg.norm(a + s * (b - a) - q)))
    return best


def triangle_distance(p, a, b, c) -> float:
    """Inside by solving, else the nearest edge."""
    e, f = b - a, c - a
    u, v = np.linalg.lstsq(np.stack([e, f], axis=1), p - a, rcond=None)[0]
    if u >= 0 and v >= 0 and u + v <= 1:
        return float(np.linalg.norm(a + u * e + v * f - p))
    return min(segment_distance(p, p + 1e-12, *ends) for ends in ((a, b), (b, c), (c, a)))


@pytest.mark.slow
def test_all_near_pairs_are_found_once(rng):
    d = detector(soup(rng, 48))
    d.paths.begin()
    d.cover()
    found = [tuple(row) for row in d.candidates.tolist()]
    assert len(found) == len(set(found))
    near = {tuple(row) for row in d.look().pair.tolist()}
    x, expected = d.model.read_particles()[0], set()
    faces, edges = d.mesh.faces, d.mesh.edges
    for v, f in zip(*(found.tolist() for found in boxes_within(x[:, None], x[faces], THICKNESS))):
        if v not in faces[f] and triangle_distance(x[v], *x[faces[f]]) < THICKNESS * (1 - 1e-9):
            expected.add((v, f, VERTEX_FACE))
    for i, j in zip(*(found.tolist() for found in boxes_within(x[edges], x[edges], THICKNESS))):
        apart = j <= i or len({*edges[i], *edges[j]}) < 4
        if not apart and segment_distance(*x[edges[i]], *x[edges[j]]) < THICKNESS * (1 - 1e-6):
            expected.add((i, j, 1))
    assert len(expected) > 100
    near = {row if row[2] == VERTEX_FACE else (min(row[:2]), max(row[:2]), 1) for row in near}
    assert near <= expected and len([row for row in near if row[2] != VERTEX_FACE]) > 50
    for i, j, kind in expected - near:  # edges that are nearest at an end of one: there a vertex is as near
        assert kind != VERTEX_FACE
        (a, b), (p, q) = x[d.mesh.edges[i]], x[d.mesh.edges[j]]
        ends = [triangle_distance(e, g, h, g) for e, g, h in ((a, p, q), (b, p, q), (p, a, b), (q, a, b))]
        assert min(ends) < segment_distance(a, b, p, q) * (1 + 1e-6)


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.slow
def test_only_what_strays_is_looked_for_again(rng, precision):
    """From step to step, from where a step stopped short on its way to an end near the one that it had, and back to that end
    from elsewhere; also where all of it moves on as one."""
    scene = soup(rng, 150)
    d, anew = detector(scene, precision), detector(scene, precision)
    x = d.model.read_particles()[0]
    again, on, falls = 0, 0, 0
    for k in range(20):
        far = (rng.uniform(size=(len(x), 1)) < 0.1 * (k % 3)) * 0.1
        way = (far + 0.3 * d.paths.skin[0]) * rng.normal(size=x.shape)
        if k % 5 == 4:
            way = 8 * d.paths.skin[0] * rng.normal(size=x.shape)
        fall = 0.3 * (k % 3 > 0) * rng.normal(size=3)  # all of it moves by as much, too
        start, end = x, x + way + fall
        for leg in range(4):
            aside = 0.1 * (rng.uniform(size=(len(x), 1)) < 0.05) * rng.normal(size=x.shape)
            if leg == 3:
                start = end + aside
            elif leg:  # the rest of the way, to another end
                start = start + 0.5 * (end - start)
                end = end + aside + 0.2 * d.paths.skin[0] * rng.normal(size=x.shape)
            for each in (d, anew):
                each.model.write_particles(start, np.zeros_like(x))
                each.model.save()
                each.paths.arrive() if leg else each.paths.begin()
                each.model.write_particles(end, np.zeros_like(x))
            some = 0 < d.paths.count_deviating() < 0.3 * len(x) and d.fresh
            again += some and not leg
            falls += some and not leg and k % 3 > 0
            on += some and leg > 0 and k % 5 == 4
            anew.fresh = False
            d.cover()
            anew.cover()
            assert len({tuple(row) for row in d.candidates.tolist()}) == len(d.candidates)
            assert d.collision_free_step()[0] == anew.collision_free_step()[0]
            for swept in (False, True):
                p, q = d.look(swept), anew.look(swept)
                assert (p.key[p.order] == q.key[q.order]).all() and (p.end[p.order] == q.end[q.order]).all()
                assert len(p.end) > 100
        x = start
    assert again > 4 and on == 12 and falls > 3


def test_what_is_near_at_rest_keeps_half_of_that(rng):
    scene = soup(rng, 60, spread=1.0)
    d = detector(scene)
    d.paths.begin()
    d.cover()
    assert not len(d.look().end)  # everything is where it rests
    x = d.model.read_particles()[0]
    d.model.write_particles(0.4 * x, np.zeros_like(x))
    d.cover()
    p = d.look()
    assert len(p.end) > 20 and (p.end < p.radius).all() and (p.radius <= THICKNESS).all()


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.slow
def test_the_free_way_is_free_and_not_too_short(rng, precision):
    scene = soup(rng, 80, 2.5)
    d = detector(scene, precision)
    x_0 = d.model.read_particles()[0]
    crossed_before = len(self_crossings(x_0, d.mesh.faces)[0])
    taken = 0
    for _ in range(20):
        way = 0.05 * rng.normal(size=x_0.shape)
        d.model.write_particles(x_0, np.zeros_like(x_0))
        d.model.save()
        d.paths.begin()
        d.model.write_particles(x_0 + way, np.zeros_like(x_0))
        d.cover()
        part, blocking = d.collision_free_step()
        assert 0 < part <= 1 and (len(blocking) > 0) == (part < 1)
        end = x_0 + part * way
        edges, rows = self_crossings(end, d.mesh.faces)
        before = {tuple(sorted(e)) + (int(r),) for e, r in zip(*self_crossings(x_0, d.mesh.faces))}
        after = {tuple(sorted(e)) + (int(r),) for e, r in zip(edges, rows)}
        assert after == before  # neither through anything, nor out of it
        near = {}
        for x in (x_0, end):
            d.model.write_particles(x, np.zeros_like(x))
            p = d.look()
            near[x is end] = dict(zip(p.key.tolist(), (p.end / p.radius).tolist()))
        lowest = [ratio for key, ratio in near[True].items() if near[False].get(key, 1.0) > PINCHED * FLOOR]
        assert min(lowest, default=1.0) > FLOOR * (1 - 10 * np.finfo(precision.replace("f", "float")).eps / 1e-3)
        taken += part
    assert crossed_before > 0 and taken / 20 > 0.005


@ti.kernel
def _law(d: ti.types.ndarray(), r: float, shift: float, out: ti.types.ndarray()):
    for k in range(d.shape[0]):
        force, slope = repulsion.law(d[k], r, shift)
        out[0, k], out[1, k], out[2, k] = force, slope, repulsion.potential(d[k], r, shift)


@pytest.mark.parametrize("shift", [0.0, 0.0017])
def test_the_law_is_the_slope_of_its_potential_and_joins_smoothly(shift):
    """Of pairs that begin to repel at their distance, or further away."""
    runtime.start("cpu", "f64")

    def at(d: np.ndarray) -> np.ndarray:
        out = np.empty((3, len(d)))
        _law(np.ascontiguousarray(d), r, shift, out)
        return out

    r, d, e = 0.01, np.linspace(-0.001, 0.0125, 2301), 1e-8
    force, slope, _ = at(d)
    change = (at(d - e) - at(d + e)) / (2 * e)
    assert np.abs(change[2] - force).max() < 1e-4 * force.max() and (force[d > r + shift] == 0).all()
    assert force[np.searchsorted(d, r + shift) - 1] > 0
    pairs = dataclasses.replace(ContactPairs.none(), end=np.interp([SHALLOW, 0.3, 0.5], [0, 1], [FLOOR * r, r]),
                                radius=np.full(3, r))
    assert np.allclose(pairs.room, [SHALLOW, 0.3, 0.5])
    heights = FLOOR * r + np.array([SHALLOW, 0.5]) * ((1 - FLOOR) * r + shift)  # parts of the way to where it begins
    inner = (d > SHALLOW * r) & (np.abs(d - np.array([[r + shift], [SHALLOW * r], [heights[0]]])) > 1e-6).all(axis=0)
    assert np.abs(change[0] - slope)[inner].max() < 1e-4 * slope.max()
    assert (np.diff(force) <= 0).all()
    for values in at(heights[1] + np.array([-1e-12, 1e-12])):
        assert abs(values[0] - values[1]) < 1e-9 * max(abs(values[0]), 1e-3)


def test_forces_of_pairs_are_the_slope_of_their_energy_on_a_ladder(rng):
    """With each pair's stiffness as it is, of pairs that are not so near that the step stops them too."""
    sim = tc.Simulation(soup(rng, 60), integrator="backward_euler")
    layers, x = sim.contacts.layers, sim.model.read_particles()[0]
    layers.clear()
    p, (weighed, _) = layers.near, layers._evaluate(layers.near)
    own = p.end > (FLOOR + 0.1 * (1 - FLOOR)) * p.radius
    stiff = dict(zip(p.key[own].tolist(), weighed[STIFF][own].tolist()))

    def energy(at: np.ndarray) -> float:
        sim.model.write_particles(at, np.zeros_like(at))
        q = layers.detector.look()
        now, _ = layers._evaluate(q)
        return sum(stiff.get(key, 0.0) * part for key, part in zip(q.key.tolist(), (now[POTENTIAL] / now[STIFF]).tolist()))

    way = rng.normal(size=x.shape)
    slope = -float(np.sum((weighed[NOW] * p.along(way))[own]))  # of the energy along the way
    off = [abs((energy(x + e * way) - energy(x - e * way)) / (2 * e) / slope - 1) for e in (1e-3, 1e-4, 1e-5)]
    assert own.sum() > 30 and off[1] < 0.03 * off[0] and off[2] < 0.03 * off[1] and off[2] < 1e-7
    sim.close()


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.slow
def test_degenerate_pairs_are_defined(precision):
    """Parallel edges do not count, but the vertices at their ends do; a vertex over an edge or a corner meets all faces there,
    with the same normal; what lies in a plane or on a thing has a finite answer."""

    def pairs(x, faces):
        mesh = tc.TriMesh(10 * (np.array(x) + 0.01 * np.random.default_rng(1).normal(size=(len(x), 3))), np.array(faces))
        scene = tc.Scene()
        scene.add_cloth(mesh, FABRIC, positions=np.array(x, dtype=float), contact=tc.ClothContact(THICKNESS))
        d = detector(scene, precision)
        d.paths.begin()
        d.cover()
        part, _ = d.collision_free_step()
        p = d.look()
        assert part == 1 and np.isfinite(p.weights).all() and np.isfinite(p.end).all() and np.isfinite(p.normal).all()
        assert np.allclose(p.weights.sum(axis=1), 0, atol=1e-5)
        edges = p.pair[:, 2] != VERTEX_FACE
        return p, edges

    lower, faces = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]]
    above = [[u, 0.02, w] for u, w in ((0.2, 0.2), (1.2, 0.2), (1.2, 1.2), (0.2, 1.2))]
    p, edges = pairs(lower + above, faces + [[4, 5, 6], [4, 6, 7]])
    assert np.allclose(p.end, 0.02, atol=1e-6) and np.allclose(np.abs(p.normal[:, 1]), 1, atol=1e-5)
    assert edges.sum() >= 2 and (~edges).sum() >= 2  # (0, 4), (4, 2): over the diagonals, which lie along each other
    for k in np.flatnonzero(edges):
        a, b, c, d = (np.array((lower + above)[i]) for i in p.vertices[k])
        assert np.linalg.norm(np.cross(b - a, d - c)) > 0.1
    for place in ([0.5, 0.02, 0.5], [0, 0.02, 0]):  # over the diagonal, over a corner: both faces
        p, edges = pairs(lower + [place, [0.5, 3, 0.5], [0.6, 3, 0.5]], faces + [[4, 5, 6]])
        down = ~edges & (p.normal[:, 1] > 0)
        assert down.sum() == 2 and np.allclose(p.normal[down], [0, 1, 0], atol=1e-5)
        assert np.allclose(p.end[down], 0.02, atol=1e-6)
    beside = [[1.02, 0, 0.3], [2, 0, 0.3], [2, 0, 0.9]]  # in the plane of the others
    p, edges = pairs(lower + beside, faces + [[4, 5, 6]])
    assert (~edges).sum() == 1 and np.allclose(p.normal[~edges], [1, 0, 0], atol=1e-5)
    p, edges = pairs(lower + [[0.5, 0, 0.3], [0.5, 3, 0.5], [0.6, 3, 0.5]], faces + [[4, 5, 6]])  # on a face: any direction
    assert (~edges).sum() == 1 and abs(p.end[0]) < 1e-7 and np.linalg.norm(p.normal[0]) < 1 + 1e-6


@pytest.mark.slow
def test_room_for_points_of_contact_grows(monkeypatch):
    """A run with room for a few at first is, bit for bit, one that has enough; without it, a step is refused by name."""

    def run(room: int, may_be: int) -> tuple[np.ndarray, int, list[int]]:
        for name, value in (("ROOM", 0), ("SPARE", room), ("MOST", may_be)):
            monkeypatch.setattr(contact_points, name, value)
        with two_sheets(0.02, (0.2, -1.0, 0.0), 0.3, gravity=(0, -9.81, 0), fabric=plain)[2] as sim:
            had = [sim.contacts.force.vertices.shape[0]]
            for _ in range(4):
                sim.step()
                had.append(sim.contacts.force.vertices.shape[0])
            return sim.positions(), max(r.layers for r in sim.log), had

    plain = tc.Fabric(0.2, tc.Stretch(1000))
    for name in ("SMALL", "MIDDLE"):  # fields have little more
        monkeypatch.setattr(rows, name, 256)
    x, count, had = run(100, 40)
    y, _, enough = run(5000, 40)
    assert had[0] == 256 and had[-1] > 512 and len(set(enough)) == 1 and count > 300
    assert (x == y).all()
    with pytest.raises(tc.SimulationError, match="more than 100 points of contact"):
        run(100, 0)


def two_sheets(gap: float, v=(0.0, 0.0, 0.0), friction: float = 0.0, cells: int = 8, gravity=None, fabric=FABRIC, **kwargs):
    scene = tc.Scene(gravity=gravity)
    mesh = tc.grid(0.3, cells)
    contact = tc.ClothContact(0.005, friction)
    a = scene.add_cloth(mesh, fabric, contact=contact)
    scene.add_cloth(mesh, fabric, positions=mesh.x + [0.003, gap, 0.002], velocities=v, contact=contact)
    return scene, a, tc.Simulation(scene, **{"h": 1 / 60, "integrator": "backward_euler", **kwargs})


@pytest.mark.slow
def test_forces_of_layers_add_up_to_nothing():
    scene, a, sim = two_sheets(0.03, (0.3, -2.0, 0.0))
    n = a.mesh.vertex_count
    momentum = sim.velocities()[n:].sum(axis=0)
    met = 0
    for _ in range(4):
        sim.step()
        f, x = sim.contact_forces(), sim.positions()
        size = np.abs(f).sum()
        met += size > 0
        assert np.abs(f.sum(axis=0)).max() <= 1e-10 * size
        assert np.abs(np.cross(x, f).sum(axis=0)).max() <= 0.05 * size * 0.005 # of where it began
    m = sim.model.mass[sim.model.particle]
    after = (m[:, None] * sim.velocities()).sum(axis=0) / m.mean()
    assert met > 0 and np.abs(after - momentum).max() < 1e-3 * np.abs(momentum).max()
    sim.close()


def test_energy_with_that_of_repulsion_never_grows():
    scene, a, sim = two_sheets(0.03, (0.3, -2.0, 0.0), 0.2)
    totals, pressed = [sum(sim.energy().values())], []
    for _ in range(30):
        sim.step()
        pressed.append(sim.energy().get("contact", 0.0))
        totals.append(sum(sim.energy().values()))
    assert max(pressed) > 1e-4 * totals[0] and sim.log[-1].layers == 0  # they met, and parted
    assert np.diff(totals).max() < 1e-3 * totals[0]
    sim.close()


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.slow
def test_what_hits_does_not_pass(precision):
    scene, a, sim = two_sheets(0.05, (0.0, -6.0, 0.0), 0.2, precision=precision, count_intersections=True)
    for _ in range(8):
        sim.step()
    assert [r.intersections for r in sim.log] == [0] * len(sim.log)
    n = a.mesh.vertex_count
    x, v = sim.positions(), sim.velocities()
    assert (x[n:, 1] > x[:n, 1]).all()
    assert v[:n, 1].mean() < -2.5 and max(r.layers for r in sim.log) > 50
    sim.close()


def test_pairs_are_compared_where_the_model_is():
    """As if measured anew, after solves that went all of their way and after those that were cut short."""
    scene, a, sim = two_sheets(0.05, (0.0, -6.0, 0.0), 0.2)
    layers, parts = sim.contacts.layers, []
    look, advance = layers.look, layers.advance

    def looked() -> None:
        look()
        if layers.compared is not None:
            assert (layers.compared.measured == layers._measure(layers.linearized)).all()

    def advanced() -> float:
        parts.append(advance())
        return parts[-1]

    layers.look, layers.advance = looked, advanced
    for _ in range(5):
        sim.step()
    assert min(parts) < 1 and max(parts) == 1
    sim.close()


@pytest.mark.slow
def test_the_same_twice_and_resumed():
    scene, a, sim = two_sheets(0.02, (0.2, -1.0, 0.0), 0.3, gravity=(0, -9.81, 0))
    while not (sim.log and sim.log[-1].layers):
        sim.step()
    state = sim.checkpoint()
    for _ in range(4):
        sim.step()
    end = sim.positions()
    sim.close()
    scene, a, again = two_sheets(0.02, (0.2, -1.0, 0.0), 0.3, gravity=(0, -9.81, 0))
    again.resume(state)
    for _ in range(4):
        again.step()
    assert np.array_equal(again.positions(), end)
    for change, what in (({"version": np.array(1)}, "of version 1, and this"), ({}, "no 'spared': it is of a run with other")):
        broken = {**state, **change}
        del broken["contacts.solids.penetration.spared"]
        with pytest.raises(tc.SceneError, match=what):
            again.resume(broken)
    state = again.checkpoint()
    kept = {name: array.copy() for name, array in state.items()}
    again.contacts.layers.release_around(np.arange(3))  # what goes on in a simulation changes no checkpoint of it
    assert again.contacts.layers.intersections.until.any() and not kept["contacts.layers.intersections.until"].any()
    assert all(np.array_equal(state[name], kept[name]) for name in kept)
    again.close()


@pytest.mark.slow
def test_a_step_in_which_layers_turn_out_to_meet_begins_anew():
    """Its second attempt starts from the saved state, and not from where the first one ended."""
    sim = two_sheets(0.02, (0.3, -2.0, 0.0), contact_tol=None)[2]
    while not sim.log or not sim.log[-1].layers:
        x, v = sim.model.read_particles()
        sim.step()
    start = sim.contacts.start
    assert start.together and start.h == sim.log[-1].h == pytest.approx(1 / 60)
    assert (start.x == x).all() and (start.v == v).all()
    layers = sim.contacts.layers
    assert sim.contacts.touching and layers.count > 0 and not layers.intersections.active
    layers.count = 0  # what crosses keeps contact in mind, also where all of its pairs rest
    assert not sim.contacts.touching
    layers.intersections.active = True
    assert sim.contacts.touching
    sim.close()


@pytest.mark.parametrize("smallest, part, released", [(False, 0.5, False), (True, 0.5, True), (True, 1.0, False)])
def test_only_what_nothing_else_can_make_room_for_is_released(smallest, part, released):
    """In the smallest of steps; nowhere else, and not what went all its way."""
    asked = []
    step = LayerStep.__new__(LayerStep)
    step.layers = SimpleNamespace(release=lambda: asked.append(1) or True, unsettled=3, least=0.2,
                                  intersections=SimpleNamespace(active=False))
    step.contacts = SimpleNamespace(start=SimpleNamespace(small=True, smallest=smallest))
    step.held, step.part, step.agreed, step.released = None, part, False, False
    step.solutions, step.conclude = [], lambda measures, early=False: None
    assert step.give_up(None).rejection == "CONTACT" and step.released is released
    assert asked == ([1] if released else [])


@pytest.mark.parametrize("k, part, settled, asks", [(4, 1.0, False, True), (4, 0.5, False, True), (3, 1.0, False, False),
                                                    (4, 1.0, True, False)])
def test_what_beside_a_tangle_ends_too_near_is_released(k, part, settled, asks):
    """In steps of any size, after five solves; and a solve that is stopped short stiffens what stopped it."""
    stopped = []
    step = LayerStep.__new__(LayerStep)
    step.layers = SimpleNamespace(release_beside=lambda held: True, unsettled=0, least=0.2, settled=lambda: settled, ROUNDS=12,
                                  stop_short=lambda: stopped.append("layers"))
    solids = SimpleNamespace(holds=lambda: None, unsettled=0, ends_deep=lambda: False)
    step.contacts = SimpleNamespace(count=0, solids=solids, forcing_terms=ForcingTerms(),
                                    stop_short=lambda: stopped.append("solids"))
    step.preliminary = False
    step.clock, step.agrees, step.released = Clock(), True, False
    step.solutions, step.conclude = [], lambda measures, early=False: None
    step.accounted = lambda ended: ended
    made = step.judge(k, part, None)
    assert step.released is asks and (made is not None and made.rejection == "CONTACT") is asks
    assert stopped == (["solids", "layers"] if part < 1 else [])


def test_no_step_of_layers_ends_with_a_preliminary_solve():
    """Whatever agrees with it: the next one's answer is taken."""
    step = LayerStep.__new__(LayerStep)
    step.layers = SimpleNamespace(settled=lambda: True, ROUNDS=12)
    solids = SimpleNamespace(unsettled=0, ends_deep=lambda: False)
    step.contacts = SimpleNamespace(count=0, solids=solids, forcing_terms=ForcingTerms())
    step.clock, step.agrees, step.released, step.preliminary = Clock(), True, False, True
    step.solutions, step.conclude, step.accounted = [], lambda measures, early=False: ("end", None), lambda ended: ended
    step.finish = lambda *ended: ended
    assert step.judge(0, 1.0, None) is None and not step.agreed and not step.preliminary
    assert step.judge(1, 1.0, None) == ("end", None) and step.agreed


@pytest.mark.parametrize("k, deep, ends", [(LATER - 1, False, False), (LATER, False, True), (LATER, True, False)])
def test_contacts_with_solids_that_still_change_do_so_in_the_next_step(k, deep, ends):
    """After three Newton steps of one with layers of cloth, and no sooner; not with particles too deep in solids."""
    step = LayerStep.__new__(LayerStep)
    step.layers = SimpleNamespace(settled=lambda: True, ROUNDS=12, release_beside=lambda held: False)
    solids = SimpleNamespace(unsettled=1, holds=lambda: None, ends_deep=lambda: deep)
    step.contacts = SimpleNamespace(count=9, solids=solids, forcing_terms=ForcingTerms())
    step.clock, step.agrees, step.released, step.preliminary = Clock(), False, False, False
    step.solutions, step.conclude, step.accounted = [], lambda measures, early=False: ("end", None), lambda ended: ended
    step.finish = lambda *ended: ended
    assert (step.judge(k, 1.0, None) == ("end", None)) is ends


def crossing_scene() -> tc.Scene:
    mesh, contact, tilt = tc.grid(0.3, 13), tc.ClothContact(0.005, 0.2), np.radians(25)
    turn = np.array([[np.cos(tilt), -np.sin(tilt), 0], [np.sin(tilt), np.cos(tilt), 0], [0, 0, 1]])
    scene = tc.Scene(gravity=None)
    damped = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5, k_d=1e-6))
    scene.add_cloth(mesh, damped, contact=contact)
    scene.add_cloth(mesh, damped, positions=(mesh.x - [0.08, 0, -0.15]) @ turn.T + [0.12, 0.003, -0.16], contact=contact)
    return scene


@pytest.mark.slow
def test_what_starts_crossed_is_counted_named_and_pulled_apart():
    sim = tc.Simulation(crossing_scene(), h=1 / 60, count_intersections=True)
    before = sim.intersections()
    assert before >= 50 and any("pass through each other at the start" in note for note in sim.notes)
    speeds = []
    for _ in range(60):
        sim.step()
        speeds.append(np.abs(sim.velocities()).max())
    assert sim.intersections() == 0 and max(speeds) < 2
    assert [r.known_intersections for r in sim.log] == [r.intersections for r in sim.log]  # not a step late
    sim.close()


def test_tables_of_crossings_are_made_where_something_crosses():
    """Which faces are at an edge, 12 numbers a vertex, is for tangles alone."""
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.2, -1], [0.2, 0.2, 1], [5, 5, 1]])
    mesh = SimpleNamespace(faces=np.array([[0, 1, 2], [3, 4, 5]], dtype=np.int32), half_thickness=np.ones(6),
                           cluster_ids=np.arange(6), may_meet=lambda a, b: np.ones(len(a), dtype=bool))
    tangles = Intersections(6, mesh, "untangle")
    tangles.look(x + np.outer([0, 0, 0, 1, 1, 1], [9.0, 0, 0]))
    assert tangles.count == 0 and "_sides" not in vars(tangles)
    tangles.look(x)
    assert tangles.count == 2 and "_sides" in vars(tangles)
    assert (tangles._faces_of(np.array([[0, 1], [3, 4], [0, 2]])) == [[0, -1], [1, -1], [0, -1]]).all()


@pytest.mark.parametrize("crossings, sewn, firmer", [(20, [], True), (21, [], False), (30, [95], True), (30, [1, 4, 7], False),
                                                     (30, [3 * k for k in range(10)], True)])
def test_a_tangle_is_as_large_as_what_crosses_away_from_seams(crossings, sewn, firmer):
    """Of 20 crossings without a sewn corner at most, it is led twice as firmly after a usual step. One edge crosses all."""
    cluster_ids = np.arange(99)
    cluster_ids[sewn] = 98
    mesh = SimpleNamespace(faces=np.arange(90).reshape(30, 3)[:crossings], half_thickness=np.ones(99), cluster_ids=cluster_ids,
                           around=lambda some: some)
    tangles = Intersections(99, mesh, "untangle")
    tangles.edges = np.tile([95, 96], (crossings, 1))
    tangles.rows = np.arange(crossings)
    tangles.found = tangles.edges, tangles.rows
    tangles.commit(1 / 60, 1.0)
    crosses = np.concatenate([np.arange(3 * crossings), [95, 96]])
    assert (tangles.firm[crosses] == (2.0 if firmer else 1.0)).all() and tangles.firm.sum() == 99 + firmer * len(set(crosses))


def test_what_a_tangle_or_a_pinch_holds_too_near_is_let_go():
    """Pairs of what rests that end too near rest as well, if the nearest of all is one; else a smaller step is tried. And so
    do those of what is pinched with what solids hold."""
    _, a, sim = two_sheets(0.012)
    layers, n, particle = sim.contacts.layers, a.mesh.vertex_count, sim.model.particle
    x = sim.positions()
    x[n:, 1] = (0.1 + 2 * (x[n:, 0] - x[n:, 0].min())) * 0.005  # from a tenth of the distance to more than a half
    sim.set_state(x, 0 * x)
    layers.detector.cover()

    def gaps() -> np.ndarray:
        """Of each particle to what it is nearest to, over the distance."""
        layers.look()
        p, out = layers.near, np.full(sim.model.n, np.inf)
        np.minimum.at(out, p.vertices, np.broadcast_to((p.end / p.radius)[:, None], p.vertices.shape))
        return out[particle]

    def rest(which: np.ndarray) -> None:
        layers.intersections.until[:] = 0.0
        layers.intersections.until[particle[which]] = 1.0
        layers.intersections.commit()

    before = gaps()
    edge, other = (n + a.mesh.groups[name] for name in ("left", "right"))
    near = n + np.flatnonzero(x[n:, 0] < x[n:, 0].min() + 0.05)
    layers.least_before = 0.9
    assert before[edge] == pytest.approx(0.1, abs=0.02) and before.min() == layers.least
    nothing, below = np.zeros(sim.model.n, dtype=bool), np.zeros(sim.model.n, dtype=bool)
    below[particle[:n]] = True
    rest(np.zeros(0, dtype=int))
    assert not layers.release_beside(below)  # nothing is tangled, nor pinched
    rest(np.setdiff1d(near, edge))
    assert not layers.release_beside(nothing) and gaps().min() == before.min()  # what is, is not the nearest
    rest(np.concatenate([edge, other]))  # the other side rests too, with room enough
    assert layers.release_beside(nothing)
    parting = layers.intersections.parting[0]
    assert len(parting) == 0, "a tangle leads its edges out of triangles"
    after = gaps()
    assert (after[edge] > before[edge] + 0.01).all()
    far = before > 0.35
    assert far.sum() > 40 and after[far] == pytest.approx(before[far])
    rest(np.zeros(0, dtype=int))
    pinched = nothing.copy()
    pinched[particle[near]] = True
    layers.waive(pinched, np.zeros(0, dtype=int))
    assert gaps()[edge] == pytest.approx(before[edge])
    assert not layers.release_beside(nothing)  # the other side goes where it is pushed
    assert layers.release_beside(below) and (gaps()[edge] > before[edge] + 0.01).all()
    vertices, weights, normal, radius = layers.intersections.parting
    assert np.isin(particle[edge], vertices).all(), "what solids squeeze is led apart"
    high = np.einsum("ka,kai,ki->k", weights, sim.positions()[np.argsort(particle)][vertices], normal)
    assert (high > 0).all() and high.min() < 0.2 * radius.max()
    layers.waive(nothing, np.zeros(0, dtype=int))
    rest(edge)
    layers.least_before = -1.0  # it was nearer before the step
    assert not layers.release_beside(nothing)
    sim.close()


@pytest.mark.parametrize("resting, led, left_alone", [
    ((), (), False), ((3,), (), False), ((0, 1), (), False), ((3, 0), (), True), ((3, 2), (), True), ((0, 1, 2), (), False),
    ((), (0, 1, 2, 3), True), ((), (3, 0, 1), False), ((3,), (0, 1), False), ((3,), (0, 1, 2), True)])
def test_a_vertex_and_a_face_are_left_alone_where_either_rests(resting, led, left_alone):
    """So that what passes through is found among faces with a particle that rests: the vertex's, and the other. And where
    solids lead all of their particles: what has any other can keep apart."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0.3, 0.3 * THICKNESS, 0.3], [0.3, 1, 0.3], [0.4, 1, 0.3]])
    scene = tc.Scene()
    scene.add_cloth(tc.TriMesh(10 * x, np.arange(6).reshape(-1, 3)), FABRIC, positions=x, contact=tc.ClothContact(THICKNESS))
    made = detector(scene)
    particle, masks = made.model.particle, np.zeros((2, 6), dtype=bool)
    for mask, of in zip(masks, (resting, led)):
        mask[particle[list(of)]] = True
    made.let_rest(*masks)
    made.cover()
    found = made.look()
    there = (found.pair[:, 2] == VERTEX_FACE) & (found.vertices[:, 0] == particle[3])
    assert there.any() != left_alone


@pytest.mark.parametrize("began, ended, too_near", [(0.15, 0.22, False), (0.3, 0.22, True), (0.22, 0.22, True),
                                                    (0.3, 0.29, False)])
def test_what_starts_too_near_and_parts_is_not_too_near(began, ended, too_near):
    """Pairs that a tangle or solids held, and that count again, begin nearer than a step leaves those that counted before."""
    _, a, sim = two_sheets(0.012)
    layers, x = sim.contacts.layers, sim.positions()

    def at(gap: float) -> np.ndarray:
        x[a.mesh.vertex_count:, 1] = gap * 0.005
        return x

    sim.set_state(at(began), 0 * x)
    layers.least_before = 0.9
    sim.model.write(at(ended), 0 * x)
    layers.detector.cover()
    layers.look()
    assert layers.least == pytest.approx(ended)
    assert layers._too_near().any() == too_near
    sim.close()


@pytest.mark.slow
def test_a_run_resumed_in_contact_goes_on_bit_for_bit(rng):
    """With layers that press, rub, are tangled and pinched, and stiffened pairs; and all of that decides how it goes on, if
    not from each of three steps, since a tangle may come apart in the second."""
    def start() -> tc.Simulation:
        return two_sheets(0.012, (0.2, -1.0, 0.0), 0.3, gravity=(0, -9.81, 0), integrator="safe")[2]

    def end(sim: tc.Simulation) -> np.ndarray:
        for _ in range(2):
            sim.step()
        return np.stack([sim.positions(), sim.velocities()])

    sim = start()
    x, v, n = sim.positions(), sim.velocities(), sim.vertex_count // 2
    x[n] -= [0, 0.08, 0]  # a corner of the upper one is through the lower
    sim.set_state(x, v)
    sim.step()
    layers, states = sim.contacts.layers, []
    layers.adaptive_stiffness.scale = rng.choice([1.0, 3.0], size=sim.model.n)
    layers.intersections.release(rng.choice(sim.model.n, 30, replace=False))
    layers.detector.let_rest(layers.intersections.resting)
    for k in range(3):
        sim.step()
        states.append(sim.checkpoint())
        assert k > 1 or min(sim.log[-1].layers, sim.log[-1].pinched, len(states[k]["contacts.layers.kept.force"])) >= 10
    assert sim.log[1].known_intersections >= 10
    sim.step()
    rested = np.maximum(states[-1]["contacts.layers.intersections.until"] - (sim.time - float(states[-1]["time"])), 0)
    assert np.allclose(layers.intersections.until, rested, atol=1e-12) and rested.max() > 0.01
    wholes = []
    for state in states:
        sim.resume(state)
        wholes.append(end(sim))
    sim.close()
    again = start()
    decides: dict[str, list[bool]] = {}
    for state, whole in zip(states, wholes):
        again.resume(state)
        assert np.array_equal(end(again), whole)
        for name, other in (("kept.force", 0.0), ("adaptive_stiffness.scale", 1.0), ("shift.parts", 0.0),
                            ("intersections.until", 0.0), ("intersections.firm", 64.0), ("intersections.rows", None)):
            changed = {f"contacts.layers.{name}": other}
            if other is None:  # no crossing
                changed = {f"contacts.layers.intersections.{part}": None for part in ("edges", "rows")}
            again.resume({**state, **{k: state[k][:0] if a is None else np.full_like(state[k], a)
                                      for k, a in changed.items()}})
            decides.setdefault(name, []).append(not np.array_equal(end(again), whole))
    assert all(map(any, decides.values())), decides
    again.resume(states[1])  # what it went through in between has left nothing behind
    assert again.contacts.layers.least_before == states[1]["contacts.layers.least_before"] < 1
    assert np.array_equal(end(again), wholes[1])
    again.close()


@pytest.mark.slow
def test_what_is_around_some_particles_rests_for_a_tenth_of_a_second():
    """Pairs with a neighbour on either side, and no others."""
    _, _, sim = two_sheets(0.004)
    layers, faces, n = sim.contacts.layers, sim.contacts.layers.detector.mesh.faces, sim.model.n

    def pairs() -> dict:
        layers.detector.paths.begin()
        layers.detector.cover()
        found = layers.detector.look()
        sides = [(w[1:] if kind == VERTEX_FACE else w[2:]) for w, kind in zip(found.vertices.tolist(), found.pair[:, 2])]
        return {(tuple(w[: 4 - len(other)]), tuple(other)) for w, other in zip(found.vertices.tolist(), sides)}

    before, some = pairs(), sim.model.particle[[40, 121]]
    around = np.zeros(n, dtype=bool)
    around[faces[np.isin(faces, some).any(axis=1)]] = True
    layers.release_around(some)
    left = {(a, b) for a, b in before if not (around[list(a)].any() and around[list(b)].any())}
    assert pairs() == left and 10 < len(left) < len(before) - 10
    for _ in range(7):
        sim.step()
    assert not layers.intersections.active
    sim.close()


@pytest.mark.slow
def test_tangles_can_be_left_alone_or_refused():
    with pytest.raises(tc.SceneError, match="pass through each other at the start"):
        tc.Simulation(crossing_scene(), tangles="abort")
    with pytest.raises(tc.SceneError, match="did you mean 'ignore'"):
        tc.Simulation(crossing_scene(), tangles="ignroe")
    sim = tc.Simulation(crossing_scene(), h=1 / 60, integrator="backward_euler", tangles="ignore")
    before = sim.intersections()
    for _ in range(5):
        sim.step()
    assert abs(sim.intersections() - before) < 0.1 * before and np.abs(sim.velocities()).max() < 0.3
    sim.close()


@pytest.mark.slow
def test_cloths_can_pass_through_each_other():
    scene, mesh, contact = tc.Scene(gravity=None), tc.grid(0.2, 4), tc.ClothContact(0.005)
    a = scene.add_cloth(mesh, FABRIC, contact=contact)
    b = scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0, 0.02, 0], velocities=(0, -1, 0), contact=contact)
    scene.pass_through(a, b)
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    for _ in range(4):
        sim.step()
    assert np.allclose(sim.velocities()[25:], [0, -1, 0], atol=1e-6) and sim.positions()[25:, 1].max() < 0
    with pytest.raises(tc.SceneError, match="twice"):
        scene.pass_through(a, a)
    sim.close()


def test_explicit_steps_refuse_it_and_bad_values_are_named():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 2), FABRIC, contact=tc.ClothContact(0.01))
    with pytest.raises(tc.SceneError, match="knows no contact"):
        tc.Simulation(scene, integrator="verlet")
    with pytest.raises(tc.SceneError, match="thickness = -1"):
        tc.ClothContact(-1)
    with pytest.raises(tc.SceneError, match="must be a ClothContact"):
        scene.add_cloth(tc.grid(1.0, 2), FABRIC, contact=0.01)


@pytest.mark.slow
def test_without_contact_none_of_it_is_imported():
    """A mesh large enough for the multilevel preconditioner: no contact at all; on a solid: none of cloth against cloth."""
    code = """
import sys
import taichi_cloth as tc

def step(touches):
    scene, mesh = tc.Scene(), tc.grid(1.0, 23)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), bend=tc.Bend(1e-5)), positions=mesh.x + [0, 0.004, 0])
    if touches:
        scene.add_solid(tc.Plane(), friction=0.3, thickness=0.005)
    sim = tc.Simulation(scene, threads=1)
    sim.step()
    ours = {m.removeprefix("taichi_cloth.") for m in sys.modules if m.startswith("taichi_cloth.")}
    print(*sorted(m for m in ours if m.startswith("contact") or m.endswith("_contact")))
    return sim

assert step(False).contacts is None
sim = step(True)
assert sim.log[-1].contacts > 500 and sim.contacts.layers is None
assert not hasattr(sim.contacts.force, "rotation_coupling") and sim.contacts.force.capacity < 8 * 576 + 40000
"""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    lines = done.stdout.splitlines()
    assert lines[-2] == ""  # of a scene without solids and contact
    some = set(lines[-1].split())
    assert {"contact.contacts", "contact.points"} <= some and not {m for m in some if m.startswith("contact.cloth")}
    assert "contact.pair_geometry" not in some
    assert {m for m in some if m.startswith("step")} == {"step.nonlinear.solid_contact", "step.nonlinear.solved_contact"}


@pytest.mark.slow
def test_a_pair_is_neither_pushed_nor_turned_nor_braked_as_it_turns(rng):
    """Weights add up to 0, the normal is that of the shortest way, and the turns make up for the gap between the two places at
    which friction acts."""
    sim = tc.Simulation(soup(rng, 90), integrator="backward_euler")
    layers, x = sim.contacts.layers, sim.model.read_particles()[0]
    layers.clear()
    layers.begin(dataclasses.replace(layers.start, h=1 / 60, x=x), True)
    sim.model.write_particles(2 * x, np.zeros_like(x))  # a solve asks for them from elsewhere
    layers.points(x)
    took, p = layers.linearized, layers.near
    assert len(p.end) > 50 and np.allclose(p.along(x), p.end, rtol=1e-12, atol=1e-15)
    across = rng.normal(size=(len(p.end), 3))
    across -= np.einsum("ki,ki->k", across, p.normal)[:, None] * p.normal
    counts = took.weighed[MU] / took.weighed[MU].max()
    assert np.mean(counts == 1) > 0.8 and counts.min() < 1  # the latter: edges near parallel
    for force in (p.normal, counts[:, None] * across):
        push = np.stack([one(sim.model.n, took.points, k, force) for k in range(len(p.end))])
        size = np.abs(push).sum(axis=(1, 2))
        assert size.max() < 30 and np.abs(push.sum(axis=1)).max() < 1e-12
        assert np.abs(np.cross(x, push).sum(axis=1)).max() < 1e-12
    turning = np.cross(rng.normal(size=3), x - rng.normal(size=3)) + rng.normal(size=3)
    assert np.abs(counts[:, None] * took.slip(turning)).max() < 1e-12
    slid = took.slip(rng.normal(size=x.shape))
    assert (np.linalg.norm(slid, axis=1) > 1e-3).all()
    sim.close()


def one(n: int, points: ContactRows, k: int, forces: np.ndarray) -> np.ndarray:
    """(n, 3) what a force on point k alone is for the particles."""
    out = np.zeros((n, 3))
    ContactRows(*(value[k:k + 1] for f in dataclasses.fields(ContactRows) if (value := getattr(points, f.name)) is not None)
                ).spread(forces[k:k + 1], out)
    return out


@ti.data_oriented
class Diagonal:
    """What points of contact add to the diagonal blocks."""

    def __init__(self, sim: tc.Simulation) -> None:
        self.touch, self.blocks = sim.contacts.force, sim.model.blocks
        self.P = ti.Vector.field(6, ti.f64, shape=sim.model.n)

    @ti.kernel
    def add(self):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.touch.add_diagonal(t // self.blocks.grain, self.P)


def test_points_of_contact_join_the_product_and_its_diagonal(rng):
    _, a, sim = two_sheets(0.004, friction=0.3)
    n = sim.model.n
    R = rng.normal(size=(40, 3, 3))
    block = np.einsum("kia,kja->kij", R, R)[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    vertices = np.stack([rng.choice(n, 4, replace=False) for _ in range(40)])
    p = ContactRows(vertices, rng.normal(size=(40, 4)), block, rng.normal(size=(40, 3)), rng.normal(size=(40, 3)),
                    rng.normal(size=(40, 4, 3)))
    v = rng.normal(size=(n, 3))
    assert sim.contacts.force.set(p)
    product, right = sim.product(v, 1 / 60), sim.right_hand_side(1 / 60)
    diagonal = Diagonal(sim)
    diagonal.add()
    assert sim.contacts.force.set(ContactRows(p.vertices[:0], p.weights[:0], p.block[:0], p.rhs[:0]))
    product -= sim.product(v, 1 / 60)
    right -= sim.right_hand_side(1 / 60)
    A, J = block[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3), np.zeros((40, 3, n, 3))
    for k in range(40):
        for i, w, t in zip(p.vertices[k], p.weights[k], p.rotation_coupling[k]):
            J[k, :, i] += w * np.eye(3) + np.outer(t, p.normal[k])
    mine = sim.model.to_user(np.einsum("kanb,kac,kcmd,md->nb", J, A, J, sim.model.to_particles(v), optimize=True))
    assert np.abs(product - mine).max() < 1e-12 * np.abs(mine).max()
    push = sim.model.to_user(np.einsum("kanb,ka->nb", J, p.rhs))
    assert np.abs(right - push).max() < 1e-12 * np.abs(push).max()
    blocks = np.einsum("kanb,kac,kcnd->nbd", J, A, J, optimize=True)[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]
    assert np.abs(diagonal.P.to_numpy() - blocks).max() < 1e-12 * np.abs(blocks).max()
    sim.close()
