"""Exact counts of crossings: against a plain count in fractions, on coordinates of all sizes, in little memory."""

import tracemalloc
from fractions import Fraction

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.scene import intersections
from taichi_cloth.scene.boxes import near
from taichi_cloth.scene.intersections import count_crossings, count_self_crossings, self_crossings


def volume(a, b, c, d) -> Fraction:
    u, v, w = ([Fraction(float(q)) - Fraction(float(p)) for p, q in zip(a, x)] for x in (b, c, d))
    return (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0]) + u[2] * (v[0] * w[1] - v[1] * w[0]))


def plain(x, faces) -> set:
    """Every edge against every triangle, in fractions."""
    edges = {tuple(sorted((int(f[k]), int(f[k - 1])))) for f in faces for k in range(3)}
    found = set()
    for p, q in edges:
        for t, (a, b, c) in enumerate(faces):
            if {p, q} & {a, b, c}:
                continue
            if volume(x[p], x[a], x[b], x[c]) * volume(x[q], x[a], x[b], x[c]) >= 0:
                continue
            turns = [volume(x[p], x[q], x[i], x[j]) for i, j in ((a, b), (b, c), (c, a))]
            if min(turns) > 0 or max(turns) < 0:
                found.add((p, q, t))
    return found


@pytest.mark.parametrize("kind", ["random", "whole numbers", "all sizes", "far away", "faint", "tiny", "huge"])
def test_every_crossing_is_counted_and_none_made_up(kind, rng):
    total = 0
    for _ in range(2):
        x = rng.normal(size=(16, 3))
        faces = np.array([rng.choice(16, 3, replace=False) for _ in range(12)])
        if kind == "whole numbers":  # most are degenerate: in one plane, touching, equal
            x = np.round(2 * x)
        elif kind == "all sizes":
            x *= 10 ** rng.uniform(-4, 4, size=(16, 1))
        else:
            x = {"random": x, "far away": x * 1e-6 + 1e5, "faint": x * 3e-108, "tiny": x * 1e-160, "huge": x * 1e160}[kind]
        expected = plain(x, faces)
        edges, rows = self_crossings(x, faces)
        assert {(*map(int, e), int(t)) for e, t in zip(edges, rows)} == expected
        assert count_self_crossings(x, faces) == len(expected)
        total += len(expected)
    assert total > 3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_lies_in_a_plane_is_not_passed_over(axis, rng):
    """Triangles in planes of one coordinate, as sheets start, against others, some of whose edges lie in such too."""
    x, faces = rng.normal(size=(60, 3)), rng.permutation(60).reshape(20, 3)
    x[faces[10:], axis] = rng.integers(-1, 2, (10, 1)) / 2
    x[faces[:3, :2], axis] = 0.3  # an edge each
    sloping, flat = count_self_crossings(x, faces[:10]), count_self_crossings(x, faces[10:])
    between = count_crossings(x, faces[:10], x, faces[10:])
    assert flat == 0 and between > 3 and between + sloping == count_self_crossings(x, faces) == len(plain(x, faces))


def test_boxes_that_meet_are_found_once_each(rng, monkeypatch):
    monkeypatch.setattr("taichi_cloth.scene.boxes.PART", 37)
    for spread in (0.1, 3.0):  # alike, and from 1e-9 to 1e9
        a, b = (rng.normal(size=(n, 1, 3)) * 3 + rng.normal(size=(n, 2, 3)) * 10 ** (spread * rng.normal(size=(n, 1, 1)))
                for n in (80, 70))
        pairs = [pair for i, j in near(a, b) for pair in zip(i.tolist(), j.tolist())]
        low_a, high_a, low_b, high_b = a.min(axis=1), a.max(axis=1), b.min(axis=1), b.max(axis=1)
        meet = ((low_a[:, None] <= high_b) & (high_a[:, None] >= low_b)).all(axis=2)
        assert len(pairs) == len(set(pairs)) == meet.sum() > 20 and all(meet[p] for p in pairs)


@pytest.mark.parametrize("far", [0.0, 1e30, 1e300])
def test_a_fine_patch_beside_a_floor_takes_little_memory(far, rng):
    patch, floor = tc.grid(0.5, 40), tc.grid(20.0, 1)
    x = np.concatenate([patch.x + [0, 0.1, 0], floor.x])
    x += 1e-4 * rng.normal(size=x.shape)
    x[7] += far  # as one damaged number puts it
    faces = np.concatenate([patch.faces, floor.faces + patch.vertex_count])
    tracemalloc.start()
    count_self_crossings(x, faces)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 150e6


def test_touching_is_no_crossing():
    """An edge that ends within a triangle touches it; a little longer, it goes through."""
    x, triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]), np.array([[0, 1, 2]])
    for end, count in ((0.0, 0), (1e-12, 0), (-1e-12, 1)):
        other = np.array([[0.25, 1.0, 0.25], [0.25, end, 0.25], [5.0, 1.0, 0.25]])
        assert intersections.count_crossings(x, triangle, other, np.array([[0, 1, 2]])) >= count
        assert (intersections.count_crossings(x, triangle, other, np.array([[0, 1, 2]])) > 0) == (count > 0)


@pytest.mark.parametrize("sewn", [True, False])
def test_sides_of_a_seam_that_is_still_apart_are_not_tangled(sewn):
    """The right panel begins 3 mm below the left one's end and goes up through it."""
    left, right = tc.grid((0.1, 0.1), 5, plane="xy"), tc.grid((0.1, 0.1), 5, plane="xy")
    n, x = left.vertex_count, right.x.copy()
    x[:, 2], x[:, 0], x[:, 1] = 0.4 * x[:, 0] - 0.003, x[:, 0] + 0.09, x[:, 1] + 0.003
    mesh = tc.TriMesh([*left.x, *x], [*left.faces, *(right.faces + n)], [*left.uv, *(right.uv + [0.2, 0])])
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), contact=tc.ClothContact(0.002))
    if sewn:
        scene.sew(cloth, left.groups["right"], n + right.groups["left"])
    with tc.Simulation(scene, h=1 / 60) as sim:
        assert sim.intersections() > 3 and (sim.contacts.layers.intersections.count == 0) == sewn
