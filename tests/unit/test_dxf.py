"""Patterns in DXF files as the apparel trade writes them, written here as text: pieces, units, sizes, folds, grain, copies."""

import json
import math

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.errors import SceneError

pytest.importorskip("ezdxf", reason="reading DXF needs the extra `dxf`")

FRONT = [(0, 0), (300, 0), (280, 250), (220, 400), (160, 330), (90, 330), (0, 420)]  # a curve from 280,250 to 220,400 and on
TURNS = [(0, 0), (300, 0), (220, 400), (0, 420)]
SQUARE = [(0, 0), (100, 0), (100, 100), (0, 100)]


def entity(kind: str, layer, **codes) -> str:
    return "".join(f"{code}\n{value}\n" for code, value in ((0, kind), (8, layer), *((k[1:], v) for k, v in codes.items())))


def text(words: str, layer=1) -> str:
    return entity("TEXT", layer, _10=0, _20=0, _40=5, _1=words)


def line(layer, a, b) -> str:
    return entity("LINE", layer, _10=a[0], _20=a[1], _11=b[0], _21=b[1])


def polyline(layer, points, closed=True) -> str:
    rows = [entity("VERTEX", layer, _10=x, _20=y) for x, y in points]
    return entity("POLYLINE", layer, _66=1, _70=int(closed)) + "".join(rows) + entity("SEQEND", layer)


def points(layer, places) -> str:
    return "".join(entity("POINT", layer, _10=x, _20=y) for x, y in places)


def block(name: str, *parts: str, piece="", **said) -> str:
    words = {"Piece Name": piece or name, **said}
    return entity("BLOCK", 1, _2=name, _70=0, _10=0, _20=0) + "".join(
        text(f"{key.replace('_', ' ')}: {value}") for key, value in words.items() if value is not None
    ) + "".join(parts) + entity("ENDBLK", 1)


def dxf(*blocks: str, units="METRIC", header="", inserts="") -> str:
    head = f"0\nSECTION\n2\nHEADER\n{header}0\nENDSEC\n" if header else ""
    own = text(f"Units: {units}") if units else ""
    return (f"{head}0\nSECTION\n2\nBLOCKS\n{''.join(blocks)}0\nENDSEC\n0\nSECTION\n2\nENTITIES\n"
            f"{text('Style Name: shirt')}{own}{inserts}0\nENDSEC\n0\nEOF\n")


@pytest.fixture
def load(tmp_path):
    def loaded(*blocks, side=None, size=None, scale=1.0, **more) -> tc.Pattern:
        (tmp_path / "shirt.dxf").write_text(dxf(*blocks, **more))
        if side:
            (tmp_path / "shirt.json").write_text(json.dumps(side))
        return tc.load_pattern(tmp_path / "shirt.dxf", size=size, scale=scale)
    return loaded


def front(*more: str, **said) -> str:
    return block("FRONT", polyline(1, FRONT), points(2, TURNS), *more, **said)


def drawn(panel: tc.Panel) -> np.ndarray:
    """(n, 2) [m] its border, from its first corner on."""
    border = panel.outline()[0]
    return border - border[0]


def test_edges_are_between_turn_points(load):
    """Millimetres; curves keep every point; the side file names edges by the same numbers."""
    side = {"labels": {"hem": [{"panel": "FRONT", "edge": 0}]}, "placement": {"FRONT": {"translation": [0, 90, 15]}}}
    panel, = load(front(points(3, FRONT[2:3]), line(7, (50, 10), (50, 90))), side=side).panels
    assert panel.name == "FRONT" and [e.kind for e in panel.edges] == ["line", "polyline", "polyline", "line"]
    assert np.abs(drawn(panel) - np.array(FRONT) / 1000).max() < 1e-12
    assert panel.edges[0].label == "hem" and panel.translation.tolist() == [0, 0.9, 0.15] and panel.grain == math.pi / 2
    low, high = panel.outline()[0].min(axis=0), panel.outline()[0].max(axis=0)
    assert np.abs(low + high).max() < 1e-12
    for k, way in ((1, FRONT[1:4]), (2, FRONT[3:7])):
        pieces = np.linalg.norm(np.diff(np.array(way) / 1000, axis=0), axis=1)
        assert panel.edges[k].length(panel.corners) == pytest.approx(pieces.sum(), abs=1e-12)
        steps = panel.edges[k].divided(panel.corners, 2)
        assert (steps[[0, 2]] == panel.corners[[k, k + 1]]).all()
    # half the way along edge 1: on its second piece
    a, b, c = np.array(FRONT[1:4]) / 1000
    long, short = np.linalg.norm(b - a), np.linalg.norm(c - b)
    half = b + (c - b) * ((long + short) / 2 - long) / short if long < short else a + (b - a) * (long + short) / 2 / long
    middle = panel.edges[1].divided(panel.corners, 2)[1] - panel.outline()[0][0]
    assert np.abs(middle - half).max() < 1e-12


