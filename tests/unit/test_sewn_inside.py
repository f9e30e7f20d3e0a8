"""Lines and points within panels: pockets, patches and buttons are sewn there, and the mesh has vertices where they are."""

import json
import math

import numpy as np
import pytest

import taichi_cloth as tc

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")

POCKET = ((0.0, 0.0), (0.12, 0.0), (0.12, 0.1), (0.0, 0.1))
AT = np.array([0.11, 0.07])  # m, where the pocket's first corner comes to be


def panel(name: str, corners, z: float = 0.0) -> tc.Panel:
    """A polygon."""
    n = len(corners)
    return tc.Panel(name, np.array(corners), tuple(tc.Curve(k, (k + 1) % n) for k in range(n)), np.array([0, 0, z]))


def place(k: int, parts: int = 1):
    """Where edge k of the pocket is on the front, from its end to its start."""
    ends = np.array([POCKET[(k + 1) % 4], POCKET[k]])
    return "front", tuple(map(tuple, AT + np.linspace(*ends, parts + 1)))


def front(z: float = 0.0) -> tc.Panel:
    """40 x 30 cm with a bay in its right side."""
    return panel("front", [(0, 0), (0.4, 0), (0.4, 0.1), (0.3, 0.15), (0.4, 0.2), (0.4, 0.3), (0, 0.3)], z)


def with_pocket(*more: tc.Stitch) -> tc.Pattern:
    """A pocket on the front by three of its edges, and a flap with a button."""
    flap = panel("flap", [(0, 0), (0.1, 0), (0.1, 0.06), (0, 0.06)], 0.04)
    sewn = tuple(tc.Stitch(("pocket", k), place(k, k + 1)) for k in (0, 1, 3))
    top = tc.Stitch(("flap", 2), ("front", ((0.12, 0.25), (0.22, 0.25))))
    button = tc.Stitch(("flap", ((0.05, 0.01),)), ("front", ((0.17, 0.21),)))
    return tc.Pattern((front(), panel("pocket", POCKET, 0.02), flap), (*sewn, top, button, *more))


def edge_set(faces: np.ndarray) -> set[tuple[int, int]]:
    return {tuple(sorted((int(f[k]), int(f[(k + 1) % 3])))) for f in faces for k in range(3)}


@pytest.mark.parametrize("spacing", [0.05, 0.02, 0.007])
def test_the_mesh_has_vertices_and_edges_along_lines_that_are_sewn(spacing):
    """As many on either side, in the right places, with edges between them; all of the panel is covered by triangles that lie
    as they should, and no angle is smaller than what the drawing has."""
    garment = with_pocket().mesh(spacing)
    mesh, edges = garment.mesh, edge_set(garment.mesh.faces)
    rows = [set(mesh.groups[name].tolist()) for name in ("front", "pocket", "flap")]
    assert len(garment.seams) == 5 and all(len(seam.a) == max(1, math.ceil(long / spacing - 1e-6)) + 1
                                           for seam, long in zip(garment.seams, (0.12, 0.1, 0.1, 0.1)))
    for seam in garment.seams[:3]:
        assert set(seam.a.tolist()) <= rows[1] and set(seam.b.tolist()) <= rows[0]
        assert mesh.uv[seam.b] == pytest.approx(mesh.uv[seam.a] + AT, abs=1e-12)  # the pocket lies on the front as it was cut
        for row in (seam.a, seam.b):
            assert all(tuple(sorted(pair)) in edges for pair in zip(row[:-1].tolist(), row[1:].tolist()))
    corner = {int(v) for seam in garment.seams[:3] for v in (seam.b[0], seam.b[-1])}
    assert len(corner) == 4  # two edges that share a corner share the vertex under it
    a, b = garment.seams[4].a, garment.seams[4].b
    assert mesh.uv[a] == pytest.approx(np.array([[0.05, 0.01]])) and mesh.uv[b] == pytest.approx(np.array([[0.17, 0.21]]))
    p = mesh.uv[mesh.faces]
    e, f = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
    areas = (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) / 2
    assert areas.min() > 0 and areas.sum() == pytest.approx(0.12 - 0.005 + 0.012 + 0.006, abs=1e-12)
    way = np.roll(p, -1, axis=1) - p
    back = -np.roll(way, 1, axis=1)
    angle = np.arccos(np.einsum("kij,kij->ki", way, back) / np.linalg.norm(way, axis=2) / np.linalg.norm(back, axis=2))
    assert np.degrees(angle).min() > 11


