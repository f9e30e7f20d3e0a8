"""Exports of a recording made by hand: what each file holds is read here afresh, and compared with what was put in."""

import re
import struct
from types import SimpleNamespace

import meshio
import numpy as np
import pytest

from taichi_cloth.errors import OutputError
from taichi_cloth.output.export import export
from taichi_cloth.output.export.pc2 import read_pc2
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording

FPS, FIRST = 25, 2
FACES = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7], [6, 7, 8]], dtype=np.int32)  # two pieces of 4 and 5 vertices
NAMES = ["shirt\nf 1 2 3 # \\", "4 skirts"]


def make(folder, rng, frames=3, **more):
    """A recording of two pieces of cloth, from frame FIRST on, whose positions and velocities have nothing in common."""
    arrays = [{"t": np.array(k / FPS), "x": rng.normal(size=(9, 3)).astype(np.float32),
               "v": 10 + rng.normal(size=(9, 3)).astype(np.float32), "contact": -5 - rng.random((9, 3)).astype(np.float32)}
              for k in range(FIRST, FIRST + frames)]
    geometry = {"faces": FACES, "uv": rng.random((5, 3, 2)).astype(np.float32), "x": rng.normal(size=(9, 3)),
                "cloth_start": np.array([0, 4, 9]), "cloth_faces": np.array([0, 2, 5]), "cloth_names": np.array(NAMES)} | more
    out = RunFolder(folder)
    out.write_geometry(geometry)
    for k, frame in enumerate(arrays, FIRST):
        out.write_frame(k, frame)
    out.write_manifest({"fps": FPS, "frames": [FIRST, FIRST + frames - 1]})
    out.close()
    return SimpleNamespace(recording=Recording(folder), geometry=geometry, frames=arrays)


@pytest.fixture
def made(tmp_path, rng):
    return make(tmp_path / "run", rng)


FIELDS = {"speed": lambda frame: np.linalg.norm(frame["v"], axis=1), "contact_force": lambda frame: frame["contact"]}


def test_pc2_header_and_positions(made, tmp_path):
    obj, pc2 = export(made.recording, "pc2", tmp_path / "o", FIELDS)
    data = pc2.read_bytes()
    assert data[:12] == b"POINTCACHE2\0"
    version, count, start, rate, frames = struct.unpack("<iiffi", data[12:32])
    assert (version, count, start, rate, frames) == (1, 9, FIRST, 1.0, 3)
    x = np.frombuffer(data[32:], "<f4").reshape(3, 9, 3)
    assert all((x[k] == frame["x"]).all() for k, frame in enumerate(made.frames))
    assert (read_pc2(pc2) == x).all()


def test_the_obj_beside_it_has_the_first_shape_and_both_pieces(made, tmp_path):
    lines = export(made.recording, "pc2", tmp_path / "o", FIELDS)[0].read_text().splitlines()
    v = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=np.float32)
    vt = np.array([line.split()[1:] for line in lines if line.startswith("vt ")], dtype=np.float32)
    corners = np.array([[word.split("/") for word in line.split()[1:]] for line in lines if line.startswith("f ")], dtype=int)
    assert (v == made.frames[0]["x"]).all() and (corners[:, :, 0] - 1 == FACES).all()
    assert (vt[corners[:, :, 1] - 1] == made.geometry["uv"]).all()
    assert {line.split()[0] for line in lines} == {"v", "vt", "f", "g"}
    groups = [k for k, line in enumerate(lines) if line.startswith("g ")]
    assert [len(lines[k].split()) for k in groups] == [2, 2] and [x[0] for x in lines[groups[0] + 1: groups[1]]] == ["f"] * 2


def samples(text, name):
    """Rows of numbers by time code of an attribute's time samples, in every mesh of a .usda file."""
    out = []
    for block in re.findall(rf" {name}\.timeSamples = {{\n(.*?)\n        }}", text, re.DOTALL):
        rows = re.findall(r"(\d+): \[(.*)\],", block)
        out.append({int(k): np.array(re.findall(r"[-\d.e+]+", row), dtype=np.float32).reshape(-1, 3) for k, row in rows})
    return out