@pytest.mark.parametrize("more, metres", [
    ({"units": "ENGLISH"}, 0.0254), ({"units": "metric"}, 1e-3), ({"units": "", "header": "9\n$INSUNITS\n70\n5\n"}, 1e-2),
    ({"units": "METRIC", "header": "9\n$INSUNITS\n70\n4\n"}, 1e-3), ({"units": "", "scale": 0.002}, 0.002),
    ({"units": "METRIC", "header": "9\n$INSUNITS\n70\n6\n"}, 1e-3)])
def test_units(load, more, metres):
    pattern = load(block("A", polyline(1, [(0, 0), (20, 0), (20, 30)])), **more)
    assert np.ptp(pattern.panels[0].corners, axis=0) == pytest.approx([20 * metres, 30 * metres])
    assert any("$INSUNITS = 6" in note for note in pattern.notes) == ("6" in more.get("header", ""))


def test_lines_and_arcs_in_any_order_are_one_outline(load):
    """Half a disk on a rectangle, its lines shuffled, reversed and one of them twice; without marks, edges end at corners."""
    lines = (line(1, (0, 0), (0, 100)), line(1, (200, 100), (200, 0)), line(1, (0, 100), (0, 0)),
             entity("ARC", 1, _10=100, _20=100, _40=100, _50=0, _51=180), line(1, (0, 0), (200, 0)))
    for turns, want in (([], [0.2, 0.2 + math.pi * 0.1]),  # the sides go on smoothly in the arc
                        ([(0, 0), (200, 0), (200, 100), (0, 100)], [0.1, 0.1, 0.2, math.pi * 0.1])):
        panel, = load(block("A", *lines, points(2, turns))).panels
        assert sorted(e.length(panel.corners) for e in panel.edges) == pytest.approx(want, rel=1e-4)
    half_a_turn = "10\n200\n20\n0\n42\n1\n"  # from there back to the first point
    bulged = polyline(1, [(0, 0), (200, 0)]).replace("10\n200\n20\n0\n", half_a_turn)
    border = load(block("A", bulged)).panels[0].outline()[0]
    assert np.ptp(border, axis=0) == pytest.approx([0.2, 0.1], rel=1e-4) and len(border) > 50


def test_corners_where_none_are_marked(load):
    """At sharp turns, but not at points of curves; a sixteenth of a circle turns by 22.5 degrees."""
    assert len(load(block("A", polyline(1, SQUARE), points(3, [(100, 100)]))).panels[0].edges) == 3
    round_ = [(100 + 100 * math.cos(k * math.pi / 8), 100 * math.sin(k * math.pi / 8)) for k in range(9)]
    assert [e.kind for e in load(block("A", polyline(1, round_))).panels[0].edges] == ["polyline", "line"]


def test_a_smooth_outline_is_cut_in_two(load):
    panel, = load(block("A", entity("CIRCLE", 1, _10=5, _20=5, _40=100))).panels
    one, other = (e.length(panel.corners) for e in panel.edges)
    assert one == pytest.approx(other, rel=0.05) and one + other == pytest.approx(math.tau * 0.1, rel=1e-4)


def test_a_half_is_unfolded(load):
    """Cut on the fold at x = 0, which is drawn the wrong way round; the neck has a curve; a whole piece stays as it is."""
    panel, = load(front(line(6, (0, 420), (0, 0)), line(7, (50, 0), (50, 90)))).panels
    border = panel.outline()[0]
    assert np.ptp(border, axis=0) == pytest.approx([0.6, 0.42])
    half = [p for p in FRONT if p[0] > 0]
    want = {(sign * x, y - 210) for x, y in half for sign in (1, -1)} | {(0, -210), (0, 210)}
    assert {tuple(p) for p in (border * 1000).round(6).tolist()} == want and len(border) == len(want)
    assert [e.kind for e in panel.edges] == ["line", "polyline", "polyline", "polyline", "polyline", "line"]
    lengths = [e.length(panel.corners) for e in panel.edges]
    assert lengths == pytest.approx(lengths[::-1])
    whole = [(-50, 0), (50, 0), (50, 80), (-50, 80)]
    assert len(load(block("A", polyline(1, whole), line(6, (0, 0), (0, 80)))).panels[0].edges) == 4