def test_a_line_may_go_round_a_bend_and_end_at_a_corner():
    strap = panel("strap", [(0, 0), (0.2, 0), (0.2, 0.02), (0, 0.02)], 0.02)
    bend = ((0.05, 0.05), (0.05, 0.15), (0.15, 0.15))
    garment = tc.Pattern((front(), strap), (tc.Stitch(("strap", 0), ("front", bend), together=True),
                                            tc.Stitch(("strap", ((0.0, 0.02),)), ("front", ((0.4, 0.3),))))).mesh(0.02)
    line, button = garment.seams
    at = garment.mesh.uv[line.b]
    s = np.linspace(0, 0.2, 11)
    assert at == pytest.approx(np.column_stack([0.05 + np.maximum(s - 0.1, 0), 0.05 + np.minimum(s, 0.1)]), abs=1e-12)
    ends = garment.mesh.uv[[button.a[0], button.b[0]]]
    assert ends == pytest.approx(np.array([[0, 0.02], [0.4, 0.3]]))
    assert garment.mesh.notes == ()


@pytest.mark.parametrize("a, b, what", [
    (("pocket", 2), ("front", ((0.1, 0.1), (0.5, 0.1))), r"stitch 5: \(0.5, 0.1\) m is not within panel 'front'"),
    (("pocket", 2), ("front", ((0.2, 0.0), (0.3, 0.1))), r"stitch 5: \(0.2, 0\) m is not within panel 'front', nor a corner"),
    (("pocket", 2), ("front", ((0.38, 0.08), (0.38, 0.22))), "stitch 5: the line leaves panel 'front' near"),
    (("pocket", 2), ("front", ((0.1, 0.1),)), "edge 2 of panel 'pocket' to a point at .* a point is sewn to a point"),
    (("pocket", ((0.05, 0.05),)), ("front", 3), "a point is sewn to a point"),
    (("pocket", 2), ("front", ()), "points of panel 'front': there is none"),
    (("pocket", 2), ("front", ((0.1, 0.1), (0.1, 0.1))), "points of panel 'front': one of them follows itself"),
    (("pocket", 2), ("front", ((0.1, float("nan")), (0.1, 0.1))), "not finite"),
    (("pocket", 2), ("front", "waist"), "stitch: b, edge"),
    (("pocket", 2), ("front", ((0.02, 0.02), (0.03, 0.02))), "stitch 5: edge 2 of panel 'pocket' is 0.12 m long"),
    (("pocket", 2), place(1, 2), "a line at .* of panel 'front' is sewn twice, by stitches 1 and 5"),
    (("sleeve", ((0.1, 0.1),)), ("front", ((0.1, 0.1),)), "stitch 5: there is no panel 'sleeve'"),
    (("front", ((0.1, 0.1),)), ("front", ((0.1, 0.1),)), "sews a point at .* to itself")])
def test_what_cannot_be_sewn_is_named(a, b, what):
    with pytest.raises(tc.SceneError, match=what):
        with_pocket(tc.Stitch(a, b))


def test_a_button_has_no_strength_a_length():
    with pytest.raises(tc.SceneError, match=r"a point has no strength.* use Scene.stitch\(force=...\)"):
        tc.Stitch(("a", ((0.1, 0.1),)), ("b", ((0.1, 0.1),)), strength=10.0)


