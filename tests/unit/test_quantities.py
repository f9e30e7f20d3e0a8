"""What is read off recorded frames, against the simulation itself and plain numpy; rays against brute force."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.rows import write
from taichi_cloth.recording import record
from taichi_cloth.system.quantities import MARKS, QUANTITIES, deformation, evaluate, on_vertices, principal_stretches


@pytest.fixture(params=["hinge", "curvature"])
def crumpled(rng, request):
    mesh = tc.grid(0.5, 6)
    scene = tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-3, model=request.param)),
                    positions=mesh.x + 0.01 * rng.normal(size=mesh.x.shape), velocities=rng.normal(size=mesh.x.shape))
    return tc.Simulation(scene)


def test_stretch_is_the_singular_values(crumpled):
    mesh = crumpled.scene.cloths[0].mesh
    w = deformation(crumpled.positions(), mesh.faces, mesh.corner_uv)
    expected = np.linalg.svd(w, compute_uv=False)
    assert np.abs(principal_stretches(w) - expected).max() < 1e-12
    assert np.abs(crumpled.stretch() - expected).max() < 1e-12


def test_bend_energy_adds_up(crumpled):
    geometry, frame = record.geometry(crumpled), record.frame(crumpled)
    density = evaluate("bend", geometry, frame)
    area = 0.25 / 36 * np.bincount(geometry["faces"].ravel(), minlength=49) / 6  # a third of each triangle of equal area
    assert float(density @ area) == pytest.approx(crumpled.energy()["bend"], rel=1e-4)


def test_means_over_a_vertex_are_weighted_by_area():
    """A vertex of triangles of 1 and 3 m^2 with the values 10 and 2; one of neither."""
    out = on_vertices(np.array([10.0, 2.0]), np.array([[0, 1, 2], [0, 2, 3]]), np.array([1.0, 3.0]), 5)
    assert out == pytest.approx([4, 10, 4, 2, 0])


def test_every_quantity_has_a_value_a_vertex(crumpled):
    geometry, frame = record.geometry(crumpled), record.frame(crumpled)
    for name, quantity in QUANTITIES.items():
        if name in MARKS:  # of scenes that have it
            continue
        values = evaluate(name, geometry, frame)
        low, high = quantity.scale(values)
        assert values.shape == (49,) and np.isfinite(values).all() and low < high
    assert np.abs(evaluate("speed", geometry, frame) - np.linalg.norm(crumpled.velocities(), axis=1)).max() < 1e-6
    with pytest.raises(tc.SceneError, match="did you mean 'shear'"):
        evaluate("sheer", geometry, frame)


def test_rays_against_every_triangle(rng):
    runtime.start()
    from taichi_cloth.backend.fields import Fields
    from taichi_cloth.backend.language import ti
    from taichi_cloth.output.rays import RayTree

    count, rays = 300, 400
    x = (rng.uniform(size=(count, 1, 3)) + 0.15 * rng.normal(size=(count, 3, 3))).reshape(-1, 3)
    faces = np.arange(3 * count).reshape(-1, 3)
    fields = Fields(np.float32)
    tree = RayTree(fields, count)
    fields.allocate()
    tree.build(x, faces)
    origin, way = rng.normal(size=(rays, 3)), rng.normal(size=(rays, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    hit = np.zeros(rays, dtype=np.int32)

    @ti.kernel
    def shoot(o: ti.types.ndarray(), d: ti.types.ndarray(), reach: float, out: ti.types.ndarray()):
        for i in range(o.shape[0]):
            out[i] = tree.blocked(ti.Vector([o[i, 0], o[i, 1], o[i, 2]]), ti.Vector([d[i, 0], d[i, 1], d[i, 2]]), reach)

    a = x[faces[:, 0]]
    e, f = x[faces[:, 1]] - a, x[faces[:, 2]] - a
    for reach in (0.7, 100.0):
        shoot(origin, way, reach, hit)
        expected = []
        for o, d in zip(origin, way):
            system = np.stack([e, f, np.broadcast_to(-d, e.shape)], axis=2)
            u, v, t = np.linalg.solve(system, (o - a)[..., None])[..., 0].T
            expected.append(bool(((u > 0) & (v > 0) & (u + v < 1) & (t > 0) & (t < reach)).any()))
        assert (hit == expected).mean() > 0.99 and 20 < sum(expected) < rays - 20  # grazing rays are f32's to decide


def test_how_much_of_a_limit_is_used():
    """A sheet stretched by 3 % along the warp and sheared by .1: parts of 5 %, of 4 % and of .2."""
    mesh = tc.grid((0.5, 0.4), (4, 3), plane="xy")
    both = {"limit": (1.05, 1.04)}
    for move, limits, expected in (((0.03, 0.0, 0.0), both, 0.6), ((0.0, 0.03, 0.0), both, 0.75), ((0.0, 0.0, 0.1), {}, 0.5)):
        scene = tc.Scene()
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500, **limits), tc.Shear(50, limit=0.2)))
        sim = tc.Simulation(scene)
        x = mesh.x * [1 + move[0], 1 + move[1], 1] + mesh.x[:, 1:2] * [move[2], 0, 0]
        sim.set_state(x, 0 * x)
        assert evaluate("limit", record.geometry(sim), record.frame(sim)) == pytest.approx(expected, rel=1e-5)
        sim.close()


@pytest.mark.parametrize("model", ["hinge", "curvature"])
def test_creases_are_curvatures_at_rest(model):
    """One hinge, or one triangle, that was creased: (1 - H) of it, on its vertices and nowhere else."""
    mesh, H, scene = tc.grid(0.5, 5), 0.25, tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(1e-4, yield_=10, hardening=H, model=model)))
    sim = tc.Simulation(scene)
    state = next(iter(sim.model.remembered.values())).now
    rows = np.zeros((state.rows, 2 if model == "hinge" else 9))
    geometry = record.geometry(sim)
    if model == "hinge":
        rows[7, 1] = -0.3
        on, uv = geometry["hinges"][7, :2], mesh.uv
        arc = 0.1**2 / np.linalg.norm(uv[on[0]] - uv[on[1]])  # two triangles of half a cell each, over their edge
        expected = (1 - H) * 0.3 / arc
    else:
        rows[7, 2::3] = 3.0, 2.0, 6.0  # along the normal: 3^2 + 2 2^2 + 6^2
        on, expected = mesh.faces[7], (1 - H) * np.sqrt(53.0)
    write(state, rows)
    values = evaluate("crease", geometry, record.frame(sim))
    assert values[on] == pytest.approx(expected, rel=1e-5) and (np.delete(values, on) == 0).all()
    sim.close()


def test_creases_by_hand_are_shown_and_what_is_not_there_is_refused():
    mesh, scene = tc.grid((0.4, 0.2), (4, 2)), tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-4)))
    sim = tc.Simulation(scene)
    plain, frame = record.geometry(sim), record.frame(sim)
    assert not {"creases", "hinge_arc", "face_limit", "seam_length"} & set(plain) and set(frame) == {"t", "x", "v"}
    for name, words in (("crease", "yields"), ("limit", "limit"), ("seam", "sewn")):
        with pytest.raises(tc.SceneError, match=f"heat '{name}': .*{words}"):
            evaluate(name, plain, frame)
        with pytest.raises(tc.SceneError, match=words):
            tc.render(sim, heat=name, size=(64, 48))
    sim.close()
    scene.crease(cloth, 0.7, line=[(0.2, 0.0), (0.2, 0.2)])
    sim = tc.Simulation(scene)
    values = evaluate("crease", record.geometry(sim), record.frame(sim))
    assert values[[2, 7, 12]] == pytest.approx(0.7 / 0.1) and np.delete(values, [2, 7, 12]).max() == 0
    sim.close()
