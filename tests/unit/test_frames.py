"""Sequences of files: their order, gaps, jumps and times; files whose z points up; names with brackets."""

import struct
import warnings

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.io.sequence import natural

X = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0.5, 0.25, 5]])  # no axis is like another
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
UP_Z = np.array([[0, 0, 0], [2, 0, 0], [0, 0, -3], [0.5, 5, -0.25]])  # the same where y points up


def obj(x=X) -> str:
    return "".join(f"v {a} {b} {c}\n" for a, b, c in x) + "".join(f"f {a} {b} {c}\n" for a, b, c in FACES + 1)


def sequence(folder, names, step=1.0):
    """Frames in the order of their names, each `step` further along x."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, name in enumerate(names):
        (folder / name).write_text(obj(X + [step * k, 0, 0]))
    return folder


def places(solid) -> list[float]:
    """Where its first vertex is, frame by frame."""
    return solid.x[:, 0, 0].tolist()


def test_numbers_count_as_numbers(tmp_path):
    names = [f"frames_{k}.obj" for k in range(12)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = tc.load_solid(sequence(tmp_path, names) / "frames_*.obj", fps=24)
        assert places(made) == list(range(12)) and not any("jump" in note for note in made.notes)
        padded = sequence(tmp_path / "b", [f"v2 f{k:03d}.obj" for k in range(90, 130, 10)])  # every tenth: whole
        assert places(tc.load_solid(padded / "*.obj", fps=24)) == [0, 1, 2, 3]
    ordered = ["9", "10", "a", "a9b2", "a9b10", "a10", "b1"]
    assert sorted(sorted(ordered), key=natural) == ordered
    (tmp_path / "frames_04.obj").write_text(obj())
    with pytest.raises(tc.MeshError, match="frames_4.obj and .*frames_04.obj are of one number|04.obj and .*4.obj are of one"):
        tc.load_solid(tmp_path / "frames_*.obj", fps=24)


@pytest.mark.parametrize("numbers, said", [((1, 2, 4), "3 of 1 to 4 are missing"), ((0, 10, 30), "20 of 0 to 30"),
                                           ((7, 8, 100), "9, 10, 11.*20 and 79 more of 7 to 100")])
def test_gaps_are_said(tmp_path, numbers, said):
    folder = sequence(tmp_path, [f"f.{k}.obj" for k in numbers])
    with pytest.warns(UserWarning, match=said) as warned:
        made = tc.load_solid(folder / "f.*.obj", fps=24)
    assert len(warned) == 1 and warned[0].filename == __file__ and places(made) == [0, 1, 2]


def test_jumps_are_noted():
    t = np.arange(40)
    steady, away = 0.01 * t, 0.2 * np.maximum(t - 30, 0)  # which stands still for long
    for path, found in ((steady, []), (np.sin(0.3 * t), []), (away, []),
                        (steady + 3.0 * (t > 16), ["16 to 17 (counted from 0) by 3.01"]),
                        (steady + 3.0 * (t == 20), [
                            "19 to 20 (counted from 0) by 3.01", "20 to 21 (counted from 0) by 2.99"])):
        made = tc.SolidMesh(X + path[:, None, None] * [1.0, 0, 0], FACES, fps=24)
        notes = [note for note in made.notes if "jumps" in note]
        assert [f"from frame {said} m" in note for said, note in zip(found, notes, strict=True)] == [True] * len(found)


@pytest.mark.parametrize("name", ["take [2]", "a[b-", "what? *", "plain"])
def test_brackets_in_names_are_what_they_are(tmp_path, name):
    folder = sequence(tmp_path / name, [f"body[{name[:1]}]_{k}.obj" for k in (8, 9, 10)])
    assert places(tc.load_solid(folder / f"body[{name[:1]}]_*.obj", fps=24)) == [0, 1, 2]
    assert places(tc.load_solid(folder / "body*.obj", fps=24)) == [0, 1, 2]
    assert places(tc.load_solid(folder / f"body[{name[:1]}]_10.obj")) == [2]
    sequence(tmp_path / "xyz", ["f_1.obj", "f_2.obj"])
    assert places(tc.load_solid(tmp_path / "[x]yz" / "f_[12].obj", fps=24)) == [0, 1]  # and a pattern is a pattern
    with pytest.raises(tc.MeshError, match="no file matches"):
        tc.load_solid(folder / "none_*.obj", fps=24)


def pc2(path, frames, start, every):
    data = np.stack(frames).astype("<f4")
    path.write_bytes(b"POINTCACHE2\0" + struct.pack("<iiffi", 1, data.shape[1], start, every, len(data)) + data.tobytes())
    return path


@pytest.mark.parametrize("start, every", [(0.0, 1.0), (12.0, 1.0), (0.0, 4.0), (6.0, 0.5), (-3.0, 2.0)])
def test_a_point_cache_starts_and_samples_as_it_says(tmp_path, start, every):
    (tmp_path / "a.obj").write_text(obj())
    path = pc2(tmp_path / "a.pc2", [X + [k, 0, 0] for k in range(5)], start, every)
    made = tc.load_solid(path, fps=24, mesh=tmp_path / "a.obj")
    solid = tc.Scene().add_solid(made, friction=0.1, thickness=0.01)
    for frame in np.linspace(-5, 40, 91):  # of 24 a second
        wanted = min(max((frame - start) / every, 0), 4)
        assert solid.surface_at(frame / 24)[0, 0] == pytest.approx(wanted, abs=1e-6)
    assert any("until its first frame" in note for note in made.notes) == (start > 0)
    made = tc.load_solid(path, fps=24, mesh=tmp_path / "a.obj", start=0.5)
    assert made.shape_at(0.5)[0, 0] == 0 and made.shape_at(0.5 + every / 24)[0, 0] == pytest.approx(1)


@pytest.mark.parametrize("start, every", [(0.0, 0.0), (0.0, -1.0), (float("nan"), 1.0), (0.0, float("inf"))])
def test_a_point_cache_without_times_is_refused(tmp_path, start, every):
    (tmp_path / "a.obj").write_text(obj())
    with pytest.raises(tc.MeshError, match="a.pc2: its header says that it starts at frame .* and has one every"):
        tc.load_solid(pc2(tmp_path / "a.pc2", [X, X], start, every), fps=24, mesh=tmp_path / "a.obj")


def mdd(path, frames, times):
    data = np.stack(frames).astype(">f4")
    path.write_bytes(struct.pack(">ii", len(data), data.shape[1]) + np.asarray(times, ">f4").tobytes() + data.tobytes())
    return path


def test_an_mdd_cache_has_its_own_times(tmp_path):
    (tmp_path / "a.obj").write_text(obj())
    path = mdd(tmp_path / "a.mdd", [X + [k, 0, 0] for k in range(5)], np.arange(5) / 30)
    made = tc.load_solid(path, mesh=tmp_path / "a.obj", scale=0.5, up="z")
    assert made.fps == pytest.approx(30) and np.allclose(made.x, [0.5 * UP_Z + [0.5 * k, 0, 0] for k in range(5)])
    assert tc.load_solid(path, fps=12, mesh=tmp_path / "a.obj").fps == 12
    late = tc.load_solid(mdd(tmp_path / "b.mdd", [X, X + 1], [2.0, 2.1]), mesh=tmp_path / "a.obj")
    assert (late.start, late.fps) == pytest.approx((2.0, 10.0))
    assert len(tc.load_solid(mdd(tmp_path / "c.mdd", [X], [7.0]), mesh=tmp_path / "a.obj").x) == 1
    for name, frames, times, words in (("d.mdd", [X, X, X], [0, 1, 3], "its frames are at uneven times, from 0 to 3 s"),
                                       ("e.mdd", [X[:3]] * 2, [0, 1], "has 3 vertices, and .*a.obj 4")):
        with pytest.raises(tc.MeshError, match=f"{name}: {words}"):
            tc.load_solid(mdd(tmp_path / name, frames, times), mesh=tmp_path / "a.obj")
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(tc.MeshError, match="a.mdd: is 264 bytes long, its header says 5 frames of 4 points"):
        tc.load_solid(path, mesh=tmp_path / "a.obj")
    with pytest.raises(tc.MeshError, match="a.mdd: a point cache has no triangles"):
        tc.load_solid(path)


def test_vertices_of_a_body_model(tmp_path):
    """As its exports name them; parameters alone are no vertices."""
    np.savez(tmp_path / "a.npz", vertices=np.stack([X, X + 1]), faces=FACES.astype(np.uint32), fps=30.0)
    made = tc.load_solid(tmp_path / "a.npz")
    assert made.fps == 30 and (made.x[1] == X + 1).all()
    np.savez(tmp_path / "b.npz", poses=np.zeros((2, 72)), betas=np.zeros(10), faces=FACES)
    with pytest.raises(tc.MeshError, match=r"b.npz: .* needs positions \(or vertices\) and faces; poses"):
        tc.load_solid(tmp_path / "b.npz")


def test_a_format_that_is_not_known_names_those_that_are(tmp_path):
    for name in ("a.dae", "a.npz"):
        (tmp_path / name).write_text("x")
    with pytest.raises(tc.MeshError) as caught:
        tc.load_solid(tmp_path / "a.dae")
    assert all(suffix in str(caught.value) for suffix in (".obj", ".npz", ".mdd", ".glb", ".usdz", ".abc", ".fbx"))
    with pytest.raises(tc.MeshError, match=r"unknown mesh format '.npz' \(.npz is read by tc.load_solid\); known: .*.glb"):
        tc.load(tmp_path / "a.npz")
    (tmp_path / "a.obj").write_text(obj())
    for reader, option in ((tc.load_solid, {"clip": "Walk"}), (tc.load_solid, {"only": "arm"}), (tc.load, {"only": "arm"})):
        with pytest.raises(tc.MeshError, match=f"a.obj: {next(iter(option))}: .*to choose from.*glb"):
            reader(tmp_path / "a.obj", **option)


def text_of(suffix: str) -> str:
    """A file of X and FACES, by hand."""
    rows = "".join(f"{a} {b} {c}\n" for a, b, c in X)
    triangles = "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
    if suffix == ".ply":
        return ("ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
                "element face 4\nproperty list uchar int vertex_indices\nend_header\n" + rows + triangles)
    if suffix == ".stl":
        return "solid a\n" + "".join("facet normal 0 0 0\nouter loop\n" + "".join(
            "vertex {} {} {}\n".format(*X[i]) for i in face) + "endloop\nendfacet\n" for face in FACES) + "endsolid a\n"
    if suffix == ".vtk":
        return ("# vtk DataFile Version 2.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 double\n" + rows
                + "CELLS 4 16\n" + triangles + "CELL_TYPES 4\n5\n5\n5\n5\n")
    if suffix == ".vtu":
        def array(name, kind, more, values):
            return f'<DataArray type="{kind}" Name="{name}"{more} format="ascii">{values}</DataArray>'

        cells = (array("connectivity", "Int32", "", " ".join(map(str, FACES.ravel())))
                 + array("offsets", "Int32", "", "3 6 9 12") + array("types", "UInt8", "", "5 5 5 5"))
        points = array("Points", "Float64", ' NumberOfComponents="3"', rows.replace("\n", " "))
        return ('<?xml version="1.0"?><VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">'
                '<UnstructuredGrid>'
                f'<Piece NumberOfPoints="4" NumberOfCells="4"><Points>{points}</Points><Cells>{cells}</Cells></Piece>'
                "</UnstructuredGrid></VTKFile>")
    return "OFF\n4 4 0\n" + rows + triangles if suffix == ".off" else obj()


def volume(x, faces) -> float:
    return float(np.linalg.det(x[faces]).sum() / 6)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl", ".vtk", ".vtu", ".off"])
def test_files_in_which_z_points_up(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_text(text_of(suffix))
    for up, x in (("y", X), ("z", UP_Z)):
        mesh, solid = tc.load(path, scale=0.5, up=up), tc.load_solid(path, scale=0.5, up=up)
        for places, faces in ((mesh.x, mesh.faces), (solid.x[0], solid.faces)):
            assert sorted(places.tolist()) == sorted((0.5 * x).tolist())
            assert volume(places, faces) == pytest.approx(0.125 * 5)  # outside stays outside
        assert not solid.notes
    for reader in (tc.load, tc.load_solid):
        with pytest.raises(tc.ClothError, match="unknown up 'x'"):
            reader(path, up="x")


def test_sequences_in_which_z_points_up(tmp_path):
    frames = np.stack([X, X + [1, 2, 3]])
    turned = 0.5 * np.stack([UP_Z, UP_Z + [1, 3, -2]])
    np.savez(tmp_path / "a.npz", positions=frames, faces=FACES, fps=24)
    pc2(tmp_path / "a.pc2", frames, 0, 1)
    for k, x in enumerate(frames):
        (tmp_path / f"f_{k}.obj").write_text(obj(x))
    for name, more in (("a.npz", {}), ("f_*.obj", {"fps": 24}), ("a.pc2", {"fps": 24, "mesh": tmp_path / "f_0.obj"})):
        made = tc.load_solid(tmp_path / name, scale=0.5, up="z", **more)
        assert np.allclose(made.x, turned) and volume(made.x[1] - made.x[1, 0], made.faces) > 0


def test_patterns_in_which_z_points_up(tmp_path):
    """A garment of two triangles that are sewn along an edge, flat in the file; and where it was draped."""
    x = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1.1, 0, 0], [1.1, 1, 0], [0.1, 1, 0]])
    rows = "".join("v {} {} {}\nvt {} {}\n".format(*p, *p[:2]) for p in x)
    (tmp_path / "a.obj").write_text(rows + "f 1/1 2/2 3/3\nf 4/4 5/5 6/6\nl 2 4\nl 3 6\n")
    draped = x + [0, 0, 7]
    made = tc.load_stitched(tmp_path / "a.obj", scale=0.5, positions=draped, up="z")
    at = {tuple(p) for p in made.mesh.x.round(9).tolist()}
    assert at >= {tuple(p) for p in (0.5 * np.column_stack([x[:, 0], x[:, 2], -x[:, 1]]) + 0.0).round(9).tolist()}
    assert np.allclose(made.positions[:, 1], 3.5) and made.mesh.material_areas.sum() == pytest.approx(0.25)
    again = tc.load_pattern(tmp_path / "a.obj", scale=0.5, up="z").mesh()
    assert (again.mesh.x == made.mesh.x).all()
    for more in ({"scale": 0.5}, {"up": "z"}):
        with pytest.raises(tc.SceneError, match="a.json: has its units and its axes itself"):
            tc.load_pattern(tmp_path / "a.json", **more)