def test_lines_that_cross_are_named():
    one, other = (("front", line) for line in (((0.05, 0.25), (0.25, 0.05)), ((0.05, 0.05), (0.25, 0.25))))
    straps = [panel(name, [(0, 0), (0.28, 0), (0.28, 0.02), (0, 0.02)], z) for name, z in (("one", 0.02), ("two", 0.04))]
    pattern = tc.Pattern((front(), *straps), (tc.Stitch(("one", 0), one), tc.Stitch(("two", 0), other)))
    with pytest.raises(tc.MeshError, match="panel 'front': a line within it that is sewn is lost near"):
        pattern.mesh(0.06)
    meeting = pattern.mesh(0.036)  # both have a point where they cross
    assert len(np.intersect1d(meeting.seams[0].b, meeting.seams[1].b)) == 1


def test_a_panel_that_no_seam_holds_is_named():
    pocket = panel("pocket", POCKET, 0.02)
    sewn = tc.Stitch(("back", 0), ("front", 0))
    alone = tc.Pattern((front(), panel("back", [(0, 0), (0.4, 0), (0.4, 0.1), (0, 0.1)], -0.1), pocket), (sewn,)).mesh(0.05)
    (note,) = alone.mesh.notes
    assert note == "no seam holds 'pocket' to the rest of the garment: nothing keeps it there while it is put on"
    assert len(alone.parts()) == 2 and not with_pocket().mesh(0.05).mesh.notes
    assert tc.Pattern((front(), pocket)).mesh(0.05).mesh.notes == ()  # pieces of which nothing is sewn


def test_points_are_in_the_file_too(tmp_path):
    """In its units, as corners are."""
    square = lambda w, h: {"vertices": [[0, 0], [w, 0], [w, h], [0, h]],  # noqa: E731
                           "edges": [{"endpoints": [k, (k + 1) % 4]} for k in range(4)]}
    panels = {"front": square(40, 30), "patch": {**square(10, 8), "translation": [0, 0, 2]}}
    data = {"pattern": {"panels": panels, "stitches": [
        [{"panel": "patch", "edge": 0}, {"panel": "front", "points": [[22, 11], [12, 11]]}],
        [{"panel": "patch", "points": [[5, 7]]}, {"panel": "front", "points": [[17, 18]]}]]}}
    path = tmp_path / "patch.json"
    path.write_text(json.dumps(data))
    pattern = tc.load_pattern(path)
    assert pattern.stitches == (tc.Stitch(("patch", 0), ("front", [(0.22, 0.11), (0.12, 0.11)])),
                                tc.Stitch(("patch", [(0.05, 0.07)]), ("front", [(0.17, 0.18)])))
    data["pattern"]["stitches"][1][1]["points"] = [["left", 3]]
    path.write_text(json.dumps(data))
    with pytest.raises(tc.SceneError, match="patch.json: stitch 1: points"):
        tc.load_pattern(path)


def test_remeshing_names_a_seam_within_a_panel():
    """It keeps borders: what is sewn to a line within a panel would be lost."""
    garment = with_pocket().mesh(0.04)
    with pytest.raises(tc.SceneError, match="remesh: seam 0 is sewn to a line within panel 'front': mesh its pattern"):
        tc.remesh(garment, 0.02)
    alone = tc.Garment(garment.mesh, garment.seams[4:])
    (button,) = tc.remesh(alone, 0.03).seams
    assert len(button.a) == 1


@pytest.mark.slow
def test_a_button_and_a_pocket_hold():
    """Sewn on the front, which hangs from its top: no gap anywhere, at rest under its weight."""
    garment = with_pocket().mesh(0.04)
    scene = tc.Scene()
    fabric = tc.Fabric(0.19, tc.Stretch(400, 0.4), tc.Shear(50, 0.05), tc.Bend(2e-5, 2e-7))
    cloth = scene.add_garment(garment, fabric, contact=tc.ClothContact(0.003, 0.3), pull=50.0)
    top = [v for v in garment.mesh.groups["front"] if garment.mesh.uv[v, 1] > 0.2999]
    scene.pin(cloth, top)
    with tc.Simulation(scene, h=1 / 60, cg_tol=1e-3) as sim:
        sim.run(0.6, fps=10)
        x = sim.positions()
        assert max(np.abs(x[s.a] - x[s.b]).max() for s in garment.seams) == 0
        assert sim.intersections() == 0 and sim.log[-1].stretch < 1.1
