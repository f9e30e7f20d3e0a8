"""The geometry that the simulator is judged by: against closed forms, dense samples, rational arithmetic and ipctk."""

from types import SimpleNamespace

import numpy as np
import pytest
from reference import geometry
from scipy.spatial import cKDTree

import taichi_cloth as tc

CUBE = np.array([[i, j, k] for i in (0.0, 1) for j in (0.0, 1) for k in (0.0, 1)])
FACES = np.array([f for a, b, c, d in [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
                  for f in ((a, b, c), (a, c, d))])


def solid(shape, position=(0.0, 0, 0), rotation=(0.0, 0, 0)):
    return SimpleNamespace(shape=shape, position=position, rotation=rotation, thickness=0.01, name="s")


@pytest.mark.parametrize("shape, point, wanted", [
    (tc.Sphere(0.4), (0, 0.5, 0), 0.1), (tc.Sphere(0.4), (0.1, 0, 0), -0.3),
    (tc.Plane((0, 2, 0)), (3, -0.2, 1), -0.2), (tc.Capsule((0, 0, 0), (1, 0, 0), 0.1), (2, 1, 0), 2**0.5 - 0.1),
    (tc.Capsule((0, 0, 0), (1, 0, 0), 0.1), (0.5, 0, 0.05), -0.05), (tc.Box((2, 4, 6)), (2, 3, 3), 2**0.5),
    (tc.Box((2, 4, 6)), (0.5, 0, 0), -0.5), (tc.Box((2, 2, 2), 0.5), (2, 2, 0), 1.5 * 2**0.5 - 0.5),
    (tc.Cylinder(1, 2), (3, 0, 0), 2), (tc.Cylinder(1, 2), (0, 1.5, 2), 1.25**0.5), (tc.Cylinder(1, 2), (0, 0.7, 0), -0.3),
    (tc.SolidMesh(CUBE, FACES), (0.5, 0.5, 0.9), -0.1), (tc.SolidMesh(CUBE, FACES), (2, 2, 2), 3**0.5),
    (tc.SolidMesh(CUBE, FACES[2:]), (0.5, 0.5, 0.9), 0.1),
])
def test_distances(shape, point, wanted):
    assert geometry.signed_distance(solid(shape), 0.0, np.array([point], dtype=float)) == pytest.approx(wanted, abs=1e-12)


def test_solids_are_where_they_are_at_a_time():
    moving = solid(tc.Box((2.0, 1, 1)), lambda t: (0, 3 * t, 0), lambda t: (0, 0, np.pi * t))
    assert geometry.signed_distance(moving, 0.5, np.array([[0, 3.5, 0.0]])) == pytest.approx(1.0)  # upright, 1.5 higher
    frames = tc.SolidMesh(np.stack([CUBE, CUBE + 1, CUBE + 3]), FACES, fps=2.0)
    for t, moved in ((-1.0, 0), (0.25, 0.5), (0.75, 2), (9, 3)):
        assert geometry.triangles(solid(frames), t)[0] == pytest.approx(CUBE + moved)


@pytest.mark.slow
def test_faces_come_nearer_than_their_corners(rng):
    x, faces = np.array([[-1.0, 0.2, -1], [1, 0.2, -1], [0, 0.2, 1]]), np.array([[0, 1, 2]])
    for shape in (tc.Sphere(0.1), tc.SolidMesh(*tc.Box((0.2, 0.2, 0.2)).core()[:2]), tc.Box((0.2, 0.2, 0.2), 0.05)):
        assert geometry.clearance(solid(shape), 0.0, x, faces, 0.5) == pytest.approx([0.1], abs=2e-3)
        through = geometry.clearance(solid(shape, (0, 0.2, 0)), 0.0, x, faces, 0.5)[0]
        assert through == 0 if hasattr(shape, "faces") else through == pytest.approx(-0.1, abs=2e-3)
    a, b = rng.normal(size=(40, 3, 3)), rng.normal(size=(40, 3, 3)) + [1.5, 0, 0]
    w = rng.dirichlet((0.5, 0.5, 0.5), size=900)
    near = np.array([cKDTree(w @ p).query(w @ q)[0].min() for p, q in zip(a, b)])
    mine = geometry.triangle_triangle(a, b)
    apart = [not geometry.count_crossings(p, faces, q, faces) for p, q in zip(a, b)]
    assert sum(apart) > 20 and (mine <= near + 1e-12)[apart].all()
    assert (near - mine)[apart].max() < 0.2 and np.median((near - mine)[apart]) < 0.03


@pytest.mark.parametrize("shape", [tc.Sphere(0.3), tc.Capsule((-0.3, 0, 0.1), (0.4, 0.2, 0), 0.2), tc.Plane((1, 2, 0.5))])
def test_closed_forms_are_what_bounds_close_in_on(rng, shape):
    x, faces = rng.normal(size=(180, 3)), np.arange(180).reshape(60, 3)
    one = solid(shape, (0.1, -0.2, 0.1), (0.3, 0.5, -0.2))
    wanted = geometry._lowest(lambda q: geometry.signed_distance(one, 0.0, q), x[faces], 1.0)
    mine = geometry.clearance(one, 0.0, x, faces, 1.0)
    near = wanted < 1
    assert near.sum() > 30 and (wanted < 0).sum() > 3 and (mine <= wanted + 1e-12).all()
    assert (wanted - mine)[near].max() <= geometry.FINE


def test_crossings_are_those_of_rational_arithmetic(rng):
    """On a coarse lattice, where most doubtful cases are exact contact; and none is lost by scale or place."""
    from fractions import Fraction

    count = 0
    for _ in range(300):
        p, q, a, b, c = (tuple(map(int, v)) for v in rng.integers(-2, 3, size=(5, 3)))

        def volume(s, t, u, v):
            m = [[Fraction(i - j) for i, j in zip(w, v)] for w in (s, t, u)]
            minors = [m[1][i - 2] * m[2][i - 1] - m[1][i - 1] * m[2][i - 2] for i in range(3)]
            out = sum(a * b for a, b in zip(m[0], minors))
            return (out > 0) - (out < 0)

        turns = {volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)}
        wanted = volume(p, a, b, c) * volume(q, a, b, c) < 0 and turns in ({1}, {-1})
        count += wanted
        for scale, shift in ((1.0, 0.0), (2.0**-20, 3.0)):
            x, y = (np.array(v, dtype=float) * scale + shift for v in ((p, q), (a, b, c)))
            assert len(geometry.edges_through(x, np.array([[0, 1]]), y, np.array([[0, 1, 2]]))[0]) == wanted
    assert count > 10


def test_crossings_against_ipctk(rng):
    ipctk = pytest.importorskip("ipctk")
    seen = []
    for _ in range(30):
        x = rng.normal(size=(24, 3))
        faces = rng.permutation(24).reshape(8, 3)
        mine = geometry.count_self_crossings(x, faces)
        mesh = ipctk.CollisionMesh(x, geometry.edges_of(faces), faces)
        assert ipctk.has_intersections(mesh, x) == (mine > 0)
        seen.append(mine)
        y, others = x + 0.3, rng.permutation(24).reshape(8, 3)
        both = geometry.count_self_crossings(np.concatenate([x, y]), np.concatenate([faces, others + 24]))
        assert geometry.count_crossings(x, faces, y, others) == both - mine - geometry.count_self_crossings(y, others)
    assert 0 < sum(n > 0 for n in seen)
