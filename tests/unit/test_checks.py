"""Checks of what callers hand over: what is taken, as what, and with which words the rest is refused; notes of meshes."""

import fractions

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth import checks
from taichi_cloth.scene.mesh import facing
from taichi_cloth.simulation.parts import notes_of

nan, inf = float("nan"), float("inf")
SHEET = tc.grid(1.0, 3)


@pytest.mark.parametrize("value, made", [(2, 2.0), (np.float32(0.5), 0.5), (fractions.Fraction(1, 4), 0.25),
                                         (np.array(3), 3.0),
                                         (1e30, 1e30), (-1e30, -1e30), (0, 0.0)])
def test_numbers_that_are_taken(value, made):
    out = checks.number("a", value)
    assert out == made and type(out) is float


@pytest.mark.parametrize("value", [None, "1", "", b"1", True, np.bool_(True), nan, inf, -inf, 10**400, -10**400, 1e31, 1j, [1],
                                   np.zeros(1), np.float64("nan"), object()])
def test_what_is_no_number(value):
    for check in (checks.number, checks.integer, checks.number_or_pair):
        with pytest.raises(tc.SceneError, match="^a = .*: (must be|needs)"):
            check("a", value)


@pytest.mark.parametrize("bounds, good, bad", [
    ({"positive": True}, (1e-30, 1e30), (0, -1, 1e-31, 1e31)), ({"least": 0.0}, (0, 5), (-1e-300,)),
    ({"least": 1.0, "most": 2.0}, (1, 2), (0.999999, 2.000001)), ({"positive": True, "most": 1.0}, (1, 1e-9), (1.1, 0))])
def test_bounds_may_be_reached_and_not_passed(bounds, good, bad):
    for value in good:
        assert checks.number("a", value, **bounds) == value
    for value in bad:
        with pytest.raises(tc.SceneError, match="a = .* m: must be a"):
            checks.number("a", value, "m", **bounds)


def test_whole_numbers():
    assert checks.integer("a", 3.0) == 3 and type(checks.integer("a", np.float64(3))) is int
    assert checks.integer("a", 0, least=0) == 0 and checks.integer("a", 7, most=7) == 7
    for value in (0, 2.5, 8, -1):
        with pytest.raises(tc.MeshError, match="a = .*: must be a whole number"):
            checks.integer("a", value, most=7, error=tc.MeshError)


def test_pairs_and_flags_and_names():
    assert checks.number_or_pair("a", [1, 2]) == (1.0, 2.0) and checks.number_or_pair("a", np.array([1, 2])) == (1.0, 2.0)
    assert checks.number_or_pair("a", 3) == 3.0
    for value in ([1], (1, 2, 3), (1, "2"), (1, -1)):
        with pytest.raises(tc.SceneError):
            checks.number_or_pair("a", value, positive=True)
    assert checks.flag("a", np.bool_(False)) is False and checks.name("a", "my cloth") == "my cloth"
    for value in (0, 1, "no", None):
        with pytest.raises(tc.SceneError, match="must be True or False"):
            checks.flag("a", value)
    for value in ("", " ", "a\nf 1 2 3", 3, None):
        with pytest.raises(tc.SceneError, match="on one line"):
            checks.name("a", value)
    with pytest.raises(tc.SceneError, match="unknown a 'lefft'; did you mean 'left'"):
        checks.choice("a", "lefft", ("left", "right"))
    for value in (None, ["left"], np.array(["left", "right"]), {}):
        with pytest.raises(tc.SceneError, match="unknown a .*; known: left, right"):
            checks.choice("a", value, ("left", "right"))


def test_arrays():
    rows = [[1, 2, 3], [4, 5, 6]]
    out = checks.array("a", rows, (2, 3))
    assert out.dtype == np.float64 and (out == rows).all()
    given = np.array(rows, dtype=float)
    checks.array("a", given, ("n", 3))[0] = 9
    assert given[0, 0] == 1  # a copy
    for value, words in ((rows[:1], r"needs shape \(2, 3\), not \(1, 3\)"), ([[1, 2, 3], [4, nan, 6]],
                                                                             "vertex 1 is not finite"),
                         ([[1, 2, 3], [4, 1e31, 6]], "vertex 1 is beyond 1e"),
                         ([[inf] * 3] * 2, r"vertex 0 \(2 such\) is not finite"),
                         ([[1], [2, 3]], "needs numbers"), ("abc", "needs numbers"), ([["1"] * 3] * 2, "needs numbers"),
                         ([[True] * 3] * 2, "needs numbers"), (None, "needs numbers"),
                         (np.ones((2, 3), complex), "needs numbers")):
        with pytest.raises(tc.SceneError, match=f"^a: {words}"):
            checks.array("a", value, (2, 3), row="vertex")


def test_indices():
    assert checks.indices("a", [0, 4], 5).tolist() == [0, 4] and checks.indices("a", [], 5).dtype == np.int64
    for value, words in (([5], "names vertex 5, but there are 5"), ([-1], "names vertex -1"), ([0.0], "integer"),
                         ([[0]], "needs shape"), ("01", "integer"), ([True], "integer"), ([10**400], "integer"),
                         ([2**63], "names")):
        with pytest.raises(tc.MeshError, match=f"^a: .*{words}"):
            checks.indices("a", value, 5, error=tc.MeshError)


