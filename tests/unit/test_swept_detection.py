"""Vertices of cloth that meet solids on their way through a step, against distances sampled densely along the way."""

import numpy as np
import pytest
from reference.geometry import point_triangle, segment_segment, signed_distance

import taichi_cloth as tc

pytestmark = pytest.mark.slow

H, THICK, SAMPLES, COUNT = 1 / 30, 0.01, 150, 1500
SPEEDS = ((3.0, 0.0, 1.0), (0.0, 4.0, 0.0), (-2.0, 1.0, 2.0), (0.0, -3.0, 0.0))


def solids(kind: str) -> list:
    cube = tc.SolidMesh(*tc.Box((0.2, 0.2, 0.2)).core()[:2])
    analytic = [tc.Sphere(0.12), tc.Box((0.4, 0.004, 0.4)),
                tc.Capsule((0, -0.15, 0), (0, 0.15, 0), 0.05), tc.Cylinder(0.1, 0.2)]
    return {"analytic": analytic, "mesh": [cube]}[kind]


def scene_of(kind: str, count: int) -> tuple[tc.Scene, list]:
    scene = tc.Scene()
    mesh = tc.grid(1.0, count)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [0, 50, 0])
    made = []
    for k, shape in enumerate(solids(kind)):
        speed = np.array(SPEEDS[k])
        made.append(scene.add_solid(shape, friction=0.0, thickness=THICK, name=f"solid {k}",
                                    position=lambda t, k=k, speed=speed: 0.2 * np.array([k % 2, k // 2, 0]) + speed * t,
                                    rotation=(0.3 * k, 0.2, 0.5)))
    return scene, made


@pytest.mark.parametrize("kind", ["analytic", "mesh"])
def test_what_comes_within_the_thickness_is_met_and_nothing_else(kind, rng):
    """Fast vertices and moving solids, thin ones too; of several solids each, three at most; half of the vertices stand still.
    What only grazes the thickness on its way, and not the solid, is left out."""
    scene, made = scene_of(kind, 60)
    sim = tc.Simulation(scene, h=H, threads=1)
    model, detector, n = sim.model, sim.contacts.detector, sim.model.n
    x_0 = rng.uniform(-0.5, 0.6, size=(n, 3))
    x_1 = x_0 + rng.uniform(-0.35, 0.35, size=(n, 3)) * (rng.random((n, 1)) < 0.5)
    origin = model.origin
    model.write_particles(x_0 - origin, np.zeros((n, 3)))
    model.save()
    model.write_particles(x_1 - origin, np.zeros((n, 3)))
    detector.set_time(0.0, H)
    found = detector.detect()
    missed = false = wanted = 0
    times = np.zeros(n, dtype=int)
    for k, solid in enumerate(made):
        d = np.array([signed_distance(solid, s * H, x_0 + s * (x_1 - x_0)) for s in np.linspace(0, 1, SAMPLES)])
        nearest, start = d.min(axis=0), d[0]
        must = (start > 1.05 * THICK) & (nearest < -0.05 * THICK)
        here = np.zeros(n, dtype=bool)
        here[found.index[found.solid == k]] = True
        missed += int(np.sum(must & ~here & (np.bincount(found.index, minlength=n) < 3)))
        false += int(np.sum(here & (nearest > 1.6 * THICK)))
        wanted += int(must.sum())
        times += must
    several = int(np.sum(times > 1))
    assert missed == 0 and false == 0 and wanted > 30 and (kind == "mesh" or several > 10)


def test_edges_and_corners_that_come_near_are_found(rng):
    """A cube moves up to loose triangles: its corners to their faces, its edges to their edges, each by each."""
    size, reach, shift = 0.2, 0.5 * 0.02, np.array([-0.03, 0.02, 0.025])
    corners = size * (np.array(list(np.ndindex(2, 2, 2))) - 0.5)
    edges = [(a, b) for a in range(8) for b in range(a) if np.isclose(np.linalg.norm(corners[a] - corners[b]), size)]
    ends = np.array(edges)[rng.integers(12, size=COUNT)]
    on = corners[ends[:, 0]] + rng.random((COUNT, 1)) * (corners[ends[:, 1]] - corners[ends[:, 0]])
    out = on / np.abs(on).max(axis=1, keepdims=True) * (np.abs(on) > 0.45 * size) + rng.normal(scale=0.5, size=(COUNT, 3))
    x = (on + shift + 0.015 * out)[:, None] + rng.uniform(-0.02, 0.02, size=(COUNT, 3, 3))
    scene = tc.Scene()
    scene.add_cloth(tc.TriMesh(x.reshape(-1, 3), np.arange(3 * COUNT).reshape(-1, 3)), tc.Fabric(0.2, tc.Stretch(100)))
    cube = scene.add_solid(tc.SolidMesh(*tc.Box((size,) * 3).core()[:2]), friction=0.0, thickness=0.02,
                           position=lambda t: shift * t / H)
    sim = tc.Simulation(scene, h=H, threads=1)
    sim.model.save()
    sim.contacts.detector.set_time(0.0, H)
    found = sim.contacts.detector.find_pairs()
    rows = sim.model.user[found.vertices] // 3
    assert (rows == rows[:, :1]).all() and (np.abs(found.weights.sum(axis=1) - 1) < 1e-12).all()
    many = np.bincount(rows[:, 0], minlength=COUNT)  # pairs of each face
    clear = (signed_distance(cube, 0.0, x.reshape(-1, 3)).reshape(-1, 3).min(axis=1) > 1.2 * reach)
    outside = signed_distance(cube, H, x.reshape(-1, 3)).reshape(-1, 3).min(axis=1) > 1e-3
    here, wanted = corners + shift, np.zeros(COUNT, dtype=int)
    some = clear & outside
    y = x[some]
    at = [np.broadcast_to(p, y[:, 0].shape) for p in here]
    near = [point_triangle(p, *y.swapaxes(0, 1)) for p in at]
    near += [segment_segment(at[i], at[j], y[:, k], y[:, (k + 1) % 3]) for i, j in edges for k in range(3)]
    wanted[some] = np.sum(np.array(near) < 0.95 * reach, axis=0)
    lacks = (wanted > 0) & (many < wanted)
    # a few are taken as they were on their way, or lie across the cube from where they began
    assert wanted.sum() > 300 and lacks.sum() < 0.06 * np.sum(wanted > 0), (lacks.sum(), np.sum(wanted > 0))


@pytest.mark.parametrize("moving", [True, False])
def test_pairs_are_found_as_if_all_were_looked_for_anew(moving, rng):
    """Look for look, while some vertices move less and some more than what candidates were looked for with, and where paths
    begin too; round a cube that moves, and one that does not, for which candidates last from step to step."""
    size, thick, count = 0.2, 0.02, 400
    x = rng.uniform(-0.55 * size, 0.55 * size, size=(count, 1, 3)) + rng.uniform(-0.02, 0.02, size=(count, 3, 3))
    scene = tc.Scene()
    scene.add_cloth(tc.TriMesh(x.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)), tc.Fabric(0.2, tc.Stretch(100)))
    at = (lambda t: np.array([0.3, 0.2, 0.25]) * t) if moving else (0, 0, 0)
    scene.add_solid(tc.SolidMesh(*tc.Box((size,) * 3).core()[:2]), friction=0.0, thickness=thick, position=at)
    sims = [tc.Simulation(scene, h=H, threads=1) for _ in range(2)]
    n, begin = 3 * count, sims[0].model.read_particles()[0]
    end, pairs, kept = begin.copy(), 0, 0
    for look in range(24):
        if look % 4 == 0:  # a new step
            begin = begin + thick * rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.2)
            end = begin
        scale, part = ((0.0, 0.0), (0.08, 1.0), (0.08, 1.0), (1.0, 0.2))[look % 4]
        end = end + scale * thick * rng.normal(size=(n, 3)) * (rng.random((n, 1)) < part)
        found = []
        for sim in sims:
            near, detector = sim.contacts.detector.pairs.near, sim.contacts.detector
            for x in (begin, end):
                sim.model.write_particles(x, np.zeros((n, 3)))
                if x is begin:
                    sim.model.save()
            if look % 6 == 0:
                detector.set_time(look * H, H)
            if sim is sims[1]:
                near.forget()
            before = near.rows
            found.append(detector.find_pairs())
            kept += near.rows is before
        a, b = found
        assert np.array_equal(a.key, b.key) and np.array_equal(a.distance, b.distance), look
        pairs += len(a.key)
    assert pairs > 500 and kept >= 2, (pairs, kept)


