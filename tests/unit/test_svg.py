"""Panels drawn in SVG files with a side file, and panels wrapped round a part of the body."""

import json

import numpy as np
import pytest

import taichi_cloth as tc

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="{w}" viewBox="0 0 1000 800"><g id="layer" transform="translate(10 20)">'
FRONT = '<path id="front" d="M 100,600 H 500 L 440,200 q -70 60 -140 0 C 250,180 200,180 160,200 Z"/>'
BACK = '<polygon id="back" transform="rotate(90) scale(1,-1)" points="600,560 600,960 200,900 200,620"/>'
SIDE = {"stitches": [[{"panel": "front", "edge": 1}, {"panel": "back", "edge": 3}, "right_wrong"],
                     [{"panel": "front", "edge": 4}, {"panel": "back", "edge": 1}, "right_wrong"]],
        "labels": {"hem": [{"panel": "front", "edge": 0}, {"panel": "back", "edge": 0}]},
        "placement": {"front": {"translation": [0, 80, 16]}, "back": {"translation": [0, 80, -16], "rotation": [0, 180, 0]}}}


def drawn(tmp_path, body: str, side=None, width="1000mm"):
    (tmp_path / "skirt.svg").write_text(HEAD.format(w=width) + body + "</g></svg>")
    if side is not None:
        (tmp_path / "skirt.json").write_text(side if isinstance(side, str) else json.dumps(side))
    return tc.load_pattern(tmp_path / "skirt.svg")