def test_the_sew_line_is_the_border(load):
    """Closed by itself, or by the fold; where it is open the outline is taken, and a note says so."""
    outer, inner = [(0, 0), (120, 0), (120, 90), (0, 90)], [(0, 10), (110, 10), (110, 80), (0, 80)]
    for closed, more in ((True, ""), (False, line(6, (0, 0), (0, 90)))):
        sewn = polyline(14, inner, closed)
        panel, = load(block("A", polyline(1, outer), points(2, [*outer, *inner]), sewn, more)).panels
        assert np.ptp(panel.outline()[0], axis=0) == pytest.approx([0.11 if closed else 0.22, 0.07])
    pattern = load(block("A", polyline(1, outer), polyline(14, inner, closed=False)))
    assert np.ptp(pattern.panels[0].corners, axis=0) == pytest.approx([0.12, 0.09])
    assert any("layer 14) is open" in note and note.endswith(": A") for note in pattern.notes)


@pytest.mark.parametrize("degrees, turned, warp", [(90, False, 90), (270, False, 90), (0, True, 90), (180, True, 90),
                                                   (45, False, 45), (135, False, 135), (10, True, 100), (-10, True, 80)])
def test_the_grain_line_is_the_warp(load, degrees, turned, warp):
    """A grain line that lies across is turned up, and material coordinates are along it and across."""
    way = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    pattern = load(block("A", polyline(1, [(0, 0), (200, 0), (200, 100), (0, 100)]), line(7, (100, 50), (100, 50) + 20 * way)))
    panel = pattern.panels[0]
    assert np.ptp(panel.corners, axis=0) == pytest.approx([0.1, 0.2] if turned else [0.2, 0.1])
    assert math.degrees(panel.grain) == pytest.approx(warp)
    pytest.importorskip("scipy")
    mesh = pattern.mesh(0.05).mesh
    along = np.array([math.cos(panel.grain), math.sin(panel.grain)])
    assert mesh.uv[:, 0] == pytest.approx(mesh.x[:, :2] @ along)
    assert mesh.uv[:, 1] == pytest.approx(mesh.x[:, :2] @ [-along[1], along[0]])


def test_copies_and_mirrored_ones(load):
    """Edge k of the mirrored panel is edge k of the other, seen in a mirror, grain and all."""
    grain = line(7, (50, 50), (70, 90))
    pattern = load(front(grain, Quantity="1,1"), block("CUFF", polyline(1, [(0, 0), (90, 0), (90, 40)]), Quantity="2"),
                   block("OLD", polyline(1, [(0, 0), (90, 0), (90, 40)]), Quantity="0"))
    assert [p.name for p in pattern.panels] == ["FRONT", "FRONT mirrored", "CUFF", "CUFF 2"]
    one, other = pattern.panels[:2]
    assert np.abs(one.outline()[0] * [-1, 1] - other.outline()[0]).max() < 1e-12
    assert (one.outline()[1] == other.outline()[1]).all() and one.grain + other.grain == pytest.approx(math.pi)
    assert any("quantity is 0: OLD" in note for note in pattern.notes)
    pytest.importorskip("scipy")
    side = {"stitches": [[{"panel": "FRONT", "edge": 3}, {"panel": "FRONT mirrored", "edge": 3}, "right_wrong"]]}
    garment = load(front(Quantity="1,1"), side=side).mesh(0.06)
    sewn, = garment.seams
    one, other = (garment.mesh.x[rows] for rows in sewn[:2])
    assert len(one) == 8 and np.abs(one * [-1, 1, 1] - other).max() < 1e-12  # in the middle, where both hang unplaced


def test_sizes(load):
    """Of graded pieces those of the size, and those that name none."""
    def square(name, piece, wide, size=None):
        return block(name, polyline(1, [(0, 0), (wide, 0), (wide, wide), (0, wide)]), piece=piece, Size=size)

    blocks = [square("F-S", "F", 100, "S"), square("F-M", "F", 120, "M"), square("LOOP", "LOOP", 30)]
    pattern = load(*blocks, size="M")
    assert {p.name: round(float(np.ptp(p.corners)), 6) for p in pattern.panels} == {"F": 0.12, "LOOP": 0.03}
    for size, words in ((None, "has 2 sizes: choose one by size=: S, M"), ("m", "has no size 'm'; did you mean 'M'")):
        with pytest.raises(SceneError, match=words):
            load(*blocks, size=size)
    with pytest.raises(SceneError, match="its pieces name none"):
        load(blocks[2], size="M")