@pytest.mark.parametrize("fov", [0.9, 151, "40"])
def test_angles_of_a_camera(fov):
    with pytest.raises(tc.SceneError, match="camera fov = .* degrees: must be a number from 1 to 150"):
        tc.Camera((1, 1, 1), (0, 0, 0), fov)


def test_paths():
    assert checks.path("a", "b/c.obj").name == "c.obj"
    for value in ("", None, 3, b"a", "n" * 5000):
        with pytest.raises(tc.MeshError, match="^a = .*: (must be a|is not a) path"):
            checks.path("a", value, tc.MeshError)


def test_functions_and_their_results_are_named():
    scene = tc.Scene()
    cloth = scene.add_cloth(SHEET, tc.Fabric(0.2))
    for act, words in (
            (lambda: scene.move(cloth, 0, lambda: (0, 0, 0)), "path .* function of time, but cannot be called with 1"),
            (lambda: scene.move(cloth, 0, lambda t: "abc"), "at t = 0 s: needs numbers"),
            (lambda: scene.at(1, lambda a, b: None), "of nothing, or of the scene"),
            (lambda: tc.Air(1, wind=lambda t: (0, 1)), "the wind at t = 0 s = .*three finite"),
            (lambda: tc.Solid("s", tc.Sphere(1), 0.1, 0.1, lambda t: [[1], [2, 3]], (0, 0, 0)), "position at t = 0 s"),
            (lambda: tc.Air(1, wind=lambda t: (t, 0, 0) if t < 1 else None).wind_at(2), "the wind at t = 2 s = None"),
            (lambda: scene.add_solid(tc.Sphere(1), 0, 0.1, rotation=lambda t: (t, nan, 0)),
             "rotation at t = 0 s: .* not finite"),
            (lambda: scene.add_cloth(SHEET, tc.Fabric(0.2), color="redd"),
             "color .*'redd': is not a colour: did you mean 'red'"),
            (lambda: scene.add_cloth(SHEET, tc.Fabric(0.2), name="a\nf 1 2 3"), "on one line"),
            (lambda: scene.add_cloth(SHEET, tc.Fabric(0.2), velocities=(nan, 0, 0)), "velocities of 'cloth1': .* not finite"),
            (lambda: tc.Camera((nan, 0, 0), (0, 0, 0)), "camera eye"),
            (lambda: tc.Constraint(1.5), "constraint: vertex = 1.5"),
            (lambda: tc.grid(1, 10**5), "20,000,000,000 triangles: at most 20,000,000"),
            (lambda: tc.grid("1", 2), "size = '1'"),
            (lambda: tc.SolidMesh(np.eye(3), [[0, 0, 1]]), r"face 0 repeats a vertex: \[0, 0, 1\]")):
        with pytest.raises((tc.SceneError, tc.MeshError), match=words):
            act()
    assert not scene.solids and len(scene.cloths) == 1 and not scene.script.attachments and not scene.script.events


@pytest.mark.parametrize("face", [[1, 1, 2], [1, 2, 2], [2, 1, 2]])
def test_a_repeated_vertex_is_named_with_its_face(face):
    for make in (tc.TriMesh, tc.SolidMesh):
        with pytest.raises((tc.MeshError, tc.SceneError), match=r"face 1 repeats a vertex: .*\(1 such faces\)"):
            make(SHEET.x, [[0, 1, 4], face])


def test_a_tear_is_noted():
    """Two halves of a sheet with vertices of their own on the line between them."""
    half = SHEET.x[:, 0] < SHEET.x[:, 0].min() + 1.5 / 3
    assert not SHEET.notes
    left = SHEET.faces[half[SHEET.faces].any(axis=1)]
    right = SHEET.faces[~half[SHEET.faces].any(axis=1)]
    x = np.concatenate([SHEET.x, SHEET.x])
    torn = np.concatenate([left, right + len(SHEET.x)])
    used, index = np.unique(torn, return_inverse=True)
    mesh = tc.TriMesh(x[used], index.reshape(-1, 3), np.concatenate([SHEET.uv, SHEET.uv])[used])
    assert len(mesh.notes) == 1 and "in 3 pairs of edges, with 4 vertices" in mesh.notes[0]
    apart = mesh.x + 1e-6 * np.isin(used, np.arange(len(SHEET.x), 2 * len(SHEET.x)))[:, None]
    assert not tc.TriMesh(apart, mesh.faces, mesh.uv).notes
    for shape in (tc.disk(1, 3), tc.cylinder(1, 2, (6, 2)), tc.equilateral_strip(2, 2, 4), tc.grid(1, 3, "cross")):
        assert not shape.notes