def test_usda(made, tmp_path):
    text = export(made.recording, "usda", tmp_path / "o", {})[0].read_text()
    for part, (first, last) in enumerate(((0, 4), (4, 9))):
        for k, frame in enumerate(made.frames, FIRST):
            assert (samples(text, "points")[part][k] == frame["x"][first:last]).all()
            assert (samples(text, "velocities")[part][k] == frame["v"][first:last]).all()
            extent = samples(text, "extent")[part][k]
            assert (extent[0] == frame["x"][first:last].min(axis=0)).all()
            assert (extent[1] == frame["x"][first:last].max(axis=0)).all()
        assert list(samples(text, "points")[part]) == [FIRST, FIRST + 1, FIRST + 2]
    index = [[int(i) for i in row.split(",")] for row in re.findall(r"faceVertexIndices = \[(.*?)\]", text)]
    assert index == [FACES[:2].ravel().tolist(), (FACES[2:] - 4).ravel().tolist()]
    assert [row.count("3") for row in re.findall(r"faceVertexCounts = \[(.*?)\]", text)] == [2, 3]
    st = [np.array(re.findall(r"[-\d.e+]+", row), dtype=np.float32) for row in re.findall(r"primvars:st = \[(.*?)\] \(", text)]
    assert (np.concatenate(st).reshape(5, 3, 2) == made.geometry["uv"]).all() and 'interpolation = "faceVarying"' in text
    for line in ("metersPerUnit = 1", 'upAxis = "Y"', f"startTimeCode = {FIRST}", f"endTimeCode = {FIRST + 2}",
                 f"timeCodesPerSecond = {FPS}", 'subdivisionScheme = "none"', "doubleSided = 1"):
        assert line in text
    assert all(re.fullmatch(r"[A-Za-z_]\w*", name) for name in re.findall(r'def Mesh "(.*?)"', text))
    assert len(set(re.findall(r'def Mesh "(.*?)"', text))) == 2


def test_usdc_says_the_same_as_usda(made, tmp_path):
    Usd = pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    from pxr import UsdGeom

    stage = Usd.Stage.Open(str(export(made.recording, "usdc", tmp_path / "o", {})[0]))
    assert stage.GetTimeCodesPerSecond() == FPS and UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1
    meshes = [UsdGeom.Mesh(p) for p in stage.Traverse() if p.IsA(UsdGeom.Mesh)]
    for k, frame in enumerate(made.frames, FIRST):
        assert (np.concatenate([m.GetPointsAttr().Get(k) for m in meshes]) == frame["x"]).all()
        assert (np.concatenate([m.GetVelocitiesAttr().Get(k) for m in meshes]) == frame["v"]).all()


def test_vtu(made, tmp_path):
    *files, pvd = export(made.recording, "vtu", tmp_path / "o", FIELDS)
    assert [f.name for f in files] == ["00002.vtu", "00003.vtu", "00004.vtu"] and pvd.name == "cloth.pvd"
    listed = re.findall(r'timestep="([^"]+)".*file="([^"]+)"', pvd.read_text())
    assert [name for _, name in listed] == [f.name for f in files]
    assert [float(t) for t, _ in listed] == pytest.approx([k / FPS for k in (2, 3, 4)], rel=1e-8)
    for file, frame in zip(files, made.frames):
        grid = meshio.read(file)
        data = grid.point_data
        assert (grid.points == frame["x"]).all() and (grid.cells_dict["triangle"] == FACES).all()
        assert (data["velocity"] == frame["v"]).all() and (data["contact_force"] == frame["contact"]).all()
        assert (data["speed"] == np.linalg.norm(frame["v"], axis=1)).all() and (data["uv"] == first_uv(made)).all()


def first_uv(made):
    """(9, 2) uv of each vertex's first corner in the order of the faces."""
    out = {}
    for corner, uv in zip(FACES.ravel().tolist(), made.geometry["uv"].reshape(-1, 2)):
        out.setdefault(corner, uv)
    return np.array([out[k] for k in range(9)])


