"""Cloth against cloth, number by number, against `reference.contact`: what is found, how far the way is free, what a solve is
told. Numbers that decide are stated here or there, not read from what is tested."""

import dataclasses

import numpy as np
import pytest
from reference import contact as ref

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import write
from taichi_cloth.contact.cloth import barrier as repulsion
from taichi_cloth.contact.cloth.contact_pairs import AdaptiveStiffness, EndedPairs
from taichi_cloth.contact.cloth.narrow_phase import LayerDetector
from taichi_cloth.contact.cloth.pair_kernels import BACK, BEARS, FORCE, GAP, LED, OWN, POTENTIAL, RUBBED, STIFF
from taichi_cloth.contact.pair_geometry import between, closing, fading, gap
from taichi_cloth.scene import intersections
from taichi_cloth.system.state import ParticleState

THICK = (0.05, 0.03)  # m, of two cloths
SKIN = 0.2 * 0.03  # m that particles may stray, of the thinner one's thickness
H = 1 / 60


def soup(rng, count: int = 26, reach: float = 0.7) -> tc.Scene:
    """Triangles of some 0.2 m of two cloths thrown into a box; some of them are near each other also at rest."""
    scene = tc.Scene()
    for thickness, friction, density in zip(THICK, (0.2, 0.7), (0.2, 0.5)):
        x = (reach * rng.uniform(size=(count, 1, 3)) + 0.1 * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
        mesh = tc.TriMesh(x + 0.06 * rng.normal(size=x.shape), np.arange(3 * count).reshape(-1, 3))
        scene.add_cloth(mesh, tc.Fabric(density, tc.Stretch(1000)), positions=x, velocities=rng.normal(size=x.shape),
                        contact=tc.ClothContact(thickness, friction))
    return scene


def detector(scene: tc.Scene, precision: str = "f64") -> LayerDetector:
    run = runtime.start("cpu", precision)
    fields = Fields(run.exchange, pooled=True)
    model = ParticleState(fields, scene, run)
    made = LayerDetector(fields, model, scene, not run.device, 0.2)
    fields.allocate()
    made.model.save()
    return made


class Truth:
    """All pairs of a scene's cloths, and what each should keep."""

    def __init__(self, scene: tc.Scene, d: LayerDetector) -> None:
        self.row, self.kind, self.four = ref.all_pairs(d.mesh.edges, d.mesh.faces)
        user = d.model.user
        owner = np.repeat([0, 1], [c.mesh.vertex_count for c in scene.cloths])[user]
        rest = np.concatenate([c.mesh.x for c in scene.cloths])[user]
        a, b = owner[self.four[:, 0]], owner[self.four[:, 3]]
        self.radius = (np.array(THICK)[a] + np.array(THICK)[b]) / 2
        near = ref.distances(self.kind, rest[self.four]) / 2
        self.limited = (a == b) & (near < self.radius)
        self.radius[self.limited] = near[self.limited]
        self.key = {(*sorted(r), 1) if k else (*r, 0): i for i, (r, k) in enumerate(zip(self.row.tolist(), self.kind))}

    def rows(self, pair: np.ndarray) -> np.ndarray:
        """Which of all pairs those found (k, 3) are."""
        return np.array([self.key[(*sorted(p[:2]), 1) if p[2] else tuple(p)] for p in pair.tolist()], dtype=np.int64)


@ti.kernel
def _pairs(kind: ti.types.ndarray(), x: ti.types.ndarray(), way: ti.types.ndarray(), out: ti.types.ndarray()):
    for k in range(kind.shape[0]):
        p = ti.Matrix([[x[k, a, c] for c in ti.static(range(3))] for a in ti.static(range(4))])
        q = ti.Matrix([[way[k, a, c] for c in ti.static(range(3))] for a in ti.static(range(4))])
        a, b, c, d = p[0, :], p[1, :], p[2, :], p[3, :]
        difference, w = between(kind[k], a, b, c, d)
        for i in ti.static(range(3)):
            out[k, i] = difference[i]
        for i in ti.static(range(4)):
            out[k, 3 + i] = w[i]
        out[k, 7] = fading(kind[k], w, a, b, c, d)
        out[k, 8] = closing(kind[k], q[0, :], q[1, :], q[2, :], q[3, :])
        out[k, 9] = gap(kind[k], a, b, c, d)


def odd_pairs(rng) -> np.ndarray:
    """(k, 4, 3) pairs in all regions, and degenerate ones: on a lattice many are parallel, in one plane, on each other."""
    lattice = rng.integers(0, 3, size=(3000, 4, 3)).astype(float)
    slim = rng.normal(size=(1000, 4, 3)) * [1.0, 1.0, 0.03]
    return np.concatenate([rng.normal(size=(2000, 4, 3)), slim, lattice])


def test_pairs_are_where_the_reference_has_them(rng):
    """Distances, weights, fading, and bounds of what can happen to a distance."""
    x = np.concatenate([odd_pairs(rng)] * 2)
    kind = np.repeat([0, 1], len(x) // 2).astype(np.int32)
    way = rng.normal(size=x.shape) * rng.choice([0.01, 1.0], size=(len(x), 1, 1)) + rng.normal(size=(len(x), 1, 3))
    runtime.start("cpu", "f64")
    out = np.empty((len(x), 10))
    _pairs(kind, x, way, out)
    w, d = ref.weights_of(kind, x), ref.distances(kind, x)
    difference = np.einsum("ka,kai->ki", out[:, 3:7], x)
    assert np.abs(difference - out[:, :3]).max() < 1e-12
    assert np.abs(np.linalg.norm(out[:, :3], axis=1) - d).max() < 1e-7  # of edges near parallel; of all others:
    edges = np.cross(x[:, 1] - x[:, 0], x[:, 3] - x[:, 2])
    clear = (kind == 0) | (np.linalg.norm(edges, axis=1) > 1e-3)
    assert np.abs(np.linalg.norm(out[:, :3], axis=1) - d)[clear].max() < 1e-12
    usual = np.repeat(np.arange(len(x) // 2) < 2000, 1)  # there is one answer
    usual = np.concatenate([usual, usual])
    assert np.abs(out[usual, 3:7] - w[usual]).max() < 1e-8
    assert np.abs(out[usual, 7] - ref.fading(kind, w, x)[usual]).max() < 1e-6
    assert np.abs(ref.fading(kind, out[:, 3:7], x) - out[:, 7]).max() < 1e-9
    faded = out[kind == 1, 7]
    assert ((faded > 0) & (faded < 1)).sum() > 50
    assert np.allclose(out[:, 8], ref.speed(kind, way), rtol=1e-12)
    assert (out[:, 9] <= d + 1e-12).all() and np.mean(out[usual, 9] > 0.3 * d[usual]) > 0.3
    boxes = [x[:, :1], x[:, 1:]], [x[:, :2], x[:, 2:]]
    apart = [np.maximum(a.min(axis=1) - b.max(axis=1), b.min(axis=1) - a.max(axis=1)).max(axis=1) for a, b in boxes]
    assert np.allclose(out[:, 9], np.where(kind == 0, *apart), atol=1e-12)


@ti.kernel
def _law(d: ti.types.ndarray(), r: ti.types.ndarray(), s: ti.types.ndarray(), out: ti.types.ndarray()):
    for k in range(d.shape[0]):
        force, slope = repulsion.law(d[k], r[k], s[k])
        out[k, 0], out[k, 1], out[k, 2] = repulsion.potential(d[k], r[k], s[k]), force, slope


def test_repulsion_is_the_law(rng):
    """Energy, force and slope at distances from below 0 to beyond reach, of pairs that keep different ones, and of some that
    begin to repel further away."""
    r = rng.choice([0.002, 0.01, 0.3], size=4000)
    d = r * np.concatenate([rng.uniform(*ends, size=count)  # everywhere, about the floor, and deep below it
                            for ends, count in (((-0.01, 1.3), 2000), ((0.19, 0.23), 1000), ((0.0, 0.03), 1000))])
    s = r * rng.uniform(0, 0.25, size=4000) * rng.choice([0, 1], size=4000)
    runtime.start("cpu", "f64")
    out = np.empty((len(d), 3))
    _law(d, r, s, out)
    mine = np.array([ref.repulsion(*each) for each in zip(d, r, s)])
    deep = d > 0.02 * r  # below which the force stays, and the slope stands for it
    assert np.abs(out[:, :2] - mine[:, :2]).max(axis=0) == pytest.approx([0, 0], abs=1e-12)
    assert np.abs(out / mine - 1)[deep & (d < r + s - 0.01 * r)].max() < 1e-9
    assert (out[~deep, 2] > 0).all() and (~deep).sum() > 100


@pytest.mark.parametrize("precision, layout, shifted", [("f64", "cpu", 0.0), ("f64", "cpu", 0.25), ("f64", "device", 0.25),
                                                        ("f32", "cpu", 0.0)])
def test_all_pairs_in_reach_are_found_as_they_are(rng, monkeypatch, precision, layout, shifted):
    """Also after particles have strayed within the skin, each where that matters most; what is limited by rest; and what
    repels further away."""
    monkeypatch.setenv(runtime.LAYOUT, layout)
    scene = soup(rng)
    d = detector(scene, precision)
    every = Truth(scene, d)
    shifts = shifted * rng.choice([0.5, 1.0], size=d.model.n)
    write(d.mesh.shifts, shifts.astype(d.exchange))
    d.paths.begin()
    d.cover()
    x, small = d.model.read_particles()[0].astype(float), 1e-12 if precision == "f64" else 1e-6
    for stray in (0.0, 0.97 * SKIN):
        if stray:
            four, gone = every.four, ref.distances(every.kind, x[every.four])
            w = ref.weights_of(every.kind, x[four])
            n = np.einsum("ka,kai->ki", w, x[four]) / gone[:, None]
            moved, way = np.zeros(len(x), dtype=bool), np.zeros_like(x)
            over = gone - every.radius * (1 + np.einsum("ka,ka->k", np.abs(w), shifts[four]) / 2)
            wanted = np.flatnonzero((over > 0.4 * SKIN) & (over < 1.9 * SKIN))
            for k in wanted[np.argsort(-over[wanted])]:  # those that come from furthest first
                if not moved[four[k]].any():
                    moved[four[k]] = True
                    way[four[k]] = -np.sign(w[k])[:, None] * stray * n[k]
            assert moved.sum() > 20
            x = x + way
            d.model.write_particles(x, np.zeros_like(x))
            d.model.save()
            d.paths.begin()
            assert d.paths.count_deviating() == 0
        p = d.look()
        x = d.model.read_particles()[0].astype(float)
        rows, four = every.rows(p.pair), x[every.four]
        gone, w = ref.distances(every.kind, four), ref.weights_of(every.kind, four)
        counts = ref.fading(every.kind, w, four)
        assert len(set(rows.tolist())) == len(rows)
        reach = every.radius * (1 + np.einsum("ka,ka->k", np.abs(w), shifts[every.four]) / 2)
        sure = (gone < reach * (1 - 1e-5)) & (counts > 1e-5)
        maybe = (gone < reach * (1 + 1e-5)) & (counts > 1e-7)
        found = np.zeros(len(gone), dtype=bool)
        found[rows] = True
        assert not (sure & ~found).any() and not (found & ~maybe).any()
        assert (found & (every.kind == 0)).sum() > 40 and (found & (every.kind == 1)).sum() > 40
        assert (found & every.limited).sum() > 5
        assert np.abs(p.radius - every.radius[rows]).max() < small
        assert np.abs(p.end - gone[rows]).max() < small and np.abs(p.start - gone[rows]).max() < small
        place = np.einsum("ka,kai->ki", p.weights, x[p.vertices])
        assert np.abs(place - p.end[:, None] * p.normal).max() < 10 * small
        assert (np.sort(p.vertices, axis=1) == np.sort(every.four[rows], axis=1)).all()
        if precision == "f64":
            assert np.abs(p.factor - counts[rows]).max() < 1e-6


def free_parts(d: LayerDetector) -> np.ndarray:
    """(k,) what each candidate allows of the path."""
    d.paths.count_deviating()
    part = np.empty(len(d.candidates), dtype=d.exchange)
    d._free(*d.known.arrays, part)
    return part.astype(float)


@pytest.mark.slow
def test_the_free_way_of_every_pair(rng):
    """It leaves a fifth of what is above the floor, a fifth of r, and comes as near to that as a twentieth of it; what it
    does not stop does not come so near, nor into reach, and nothing is missed. No pair goes as far as to where it touches."""
    scene = soup(rng)
    d = detector(scene)
    every = Truth(scene, d)
    x = d.model.read_particles()[0]
    d.paths.begin()
    for size in (0.03, 0.15):
        way = size * rng.normal(size=x.shape) + rng.normal(size=3)
        d.model.write_particles(x + way, np.zeros_like(x))
        d.cover()
        part = np.ones(len(every.kind))
        part[every.rows(d.candidates)] = free_parts(d)
        assert d.collision_free_step()[0] == part.min()
        begins, ways = x[every.four], way[every.four]
        gone = ref.distances(every.kind, begins)
        floor = np.where(gone > 1.02 * every.radius / 5, every.radius / 5, 0.0)
        left = floor + (gone - floor) / 5
        maybe = np.flatnonzero(gone - ref.speed(every.kind, ways) < left)
        assert (part[np.setdiff1d(np.arange(len(part)), maybe)] == 1).all()
        allow = maybe[part[maybe] == 1]  # of these, those that come nearest
        least = np.min([ref.distances(every.kind[allow], begins[allow] + s * ways[allow]) for s in np.linspace(0, 1, 13)],
                       axis=0)
        allow = allow[np.argsort(least - np.minimum(left, every.radius)[allow])[:80]]
        maybe = np.concatenate([rng.permutation(maybe[part[maybe] < 1])[:100], allow])
        few = [a[maybe] for a in (every.kind, begins, ways)]
        last = ref.first_below(*few, np.minimum(left, every.radius)[maybe])
        first = ref.first_below(*few, (left + (gone - floor) / 100)[maybe])
        stopped = np.isfinite(last)
        for kind in (0, 1):
            mine = stopped & (every.kind[maybe] == kind)
            assert mine.sum() > 8 and (part[maybe][mine] <= last[mine] + 1e-9).all()
        short = part[maybe] < np.minimum(first, 1.0) - 1e-6
        assert np.mean(short) < 0.02  # they crawl along each other
        touch = np.array([ref.first_touch(*each) for each in zip(*few)])
        assert np.isfinite(touch).sum() > 2 and (part[maybe] < touch).all() and (last <= touch).all()


@dataclasses.dataclass
class Solve:
    """What the reference knows of the pairs of a solve, by key."""

    pairs: dict
    taken: dict


def reference_pairs(sim, p, at, x_0, boost, shifts=None) -> dict:
    """Pairs as found, as the reference has them; with the shifts that they now have, or others."""
    shifts = sim.contacts.layers.shift.parts if shifts is None else shifts
    model, mass = sim.model, sim.model.mass
    mu = np.repeat([0.2, 0.7], [c.mesh.vertex_count for c in sim.scene.cloths])[model.user]
    out = {}
    for k, key in enumerate(p.key.tolist()):
        v = p.vertices[k]
        out[key] = ref.Pair(int(p.pair[k, 2]), at[v], p.weights[k], p.normal[k], float(p.end[k]), float(p.radius[k]),
                            float(p.normal[k] @ (p.weights[k] @ x_0[v])), mass[v], float(np.sqrt(mu[v[0]] * mu[v[3]])),
                            float(p.factor[k]), float(boost[v].max()), shifts[v], H / 2)
    return out


@pytest.mark.slow
def test_energy_has_that_of_repulsion_as_the_log_has_it(monkeypatch):
    """Of a sheet that falls on another, and its pairs' energy worked out from positions."""
    scene, mesh, stiffer = tc.Scene(gravity=None), tc.grid(0.3, 8), []
    monkeypatch.setattr(AdaptiveStiffness, "stiffen", lambda stiffness, pairs, stiffen=AdaptiveStiffness.stiffen:
                        stiffer.append(1) or stiffen(stiffness, pairs))
    for friction, up in ((0.2, 0.0), (0.7, 0.02)):
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50)), mesh.x + [0.003, up, 0.002],
                        [0.0, -up / 0.02, 0.0], contact=tc.ClothContact(0.005, friction))
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        layers, met = sim.contacts.layers, 0
        for _ in range(6):
            boost, shifts = layers.adaptive_stiffness.scale.copy(), layers.shift.parts.copy()
            stiffer.clear()
            record = sim.step()
            assert sim.energy() == pytest.approx(record.energies, rel=1e-12, abs=1e-15)
            if record.layers and not stiffer:
                x, x_0 = sim.model.read_particles()[0], sim.model.read_saved()[0]
                pairs = reference_pairs(sim, layers.near, x, x_0, boost, shifts).values()
                stored = sum(q.stiff * ref.repulsion(float(np.linalg.norm(q.w @ q.x)), q.r, q.shift)[0] for q in pairs)
                assert sim.energy()["contact"] == pytest.approx(stored, rel=1e-6) and stored > 0
                met += 1
        assert met
        sim.set_state(sim.positions() + [[0.0, 1.0, 0.0]] * (len(mesh.x) * 2), sim.velocities())
        assert "contact" not in sim.energy()  # nothing is known to be near until a step has looked


@pytest.mark.slow
def test_solves_are_told_what_the_reference_says(rng):
    """Three solves of a step half as large as usual: stiffness, force, slope, stop, turns, friction as damping and as sliding;
    then what they led to: energy, friction, its potential, what stops approaches, and forces on particles."""
    scene = soup(rng)
    sim = tc.Simulation(scene, h=H, integrator="backward_euler")
    layers, model = sim.contacts.layers, sim.model
    layers.clear()
    layers.intersections.resting[:] = layers.intersections.active = False  # what passes through counts like all else
    layers.detector.let_rest(layers.intersections.resting)
    layers.adaptive_stiffness.scale = rng.choice([1.0, 4.0], size=model.n)
    layers.shift.parts = rng.uniform(0, 0.25, model.n) * rng.choice([0, 1], size=model.n)
    layers.shift.resumed()
    x_0, v_0 = model.read_particles()
    model.save()
    ends = [x_0 + 0.005 * rng.normal(size=x_0.shape) for _ in range(3)]
    model.write_particles(ends[0], v_0)
    model_at = ends[0]
    layers.detector.paths.begin()
    layers.detector.cover()
    layers.begin(dataclasses.replace(layers.start, h=H / 2, x=x_0), True)
    before, slid, stuck, new = Solve({}, {}), 0, 0, 0
    # half of the pairs were there in the step before, and some of these stuck
    keys, p = list(reference_pairs(sim, layers.near, model_at, x_0, layers.adaptive_stiffness.scale)), layers.near
    order = np.argsort(p.key)[rng.random(len(keys)) < 0.5]
    force = 10.0 ** rng.uniform(-4, 0, len(order))
    kept = EndedPairs(p.key[order], force, 0.2 * force[:, None] * rng.normal(size=(len(order), 3)),
                      np.where(rng.random(len(order)) < 0.5, 10.0 ** rng.uniform(-6, -1, len(order)), np.inf))
    layers.kept = kept
    ended = {keys[row]: (kept.friction[k], kept.slip[k]) for k, row in enumerate(order)}
    bore: dict = {keys[row]: kept.force[k] for k, row in enumerate(order)}
    for k in range(3):
        p = layers.near
        pairs = reference_pairs(sim, p, model_at, x_0, layers.adaptive_stiffness.scale)
        base = x_0 if k == 0 else model_at
        there = model_at
        model.write_particles(model_at, v_0)
        points, taken = layers.points(base), {}
        for row, (key, pair) in enumerate(pairs.items()):
            v = p.vertices[row]
            old = before.taken.get(key)
            taken[key] = pair.take(k == 0, bore.get(key), there[v] - x_0[v], base[v] - x_0[v], v_0[v],
                                   None if old is None else old[5:8], *ended.get(key, (np.zeros(3), np.inf)))
        A = np.stack([t[0][np.triu_indices(3)] for t in taken.values()])
        r = np.stack([t[1] for t in taken.values()])
        size = np.abs(A).max(axis=1, keepdims=True)
        wild = np.array([np.abs(pair.t).max() for pair in pairs.values()]) > 1e3  # edges near parallel have none to speak of
        assert wild.mean() < 0.02
        assert (np.abs(points.block - A) / size)[~wild].max() < 1e-6
        assert (np.abs(points.rhs - r) / np.abs(r).max(axis=1, keepdims=True))[~wild].max() < 1e-5
        t = np.stack([pair.t for pair in pairs.values()])
        assert np.abs(points.rotation_coupling - t)[~wild].max() < 1e-7 * np.abs(t[~wild]).max()
        weighed = layers._evaluate(p)[0]
        assert np.allclose(weighed[OWN], [q.own for q in pairs.values()], rtol=1e-12)
        assert np.allclose(weighed[STIFF], [q.stiff for q in pairs.values()], rtol=1e-12)
        assert np.allclose(weighed[POTENTIAL], [q.stiff * ref.repulsion(q.end, q.r, q.shift)[0] for q in pairs.values()],
                           rtol=1e-9, atol=1e-15)
        ways = np.array([u[7].any() for u in taken.values()])
        slid, stuck, new = slid + ways.sum() * (k == 2), stuck + (~ways).sum(), new + len(pairs.keys() - bore.keys())
        # where this solve leads
        model_at = ends[min(k + 1, 2)]
        model.write_particles(model_at, v_0)
        layers.detector.cover()
        layers.record_forces()
        layers.look()
        bore = {}
        led = np.zeros((LED, len(pairs)))
        forces = np.zeros_like(x_0)
        for row, (key, pair) in enumerate(pairs.items()):
            v = p.vertices[row]
            A_k, r_k, force, slope, at, bound, drag, way, offset = taken[key]
            moved = (model_at - x_0)[v]
            now = pair.n @ (pair.w @ model_at[v])
            slip = (np.eye(3) - np.outer(pair.n, pair.n)) @ pair.J @ moved.ravel() / (H / 2) + offset
            ahead = slip @ way
            normal = force + slope * (at - now)
            bore[key] = max(normal, 0.0)
            friction = -bound * way - drag * (slip - ahead * way)
            led[GAP, row], led[RUBBED, row], led[BACK, row] = now, np.linalg.norm(friction), ahead < 0
            J = ref.jacobian(pair.w, points.rotation_coupling[row], pair.n)
            if wild[row]:
                friction = layers.linearized.friction(layers.linearized.slip(model_at - x_0) / (H / 2))[row]
            np.add.at(forces, v, (J.T @ (normal * pair.n + friction)).reshape(4, 3))
        tame = np.flatnonzero(~wild)
        mine = layers._measure(layers.linearized)
        for one in (GAP, RUBBED, BACK):
            assert np.allclose(mine[one, tame], led[one, tame], rtol=1e-6, atol=1e-12 + 1e-9 * np.abs(led[one, tame]).max())
        assert np.allclose(layers.last_forces, list(bore.values()), rtol=1e-8, atol=1e-9)
        assert np.abs(layers.pushes().add(0 * forces) - forces).max() < 1e-6 * np.abs(forces).max()
        before = Solve(pairs, taken)
    energy = sum(q.stiff * ref.repulsion(q.end, q.r, q.shift)[0]
                 for q in reference_pairs(sim, layers.near, model_at, x_0, layers.adaptive_stiffness.scale).values())
    assert layers.energy == pytest.approx(energy, rel=1e-9) and layers.count == len(layers.near.end)
    assert slid > 20 and stuck > 100 and new > 20
    # what ends with less than .3 of its room gets stiffer, with more than .7 softer again: by as much a usual step, half here
    p, boost, room = layers.near, layers.adaptive_stiffness.scale, np.full(model.n, np.inf)
    for v, part in zip(p.vertices, (p.end / p.radius - 0.2) / 0.8):
        room[v] = np.minimum(room[v], part)
    expected = np.where(room < 0.3, np.minimum(2 * boost, 64), np.where(room > 0.7, np.maximum(0.8**0.5 * boost, 1), boost))
    # and what ends nearer than it should, by more than 1.5 %, begins to repel further away by .15 of that, half as much here
    gap, shifts = 0.2 + 0.8 * room, layers.shift.parts
    lacks = np.where(np.isinf(room), -0.25, np.where(np.abs(1 - gap) > 0.015, 1 - gap, 0))
    further = np.clip(shifts + 0.075 * lacks, 0, 0.25)
    layers.commit()
    assert np.allclose(layers.adaptive_stiffness.scale, expected, rtol=1e-12)
    assert np.allclose(layers.shift.parts, further, rtol=1e-12, atol=1e-15) and len(set(further)) > 20
    assert {1.0, 2.0, 4.0, 8.0} <= set(np.round(expected, 9))
    sim.close()


def test_a_step_ends_when_forces_and_friction_agree(rng):
    """Solves that lead nowhere agree with what is there; with other forces, or half the friction, they do not."""
    sim = tc.Simulation(soup(rng), h=H, integrator="backward_euler")
    layers, x = sim.contacts.layers, sim.model.read_particles()[0]
    layers.clear()
    layers.begin(dataclasses.replace(layers.start, h=H, x=x), True)
    for _ in range(3):  # the third is told what the second bore
        layers.points(x)
        layers.record_forces()
        layers.look()
    layers.least_before = layers.least
    assert layers.settled() and layers.count > 20
    taken = layers.linearized.taken
    taken[BEARS] *= 0.5
    assert not layers.settled()
    layers.round, layers.waived = 4, ~layers.waived
    assert layers.settled()  # from then on friction may change in the next step, where cloth is pinched
    taken[FORCE] *= 2
    layers.look()
    assert not layers.settled() and layers.unsettled > 10
    sim.close()


def degenerate(rng) -> tuple[np.ndarray, np.ndarray]:
    """Triangles on a small lattice: many in one plane, touching, through each other's edges and corners, or without area."""
    return rng.integers(0, 3, size=(36, 3)) / 2.0, np.arange(36).reshape(-1, 3)


def test_the_exact_count_is_that_of_rational_arithmetic(rng):
    """Which edges pass through which triangles; of degenerate soups, where most touch, and of such that are moved a little."""
    total = doubtful = 0
    for k in range(16):
        x, faces = degenerate(rng)
        if k % 3 == 1:
            x = x + rng.choice([1e-16, 1e-13, 0.1]) * rng.normal(size=x.shape)
        elif k % 3 == 2:
            x = x + rng.integers(-2, 3, size=x.shape) * np.spacing(x)
        if k % 4 == 3:
            x = x + 1000.0
        expected = ref.crossings(x, faces)
        ends, rows = intersections.self_crossings(x, faces)
        found = {(*sorted(e), r) for e, r in zip(ends.tolist(), rows.tolist())}
        assert found == expected and len(rows) == len(expected) == intersections.count_self_crossings(x, faces)
        a, b = faces[:6], faces[6:]
        split = sum((i < 18) != (f < 6) for i, _, f in expected)
        assert intersections.count_crossings(x[:18], a, x[18:], b - 18) == split
        total += len(expected)
        doubtful += len(expected) > 0
    assert total > 60 and doubtful > 8


def test_ipctk_counts_the_same_pairs(rng):
    """Every edge with every triangle, asked of an independent library, on soups."""
    ipctk = pytest.importorskip("ipctk", reason="a second counter: pip install ipctk")
    counts = []
    for _ in range(30):
        n = rng.integers(4, 14)
        x = (rng.uniform(size=(n, 1, 3)) + 0.3 * rng.normal(size=(n, 3, 3))).reshape(-1, 3)
        faces = np.arange(len(x)).reshape(-1, 3)
        expected = {(int(i), int(j), k) for i, j in ref.spans(faces) for k, f in enumerate(faces)
                    if i not in f and j not in f and ipctk.is_edge_intersecting_triangle(x[i], x[j], *x[f])}
        ends, rows = intersections.self_crossings(x, faces)
        assert {(*sorted(e), r) for e, r in zip(ends.tolist(), rows.tolist())} == expected
        assert ipctk.has_intersections(ipctk.CollisionMesh(x, ipctk.edges(faces), faces), x) == (len(expected) > 0)
        counts.append(len(expected))
    assert sum(counts) > 150 and max(counts) > 12
