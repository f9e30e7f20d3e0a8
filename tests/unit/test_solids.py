"""Solids: distances and normals, meshes, what is refused; closest points; crossings."""

import struct

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import runtime
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings
from taichi_cloth.scene.solids import rotation_matrix

SHAPES = [tc.Plane((0.3, 1.0, -0.2)), tc.Sphere(0.4), tc.Capsule((-0.2, 0, 0.1), (0.3, 0.4, 0), 0.2),
          tc.Box((0.6, 0.4, 0.8)), tc.Box((0.6, 0.4, 0.8), 0.1), tc.Cylinder(0.3, 0.7)]
CUBE = tc.Box((1.0, 1.0, 1.0)).core()[:2]


class Holder:
    """What goes on with Taichi."""


@pytest.fixture(autouse=True)
def running():
    """Taichi goes on through a test that evaluates shapes many times."""
    held = Holder()
    runtime.start("cpu", "f64")
    runtime.hold(held)
    yield
    runtime.let_go(held)


def evaluate(shape, q: np.ndarray) -> np.ndarray:
    """(k, 4) distance and normal at points (k, 3), by the kernel's own function."""
    runtime.start("cpu", "f64")
    from taichi_cloth.contact.solid.sdf import distance

    out = np.zeros((len(q), 4))
    p = ti.Vector((shape.parameters + [0.0] * 8)[:8])
    kind = shape.kind

    @ti.kernel
    def run(q: ti.types.ndarray(), out: ti.types.ndarray()):
        for i in range(q.shape[0]):
            d = distance(kind, ti.Vector([q[i, 0], q[i, 1], q[i, 2]]), p, ti.static((kind,)))
            for c in ti.static(range(4)):
                out[i, c] = d[c]

    run(q, out)
    return out


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_distance_is_that_to_the_surface_and_its_gradient_the_normal(shape, rng):
    q = rng.uniform(-0.8, 0.8, size=(400, 3))
    d = evaluate(shape, q)
    assert np.allclose(np.linalg.norm(d[:, 1:], axis=1), 1)
    foot = evaluate(shape, q - d[:, :1] * d[:, 1:])[:, 0]
    outside = d[:, 0] > 0
    assert np.abs(foot[outside]).max() < 1e-12  # a step of the distance along the normal leads to the surface
    eps = 1e-6
    slope = np.column_stack([(evaluate(shape, q + eps * e)[:, 0] - evaluate(shape, q - eps * e)[:, 0]) / (2 * eps)
                             for e in np.eye(3)])
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1) < 1e-4  # not across the ridges inside
    assert smooth.mean() > 0.9
    assert np.abs(slope - d[:, 1:])[smooth].max() < 1e-5


@pytest.mark.parametrize("shape", SHAPES[1:], ids=lambda s: type(s).__name__)
def test_surface_lies_on_the_shape_and_faces_out(shape):
    x, faces = shape.surface()
    d = evaluate(shape, x)
    assert np.abs(d[:, 0]).max() < 1e-12
    centre = x[faces].mean(axis=1)
    normal = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    real = np.linalg.norm(normal, axis=1) > 1e-12
    at = evaluate(shape, centre)
    assert at[:, 0].max() < 1e-9  # inscribed
    assert np.einsum("ij,ij->i", normal, at[:, 1:])[real].min() > 0