def spiked(rng) -> tuple[np.ndarray, np.ndarray]:
    """A ball whose vertices are pulled in or out at random: acute corners, dents and saddles."""
    x, faces = tc.Sphere(0.4).surface()
    x, back = np.unique(x.round(9), axis=0, return_inverse=True)
    faces = back.ravel()[faces]
    faces = faces[(np.diff(np.sort(faces, axis=1), axis=1) > 0).all(axis=1)]
    return x * rng.uniform(0.9, 1.1, size=(len(x), 1)), faces


def test_corners_of_a_mesh_have_their_outside_out(rng):
    """Points at rest near corners, one of them a needle's, against exact distances and winding numbers: the faces of a corner
    face all ways, and none alone says on which side a point is."""
    needle = np.array([[0.007, 0, -0.1], [-0.007, 0.007, -0.1], [-0.007, -0.007, -0.1], [0, 0, 0]]) + 0.5
    for x, faces in ((needle, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])), spiked(rng)):
        scene, mesh = tc.Scene(), tc.grid(1.0, 40)
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [0, 50, 0])
        solid = scene.add_solid(tc.SolidMesh(x, faces), friction=0.0, thickness=THICK)
        sim = tc.Simulation(scene, h=H, threads=1)
        model, detector = sim.model, sim.contacts.detector
        way = rng.normal(size=(model.n, 3))
        reach = THICK * rng.uniform(0.05, 0.95, size=(model.n, 1))
        q = x[rng.integers(len(x), size=model.n)] + reach * way / np.linalg.norm(way, axis=1)[:, None]
        model.write_particles(q - model.origin, np.zeros_like(q))
        model.save()
        detector.set_time(0.0, H)
        found = detector.detect()
        assert np.array_equal(found.index, np.arange(model.n))
        d = signed_distance(solid, 0.0, q)
        assert (d < 0).sum() > 30 and (d > 0).sum() > 800
        assert found.gap + THICK == pytest.approx(d, abs=1e-9)


