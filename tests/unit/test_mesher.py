"""Outlines and the triangles in them: crossings, insides, time in proportion, how many vertices there may be."""

import pathlib
import re

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.garment import mesher

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")
PATTERNS = pathlib.Path(__file__).parents[2] / "scenes" / "patterns"


def cross(border: np.ndarray) -> set[tuple[int, int]]:
    """All pieces of a closed line that meet another that is no neighbour, by the solution of two equations."""
    out, n = set(), len(border)
    for i in range(n):
        for j in range(i + 2, n - (i == 0)):
            (p, q), (r, s) = (border[[k, (k + 1) % n]] for k in (i, j))
            t = np.linalg.solve(np.column_stack([q - p, r - s]), r - p)
            if (t >= 0).all() and (t <= 1).all():
                out.add((i, j))
    return out


@pytest.mark.parametrize("swept", [0, 32])
def test_crossings_of_random_lines(swept, rng, monkeypatch):
    """Found by sorting along an axis, and by boxes."""
    monkeypatch.setattr(mesher, "SWEPT", swept)
    found = 0
    for n in (3, 4, 5, 6, 8, 20):
        for _ in range(12):
            a = np.arange(n) * 2 * np.pi / n
            border = np.column_stack([np.cos(a), np.sin(a)]) + rng.normal(size=(n, 2)) * 0.6 / n
            if rng.random() < 0.5:
                border[rng.integers(n)] *= -1.5
            expected, got = cross(border), mesher.crossing(border)
            assert (got is None) == (not expected) and (got is None or got in expected)
            found += got is not None
    assert 10 < found < 62


def test_a_point_is_inside_where_the_line_goes_round_it(rng):
    """Against the sum of angles; also far outside, and where a corner is as high as the point."""
    border = np.column_stack([np.cos(a := np.sort(rng.uniform(0, 6.28, 40))), np.sin(a)]) * rng.uniform(0.3, 1, (40, 1))
    points = np.concatenate([rng.uniform(-1.2, 1.2, (500, 2)), np.column_stack([rng.uniform(-1, 1, 40), border[:, 1]])])
    d = border[None] - points[:, None]
    angle = np.arctan2(d[..., 1], d[..., 0])
    turns = ((np.roll(angle, -1, axis=1) - angle + np.pi) % (2 * np.pi) - np.pi).sum(axis=1)
    assert (mesher.contains(border, points) == (np.abs(turns) > 3)).all()


def outline_of(kind: str, n: int) -> np.ndarray:
    t = np.arange(n) / n
    if kind == "circle":
        return np.column_stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)])
    if kind == "square":
        side, s = np.divmod(4 * t, 1)
        ways = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
        return np.array([[0, 0], [1, 0], [1, 1], [0, 1]])[side.astype(int)] + s[:, None] * ways[side.astype(int)]
    return np.concatenate([np.column_stack([np.arange(n) % 2, t]), [[2, 1], [2, 0]]])  # a comb


@pytest.mark.parametrize("kind", ["circle", "square", "comb"])
def test_long_outlines_are_looked_at_in_proportion_to_their_length(kind, monkeypatch):
    """Pairs of pieces, counted: not as the square of 40,000."""
    border, looked, ranges, near = outline_of(kind, 40_000), [], mesher._ranges, mesher.near

    def counted(first, count):
        looked.append(count.sum())
        return ranges(first, count) if looked[-1] < 1e7 else iter(())

    def met(a, b):
        for i, j in near(a, b):
            looked.append(len(i))
            yield i, j

    monkeypatch.setattr(mesher, "_ranges", counted)
    monkeypatch.setattr(mesher, "near", met)
    assert mesher.crossing(border) is None and 0 < sum(looked) < 40 * len(border)


def test_spacings_that_make_too_many_vertices_are_refused_before_any_is_made(monkeypatch):
    """With their number and the spacing that fits, which fits."""
    pattern = tc.load_pattern(PATTERNS / "shirt.json")
    with monkeypatch.context() as m:
        m.setattr("taichi_cloth.garment.pattern.mesh_polygon", None)
        for spacing in (2e-5, 1e-9, 1e-30):
            with pytest.raises(tc.MeshError, match=r"about [\d.e+]+ vertices; 2,000,000 are allowed: take 0.00067 m or more"):
                pattern.mesh(spacing)
    monkeypatch.setattr(mesher, "MOST_VERTICES", 800)
    with pytest.raises(tc.MeshError) as error:
        pattern.mesh(0.025)
    about, least = (float(re.search(said, str(error.value))[1]) for said in (r"about (\S+) vertices", r"take (\S+) m"))
    assert 640 < pattern.mesh(least).mesh.vertex_count < 850
    monkeypatch.undo()
    assert pattern.mesh(0.025).mesh.vertex_count == pytest.approx(about, rel=0.1)
    monkeypatch.setattr(mesher, "MOST_VERTICES", 20)
    with pytest.raises(tc.MeshError, match="borders with 3. corners; 20 vertices are allowed"):
        pattern.mesh(0.5)


def test_outlines_without_area_are_refused():
    for corners in ([[0, 0], [1, 0]], [[0, 0], [1, 0], [0.5, 0]], [[0, 0], [0.3, 0.3], [0.7, 0.7]]):
        edges = tuple(tc.Curve(k, (k + 1) % len(corners)) for k in range(len(corners)))
        with pytest.raises(tc.SceneError, match="'flat': its border encloses no area"):
            tc.Panel("flat", np.array(corners), edges)


def test_a_panel_that_was_meshed_is_not_meshed_again(monkeypatch):
    """A scene that is built again with another fabric has the same panels; whoever changes what he got changes no other's."""
    from scipy import spatial

    made: list[int] = []
    delaunay = spatial.Delaunay
    monkeypatch.setattr(spatial, "Delaunay", lambda points: made.append(1) or delaunay(points))
    border = np.array([(0.0, 0.0), (0.7131, 0.0), (0.7131, 0.5), (0.0, 0.5)])
    points, faces = mesher.mesh_polygon(border, 0.1131, "panel")
    assert made
    made.clear()
    points[:], before = 0, points.copy()
    again = mesher.mesh_polygon(border.copy(), 0.1131, "panel")
    assert not made and np.array_equal(again[0], before) and np.array_equal(again[1], faces)
    others = mesher.mesh_polygon(border * [1.01, 1], 0.1131, "panel")
    assert made and not np.array_equal(others[0], before)
