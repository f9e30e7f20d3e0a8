"""Descriptions without a simulation: shapes and their groups, paths and pins, moving solids, scene files, options of a run."""

import argparse

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import cli, scenefile
from taichi_cloth.errors import ScriptError
from taichi_cloth.scene.attachment import orthonormal
from taichi_cloth.scene.fabric import pair

SHAPES = {"alternating": tc.grid((2.0, 1.0), (4, 3)), "uniform": tc.grid((2.0, 1.0), (4, 3), "uniform", "xy"),
          "cross": tc.grid((2.0, 1.0), (4, 3), "cross"), "strip": tc.strip(3.0, 0.5, 12),
          "equilateral": tc.equilateral_strip(4.0, 3, 8, "xy"), "disk": tc.disk(1.5, 5),
          "tube": tc.cylinder(0.5, 2.0, (64, 3))}
AREAS = {"alternating": 2.0, "uniform": 2.0, "cross": 2.0, "strip": 1.5, "equilateral": 4.0 * 3 * np.sqrt(3) / 4,
         "disk": np.pi * 1.5**2, "tube": 2 * np.pi}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_are_at_rest_as_they_are_made(name):
    """Triangles in space are as large as in the pattern, cover the area once, and face one way."""
    mesh = SHAPES[name]
    assert not mesh.notes and mesh.material_areas.sum() == pytest.approx(AREAS[name], rel=0.03)
    a, b = (mesh.x[mesh.faces[:, k]] - mesh.x[mesh.faces[:, 0]] for k in (1, 2))
    p, q = (mesh.corner_uv[:, k] - mesh.corner_uv[:, 0] for k in (1, 2))
    loose = 2e-3 if name == "tube" else 1e-9  # chords of a circle
    for u, v, r, s in ((a, a, p, p), (a, b, p, q), (b, b, q, q)):
        off = np.einsum("ij,ij->i", u, v) - np.einsum("ij,ij->i", r, s)
        assert np.abs(off).max() < loose * np.einsum("ij,ij->i", p, p).max()
    assert (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] > 0).all()  # counter-clockwise in the pattern


def test_groups_are_where_they_say():
    for name, v in (("alternating", 2), ("uniform", 1), ("cross", 2)):
        mesh = SHAPES[name]
        u, w = mesh.x[:, 0], mesh.x[:, v] * (-1 if v == 2 else 1)
        edge = {"left": u == 0, "right": u == 2, "bottom": w == 0, "top": w == 1}
        for side, there in edge.items():
            assert mesh.select(side).tolist() == np.flatnonzero(there).tolist(), (name, side)
        assert mesh.select("border").tolist() == np.flatnonzero(np.any(list(edge.values()), axis=0)).tolist()
        for corner in ("bottom_left", "bottom_right", "top_left", "top_right"):
            row, column = corner.split("_")
            assert mesh.select(corner).tolist() == np.flatnonzero(edge[row] & edge[column]).tolist()
        corners = (edge["left"] | edge["right"]) & (edge["top"] | edge["bottom"])
        assert sorted(mesh.select("corners")) == np.flatnonzero(corners).tolist()
    disk, tube, strip = SHAPES["disk"], SHAPES["tube"], SHAPES["equilateral"]
    far = np.linalg.norm(disk.x, axis=1)
    assert disk.select("centre").tolist() == np.flatnonzero(far == 0).tolist()
    assert sorted(disk.select("rim")) == np.flatnonzero(far > 1.5 - 1e-9).tolist()
    assert sorted(tube.select("top")) == np.flatnonzero(tube.x[:, 1] == 2).tolist()
    assert sorted(tube.select("bottom")) == np.flatnonzero(tube.x[:, 1] == 0).tolist()
    assert np.allclose(np.linalg.norm(tube.x[:, [0, 2]], axis=1), 0.5)
    for side, at in (("left", 0), ("right", 4)):
        assert sorted(strip.select(side)) == np.flatnonzero(np.isclose(strip.x[:, 0], at)).tolist()


def test_diagonals():
    """Of alternating ones 4 or 8 triangles meet at a vertex inside, in turns; of uniform ones 6; of crossed ones 8 and 4."""
    for name, counts in (("alternating", {4, 8}), ("uniform", {6}), ("cross", {4, 8})):
        mesh = tc.grid(1.0, 4, name)
        at = np.bincount(mesh.faces.ravel())
        inside = np.setdiff1d(np.arange(mesh.vertex_count), mesh.select("border"))
        assert set(at[inside].tolist()) == counts
        if name == "alternating":
            square = at[:25].reshape(5, 5)[1:4, 1:4]
            assert (square[1:] != square[:-1]).all() and (square[:, 1:] != square[:, :-1]).all()