def test_what_flies_through_a_thin_solid_is_kept_on_its_side():
    """The plane of contact is that of the side that was hit, though the way ends beyond the other."""
    mesh, scene = tc.grid(0.2, 6), tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [-0.1, 0.05, 0.1])
    scene.add_solid(tc.Box((0.4, 0.004, 0.4)), friction=0.0, thickness=THICK)
    sim = tc.Simulation(scene, h=H, threads=1)
    model = sim.model
    x = model.read_particles()[0]
    model.save()
    model.write_particles(x - [0, 0.12, 0], np.zeros_like(x))
    sim.contacts.detector.set_time(0.0, H)
    found = sim.contacts.detector.detect()
    assert len(found.index) == model.n and np.allclose(found.normal, [0, 1, 0])
    for gap, height in ((found.gap, -0.07), (found.start_gap, 0.05)):
        assert np.allclose(gap, height - 0.002 - THICK, atol=1e-4)


def moved(meshed: bool, begin: np.ndarray, end: np.ndarray):
    """The contact of a vertex that goes from one place (2,) to another in a step, by the edge x = y = 0 of a box."""
    box, scene = tc.Box((0.2, 0.02, 0.2)), tc.Scene()
    mesh = tc.TriMesh(np.array([[0, 0, 0], [1e-3, 0, 0], [0, 0, 1e-3]]), [[0, 2, 1]])
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [*begin, 0])
    scene.add_solid(tc.SolidMesh(*box.core()[:2]) if meshed else box, 0.0, THICK, position=(-0.1, -0.01, 0))
    sim = tc.Simulation(scene, h=H, threads=1)
    model = sim.model
    x = model.read_particles()[0]
    model.save()
    model.write_particles(x + [*(end - begin), 0], np.zeros_like(x))
    sim.contacts.detector.set_time(0.0, H)
    found = sim.contacts.detector.detect()
    return found.take(found.index == model.particle[0])


@pytest.mark.parametrize("meshed", [False, True])
@pytest.mark.parametrize("end, normal", [((0.008, -0.003), (1, 0)), ((0.002, -0.03), (0, 1)), ((0.02, -0.003), None)])
def test_what_goes_round_an_edge_is_held_by_the_face_that_it_comes_to(meshed, end, normal):
    """From a table's top round its edge in one step: beside it, through it and out again below, or past it. The plane of the
    top, which goes on beyond the edge, is met by the second alone."""
    found = moved(meshed, np.array([-0.005, THICK + 1e-7]), np.array(end))
    if normal is None:
        assert not (found.gap < 0).any()
    else:
        assert len(found.gap) == 1 and np.allclose(found.normal[0, :2], normal, atol=1e-3)
        assert found.gap[0] == pytest.approx(np.dot(normal, end) - THICK, abs=1e-5)


@pytest.mark.parametrize("meshed", [False, True])
def test_an_edge_that_is_hit_is_round(meshed):
    """A way that leads through an edge meets the plane across the direction from the edge to where it came within the
    thickness."""
    begin, end = np.array([0.012, 0.006]), np.array([-0.014, -0.03])
    s = np.linspace(0, 1, 100001)
    way = begin + s[:, None] * (end - begin)
    n = way[np.argmax(np.linalg.norm(way, axis=1) <= THICK)] / THICK
    found = moved(meshed, begin, end)
    assert n.min() > 0.2 and len(found.gap) == 1 and np.allclose(found.normal[0, :2], n, atol=5e-3)
    assert found.gap[0] == pytest.approx(n @ end - THICK, abs=2e-4)


@pytest.mark.parametrize("speed", [2.0, 6.0])
def test_what_falls_fast_is_stopped_at_the_surface_in_whole_steps(speed):
    """Without a bounce, and without a step that has to be tried smaller."""
    mesh, scene = tc.grid(0.3, 6), tc.Scene(gravity=(0.0, -9.81, 0.0))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), tc.Shear(50), tc.Bend(1e-5)), positions=mesh.x + [0, 0.2, 0],
                    velocities=(0, -speed, 0))
    scene.add_solid(tc.Plane(), friction=0.3, thickness=THICK)
    h = 1 / 60
    sim = tc.Simulation(scene, h=h, integrator="backward_euler", threads=1)
    y, v = 0.2, -speed
    for _ in range(12):
        record = sim.step()
        assert record.rejections == {} and record.h == pytest.approx(h)
        v -= 9.81 * h
        y = max(y + h * v, THICK)  # backward Euler's free fall, to the surface and no further
        assert np.abs(sim.positions()[:, 1] - y).max() < 1e-3 * THICK
    assert np.abs(sim.positions()[:, 1] - THICK).max() < 1e-3 * THICK and np.abs(sim.velocities()).max() < 1e-3