def test_what_is_sewn_is_not_noted_as_open():
    """Three panels in a row, whose places differ by rounding: k times .4 is not k - 1 times .4 and .4."""
    panel, rows = tc.grid((0.4, 0.2), (3, 2)), range(3)
    n = panel.vertex_count
    mesh = tc.TriMesh(np.concatenate([panel.x + [0.1 + (k + 2) * 0.4, 0, 0] for k in rows]),
                      np.concatenate([panel.faces + k * n for k in rows]), np.concatenate([panel.uv + [k, 0] for k in rows]))
    left, right = (np.sort(panel.select(side)) for side in ("left", "right"))
    assert (mesh.x[right] != mesh.x[left + n]).any() and "in 4 pairs of edges, with 6 vertices" in mesh.notes[0]
    for tear in (None, tc.Tear(100.0, length=0.1)):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100.0)), tear=tear)
        assert notes_of(cloth, scene.seams) == mesh.notes
        scene.sew(cloth, right, left + n)
        assert "in 2 pairs of edges, with 3 vertices" in notes_of(cloth, scene.seams)[0]
        scene.sew(cloth, right + n, left + 2 * n)
        assert not notes_of(cloth, scene.seams)


def test_turned_triangles_are_noted():
    faces = SHEET.faces.copy()
    faces[[2, 7, 8]] = faces[[2, 7, 8]][:, [0, 2, 1]]
    note, = tc.TriMesh(SHEET.x, faces, SHEET.uv).notes
    assert "3 triangles are turned" in note and "the first is 2" in note
    assert np.flatnonzero(facing(faces)).tolist() == [2, 7, 8]
    assert np.flatnonzero(facing(faces[:, [1, 0, 2]])).tolist() == [2, 7, 8]  # the rarer ones, whichever way round
    two = np.concatenate([faces, faces[:, [0, 2, 1]] + len(SHEET.x)])  # each piece by itself
    assert np.flatnonzero(facing(two)).tolist() == [2, 7, 8, 20, 25, 26]


def test_a_strip_with_one_side_is_noted():
    n = 8
    a = np.linspace(0, 2 * np.pi, n, endpoint=False)
    ring = np.column_stack([np.cos(a), 0 * a, np.sin(a)])
    up = 0.2 * np.column_stack([np.cos(a) * np.cos(a / 2), np.sin(a / 2), np.sin(a) * np.cos(a / 2)])
    quads = [(i, i + 1, n + i + 1, n + i) if i < n - 1 else (i, n, 0, n + i) for i in range(n)]
    faces = np.array([t for p, q, r, s in quads for t in ((p, q, r), (p, r, s))])
    mesh = tc.TriMesh(np.concatenate([ring - up, ring + up]), faces)
    assert "one side only" in mesh.notes[-1]
    assert "one side only" in tc.SolidMesh(mesh.x, mesh.faces).notes[0]


def test_solids_turn_triangles_round():
    x, faces = tc.Box((1, 1, 1)).core()[:2]
    wrong = faces.copy()
    wrong[[0, 5]] = wrong[[0, 5]][:, [0, 2, 1]]
    solid = tc.SolidMesh(x, wrong)
    assert "2 triangles of the solid mesh were turned" in solid.notes[0] and len(solid.notes) == 1
    corner = solid.x[0][solid.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("ij,ij->i", normal, corner.mean(axis=1)) > 0).all()  # all out of the box round the origin


@pytest.mark.parametrize("color", [(-0.1, 0.5, 0.5), (0.5, 1.1, 0.5), (0.5, 0.5), (0.5, 0.5, float("nan"))])
def test_colours_are_three_parts_from_0_to_1(color):
    with pytest.raises(tc.SceneError, match="each from 0 to 1"):
        tc.Scene().add_solid(tc.Sphere(1.0), 0.1, 0.01, color=color)


@pytest.mark.parametrize("text", ["1/60", "1e-3", ".5", "-2", "1/0"])
def test_a_number_in_quotes_is_told_to_be_one(text):
    """The command line takes h as 1/60; Python takes it without quotes."""
    with pytest.raises(tc.SceneError, match=rf"^h = '{text}' s: must be a number .*, not text: {text} without quotes$"):
        tc.Options(h=text)
    for other in ("", "a", "1/60 s", "1" * 40, "nan", "/2"):
        with pytest.raises(tc.SceneError, match=r"^h = '.*' s: must be a number from 1e-12 to 100$"):
            tc.Options(h=other)
    with pytest.raises(tc.SceneError, match="^threads = '4': must be a whole number .*, not text: 4 without quotes$"):
        tc.Options(threads="4")


def test_files_that_are_not_there_are_answered_with_the_nearest(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shirt.obj").write_text("v 0 0 0\n")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "hang").mkdir()
    for read, name, there in ((tc.load, "shrit.obj", "shirt.obj"), (tc.load_solid, "shirt.ojb", "shirt.obj"),
                              (tc.Recording, "out/hnag", "out/hang"), (tc.load_garment, "shirtt.obj", "shirt.obj")):
        with pytest.raises(tc.ClothError, match=f"{name}.*did you mean '{there}'"):
            read(name)
    for read, name in ((tc.load, "nothing.obj"), (tc.load, "none/shirt.obj"), (tc.Recording, "out/hang"), (tc.load, "a\0")):
        with pytest.raises(tc.ClothError, match="^(?!.*did you mean)"):
            read(name)