def test_strips_have_square_cells():
    mesh = SHAPES["strip"]
    assert mesh.vertex_count == 13 * 3 and mesh.face_count == 2 * 12 * 2
    assert tc.strip(1.0, 0.01, 10).vertex_count == 11 * 2 and tc.strip(1.0, 0.5, (2, 7)).vertex_count == 3 * 8


def test_flat_triangles_are_refused_by_their_height():
    for height, good in ((1e-8, True), (1e-10, False)):
        x = [[0, 0, 0], [1.0, 0, 0], [0.5, height, 0]]
        if good:
            assert tc.TriMesh(x, [[0, 1, 2]], np.array(x)[:, :2]).face_count == 1
        else:
            with pytest.raises(tc.MeshError, match=r"triangle 0 \(vertices \[0, 1, 2\]\) has no area .*\(1 such"):
                tc.TriMesh(x, [[0, 1, 2]], np.array(x)[:, :2])


def test_a_mesh_without_a_pattern_is_flattened_without_strain():
    x = np.array([[0, 0, 0], [1, 0.5, 0], [1.5, 1.5, 0.7], [0.1, 1.2, -0.3]])
    mesh = tc.TriMesh(x, [[0, 1, 2], [0, 2, 3]])
    assert mesh.flattened and len(mesh.notes) == 1 and "flattened" in mesh.notes[0]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        space = np.linalg.norm(x[mesh.faces[:, i]] - x[mesh.faces[:, j]], axis=1)
        assert np.allclose(np.linalg.norm(mesh.uv[:, i] - mesh.uv[:, j], axis=1), space)


def sheet():
    scene = tc.Scene()
    return scene, scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2))


def test_paths_lead_the_vertices_that_are_left():
    scene, cloth = sheet()
    scene.move(cloth, [7, 2, 5], lambda t: [(7, t, 0), (2, t, 0), (5, t, 0)])
    scene.unpin(cloth, [5])
    held, = scene.script.attachments
    assert held.vertices.tolist() == [2, 7]
    assert held.target(0.5, cloth.positions).tolist() == [[2, 0.5, 0], [7, 0.5, 0]]
    scene, cloth = sheet()
    scene.move(cloth, [1, 2], lambda t: (t, 0, 0), relative=True)
    assert (scene.script.attachments[0].target(2.0, cloth.positions) == cloth.positions[[1, 2]] + [2, 0, 0]).all()
    scene, cloth = sheet()
    scene.pin(cloth, [1, 2])
    anchor = cloth.positions + 3.0
    assert (scene.script.attachments[0].target(9.0, anchor) == anchor[[1, 2]]).all()


def test_cloth_starts_as_it_is_told():
    mesh, fabric = tc.grid(1.0, 1), tc.Fabric(0.2)
    scene = tc.Scene()
    assert (scene.add_cloth(mesh, fabric, velocities=(1, 2, 3)).velocities == [[1, 2, 3]] * 4).all()
    v = np.arange(12.0).reshape(4, 3)
    cloth = scene.add_cloth(mesh, fabric, positions=mesh.x + 1, velocities=v, color=(0, 0.5, 1))
    assert (cloth.velocities == v).all() and (cloth.positions == mesh.x + 1).all() and cloth.color == (0.0, 0.5, 1.0)
    assert (cloth.start, cloth.name) == (4, "cloth1")


def test_stiffness_is_for_warp_and_weft():
    made = tc.Stretch((3, 2), 0.5)
    assert pair(made.k) == (3.0, 2.0) and pair(made.k_d) == (0.5, 0.5) and pair(made.b) == (1.0, 1.0)


def test_what_is_held_already():
    scene, cloth = sheet()
    scene.pin(cloth, [1, 2], "x")
    scene.pin(cloth, [2], "x")  # a pin where there is one changes nothing
    scene.move(cloth, [2], lambda t: cloth.positions[2], directions="y")
    for directions in ("x", "xz", "y", None):
        with pytest.raises(tc.SceneError, match="vertex 2 .* already held"):
            scene.move(cloth, [2, 3], lambda t: (0, 0, 0), True, directions)
    other = scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2))
    scene.move(other, [2], lambda t: (0, 0, 0), True)  # another cloth's vertex 2
    assert other.start == 9 and scene.vertex_count == 18