def test_marks_are_told(load):
    pattern = load(front(points(4, [(100, 0), (150, 0)]), points(13, [(100, 50)]), polyline(11, [(9, 9), (12, 9), (12, 12)])))
    assert "drawn in the pieces, and no part of the panels: 2 notches, 1 cutouts, 1 drill holes" in pattern.notes
    assert any("grain line" in note and note.endswith("FRONT") for note in pattern.notes)
    square = block("A", polyline(1, SQUARE))
    assert any("turn points" in note and note.endswith("A") for note in load(square).notes)
    assert any("is damaged" in note and "100mm" in note for note in load(square.replace("20\n100\n", "20\n100mm\n", 1)).notes)


@pytest.mark.parametrize("blocks, more, words", [
    ((), {}, "there are no pieces in it"),
    ((block("A", polyline(8, SQUARE)),), {}, "piece 'A': has no outline: there is no line on its layer 1"),
    ((block("A", polyline(1, SQUARE, closed=False)),), {}, r"piece 'A': its outline \(layer 1\) is open: its ends are 0.1 m"),
    ((block("A", polyline(1, SQUARE), polyline(1, [(9, 9), (20, 9), (9, 20)])),), {}, "piece 'A': has 2 closed lines"),
    ((block("A", polyline(1, [(0, 0), (100, 100), (100, 0), (0, 100)])),), {}, "panel 'A': edges . and . cross or touch"),
    ((block("A", polyline(1, SQUARE), line(6, (-50, 0), (-50, 90))),), {}, "piece 'A': its mirror line"),
    ((block("A", polyline(1, SQUARE), Quantity="many"),), {}, "piece 'A': 'Quantity: many' must be a number"),
    ((block("A", polyline(1, SQUARE), Quantity="900"),), {}, "piece 'A': 'Quantity: 900' is more than 50"),
    ((block("A", polyline(1, SQUARE), Quantity="0"),), {}, "no piece of it is cut"),
    ((block("A", polyline(1, SQUARE)), block("B", polyline(1, SQUARE), piece="A")), {}, "two blocks are piece 'A'"),
    ((block("A", polyline(1, SQUARE)),), {"units": ""}, "no unit of length is named.*scale=0.001"),
    ((block("A", polyline(1, SQUARE)),), {"units": "ELLS"}, "'Units: ELLS' is not a known unit"),
    ((block("A", polyline(1, SQUARE)),), {"scale": 0.01}, "names its unit itself"),
    ((block("A", polyline(1, [(0, 0), (1e200, 0), (1, 1)])),), {}, "piece 'A': layer '1' has coordinates that are no numbers"),
    ((block("A", polyline(1, SQUARE)),), {"inserts": entity("INSERT", 1, _2="A", _10=0, _20=0, _41=2)}, "'A' is inserted 2"),
    ((block("A", polyline(1, SQUARE)),), {"side": {"labels": {"hem": [{"panel": "B", "edge": 0}]}}}, "there is no panel 'B'"),
])
def test_what_is_wrong_is_named(load, blocks, more, words):
    with pytest.raises(SceneError, match=words) as error:
        load(*blocks, **more)
    assert "shirt." in str(error.value) and "\n" not in str(error.value)


def test_files_that_are_none(tmp_path):
    path = tmp_path / "a.dxf"
    whole = dxf(front()).encode()
    for data in (b"", b"no drawing", b"\x00\x01\x02", b"0\nSECTION\n", whole[:500], whole[:-6]):
        path.write_bytes(data)
        with pytest.raises(SceneError, match="a.dxf: "):
            tc.load_pattern(path)
    with pytest.raises(SceneError, match="none.dxf: cannot be read"):
        tc.load_pattern(tmp_path / "none.dxf")
    path.write_text(dxf(front()))
    for more, words in (({"up": "z"}, "units and its axes itself"), ({"size": ""}, "size = ''")):
        with pytest.raises(SceneError, match=words):
            tc.load_pattern(path, **more)
    with pytest.raises(SceneError, match="has one size"):
        tc.load_pattern(tmp_path / "a.svg", size="M")