def test_closest_points(rng):
    runtime.start("cpu", "f64")
    from taichi_cloth.contact.geometry import EDGE_EDGE, VERTEX_FACE, of_pair

    points = rng.normal(size=(300, 5, 3))
    points[:20, 4] = points[:20, 3]  # degenerate triangles
    points[20:40, 1] = points[20:40, 0] + points[20:40, 3] - points[20:40, 2]  # parallel edges
    out = np.zeros((300, 2))

    @ti.kernel
    def run(p: ti.types.ndarray(), out: ti.types.ndarray()):
        for i in range(p.shape[0]):
            v = ti.Matrix.zero(float, 5, 3)
            for a, b in ti.static(ti.ndrange(5, 3)):
                v[a, b] = p[i, a, b]
            for kind in ti.static((VERTEX_FACE, EDGE_EDGE)):
                d, w, s = of_pair(kind, v[0, :], v[1, :], v[2, :], v[3, :], v[4, :])
                out[i, kind] = d.norm()

    run(points, out)
    t = np.linspace(0, 1, 41)
    a, b = np.meshgrid(t, t)
    inside = (a + b) <= 1
    w = np.column_stack([1 - a[inside] - b[inside], a[inside], b[inside]])
    faces = np.linalg.norm(np.einsum("ka,iac->ikc", w, points[:, 2:]) - points[:, None, 0], axis=2).min(axis=1)
    first = points[:, None, 0] + t[None, :, None] * (points[:, None, 1] - points[:, None, 0])
    second = points[:, None, 2] + t[None, :, None] * (points[:, None, 3] - points[:, None, 2])
    edges = np.linalg.norm(first[:, :, None] - second[:, None, :], axis=3).min(axis=(1, 2))
    for mine, sampled in ((out[:, 0], faces), (out[:, 1], edges)):
        assert (mine <= sampled + 1e-12).all()
        assert (sampled - mine).max() < 0.06  # the samples' spacing


def test_crossings_against_a_plain_count(rng):
    x, y = rng.normal(size=(60, 3)), rng.normal(size=(60, 3))
    f, g = rng.permutation(60).reshape(20, 3), rng.permutation(60).reshape(20, 3)
    count = 0
    for (p, tri, q, other) in ((x, f, y, g), (y, g, x, f)):
        for face in tri:
            for a, b in ((0, 1), (1, 2), (2, 0)):
                for s in other:
                    k = np.linalg.solve(np.column_stack([p[face[b]] - p[face[a]], q[s[0]] - q[s[1]], q[s[0]] - q[s[2]]]),
                                        q[s[0]] - p[face[a]])
                    count += 0 < k[0] < 1 and k[1] > 0 and k[2] > 0 and k[1] + k[2] < 1
    assert count > 50 and count_crossings(x, f, y, g) == count
    touching = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])  # a common edge is no crossing
    assert count_crossings(touching, np.array([[0, 1, 2]]), touching + [0, 0, 0], np.array([[0, 1, 2]])) == 0


def test_a_mesh_against_itself():
    sheet = tc.grid(1.0, 4)
    x = np.concatenate([sheet.x, sheet.x @ [[1, 0, 0], [0, 0, 1], [0, 1, 0]] + [0.31, 0.53, -0.42]])
    faces = np.concatenate([sheet.faces, sheet.faces + sheet.vertex_count])
    crossings = count_crossings(sheet.x, sheet.faces, x[sheet.vertex_count:], sheet.faces)
    assert crossings > 0 and count_self_crossings(x, faces) == crossings
    assert count_self_crossings(sheet.x, sheet.faces) == 0
    assert f"{crossings} crossings" in tc.SolidMesh(x, faces).notes[-1]


def test_mesh_solids_say_what_was_done():
    x, faces = CUBE
    assert tc.SolidMesh(x, faces).closed and not tc.SolidMesh(x, faces).notes
    turned = tc.SolidMesh(x, faces[:, ::-1])
    assert "inside out" in turned.notes[0]
    assert (np.sort(turned.faces[:, 1:]) == np.sort(faces[:, ::-1][:, [0, 2, 1]][:, 1:])).all()
    assert "open" in tc.SolidMesh(x, faces[1:]).notes[0] and not tc.SolidMesh(x, faces[1:]).closed


def test_a_sequence_is_interpolated():
    x, faces = CUBE
    solid = tc.Solid("s", tc.SolidMesh(np.stack([x, x + 1, x + 3]), faces, fps=10), 0.1, 0.01, (0, 0, 0), (0, 0, 0))
    for t, shift in ((-1, 0), (0, 0), (0.05, 0.5), (0.15, 2.0), (0.2, 3.0), (9, 3.0)):
        assert np.allclose(solid.surface_at(t), x + shift)


