"""Panels drawn in SVG files with a side file, and panels wrapped round a part of the body."""

import gzip
import json
import pathlib
import re

import numpy as np
import pytest

import taichi_cloth as tc

pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")

HEAD = '<svg xmlns="http://www.w3.org/2000/svg" width="{w}" viewBox="0 0 1000 800"><g id="layer" transform="translate(10 20)">'
FRONT = '<path id="front" d="M 100,600 H 500 L 440,200 q -70 60 -140 0 C 250,180 200,180 160,200 Z"/>'
BACK = '<polygon id="back" transform="rotate(90) scale(1,-1)" points="600,560 600,960 200,900 200,620"/>'
PAGE = ('<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        'xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape" width="1000mm" viewBox="0 0 1000 800">')
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


def points_of(panel: tc.Panel, t=(0.0, 0.5)) -> np.ndarray:
    """(n, 2) of each edge's start and middle, in millimetres, y down, from the first corner on."""
    points = np.concatenate([edge.points(panel.corners, np.array(t)) for edge in panel.edges])
    return (points - points[0]) * [1000, -1000]


def bezier(points, t: float) -> np.ndarray:
    """De Casteljau's construction."""
    points = np.asarray(points, dtype=float)
    while len(points) > 1:
        points = (1 - t) * points[:-1] + t * points[1:]
    return points[0]


A, B, C, D = (100, 400), (500, 400), (600, 200), (300, 100)


@pytest.mark.parametrize("d, segments", [
    ("M100 400 L 500 400 S 600 200 300 100 Z", [(A, B), (B, B, C, D), (D, A)]),
    ("M100 400 L 500 400 T 300 100 Z", [(A, B), (B, B, D), (D, A)]),
    ("M100 400 Q 300 500 500 400 S 600 200 300 100 Z", [(A, (300, 500), B), (B, B, C, D), (D, A)]),
    ("M100 400 C 200 500 400 500 500 400 T 300 100 Z", [(A, (200, 500), (400, 500), B), (B, B, D), (D, A)]),
    ("M100 400 C 200 500 400 500 500 400 S 600 200 300 100 Z", [(A, (200, 500), (400, 500), B), (B, (600, 300), C, D),
                                                              (D, A)]),
    ("M100 400 s 300 100 400 0 t-200 -300z", [(A, A, (400, 500), B), (B, B, D), (D, A)]),
    ("M100 400 q 100 100 200 0 t200 0 L300,100z", [(A, (200, 500), (300, 400)), ((300, 400), (400, 300), B), (B, D), (D, A)]),
    ("M300 100 L 600 200 M100 400 S 400 500 500 400 L 300 100 Z", [(A, A, (400, 500), B), (B, D), (D, A)]),
    ("m100 400 400 0 -200 -300z", [(A, B), (B, D), (D, A)]),
    ("M100,400 500,400 300,100Z", [(A, B), (B, D), (D, A)]),
    ("M100,400 500,400 300,100 100 400", [(A, B), (B, D), (D, A)]),
    ("M100 400h400v-300h-400z", [(A, B), (B, (500, 100)), ((500, 100), (100, 100)), ((100, 100), A)]),
    ("m100 400 h400 V100 H100 z", [(A, B), (B, (500, 100)), ((500, 100), (100, 100)), ((100, 100), A)]),
    ("M100 400l400-0 .5e1-3e2.0.0-405 0z", [(A, B), (B, (505, 100)), ((505, 100), (100, 100)), ((100, 100), A)]),
    ("M0 0 H10 Z m100 400 L 500 400 L 300 100 Z", [(A, B), (B, D), (D, A)]),
    ("M100 400 A 0 50 0 0 1 500 400 S 600 200 300 100 Z", [(A, B), (B, B, C, D), (D, A)]),
    ("M100 400 A 5 5 0 0 1 100 400 L 500 400 L 500 400 L 300 100 Z", [(A, B), (B, D), (D, A)]),
    ("M100 400 C 500 400 500 100 100 400 Z", [(A, (300, 400), (400, 325), (400, 287.5)),
                                              ((400, 287.5), (400, 250), (300, 250), A)]),
])
def test_path_commands(tmp_path, d, segments):
    """Against control points worked out by hand: smooth curves after others, relative ones, lines that M and Z imply."""
    panel = drawn(tmp_path, f'<path id="a" d="{d}"/>').panels[0]
    kinds = {2: "line", 3: "quadratic", 4: "cubic"}
    assert [edge.kind for edge in panel.edges] == [kinds[len(s)] for s in segments]
    t = (0.0, 0.2, 0.5, 0.9)
    expected = np.array([bezier(s, each) for s in segments for each in t])
    assert np.abs(points_of(panel, t) - (expected - expected[0])).max() < 1e-9


@pytest.mark.parametrize("d", ["M100 400 a200 200 0 01400 0z", "M100 400a200,200,0,0,1,400,0z",
                               "M100 400A200 200 0 0 1 500 400z", "M100 400a-10 10 0 11400 0z",
                               "M100 400a2e2 200 77 0 1400 0z"])
def test_arcs_as_files_write_them(tmp_path, d):
    """Flags without spaces, radii that do not reach, negative ones: half a circle."""
    panel = drawn(tmp_path, f'<path id="a" d="{d}"/>').panels[0]
    assert [edge.kind for edge in panel.edges] == ["circle", "line"]
    assert np.abs(points_of(panel) - [[0, 0], [200, -200], [400, 0], [200, 0]]).max() < 1e-5


@pytest.mark.parametrize("tilt", [0, 30, 90, -70])
@pytest.mark.parametrize("matrix", ["", "matrix(1 .3 .5 2 4 5)", "matrix(-1 .3 .5 2 4 5)", "skewX(40) scale(.5 1)"])
def test_arcs_of_ellipses(tmp_path, tilt, matrix):
    """Every point as its definition has it, turned and sheared; both ways round, and the large arc."""
    M = {"": np.eye(2), "matrix(1 .3 .5 2 4 5)": np.array([[1, 0.5], [0.3, 2]]),
         "matrix(-1 .3 .5 2 4 5)": np.array([[-1, 0.5], [0.3, 2]]),
         "skewX(40) scale(.5 1)": np.array([[0.5, np.tan(np.radians(40))], [0, 1]])}[matrix]
    a = np.radians(tilt)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    for first, last, large, sweep in ((2.5, 4.5, 0, 1), (4.5, 2.5, 0, 0), (0.5, 5.5, 1, 1), (5.5, 0.5, 1, 0)):
        t = np.linspace(0, 1, 9)
        angle = first + t * (last - first)
        points = np.column_stack([120 * np.cos(angle), 50 * np.sin(angle)]) @ turn.T
        (x, y), (u, v) = points[0], points[-1]
        d = f"M{x:.12g} {y:.12g} A 120 50 {tilt} {large} {sweep} {u:.12g} {v:.12g} L 0 0 z"
        panel = drawn(tmp_path, f'<path id="a" transform="{matrix}" d="{d}"/>').panels[0]
        assert panel.edges[0].kind == "ellipse"
        expected = (points - points[0]) @ M.T
        assert np.abs(points_of(panel, t)[:9] - expected).max() < 1e-6, (first, last)


def test_what_an_ellipse_cannot_be_is_named():
    for parameters, what in (((1, 2, 0), "parameters radius, other radius, angle"), ((1, 0, 0, True, True), "other radius"),
                             ((1, 2, "x", True, True), "angle"), ((1, 2, 0, 3, True), "large")):
        with pytest.raises(tc.SceneError, match=what):
            tc.Curve(0, 1, "ellipse", parameters)


SQUARE = '<rect id="r" width="100" height="50"/>'


@pytest.mark.parametrize("body, panels", [
    ('<circle id="c" cx="50" r="30"/>', {"c": (4, 60, 60)}),
    ('<ellipse id="c" cx="50" rx="30" ry="45"/>', {"c": (4, 60, 90)}),
    ('<ellipse id="c" rx="30" ry="auto"/>', {"c": (4, 60, 60)}),
    ('<rect id="c" rx="10" width="100" height="50"/>', {"c": (8, 100, 50)}),
    ('<rect id="c" rx="90" ry="5" width="100" height="50"/>', {"c": (6, 100, 50)}),
    ('<rect id="c" width="5%" height="10%"/>', {"c": (4, 50, 80)}),
    ('<rect id="c" width="5in" height="48pt"/>', {"c": (4, 480, 64)}),  # of 96 to an inch, as all of a drawing's units
    ('<polyline id="c" points="0 0 50 0 50 40 0,0"/>', {"c": (3, 50, 40)}),
    (SQUARE + '<use id="s" href="#r" x="3" y="1e3" transform="rotate(90)"/>', {"r": (4, 100, 50), "s": (4, 50, 100)}),
    (SQUARE + '<use href="#r"/><use xlink:href="#r" transform="scale(2)"/>', {"r": (4, 100, 50), "r 2": (4, 100, 50),
                                                                              "r 3": (4, 200, 100)}),
    ('<defs><g id="g"><rect width="7" height="5"/></g></defs><use id="s" href="#g"/>', {"s": (4, 7, 5)}),
    ('<use id="s" href="#r"/><defs>' + SQUARE + "</defs>", {"s": (4, 100, 50)}),
    ('<symbol id="y" viewBox="0 0 10 10"><rect id="c" width="8" height="5"/></symbol><use width="200" '
     'height="300" href="#y"/>', {"c": (4, 160, 100)}),
    ('<svg width="50" height="90" viewBox="0 0 100 100">' + SQUARE + "</svg>", {"r": (4, 50, 25)}),
    ('<svg width="50" height="90" viewBox="0 0 100 100" preserveAspectRatio="xMinYMin slice">' + SQUARE + "</svg>",
     {"r": (4, 90, 45)}),
    ('<svg width="50" height="90" viewBox="0 0 100 100" preserveAspectRatio="none">' + SQUARE + "</svg>", {"r": (4, 50, 45)}),
    ('<g id="pocket"><rect width="5" height="5"/><rect width="6" height="6"/></g>', {"pocket": (4, 5, 5),
                                                                                    "pocket 2": (4, 6, 6)}),
    ('<rect id="rect12" inkscape:label="Left  front" width="5" height="5"/>', {"Left front": (4, 5, 5)}),
    ('<rect id="rect12" width="5" height="5"><title>back</title></rect>', {"back": (4, 5, 5)}),
])
def test_shapes_and_their_names(tmp_path, body, panels):
    """Name, number of edges, width and height [mm]."""
    (tmp_path / "a.svg").write_text(PAGE + body + "<rect id='far' width='400' height='1'/></svg>")
    read = tc.load_pattern(tmp_path / "a.svg").panels
    got = {p.name: (len(p.edges), *(np.ptp(p.outline()[0], axis=0) * 1000).round(3)) for p in read}
    assert got.pop("far") == (4, 400, 1) and got == panels


@pytest.mark.parametrize("body", [
    '<rect display="none" {}/>', '<g style="display:none !important">\n<g><rect {}/></g></g>',
    '<rect visibility="hidden" {}/>',
    '<g style="fill:red;visibility: collapse"><rect {}/></g>',
    '<g inkscape:groupmode="layer" style="display:none"><rect {}/></g>',
    '<g class="x h"><rect {}/></g><style>/* a{{ */ .h, path.j {{fill:red; display : none}}</style>',
    '<style>@import "a.css"; #hidden{{visibility:hidden}}</style><rect {}/>',
    '<style>rect.h{{display:none}}</style><rect class="h" {}/>',
    '<use href="#hidden" display="none"/><defs><rect {}/></defs>', "<defs><rect {}/></defs>", "<symbol><rect {}/></symbol>",
    "<clipPath><rect {}/></clipPath>", "<mask><rect {}/></mask>", "<pattern><rect {}/></pattern>",
    "<marker><rect {}/></marker>",
    "<foreignObject><rect {}/></foreignObject>", "<metadata><rect {}/></metadata>", '<x:g xmlns:x="other"><rect {}/></x:g>',
])
def test_hidden_shapes_are_left_out(tmp_path, body):
    hidden = body.format('id="hidden" width="50" height="50"')
    (tmp_path / "a.svg").write_text(PAGE + SQUARE + hidden + "</svg>")
    pattern = tc.load_pattern(tmp_path / "a.svg")
    assert [p.name for p in pattern.panels] == ["r"]
    said = any("hidden elements of the drawing that are left out: 1" in note for note in pattern.notes)
    assert said == any(word in body for word in ("display", "visibility"))


@pytest.mark.parametrize("body", [
    '<g visibility="hidden"><rect style="visibility:visible" {}/></g>',
    '<style>@media print {{.h{{display:none}} .i{{display:none}}}}</style><rect class="h i" {}/>',
    '<style>.h{{display:none}}</style><rect class="h" style="display:inline" {}/>',
    "<switch><a><rect {}/></a></switch>"])
def test_visible_shapes_stay(tmp_path, body):
    (tmp_path / "a.svg").write_text(PAGE + body.format('id="b" width="50" height="50"') + "</svg>")
    assert [p.name for p in tc.load_pattern(tmp_path / "a.svg").panels] == ["b"]


def test_open_lines_are_no_panels(tmp_path):
    """Grain lines, notches, lines to and fro, a point; but an end that misses the start by a rounding is closed."""
    lines = ('<path id="grain" d="M 50,10 L 50,40"/><line id="notch" x2="5"/><polyline points="0 0 50 50 90 0 95 9"/>'
             '<path id="fold" d="M0 0 V 50 V 0 Z"/><path id="dot" d="M3 3"/><path id="none" d=""/><rect id="flat" width="5"/>')
    almost = '<path id="almost" d="M0,0 H 100 V 50 L 0.004,0.003"/>'
    pattern = drawn(tmp_path, SQUARE + lines + almost)
    assert [(p.name, len(p.edges)) for p in pattern.panels] == [("r", 4), ("almost", 3)]
    assert pattern.notes == ("lines of the drawing that are no panels, such as notches and grain lines: 4 "
                             "(fold, grain, layer, notch)",)
    assert pattern.notes[0] in pattern.mesh(0.02).mesh.notes
    with pytest.raises(tc.SceneError, match="no closed shape in it; 4 lines are open"):
        drawn(tmp_path, lines)


PART = """<g id="fs-stack-tee.{0}" transform="translate(9 9)"><g id="fs-stack-tee.{0}-part-tee.{0}">{1}</g></g>"""


def test_freesewing_parts(tmp_path):
    """The seam line of each part, by the part's name: no seam allowance, notes, scale box, marks, nor what snippets draw."""
    seam, sa = "M 0,0 L 200,0 C 200,50 180,100 180,150 L 0,150 z", "M -10,-10 L 210,-10 L 190,160 L -10,160 z"
    parts = (PART.format("front", f'<path class="fabric" id="fs-1" d="{seam}"/><path class="fabric sa" id="fs-2" d="{sa}"/>'
                                  '<path class="note" marker-start="url(#cutonfoldFrom)" d="M0,5 L15,5 L15,99 L0,99"/>'
                                  '<path class="scalebox imperial fill-current" d="M0 0h300v300h-300z"/>'
                                  '<path class="fabric" id="fs-9" d="M 50 50 L 60 40 L 70 50 Z"/>'
                                  '<use xlink:href="#logo" x="3"/><circle r="3" class="note"/>')
             + PART.format("back", f'<path id="fs-3" d="{seam} M 5,5 L 9,9"/><path class="lining dashed" d="{sa}"/>')
             + PART.format("pocket", f'<path class="lining stroke-lg" id="fs-4" d="{seam}"/>') + PART.format("empty", ""))
    head = ('<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" class="freesewing" '
            'width="500mm" height="300mm" viewBox="0 0 500 300"><defs>'
            '<g id="logo"><path d="M0 0h9v9z m1 1 h900v9z"/></g></defs>'
            '<g id="fs-container">')
    (tmp_path / "tee.svg").write_text(head + parts + "</g></svg>")
    pattern = tc.load_pattern(tmp_path / "tee.svg")
    assert [p.name for p in pattern.panels] == ["tee.front", "tee.back", "tee.pocket"]
    for p in pattern.panels:
        assert [e.kind for e in p.edges] == ["line", "cubic", "line", "line"]
        assert np.ptp(p.corners, axis=0) == pytest.approx([0.2, 0.15])
    assert "halves that are cut on a fold, and are read as drawn: 1 (tee.front)" in pattern.notes


@pytest.mark.parametrize("head, size", [
    ('width="1000mm"', 0.4), ('width="100cm" height="100%"', 0.4), ('height="800mm"', 0.4), ('width="10in"', 0.1016),
    ('width=" 1000 "', 0.4 * 0.0254 / 0.096), ('width="1000px"', 0.4 * 0.0254 / 0.096), ('width="4000Q"', 0.4),
    ('width="2000mm" height="800mm"', 0.4), ('width="2000mm" height="800mm" preserveAspectRatio="none"', 0.8),
    ('width="2000mm" height="800mm" preserveAspectRatio="xMidYMid slice"', 0.8), ('width="720pt"', 0.1016),
])
def test_units(tmp_path, head, size):
    (tmp_path / "a.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {head} viewBox="0 0 1000 800">{FRONT}</svg>')
    pattern = tc.load_pattern(tmp_path / "a.svg")
    assert np.ptp(pattern.panels[0].corners[:, 0]) == pytest.approx(size)
    doubt = [note for note in pattern.notes if "no unit of length" in note]
    assert len(doubt) == ("1000 " in head or "px" in head)
    assert not any("no viewBox" in note for note in pattern.notes)


@pytest.mark.parametrize("side, size", [("400", 0.4 * 0.0254 / 0.096), ("400mm", 0.4), ("40", None)])
def test_a_width_without_a_viewbox_is_of_the_page_alone(tmp_path, side, size):
    (tmp_path / "a.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" width="500mm" height="500mm">'
                                    f'<rect id="r" width="{side}" height="{side}"/></svg>')
    if size is None:
        with pytest.raises(tc.SceneError, match="are its units right.*no viewBox: numbers without a unit are pixels"):
            tc.load_pattern(tmp_path / "a.svg")
        return
    pattern = tc.load_pattern(tmp_path / "a.svg")
    assert np.ptp(pattern.panels[0].corners[:, 0]) == pytest.approx(size)
    assert sum("no viewBox" in note for note in pattern.notes) == 1


@pytest.mark.parametrize("body, side, what", [
    ('<path d="M0 0 L 100 0 L 100 100 Z"/>', None, None),
    ('<g id=" "><path d="M0 0 L 100 0 L 100 100 Z"/></g>', None, None),
    ('<path id="a" d="M0 0 L 100 0 L 100 100 Z M 10 10 L 20 10 L 20 20 Z"/>', None, "'a'.*several closed lines"),
    ('<path id="a" d="M0 0 L 100 B"/>', None, "'a'.*1 of 2 numbers after L"),
    ('<path id="a" d="M0 0 B 100"/>', None, "'a'.*'B 100' at character 6"),
    ('<path id="a" d="M0 0 L 100"/>', None, "'a'.*1 of 2 numbers after L, at character 11"),
    ('<path id="a" d="L 5 5z"/>', None, "'a'.*does not begin with M"),
    ('<path id="a" d="M0 0 H 50 V 50 z 3 4"/>', None, "'3 4' at character 18"),
    ('<path id="a" d="M0 0 L nan 0 L 5 5z"/>', None, "0 of 2 numbers after L"),
    ('<path id="a" d="M0 0 L inf 0 L 5 5z"/>', None, "0 of 2 numbers after L"),
    ('<path id="a" d="M0 0 L 1e400 0 L 5 5z"/>', None, "'1e400' is too large"),
    ('<path id="a" d="M0 0 A5 5 0 2 1 10 0L5 5z"/>', None, "3 of 7 numbers after A"),
    ('<path id="a" d="M0 0 L 300 300 L 300 0 L 0 300 Z"/>', None, "'a'.*cross"),
    ('<path id="a" transform="wobble(3)" d="M0 0 L 100 0 L 100 100 Z"/>', None, "'a': transform 'wobble"),
    ('<path id="a" transform="scale(1" d="M0 0 L 100 0 L 100 100 Z"/>', None, "transform 'scale"),
    ('<path id="a" transform="rotate(1 2)" d="M0 0 L 100 0 L 100 100 Z"/>', None, "rotate has 2 numbers: it takes 1 or 3"),
    ('<path id="a" style="transform:rotate(3deg)" d="M0 0 L 100 0 L 100 100 Z"/>', None, "transform in a style"),
    ('<g transform="scale(1e30)">' * 12 + SQUARE + "</g>" * 12, None, "transforms are too large"),
    ('<rect id="a" width="abc" height="4"/>', None, "rect 'a': width = 'abc': is not a length"),
    ('<rect id="a" width="-4" height="4"/>', None, "width = -4: must be 0 or more"),
    ('<rect id="a" width="4em" height="4"/>', None, "unit 'em' is not read"),
    ('<circle id="a" r="-1"/>', None, "rx = -1"),
    ('<polygon id="a" points="0 0 50 0 50"/>', None, "5 numbers are not points"),
    ('<polygon id="a" points="0 0 50 x"/>', None, "points: 'x' is not a number"),
    ('<svg viewBox="0 0 0 5">' + SQUARE + "</svg>", None, "viewBox = '0 0 0 5'"),
    ('<use id="a" href="#a"/>', None, "use 'a' draws itself"),
    ('<g id="g"><use href="#g"/></g>', None, "draws itself: 'g'"),
    ('<g id="g"><use href="#h"/></g><g id="h"><use href="#g"/></g>', None, "draws itself"),
    ('<use href="b.svg#a"/>', None, "'b.svg#a': only elements of the drawing"),
    ("".join(f'<g id="u{k + 1}"><use href="#u{k}"/><use href="#u{k}"/></g>' for k in range(40)) + f'<g id="u0">{SQUARE}</g>',
     None, "more than 20000 elements are drawn by <use>"),
    (SQUARE + SQUARE, None, "two panels have one name, 'r'"),
    ("<g/>", None, "no closed shape"),
    (FRONT, {"labels": {"hem": [{"panel": "frnt", "edge": 0}]}}, "label 'hem'.*'frnt'"),
    (FRONT, {"labels": {"hem": [{"panel": "front", "edge": 9}]}}, "label 'hem'"),
    (FRONT, {"stitches": [[{"panel": "front", "edge": 0}]]}, "stitch 0"),
    (FRONT, {"stitches": [[{"panel": "front", "edge": 0}, {"panel": "front", "edge": 0}]]}, "to itself"),
    (FRONT, {"placement": {"fromt": {}}}, "placement: there is no panel 'fromt'"),
    (FRONT, {"placement": {"front": {"around": [[0, 0, 0], [0, 50, 0]]}}}, "radius"),
    (FRONT, {"placement": {"front": {"around": [[0, 0, 0], [0, 50, 0]], "radius": 5}}}, "'front' is 0.4 m wide"),
    (FRONT, "{", "cannot be read"),
    (FRONT, "[]", "not a side file"),
])
def test_what_is_wrong_with_a_drawing_is_named(tmp_path, body, side, what):
    if what is None:  # the name is that of the layer
        assert [p.name for p in drawn(tmp_path, body, side).panels] == ["layer"]
        return
    with pytest.raises(tc.SceneError, match=what) as error:
        drawn(tmp_path, body, side)
    assert str(tmp_path) in str(error.value)


def test_a_shape_without_any_name(tmp_path):
    (tmp_path / "a.svg").write_text(PAGE + SQUARE + "\n<rect width='5' height='5'/></svg>")
    with pytest.raises(tc.SceneError, match="the rect in line 2 is closed and has no name"):
        tc.load_pattern(tmp_path / "a.svg")


BOMB = '<!DOCTYPE svg [<!ENTITY a0 "lol">' + "".join(f'<!ENTITY a{k + 1} "{f"&a{k};" * 10}">' for k in range(12)) + "]>"


@pytest.mark.parametrize("data, what", [
    (b"", "is not XML"), (b"  \n", "is not XML"), (b"hello", "is not XML"), (b"<svg>", "is not XML"),
    (bytes(range(256)), "is not XML"), (b"<html/>", "its root is <html>"),
    (BOMB.encode() + b"<svg>&a12;</svg>", "declares the entity 'a1'"),
    (b'<!DOCTYPE svg [<!ENTITY a "' + b"x" * 9999 + b'">]><svg>' + b"&a;" * 9999 + b"</svg>", "declares the entity 'a'"),
    (b'<!DOCTYPE svg [<!ENTITY a SYSTEM "file:///a">]><svg>&a;</svg>', "declares the entity 'a'"),
    (b'<?xml version="1.0" encoding="utf-7"?><svg/>', "is not XML"),
    (b'<?xml version="1.0" encoding="odd"?><svg/>', "is not XML"),
    (gzip.compress(b"<svg/>", mtime=0)[:20], "cannot be unpacked"),
    (gzip.compress(bytes(1 << 17), mtime=0) * 600, "larger than 64 MB"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"><rect id="r" width="5" height="5"/></svg>', "it has no size"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9" width="x"/>', "drawing's width = 'x': is not a length"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9" width="9"/>', "viewBox = '0 0 9'"),
    (b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1e-320 9" width="9"/>',
     "1e-320 9': (is too small|must be)"),  # where processors take it for 0
])
def test_files_that_are_no_drawings(tmp_path, data, what):
    (tmp_path / "a.svg").write_bytes(data)
    with pytest.raises(tc.SceneError, match=what) as error:
        tc.load_pattern(tmp_path / "a.svg")
    assert str(tmp_path / "a.svg") in str(error.value)


def test_files_that_are_drawings(tmp_path):
    """Packed, in other encodings, with entities for namespaces, with a prefix, nested deeply."""
    text = PAGE + SQUARE + "</svg>"
    entities = text.replace('"http://www.w3.org/2000/svg"', '"&svg;"')
    doctype = '<!DOCTYPE svg PUBLIC "-//W3C//DTD SVG 1.1//EN" "a.dtd" [<!ENTITY svg "http://www.w3.org/2000/svg">]>'
    for name, data in (("a.svgz", gzip.compress(text.encode())), ("b.svg", gzip.compress(text.encode())),
                       ("c.svg", text.encode("utf-16")), ("d.svg", (doctype + entities).encode()),
                       ("e.SVG", re.sub("(</?)(?=svg|rect)", r"\1s:", text.replace("xmlns=", "xmlns:s=")).encode()),
                       ("f.svg", text.replace(SQUARE, "<g>" * 20000 + SQUARE + "</g>" * 20000).encode())):
        (tmp_path / name).write_bytes(data)
        assert [p.name for p in tc.load_pattern(tmp_path / name).panels] == ["r"], name
    dangling = PAGE + SQUARE + '<use href="#none"/><use/></svg>'
    (tmp_path / "g.svg").write_text(dangling)
    assert tc.load_pattern(tmp_path / "g.svg").notes == ("<use> elements of the drawing that refer to nothing in it: 2",)


@pytest.mark.parametrize("first", range(3001, 3121, 30))
def test_random_drawings_load_or_are_refused(first, monkeypatch):
    monkeypatch.syspath_prepend(str(pathlib.Path(__file__).parents[2] / "scripts"))
    from fuzzing.drawings import trial

    for seed in range(first, first + 30):
        outcome = trial(seed, "f64")
        assert outcome.verdict == "ok", outcome.text


def test_files(tmp_path):
    with pytest.raises(tc.SceneError, match="cannot be read"):
        tc.load_pattern(tmp_path / "none.svg")
    (tmp_path / "bad.svg").write_text("<svg>")
    with pytest.raises(tc.SceneError, match="is not XML"):
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


@pytest.mark.parametrize("second, told", [("", True), ('"b": {"translation": [0, 0, 10]}', False)])
def test_panels_that_hang_in_each_other_are_told_of(tmp_path, second, told):
    (tmp_path / "a.svg").write_text(PAGE + SQUARE + '<rect id="b" x="200" width="80" height="40"/></svg>')
    (tmp_path / "a.json").write_text(f'{{"placement": {{{second}}}}}')
    notes = tc.load_pattern(tmp_path / "a.svg").mesh(0.02).mesh.notes
    assert any("'r' and 'b' hang in one place" in note for note in notes) == told