def test_ply(made, tmp_path):
    files = export(made.recording, "ply", tmp_path / "o", FIELDS)
    assert [f.name for f in files] == ["00002.ply", "00003.ply", "00004.ply"]
    for k, (file, frame) in enumerate(zip(files, made.frames), FIRST):
        head, _, body = file.read_bytes().partition(b"end_header\n")
        assert f"comment t {k / FPS:.9g} s".encode() in head and b"element vertex 9\n" in head and b"element face 5\n" in head
        names = re.findall(rb"property float (\w+)", head)
        assert names == [b"x", b"y", b"z", b"s", b"t", b"speed"]  # vectors have no property
        table = np.frombuffer(body, "<f4", 9 * 6).reshape(9, 6)
        assert (table[:, :3] == frame["x"]).all() and (table[:, 3:5] == first_uv(made)).all()
        assert (table[:, 5] == np.linalg.norm(frame["v"], axis=1)).all()
        rows = np.frombuffer(body, np.dtype([("n", "u1"), ("i", "<i4", 3)]), offset=9 * 6 * 4)
        assert (rows["n"] == 3).all() and (rows["i"] == FACES).all()


@pytest.mark.parametrize("spoil", ["missing", "damaged", "another's"])
@pytest.mark.parametrize("format", ["pc2", "usda", "vtu", "ply"])
def test_a_frame_that_is_not_whole_is_refused(made, tmp_path, format, spoil):
    frames = made.recording.path / "frames"
    if spoil == "missing":
        (frames / "00003.npz").unlink()
    elif spoil == "damaged":
        data = bytearray((frames / "00003.npz").read_bytes())
        data[300] ^= 4
        (frames / "00003.npz").write_bytes(data)
    else:
        (frames / "00003.npz").write_bytes((frames / "00004.npz").read_bytes())
    with pytest.raises(OutputError, match="00003.npz is (missing|damaged)"):
        export(made.recording, format, tmp_path / "o", FIELDS)
    assert not (tmp_path / "o").exists() or not list((tmp_path / "o").glob("cloth.*"))


@pytest.mark.parametrize("end", ["first", "last"])
def test_frames_gone_from_an_end_are_missed(made, end):
    numbers = made.recording.frames()
    (made.recording.path / "frames" / f"{numbers[0 if end == 'first' else -1]:05d}.npz").unlink()
    with pytest.raises(OutputError, match="is missing, 1 of 3"):
        made.recording.frames()