@pytest.mark.parametrize("make, words", [
    (lambda: tc.Sphere(-1), "radius"), (lambda: tc.Box((1, 0, 1)), "box size"), (lambda: tc.Box((1, 1, 1), 0.6), "radius"),
    (lambda: tc.Capsule((0, 0, 0), (0, 0, 0), 1), "Sphere"),
    (lambda: tc.Capsule((0, 0, 0), (0, 1, 0)), "capsule radius = nan"),
    (lambda: tc.Capsule(0.1, 0.5), r"not a radius and a height: one that stands is Capsule\(\(0, 0, 0\), \(0, height, 0\)"),
    (lambda: tc.Plane((0, 0, 0)), "normal"),
    (lambda: tc.SolidMesh(np.full((4, 3), np.nan), [[0, 1, 2]]), "not finite"),
    (lambda: tc.SolidMesh(np.zeros((2, 4, 3)), [[0, 1, 2]]), "fps"),
    (lambda: tc.SolidMesh(CUBE[0], [[0, 1, 99]]), r"face 0 \[0, 1, 99\] names a vertex out of range, but there are 8"),
    (lambda: tc.SolidMesh(np.eye(5)[:, :3], [[0, 1, 2], [1, 0, 3], [0, 1, 4]]), "more than two"),
    (lambda: tc.Scene().add_solid(tc.Sphere(1), friction=-0.1, thickness=0.01), "friction"),
    (lambda: tc.Scene().add_solid(tc.Sphere(1), friction=0.1, thickness=0.0), "thickness"),
    (lambda: tc.Scene().add_solid(tc.Sphere(1), 0.1, 0.01, position=lambda t: (0, t / 0 if t else np.inf, 0)), "position"),
    (lambda: tc.Scene().add_solid(tc.Sphere(1), 0.1, 0.01, rotation=np.ones((3, 3))), "not a rotation"),
    (lambda: tc.Scene().add_solid("ball", 0.1, 0.01), "solid 'solid0': needs a Plane.*not 'ball'"),
])
def test_bad_solids_are_named(make, words):
    with pytest.raises(tc.SceneError, match=words):
        make()


def test_rotations():
    R = rotation_matrix((0.3, -0.2, 0.9))
    assert np.allclose(R @ R.T, np.eye(3)) and np.allclose(R @ [0.3, -0.2, 0.9], [0.3, -0.2, 0.9])
    assert np.trace(R) == pytest.approx(1 + 2 * np.cos(np.linalg.norm([0.3, -0.2, 0.9])))
    solid = tc.Scene().add_solid(tc.SolidMesh(*CUBE), friction=0.0, thickness=0.01, position=(1.0, 2.0, 3.0),
                                 rotation=lambda t: (0, 0, t))
    x, y, z = solid.surface_at(0.0).T - [[1], [2], [3]]
    assert np.allclose(solid.surface_at(np.pi / 2), np.column_stack([1 - y, 2 + x, 3 + z]))  # a quarter turn about z


def test_solids_from_files(tmp_path):
    x, faces = CUBE
    for k in range(3):
        rows = [f"v {a} {b} {c}" for a, b, c in x + k] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
        (tmp_path / f"cube_{k}.obj").write_text("\n".join(rows))
    sequence = tc.load_solid(tmp_path / "cube_*.obj", scale=2.0, fps=24)
    assert np.allclose(sequence.x, 2 * np.stack([x, x + 1, x + 2])) and sequence.closed
    np.savez(tmp_path / "cube.npz", positions=np.stack([x, x + 1]), faces=faces, fps=30)
    assert tc.load_solid(tmp_path / "cube.npz").fps == 30
    frames = np.stack([x, x + 1]).astype("<f4")
    header = b"POINTCACHE2\0" + struct.pack("<iiffi", 1, len(x), 0.0, 1.0, 2)
    (tmp_path / "cube.pc2").write_bytes(header + frames.tobytes())
    cache = tc.load_solid(tmp_path / "cube.pc2", fps=24, mesh=tmp_path / "cube_0.obj")
    assert np.allclose(cache.x, np.stack([x, x + 1]))
    other = (tmp_path / "cube_1.obj").read_text()
    (tmp_path / "cube_3.obj").write_text(other.replace("f 1 ", "f 2 "))
    for more, count in (("v 0 0 0\n", 9), ("v 0 0 0\nv 1 1 1\n", 10)):  # before and after its faces
        (tmp_path / "more.obj").write_text(more + other)
        with pytest.raises(tc.MeshError, match=rf"cube.pc2: has 8 vertices, and .*more.obj {count}: frames are of one mesh"):
            tc.load_solid(tmp_path / "cube.pc2", fps=24, mesh=tmp_path / "more.obj")
    (tmp_path / "seq_0.obj").write_text(other)
    (tmp_path / "seq_1.obj").write_text(other + "\nv 0 0 0\n")
    with pytest.raises(tc.MeshError, match=r"seq_1.obj: has 9 vertices, and .*seq_0.obj 8: frames are of one mesh"):
        tc.load_solid(tmp_path / "seq_*.obj", fps=24)
    np.savez(tmp_path / "none.npz", positions=np.zeros((0, 8, 3)), faces=faces, fps=24)
    with pytest.raises(tc.SceneError, match=r"none.npz: solid mesh: has no frames"):
        tc.load_solid(tmp_path / "none.npz")
    (tmp_path / "none.npz").unlink()
    for path, words in ((tmp_path / "cube_*.obj", "topology"), (tmp_path / "none.npz", "no such file"),
                        (tmp_path / "x_*.obj", "no file matches"), (tmp_path / "cube.pc2", "mesh=")):
        with pytest.raises(tc.MeshError, match=words):
            tc.load_solid(path, fps=24)
    (tmp_path / "cube.pc2").write_bytes(header + frames.tobytes()[:-4])
    with pytest.raises(tc.MeshError, match="bytes long"):
        tc.load_solid(tmp_path / "cube.pc2", fps=24, mesh=tmp_path / "cube_0.obj")