def test_orthonormal_rows_span_what_is_given():
    assert orthonormal("zx").tolist() == [[1, 0, 0], [0, 0, 1]] and (orthonormal(None) == np.eye(3)).all()
    given = np.array([[1.0, 2, 0], [0, 1, 1]])
    rows = orthonormal(given)
    assert np.allclose(rows @ rows.T, np.eye(2)) and np.linalg.matrix_rank(np.concatenate([rows, given])) == 2


def test_who_passes_through_whom():
    scene = tc.Scene()
    meeting = tc.ClothContact(0.01)
    a, b, c = (scene.add_cloth(tc.grid(1.0, 1), tc.Fabric(0.2), contact=k) for k in (meeting, meeting, None))
    assert not scene.passes(a, b) and scene.passes(a, c) and scene.passes(c, b) and scene.touches
    scene.pass_through(b, a)
    assert scene.passes(a, b) and scene.passes(b, a)
    with pytest.raises(tc.SceneError, match="itself=False"):
        scene.pass_through(a, a)


def test_events_are_called_with_what_they_take():
    scene, called = tc.Scene(), []
    for k, f in enumerate((lambda: called.append(None), lambda s: called.append(s), lambda s=3: called.append(s),
                           lambda *a: called.append(a))):
        scene.at(0.1 * k, f)
        scene.fire(scene.script.events[-1])
    assert called == [None, scene, 3, ()]


def test_solids_turn_and_go():
    solid = tc.Solid("s", tc.Box((1, 2, 4)), 0.1, 0.01, lambda t: (t, 0, 0), lambda t: (0, 0, np.pi / 2 * t))
    R, p = solid.pose(1.0)
    assert np.allclose(R @ [1, 0, 0], [0, 1, 0]) and p.tolist() == [1, 0, 0] and solid.moves
    x = solid.surface_at(1.0)
    assert np.allclose(np.ptp(x, axis=0), [2, 1, 4]) and np.allclose(x.mean(axis=0), [1, 0, 0])
    slanted = tc.Solid("s", tc.SolidMesh(np.eye(3), [[0, 1, 2]]), 0.1, 0.01, (0, 0, 1), (0, 0, np.pi / 6))
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    assert np.allclose(slanted.surface_at(0.0), [[c, s, 1], [-s, c, 1], [0, 0, 2]])
    still = tc.Solid("s", tc.Sphere(1), 0.1, 0.01, (1, 2, 3), np.eye(3))
    assert not still.moves and not still.deforms and still.pose(5.0)[1].tolist() == [1, 2, 3]


def test_cloth_rides_on_props_and_does_not_meet_them():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2))
    ring = scene.add_prop(tc.Sphere(0.1), position=lambda t: (t, 0, 0), name="ring", color="gold")
    scene.attach(cloth, [0, 2], ring)
    assert not scene.touches and "props: ring" in repr(scene) and repr(ring).startswith("<Prop 'ring'")
    a, = scene.script.attachments
    assert np.allclose(a.target(0.5, cloth.positions), cloth.positions[[0, 2]] + [0.5, 0, 0])
    for again in (lambda: scene.add_solid(tc.Sphere(1), 0.1, 0.01, name="ring"),
                  lambda: scene.add_prop(tc.Sphere(1), name="ring")):
        with pytest.raises(tc.SceneError, match="a prop named 'ring' already"):
            again()
    with pytest.raises(tc.SceneError, match="^prop 'b': position"):
        scene.add_prop(tc.Sphere(1), (1, 2), name="b")


SCENE = '''"""What it shows.

More."""
import taichi_cloth as tc
RUN = {"fps": 12, "h": 0.005, "K": "paper"}
SMALL = {"n": 2}

def build(n: int = 3, size: float = 1.0, open: bool = False, word: str = "a"):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(size, n), tc.Fabric(0.2))
    return scene

def check(sim):
    yield "first", sim in (1, 2)
    yield "second", sim in (2, 3)
'''


@pytest.fixture
def scene(tmp_path):
    (tmp_path / "sheet.py").write_text(SCENE)
    return scenefile.read(str(tmp_path / "sheet.py"))


def test_scene_files_are_read(scene):
    assert (scene.name, scene.summary, scene.small) == ("sheet", "What it shows.", {"n": 2})
    assert scene.typed({"n": "7", "size": "1/4", "open": "Yes", "word": "7"}) == {"n": 7, "size": 0.25, "open": True,
                                                                                  "word": "7"}
    assert not any(scene.typed({"open": word})["open"] for word in ("0", "no", "FALSE")) and scene.typed({"open": "1"})["open"]
    assert scene.make({"n": "4"}).vertex_count == 25
    for settings, words in (({"n": "1.5"}, "needs a whole number"), ({"size": "nan"}, "needs a number"),
                            ({"m": "1"}, "no option 'm'"),
                            ({"size": "1/0"}, "needs a number"), ({"open": "maybe"}, "needs true or false")):
        with pytest.raises(tc.SceneError, match=words):
            scene.typed(settings)
    with pytest.raises(tc.SceneError, match="did you mean 'size'"):
        scene.typed({"sizes": "1"})