def middle_of(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2


def test_a_drawing_is_read(tmp_path):
    """Millimetres, y up, transforms, curves against their definition, labels, stitches, placement."""
    pattern = drawn(tmp_path, FRONT + "<!-- no shape --><text>front</text>" + BACK, SIDE)
    front, back = pattern.panels
    assert [e.kind for e in front.edges] == ["line", "line", "quadratic", "cubic", "line"] and len(back.edges) == 4
    shape = np.array([[100, -600], [500, -600], [440, -200], [300, -200], [160, -200]]) / 1000
    shift = front.corners[0] - shape[0]
    assert np.abs(front.corners - shape - shift).max() < 1e-12 and np.abs(middle_of(front.corners)).max() < 1e-12
    t = np.linspace(0, 1, 7)[:, None]
    a, c, b = (np.array(p) / 1000 for p in ((440, -200), (370, -260), (300, -200)))
    bend = (1 - t) ** 2 * a + 2 * t * (1 - t) * c + t**2 * b
    assert np.abs(front.edges[2].points(front.corners, t[:, 0]) - bend - shift).max() < 1e-12
    a, c, d, b = (np.array(p) / 1000 for p in ((300, -200), (250, -180), (200, -180), (160, -200)))
    bend = (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * c + 3 * t**2 * (1 - t) * d + t**3 * b
    assert np.abs(front.edges[3].points(front.corners, t[:, 0]) - bend - shift).max() < 1e-12
    # the polygon: scaled, then turned by 90 degrees, y down: (x, y) -> (x, -y) -> (y, x); and y up: (y, -x)
    turned = np.array([[560, -600], [960, -600], [900, -200], [620, -200]]) / 1000
    assert np.abs(np.diff(back.corners, axis=0) - np.diff(turned, axis=0)).max() < 1e-12
    assert front.edges[0].label == "hem" and pattern.stitches[0].together and pattern.stitches[1].a == ("front", 4)
    garment = pattern.mesh(0.04)
    x = garment.mesh.x[garment.mesh.groups["back"]]
    assert x[:, 2] == pytest.approx(-0.16) and middle_of(x)[1] == pytest.approx(0.8, abs=1e-9)
    assert middle_of(x[:, :1])[0] == pytest.approx(0, abs=1e-9)
    corners = garment.mesh.corner_uv
    area = np.linalg.det(corners[:, 1:] - corners[:, :1])
    assert (area > 0).all() and area.sum() / 2 == pytest.approx(0.136 + 0.136, abs=0.02)


def test_arcs_bend_as_drawn(tmp_path):
    """Half a disk whose arc goes clockwise on the screen, and one that goes the other way; mirrored as well."""
    for sweep, mirror, inside in ((1, "", True), (0, "", False), (1, "scale(-1,1)", True)):
        body = f'<path id="half" transform="{mirror}" d="M 200 400 A 200 200 0 0 {sweep} 600 400 L 600 700 L 200 700 Z"/>'
        panel = drawn(tmp_path, body).panels[0]
        points = panel.outline()[0]
        size = np.ptp(points, axis=0)
        assert size == pytest.approx([0.4, 0.5 if inside else 0.3], abs=1e-3), (sweep, mirror)
        assert panel.edges[0].length(panel.corners) == pytest.approx(np.pi * 0.2, rel=1e-4)


@pytest.mark.parametrize("width, size", [("1000mm", 0.4), ("100cm", 0.4), ("1000", 0.4 * 0.0254 / 0.096), ("10in", 0.1016)])
def test_units(tmp_path, width, size):
    assert np.ptp(drawn(tmp_path, FRONT, width=width).panels[0].corners[:, 0]) == pytest.approx(size)


@pytest.mark.parametrize("body, side, what", [
    ('<path d="M0 0 L 100 0 L 100 100 Z"/>', None, "id of a shape"),
    ('<path id="a" d="M0 0 L 100 0 L 100 100 Z M 10 10 L 20 10 Z"/>', None, "'a'.*single closed line|'a'.*several lines"),
    ('<path id="a" d="M0 0 L 100 B"/>', None, "'a'.*'B'"),
    ('<path id="a" d="M0 0 L 100"/>', None, "'a'.*single closed line"),
    ('<path id="a" d="M0 0 A 100 50 0 0 1 300 0 L 0 300 Z"/>', None, "'a': edge 0 is an arc of an ellipse"),
    ('<path id="a" d="M0 0 L 300 300 L 300 0 L 0 300 Z"/>', None, "'a'.*cross"),
    ('<path id="a" transform="skewX(3)" d="M0 0 L 100 0 L 100 100 Z"/>', None, "skewX"),
    ("<g/>", None, "no closed shape"),
    (FRONT, {"labels": {"hem": [{"panel": "frnt", "edge": 0}]}}, "label 'hem'.*'frnt'"),
    (FRONT, {"labels": {"hem": [{"panel": "front", "edge": 9}]}}, "label 'hem'"),
    (FRONT, {"stitches": [[{"panel": "front", "edge": 0}]]}, "stitch 0"),
    (FRONT, {"stitches": [[{"panel": "front", "edge": 0}, {"panel": "front", "edge": 0}]]}, "to itself"),
    (FRONT, {"placement": {"fromt": {}}}, "placement: there is no panel 'fromt'"),
    (FRONT, {"placement": {"front": {"around": [[0, 0, 0], [0, 50, 0]]}}}, "radius"),
    (FRONT, {"placement": {"front": {"around": [[0, 0, 0], [0, 50, 0]], "radius": 5}}}, "'front' is 0.4 m wide"),
    (FRONT, "{", "cannot be read"),
    (FRONT, "[]", "no side file"),
])
def test_what_is_wrong_with_a_drawing_is_named(tmp_path, body, side, what):
    with pytest.raises(tc.SceneError, match=what):
        drawn(tmp_path, body, side)


def test_files(tmp_path):
    with pytest.raises(tc.SceneError, match="cannot be read"):
        tc.load_pattern(tmp_path / "none.svg")
    (tmp_path / "bad.svg").write_text("<svg>")
    with pytest.raises(tc.SceneError, match="is no SVG"):
        tc.load_pattern(tmp_path / "bad.svg")
    (tmp_path / "other.svg").write_text("<html/>")
    with pytest.raises(tc.SceneError, match="root is <html>"):
        tc.load_pattern(tmp_path / "other.svg")
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(tc.SceneError, match="only an SVG"):
        tc.load_pattern(tmp_path / "a.json", side=tmp_path / "b.json")


def test_a_sleeve_is_wrapped_round_an_arm(rng):
    """Every point is as far from the arm's axis, lengths along it stay, the middle is at the turn."""
    corners = np.array([[0.1, 0], [0.3, 0], [0.35, 0.4], [0.05, 0.4]])
    sleeve = tc.Panel("sleeve", corners, tuple(tc.Curve(k, (k + 1) % 4) for k in range(4)))
    low, high = np.array([0.45, 1.12, 0.05]), np.array([0.19, 1.38, 0.0])
    v = (high - low) / np.linalg.norm(high - low)
    pattern = tc.Pattern((sleeve,)).wrap("sleeve", (high, low), 0.07, turn=0.4)
    x = pattern.mesh(0.03).mesh.x
    along = (x - (low + high) / 2) @ v
    away = x - (low + high) / 2 - along[:, None] * v
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.07, abs=1e-12) and np.ptp(along) == pytest.approx(0.4)
    assert along.max() == pytest.approx(0.2) and np.ptp(x[np.abs(along - 0.2) < 1e-9] @ v) < 1e-9
    front = np.array([0, 0, 1.0]) - v[2] * v
    front /= np.linalg.norm(front)
    side = np.cross(v, front)
    angle = np.arctan2(away @ side, away @ front)
    assert (angle.min() + angle.max()) / 2 == pytest.approx(0.4, abs=0.05)
    assert np.ptp(angle) == pytest.approx(0.3 / 0.07, rel=0.02)
    # from points of the arm
    turn = rng.uniform(0, 2 * np.pi, 4000)
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * front
    arm = low + rng.uniform(0, 1, 4000)[:, None] * (high - low) + 0.04 * around
    x = tc.Pattern((sleeve,)).wrap("sleeve", arm, gap=0.02).mesh(0.03).mesh.x
    away = x - low - ((x - low) @ v)[:, None] * v
    assert np.linalg.norm(away, axis=1) == pytest.approx(0.06, abs=4e-3)
    for bad, what in ((("sleeve", (low, high)), "radius"), (("slev", arm), "'slev'"),
                      (("sleeve", np.ones((5, 3))), "single point"),
                      (("sleeve", (low, high), 0.03), "0.3 m wide")):
        with pytest.raises(tc.SceneError, match=what):
            tc.Pattern((sleeve,)).wrap(*bad)


def test_an_elastic_band_is_short_at_rest():
    knit = tc.fabrics["rib_knit"]
    band = knit.elastic((0.8, 1))
    assert band.stretch.b == (0.8, 1.0) and band.stretch.k == knit.stretch.k and band.bend == knit.bend
    for bad, what in ((lambda: knit.elastic(0), "stretch b"), (lambda: tc.Fabric(0.2).elastic(0.8), "no stretch")):
        with pytest.raises(tc.SceneError, match=what):
            bad()