def test_explicit_steps_refuse_solids_by_name():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, tc.Stretch(100)))
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.01)
    with pytest.raises(tc.SceneError, match="verlet.*backward_euler"):
        tc.Simulation(scene, integrator="verlet")


def test_a_body_that_is_moved_by_hand_is_where_it_then_is():
    """Positions from the step before are gone by only where the body has the same pose at that time."""
    at, scene = [0.0, 0.0, 0.0], tc.Scene()
    scene.add_cloth(tc.grid(0.5, 4), tc.Fabric(0.2, tc.Stretch(1000)))
    solid = scene.add_solid(tc.SolidMesh(*CUBE), friction=0.0, thickness=0.01, position=lambda t: [at[0], 3 + t, at[2]])
    sim = tc.Simulation(scene)
    tree = sim.contacts.solids.detector.tree
    for t, x in ((0.0, 0.0), (0.1, 0.0), (0.2, 0.5), (0.2, 0.5), (0.3, -0.5)):
        at[0] = x
        sim.contacts.solids.detector.set_time(t, 0.1)
        ends = read(tree.x) + np.tile(sim.model.origin, 2)
        assert np.allclose(ends, np.concatenate([solid.surface_at(t), solid.surface_at(t + 0.1)], axis=1), atol=1e-12)
        assert np.isclose(tree.fastest, 0.1)


def test_a_thickness_beyond_the_mesh_is_warned_of():
    scene = tc.Scene()
    mesh = tc.grid(0.1, 10)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [0, 0.1, 0])
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.05, name="floor")
    assert any("floor" in n and "0.05" in n for n in tc.Simulation(scene).notes)


def test_crossings_of_a_state_are_seen(rng):
    """The kernel's count of crossing triangles is 0 exactly where the exact count of edges and triangles is."""
    mesh, cube = tc.grid(0.5, 6), tc.SolidMesh(*CUBE)
    scene = tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000)))
    solid = scene.add_solid(cube, friction=0.0, thickness=0.01)
    sim = tc.Simulation(scene)
    seen = []
    for _ in range(60):
        R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        x = mesh.x @ R + rng.uniform(-1.2, 1.2, size=3)
        sim.set_state(x, 0 * x)
        exact = count_crossings(x, mesh.faces, solid.surface_at(0), cube.faces)
        assert (sim.contacts.crossings > 0) == (exact > 0)
        assert not sim.contacts.solids.went_through()  # what crossed before is not held against a step
        sim.contacts.solids.penetration.before = np.zeros((0, 3), dtype=np.int64)
        assert sim.contacts.solids.went_through() == (exact > 0)
        seen.append(exact > 0)
    assert 10 < sum(seen) < 50