def options(scene, *argv):
    return cli._options(cli._parser().parse_args(["run", "sheet", *argv]), scene)


def test_flags_go_before_the_scenes_own_and_those_before_defaults(scene):
    plain = options(scene)
    assert (plain.duration, plain.fps, plain.simulation["h"], plain.simulation["K"]) == (2.0, 12, 0.005, "paper")
    assert "adaptive" not in plain.simulation and plain.size == (1280, 720) and plain.checkpoint_every == 10 and plain.frames
    asked = options(scene, "--fps", "24", "--h", "1/50", "--K", "projected", "--fixed-step", "--no-images", "--no-frames",
                    "--set",
                    "n=5", "--out", "o", "--from-frame", "3", "--threads", "2", "--tolerance", "1e-3")
    assert (asked.fps, asked.simulation["h"], asked.simulation["K"], asked.simulation["adaptive"]) == (24, 0.02, "projected",
                                                                                                       False)
    assert asked.size is None and not asked.frames and asked.settings == {"n": "5"} and asked.resume and asked.from_frame == 3
    assert asked.simulation["threads"] == 2 and asked.simulation["tolerance"] == 1e-3
    for argv, words in ((("--duration", "0.01"), "number of frames, = 0"), (("--duration", "1e9"), "from 1 to 10,000,000"),
                        (("--fps", "-1"), "--fps = -1"), (("--resume",), "--out DIR"), (("--set", "n"), "needs name=value"),
                        (("--resume", "--overwrite", "--out", "o"), "choose one"),
                        (("--checkpoint-every", "-1"), "--checkpoint-every"),
                        (("--out", "o", "--from-frame", "-1"), "--from-frame"), (("--caption", "{x}"), "caption")):
        with pytest.raises(tc.SceneError, match=words):
            options(scene, *argv)
    scene.run["colour"] = 1
    with pytest.raises(tc.SceneError, match="RUN has no 'colour'"):
        options(scene)


@pytest.mark.parametrize("result, code", [(0, 1), (1, 1), (2, 0), (3, 1)])
def test_a_check_that_fails_has_exit_code_1(scene, result, code, monkeypatch, capsys):
    from taichi_cloth.app import runner

    monkeypatch.setattr(runner, "simulate", lambda scene, options, built: (result, 0.0) if options.settings == {"n": "2"}
                        else None)
    args = cli._parser().parse_args(["check", "sheet", "--small"])
    assert cli._check(args, scene) == code
    said = capsys.readouterr().out.splitlines()
    assert said == [f"{'ok    ' if result in k else 'FAILED'} {w}" for k, w in (((1, 2), "first"), ((2, 3), "second"))]


def test_exit_codes(capsys):
    def raising(error):
        def work():
            raise error
        return work

    assert cli._guard(lambda: 0) == 0 and cli._guard(lambda: 1) == 1
    for error, code in ((tc.SceneError("a"), 2), (tc.MeshError("a"), 2), (tc.BackendError("a"), 2), (tc.OutputError("a"), 2),
                        (tc.SimulationError("a"), 3), (KeyboardInterrupt(), 130), (ScriptError("a"), 4)):
        assert cli._guard(raising(error)) == code
    assert capsys.readouterr().err.count("error: a\n") == 6
    with pytest.raises(ZeroDivisionError):
        cli._guard(raising(ZeroDivisionError()))


def test_the_version_is_told(capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["--version"])
    assert end.value.code == 0 and capsys.readouterr().out == f"taichi-cloth {tc.__version__}\n"


def test_looks_are_read_from_flags():
    parser = argparse.ArgumentParser()
    cli.look_flags(parser)
    from taichi_cloth.app.look_flags import look_of

    look = look_of(parser.parse_args(["--camera", "1,2,3:0,0,0:50", "--heat", "shear", "--range=-1:1", "--orbit", "90"]))
    assert look["camera"] == tc.Camera((1, 2, 3), (0, 0, 0), 50) and look["heat"] == ("shear",
                                                                                      (-1.0, 1.0)) and look["orbit"] == 90