@pytest.mark.parametrize("format", ["usdc", "vtu", "usda", "pc2", "ply"])
def test_a_full_disk_leaves_nothing_half_written(format, tmp_path, rng):
    """A limit on the size of files stands for the disk."""
    resource = pytest.importorskip("resource", reason="this system has no limits on files")
    if format == "usdc":
        pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    many = make(tmp_path / "many", rng, frames=60).recording
    export(many, format, tmp_path / "before", {})  # what is imported and read first is so now
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ({"vtu": 256, "ply": 256}.get(format, 4096), limits[1]))
    try:
        with pytest.raises(OutputError, match=r"cannot write .*\.(obj|pc2|usda|usdc|vtu|ply)"):
            export(many, format, tmp_path / "o", {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list((tmp_path / "o").glob("*.partial*")) and not list((tmp_path / "o").glob("cloth.[upv]*"))


def test_what_usd_core_cannot_write_is_said(made, tmp_path, monkeypatch):
    Sdf = pytest.importorskip("pxr.Sdf", reason="usd-core is not installed")
    monkeypatch.setattr(Sdf.Layer, "Export", lambda self, path: False)
    with pytest.raises(OutputError, match="usd-core could not write it"):
        export(made.recording, "usdc", tmp_path / "o", {})
    assert not list((tmp_path / "o").iterdir())


def read_obj(path):
    """(groups, faces (m, 3), uv of their corners (m, 3, 2)) of an OBJ."""
    lines = [line.split() for line in path.read_text().splitlines()]
    vt = np.array([line[1:] for line in lines if line[0] == "vt"], dtype=np.float32)
    corners = np.array([[word.split("/") for word in line[1:]] for line in lines if line[0] == "f"], dtype=int) - 1
    return [line[1] for line in lines if line[0] == "g"], corners[:, :, 0], vt[corners[:, :, 1]]


SEWN = {"sewn": np.array([0, 1, 2, 3, 4, 1, 3, 7, 8]), "panel": np.array([0, 0, 1, 1, 2]),
        "panel_names": np.array(["a", "b", "c"])}


def test_panels_and_welded_meshes(tmp_path, rng):
    """Vertices 5 and 6 are sewn to 1 and 3; the last face is a panel of its own, with two corners of b's."""
    made = make(tmp_path / "run", rng, **SEWN)
    obj, pc2 = export(made.recording, "pc2", tmp_path / "p", FIELDS, "panels")
    groups, faces, uv = read_obj(obj)
    take = [0, 1, 2, 3, 4, 5, 6, 7, 6, 7, 8]
    assert groups == ["a", "b", "c"] and (np.array(take)[faces] == FACES).all() and (uv == made.geometry["uv"]).all()
    assert all((x == f["x"][take]).all() for x, f in zip(read_pc2(pc2), made.frames))
    text = export(made.recording, "usda", tmp_path / "p", FIELDS, "panels")[0].read_text()
    assert re.findall(r'def Mesh "(\w+)"', text) == ["a", "b", "c"]
    velocities = samples(text, "velocities")
    assert [len(v[FIRST]) for v in velocities] == [4, 4, 3] and (velocities[2][FIRST] == made.frames[0]["v"][[6, 7, 8]]).all()

    obj, pc2 = export(made.recording, "pc2", tmp_path / "w", FIELDS, "welded")
    groups, faces, uv = read_obj(obj)
    take = np.array([0, 1, 2, 3, 1, 3, 4, 7, 8])
    assert len(groups) == 2 and (take[faces] == SEWN["sewn"][FACES]).all() and (uv == made.geometry["uv"]).all()
    assert all((x == f["x"][take]).all() for x, f in zip(read_pc2(pc2), made.frames))
    file = export(made.recording, "ply", tmp_path / "w", FIELDS, "welded")[0]
    assert meshio.read(file).point_data["speed"] == pytest.approx(np.linalg.norm(made.frames[0]["v"], axis=1)[take], rel=1e-6)


@pytest.mark.slow
def test_a_sewn_run_is_welded_to_the_whole_sheet(tmp_path):
    (tmp_path / "sewn.py").write_text('''
import numpy as np
import taichi_cloth as tc
def build():
    mesh, scene = tc.grid((0.2, 0.2), 2), tc.Scene()
    two = tc.TriMesh(np.concatenate([mesh.x, mesh.x + [0.2, 0, 0]]), np.concatenate([mesh.faces, mesh.faces + 9]),
                     np.concatenate([mesh.uv, mesh.uv + [0.3, 0]]), groups={"left": range(9), "right": range(9, 18)})
    cloth = scene.add_cloth(two, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(1e-5)), name="sheet")
    scene.sew(cloth, [2, 5, 8], [9, 12, 15])
    scene.pin(cloth, [0])
    return scene
''')
    from taichi_cloth.app import cli

    assert cli.main(["run", str(tmp_path / "sewn.py"), "--out", str(tmp_path / "o"), "--duration", "0.1", "--fps", "30",
                     "--no-images"]) == 0
    for flag, vertices, groups in (("--weld", 15, ["sheet"]), ("--panels", 18, ["left", "right"])):
        assert cli.main(["export", str(tmp_path / "o"), "--format", "pc2", flag, "--to", str(tmp_path / flag)]) == 0
        names, faces, _ = read_obj(tmp_path / flag / "cloth.obj")
        assert names == groups and len(faces) == 16 and faces.max() == vertices - 1
        inner = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        assert len(np.unique(inner, axis=0)) == (30 if flag == "--weld" else 32)  # two edges of the seam are one each
        assert np.ptp(read_pc2(tmp_path / flag / "cloth.pc2")[-1], axis=0)[1] > 0.01
