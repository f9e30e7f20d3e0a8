"""Garments with triangles of another size: seams, labels, places, panels stay what they were."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_patterns import least_angles
from test_stitched import reference_dress, write_panels

import taichi_cloth as tc
from taichi_cloth.backend.ordering import components

pytest.importorskip("scipy", reason="meshing panels needs the extra `garment`")
PATTERNS = Path(__file__).parents[2] / "scenes" / "patterns"
BUTTON = (0.15, 0, -0.15), (0.5, 0, -0.15)  # m


def panels(garment: tc.Garment) -> dict[str, np.ndarray]:
    """Groups that are no labels of edges, with their triangles."""
    mesh = garment.mesh
    inside = {name: np.isin(mesh.faces, rows).all(axis=1) for name, rows in mesh.groups.items()}
    return {name: mesh.faces[of] for name, of in inside.items() if of.any()}


def check_same(was: tc.Garment, now: tc.Garment, spacing: float) -> None:
    """Counted from meshes: panels, places, edges as long as asked for, seams."""
    assert set(now.mesh.groups) == set(was.mesh.groups) and set(panels(now)) == set(panels(was))
    for name in panels(was):
        of = [np.isin(g.mesh.faces[:, 0], g.mesh.groups[name]) for g in (was, now)]
        area = [g.mesh.material_areas[f].sum() for g, f in zip((was, now), of)]
        assert area[1] == pytest.approx(area[0], rel=0.01), name
        corner = now.mesh.corner_uv[of[1]]
        edges = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
        assert np.median(edges) == pytest.approx(spacing, rel=0.15), name
    joined = components(now.mesh.vertex_count, *(np.concatenate([s[k] for s in now.seams]) for k in (0, 1)))
    corner = joined[now.mesh.faces]
    assert (corner != np.roll(corner, 1, axis=1)).all()  # no triangle is closed to a line
    for a, b, *_ in now.seams:
        way = [np.linalg.norm(np.diff(now.mesh.uv[row], axis=0), axis=1) for row in (a, b)]
        assert all(np.ptp(w) < 0.02 * w.mean() for w in way if len(w))  # equal parts


@pytest.mark.parametrize("name", ["skirt", "shirt"])
@pytest.mark.parametrize("spacing", [0.05, 0.018])
def test_a_pattern_that_was_meshed(name, spacing):
    """Against the mesh that the pattern itself gives: seams with as many vertices, labels where they were."""
    pattern = tc.load_pattern(PATTERNS / f"{name}.json")
    garment = replace(pattern, stitches=(replace(pattern.stitches[0], rest=0.3, stiffness=2.0, strength=50.0),
                                         *pattern.stitches[1:])).mesh(0.03)
    now, direct = tc.remesh(garment, spacing), pattern.mesh(spacing)
    check_same(garment, now, spacing)
    angles = least_angles(now.mesh)
    assert angles.min() > 20 and angles.mean() > 52
    assert now.gap() == pytest.approx(garment.gap(), abs=1e-6)
    sewn = [sum(len(s.a) - 1 for s in g.seams) for g in (now, direct)]
    assert sewn[0] == pytest.approx(sewn[1], rel=0.1)
    like = [s for s in now.seams if s.strength]
    assert like and all(s[2:] == (0.3, 2.0, 50.0) for s in like) and all(s[2:] == (0.0, 1.0, None) for s in now.seams
                                                                         if not any(s is t for t in like))
    length = [sum(np.linalg.norm(np.diff(g.mesh.uv[s.a], axis=0), axis=1).sum() for s in some)
              for g, some in ((garment, garment.seams[:1]), (now, like))]
    assert length[1] == pytest.approx(length[0], rel=1e-3)
    for label in set(garment.mesh.groups) - set(panels(garment)):
        ends = [g.mesh.uv[g.mesh.groups[label]] for g in (garment, now)]
        assert ends[1].min(axis=0) == pytest.approx(ends[0].min(axis=0), abs=3e-3)
        assert ends[1].max(axis=0) == pytest.approx(ends[0].max(axis=0), abs=3e-3)
        assert len(ends[1]) > 0.7 * len(ends[0]) * 0.03 / spacing


def test_panels_with_stitches_within_edges(tmp_path):
    """Four edges to three: at 5 cm one row of seven, and it closes; positions of a draped garment follow."""
    _, meshes, (left, right) = write_panels(tmp_path)
    lines = ""
    for v, s in zip(right, np.linspace(0, 3, 5)):
        k = min(int(s), 2)
        lines += f"stitch {v} {left[k]} {left[k + 1]} {s - k:.9f}\n"
    path, _, _ = write_panels(tmp_path, lines=lines)

    def bent(x):
        return x @ np.array([[0.3, 0.1, 0.9], [-0.2, 1.4, 0.0], [0.5, 0.0, 0.2]]) + [0.1, 1.0, -0.3]

    n = sum(m.vertex_count for m in meshes)
    plain = tc.load_stitched(path)
    garment = tc.load_stitched(path, positions=bent(plain.mesh.x[:n]), spacing=0.05)
    check_same(plain, garment, 0.05)
    (a, b, *_), = garment.seams
    assert len(a) == 7 and garment.mesh.x[a, 2] == pytest.approx(garment.mesh.x[b, 2], abs=1e-9)
    assert np.abs(garment.positions - bent(garment.mesh.x)).max() < 1e-9
    assert tc.load_pattern(path).mesh(0.05).mesh.faces.tolist() == garment.mesh.faces.tolist()


def test_three_layers_and_a_button(tmp_path):
    """Each layer of the seam has as many vertices; a stitch within two panels stays where it was."""
    rows = write_panels(tmp_path, (2, 4, 6))[2]
    lines = "".join(f"stitch {v} {rows[0][0]} {rows[0][1]} {2 * t:.9f}\n" if t < 0.5 else
                    f"stitch {v} {rows[0][1]} {rows[0][2]} {2 * t - 1:.9f}\n"
                    for row in rows[1:] for v, t in zip(row, np.linspace(0, 1, len(row))))
    plain = tc.load_stitched(write_panels(tmp_path, (2, 4, 6), lines=lines)[0])
    middle = [int(np.flatnonzero((np.abs(plain.mesh.x - at) < 1e-6).all(axis=1))[0]) for at in BUTTON]
    plain = replace(plain, seams=(*plain.seams, ([middle[0]], [middle[1]], "flat")))
    garment = tc.remesh(plain, 0.04)
    check_same(plain, garment, 0.04)
    *layers, button = garment.seams
    assert [len(s.a) for s in layers] == [9, 9] and len(button.a) == 1
    for v, at in zip((button.a[0], button.b[0]), BUTTON):
        assert np.linalg.norm(garment.mesh.x[v] - at) < 0.04


def test_an_edge_that_is_sewn_to_two_panels_and_labelled_in_part(tmp_path):
    """Half of it to either, and a label over three quarters: both ends in the middle of straight borders."""
    rows = write_panels(tmp_path, (4, 2, 2))[2]
    pairs = [*zip(rows[0][:3], rows[1]), *zip(rows[0][2:], rows[2])]
    plain = tc.load_stitched(write_panels(tmp_path, (4, 2, 2), "".join(f"l {a + 1} {b + 1}\n" for a, b in pairs))[0])
    mesh = plain.mesh
    label = np.flatnonzero((np.abs(mesh.x[:, 0]) < 1e-9) & (mesh.x[:, 2] > -0.23))
    plain = replace(plain, mesh=tc.TriMesh(mesh.x, mesh.faces, mesh.uv, mesh.groups | {"opening": label}))
    garment = tc.remesh(plain, 0.05)
    check_same(plain, garment, 0.05)
    opening = garment.mesh.x[garment.mesh.groups["opening"]]
    assert opening[:, 2].min() == pytest.approx(-0.225) and opening[:, 2].max() == 0 and np.abs(opening[:, 0]).max() < 1e-9
    sewn = {round(float(garment.mesh.x[b, 0].mean()), 3): (a, b) for s in garment.seams for a, b in (s[:2], s[1::-1])
            if garment.mesh.x[b, 0].mean() > 0.32}
    assert set(sewn) == {0.35, 0.7} and len(garment.seams) == 2
    for at, (a, b) in sewn.items():
        way = garment.mesh.x[a, 2] if at < 0.5 else garment.mesh.x[a, 2] + 0.15
        assert len(a) == 7 and way == pytest.approx(garment.mesh.x[b, 2] / 2) and garment.mesh.x[a, 0] == pytest.approx(0.3)


def test_what_cannot_be_meshed_anew_is_named():
    mesh = tc.grid(0.3, 6)
    middle = (np.abs(mesh.uv[mesh.faces].mean(axis=1) - 0.15) < 0.06).all(axis=1)
    hole = tc.TriMesh(mesh.x, mesh.faces[~middle], mesh.uv, {"front": np.arange(mesh.vertex_count)})
    with pytest.raises(tc.SceneError, match="panel 'front' has a hole"):
        tc.remesh(tc.Garment(hole, ()), 0.05)
    tube = tc.cylinder(0.1, 0.3, (12, 4))
    with pytest.raises(tc.SceneError, match="share vertices|hole"):
        tc.remesh(tc.Garment(tube, ()), 0.05)
    with pytest.raises(tc.SceneError, match="spacing"):
        tc.remesh(tc.Garment(mesh, ()), 0.0)
    for spacing in (2e-5, 1e-9, 1e-30):
        with pytest.raises(tc.MeshError, match="remesh: spacing = .* vertices; 2,000,000 are allowed: take 0.00023 m or more"):
            tc.remesh(tc.Garment(mesh, ()), spacing)
    turned = mesh.faces.copy()
    turned[40:] = turned[40:, ::-1]
    with pytest.raises(tc.SceneError, match="panel 'front' (are turned to both sides|touches itself)"):
        tc.remesh(tc.Garment(tc.TriMesh(mesh.x, turned, mesh.uv, {"front": np.arange(49)}), ()), 0.05)


@pytest.mark.slow
def test_the_dress_of_the_reference_data_at_two_sizes(shared):
    plain = reference_dress(shared)
    for spacing in (0.03, 0.012):
        garment = tc.remesh(plain, spacing)
        check_same(plain, garment, spacing)
        angles = least_angles(garment.mesh)
        assert angles.min() > 5 and angles.mean() > 50 and garment.gap() == pytest.approx(plain.gap(), abs=1e-6)
        assert sum(len(s.a) > 1 for s in garment.seams) > 60
        assert ["single stitches are left out" in note for note in garment.mesh.notes] == [True]
    with pytest.raises(tc.MeshError, match="near .* m.*take a smaller spacing"):
        tc.remesh(plain, 0.05)
