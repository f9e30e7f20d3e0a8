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
from taichi_cloth.output.export.pieces import turned
from taichi_cloth.output.folder import RunFolder
from taichi_cloth.output.recording import Recording

FPS, FIRST = 25, 2
FACES = np.array([[0, 1, 2], [2, 1, 3], [4, 5, 6], [6, 5, 7], [6, 7, 8]], dtype=np.int32)  # two pieces of 4 and 5 vertices
NAMES = ["shirt\nf 1 2 3 # \\", "4 skirts"]


SOLID_FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3], [4, 5, 6], [6, 5, 7]], dtype=np.int32)
TETRAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 1, 0]], dtype=np.float32)
COLORS = np.array([[0.1, 0.2, 0.9], [np.nan] * 3])
CAMERA = np.array([1.0, 2.0, 5.0, 0.5, 0.2, 0.1, 40.0, 0.0, 1.0, 0.0])  # eye, target, fov, up


def make(folder, rng, frames=3, own=None, **more):
    """A recording of two pieces of cloth, from frame FIRST on, whose positions and velocities have nothing in common; with
    a tetrahedron that moves and deforms, and a sheet that stays.

    Args:
        own: by frame, arrays that it has besides or instead.
        more: arrays of the geometry.
    """
    sheet = rng.normal(size=(4, 3))
    arrays = [{"t": np.array(k / FPS), "x": rng.normal(size=(9, 3)).astype(np.float32),
               "v": 10 + rng.normal(size=(9, 3)).astype(np.float32), "contact": -5 - rng.random((9, 3)).astype(np.float32),
               "solid_x": np.concatenate([TETRAHEDRON * [1, 1 + k / 10, 1] + [k, 0, 0], sheet]).astype(np.float32)}
              | (own or {}).get(k, {}) for k in range(FIRST, FIRST + frames)]
    geometry = {"faces": FACES, "uv": rng.random((5, 3, 2)).astype(np.float32), "x": rng.normal(size=(9, 3)),
                "cloth_start": np.array([0, 4, 9]), "cloth_faces": np.array([0, 2, 5]), "cloth_names": np.array(NAMES),
                "cloth_colors": COLORS, "solid_faces": SOLID_FACES, "solid_start": np.array([0, 4, 8]),
                "solid_names": np.array(["tetrahedron", "sheet"]),
                "solid_colors": np.array([[0.5, 0.25, 0.125], [np.nan] * 3]),
                "solid_x": arrays[0]["solid_x"].astype(np.float64), "camera": CAMERA, "ground": np.array(-3.0),
                "reach": np.array(0.0)} | more
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


def test_pc2_has_a_mesh_and_a_cache_for_each_that_moves(made, tmp_path):
    files = {f.name: f for f in export(made.recording, "pc2", tmp_path / "o")}
    assert sorted(files) == ["4_skirts.obj", "4_skirts.pc2", "cloth.mtl", "ground.obj", "sheet.obj", "shirt_f_1_2_3____.obj",
                             "shirt_f_1_2_3____.pc2", "tetrahedron.obj", "tetrahedron.pc2"]
    for name, key, first, last in (("shirt_f_1_2_3____", "x", 0, 4), ("4_skirts", "x", 4, 9),
                                   ("tetrahedron", "solid_x", 0, 4)):
        data = files[f"{name}.pc2"].read_bytes()
        assert data[:12] == b"POINTCACHE2\0"
        version, count, start, rate, frames = struct.unpack("<iiffi", data[12:32])
        assert (version, count, start, rate, frames) == (1, last - first, FIRST, 1.0, 3)
        x = np.frombuffer(data[32:], "<f4").reshape(3, count, 3)
        assert all((x[k] == frame[key][first:last]).all() for k, frame in enumerate(made.frames))
        assert (read_pc2(files[f"{name}.pc2"]) == x).all()
        objects = read_obj(files[f"{name}.obj"])
        assert list(objects) == [name] and (objects[name].x == x[0]).all()
        faces = {"x": FACES, "solid_x": SOLID_FACES}[key]
        mine = ((faces >= first) & (faces < last)).all(axis=1)
        assert (objects[name].faces == faces[mine] - first).all()
        assert (objects[name].uv == made.geometry["uv"][mine]).all() if key == "x" else objects[name].uv is None


def read_obj(path):
    """By name, x (n, 3), faces (m, 3), uv (m, 3, 2), normals (m, 3, 3) and colour of an OBJ's objects; None where absent."""
    colors, name = {}, ""
    lines = [line.split() for line in path.read_text().splitlines()]
    library = next(line[1] for line in lines if line[0] == "mtllib")
    for line in (path.parent / library).read_text().splitlines():
        word, *rest = line.split() or [""]
        name = rest[0] if word == "newmtl" else name
        if word == "Kd":
            colors[name] = np.array(rest, dtype=np.float32)
    tables = {word: np.array([line[1:] for line in lines if line[0] == word], dtype=np.float32) for word in ("v", "vt", "vn")}
    assert {line[0] for line in lines} <= {"v", "vt", "vn", "f", "o", "g", "usemtl", "mtllib"}
    out, of, material = {}, {}, {}
    for line in lines:
        if line[0] == "o":
            assert len(line) == 2 and line[1] not in of
            name, of[line[1]] = line[1], []
        elif line[0] == "f":
            of[name].append([[int(i or 0) - 1 for i in (word + "//").split("/")[:3]] for word in line[1:]])
        elif line[0] == "usemtl":
            material[name] = line[1]
    for name, rows in of.items():
        index = np.array(rows)
        first = index[:, :, 0].min()
        uv, normals = (tables[w][index[:, :, k]] if (index[:, :, k] >= 0).all() else None for k, w in ((1, "vt"), (2, "vn")))
        out[name] = SimpleNamespace(x=tables["v"][first: index[:, :, 0].max() + 1], faces=index[:, :, 0] - first, uv=uv,
                                    normals=normals, color=colors[material[name]])
    return out


def face_normals(x, faces):
    """(m, 3) unit normals of triangles."""
    n = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def test_obj_is_a_sequence_with_an_object_a_mesh(made, tmp_path):
    mtl, *files = export(made.recording, "obj", tmp_path / "o")
    assert mtl.name == "cloth.mtl" and [f.name for f in files] == ["00002.obj", "00003.obj", "00004.obj"]
    for file, frame in zip(files, made.frames):
        objects = read_obj(file)
        shirt, skirt, tetrahedron, sheet, ground = objects.values()
        assert list(objects) == ["shirt_f_1_2_3____", "4_skirts", "tetrahedron", "sheet", "ground"]
        assert (shirt.x == frame["x"][:4]).all() and (skirt.x == frame["x"][4:]).all()
        assert (tetrahedron.x == frame["solid_x"][:4]).all() and (sheet.x == frame["solid_x"][4:]).all()
        assert (np.concatenate([shirt.uv, skirt.uv]) == made.geometry["uv"]).all() and tetrahedron.uv is None
        assert (shirt.faces == FACES[:2]).all() and (skirt.faces == FACES[2:] - 4).all()
        assert (ground.x[:, 1] == -3).all() and ground.normals == pytest.approx(np.tile([0, 1, 0], (2, 3, 1)))
        assert shirt.color == pytest.approx(COLORS[0]) and tetrahedron.color == pytest.approx([0.5, 0.25, 0.125])
        assert np.isfinite(skirt.color).all() and (skirt.color != shirt.color).any()
        # sharp edges: each face of the tetrahedron has its own normal; cloth: one a vertex, the sum over its faces by area
        flat = face_normals(tetrahedron.x, tetrahedron.faces)
        assert tetrahedron.normals == pytest.approx(np.repeat(flat[:, None], 3, axis=1), abs=2e-6)
        a, b, c = shirt.x[shirt.faces].transpose(1, 0, 2)
        area = np.cross(b - a, c - a)
        both = area.sum(axis=0) / np.linalg.norm(area.sum(axis=0))
        assert shirt.normals[0, 1] == pytest.approx(both, abs=2e-6) and shirt.normals[1, 1] == pytest.approx(both, abs=2e-6)


def test_vtu(made, tmp_path):
    *files, pvd = export(made.recording, "vtu", tmp_path / "o", fields=FIELDS)
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
    files = export(made.recording, "ply", tmp_path / "o", fields=FIELDS)
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
@pytest.mark.parametrize("format", ["pc2", "obj", "usda", "glb", "vtu", "ply"])
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
        export(made.recording, format, tmp_path / "o")
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize("end", ["first", "last"])
def test_frames_gone_from_an_end_are_missed(made, end):
    numbers = made.recording.frames()
    (made.recording.path / "frames" / f"{numbers[0 if end == 'first' else -1]:05d}.npz").unlink()
    with pytest.raises(OutputError, match="is missing, 1 of 3"):
        made.recording.frames()


@pytest.mark.parametrize("format", ["usdc", "vtu", "usda", "pc2", "obj", "glb", "gltf", "ply"])
def test_a_full_disk_leaves_nothing_half_written(format, tmp_path, rng):
    """A limit on the size of files stands for the disk."""
    resource = pytest.importorskip("resource", reason="this system has no limits on files")
    if format == "usdc":
        pytest.importorskip("pxr.Usd", reason="usd-core is not installed")
    many = make(tmp_path / "many", rng, frames=60).recording
    export(many, format, tmp_path / "before")  # what is imported and read first is so now
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, ({"vtu": 256, "ply": 256, "pc2": 600, "obj": 800}.get(format, 4096), limits[1]))
    try:
        with pytest.raises(OutputError, match=r"cannot write .*\.(obj|pc2|usda|usdc|vtu|ply|glb|bin)"):
            export(many, format, tmp_path / "o")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    whole = {f.name: f.read_bytes() for f in (tmp_path / "before").iterdir()}
    left = {f.name: f.read_bytes() for f in (tmp_path / "o").iterdir()}
    assert len(left) < len(whole) and all(whole[name] == data for name, data in left.items())


def test_what_usd_core_cannot_write_is_said(made, tmp_path, monkeypatch):
    Sdf = pytest.importorskip("pxr.Sdf", reason="usd-core is not installed")
    monkeypatch.setattr(Sdf.Layer, "Export", lambda self, path: False)
    with pytest.raises(OutputError, match="usd-core could not write it"):
        export(made.recording, "usdc", tmp_path / "o")
    assert not list((tmp_path / "o").iterdir())


SEWN = {"sewn": np.array([0, 1, 2, 3, 4, 1, 3, 7, 8]), "panel": np.array([0, 0, 1, 1, 2]),
        "panel_names": np.array(["a", "b", "c"])}


def test_panels_and_welded_meshes(tmp_path, rng):
    """Vertices 5 and 6 are sewn to 1 and 3; the last face is a panel of its own, with two corners of b's."""
    made = make(tmp_path / "run", rng, **SEWN)
    export(made.recording, "pc2", tmp_path / "p", "panels")
    takes = {"a": [0, 1, 2, 3], "b": [4, 5, 6, 7], "c": [6, 7, 8]}
    for (name, take), mine in zip(takes.items(), (FACES[:2], FACES[2:4], FACES[4:])):
        panel = read_obj(tmp_path / "p" / f"{name}.obj")[name]
        assert (np.array(take)[panel.faces] == mine).all()
        assert (panel.uv == made.geometry["uv"][(FACES[:, None] == mine).all(axis=2).any(axis=1)]).all()
        assert all((x == f["x"][take]).all() for x, f in zip(read_pc2(tmp_path / "p" / f"{name}.pc2"), made.frames))
        if name == "a":
            assert panel.color == pytest.approx(COLORS[0])

    export(made.recording, "pc2", tmp_path / "w", "welded")
    takes, rows = {NAMES[0]: [0, 1, 2, 3], NAMES[1]: [1, 3, 4, 7, 8]}, (FACES[:2], FACES[2:])
    for name, take, mine in zip(("shirt_f_1_2_3____", "4_skirts"), takes.values(), rows):
        cloth = read_obj(tmp_path / "w" / f"{name}.obj")[name]
        assert (np.array(take)[cloth.faces] == SEWN["sewn"][mine]).all()
        assert all((x == f["x"][take]).all() for x, f in zip(read_pc2(tmp_path / "w" / f"{name}.pc2"), made.frames))
    take = np.array([0, 1, 2, 3, 1, 3, 4, 7, 8])
    file = export(made.recording, "ply", tmp_path / "w", "welded", FIELDS)[0]
    assert meshio.read(file).point_data["speed"] == pytest.approx(np.linalg.norm(made.frames[0]["v"], axis=1)[take], rel=1e-6)


def both_ways(folder, rng):
    """Four panels of two triangles in a row, in one plane, sewn to each other; the second and third face down."""
    one = np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1], [1, 0, -1]], dtype=np.float32)
    x = np.concatenate([one + [k, 0, 0] for k in range(4)]).astype(np.float32)
    up = np.array([[0, 1, 2], [2, 1, 3]])
    faces = np.concatenate([(up[:, ::-1] if k in (1, 2) else up) + 4 * k for k in range(4)]).astype(np.int32)
    sewn = np.arange(16)
    sewn[[4, 6, 8, 10, 12, 14]] = [1, 3, 5, 7, 9, 11]
    own = {k: {"x": x, "v": 0 * x, "contact": 0 * x} for k in range(FIRST, FIRST + 3)}
    return make(folder, rng, own=own, faces=faces, x=x, uv=rng.random((8, 3, 2)).astype(np.float32),
                cloth_start=np.array([0, 16]), cloth_faces=np.array([0, 8]),
                cloth_names=np.array(["strip"]), cloth_colors=np.full((1, 3), 0.5), sewn=sewn,
                panel=np.repeat(np.arange(4), 2), panel_names=np.array(list("abcd")))


def runs_once_each_way(faces) -> bool:
    """Whether every edge between two triangles is gone through in both directions."""
    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return len(np.unique(ends, axis=0)) == len(ends)


def test_what_is_welded_faces_one_side(tmp_path, rng):
    """Every triangle is there, those of the panels that face down turned with their texture, and it is said; of cloths that
    are not welded none is turned, and no normal is shared by triangles that face opposite ways."""
    made = both_ways(tmp_path / "run", rng)
    faces, uv = made.geometry["faces"], made.geometry["uv"]
    for parts in ("cloths", "welded"):
        made.recording.notes.clear()
        strip = read_obj(export(made.recording, "obj", tmp_path / parts, parts)[1])["strip"]
        corners = strip.x[strip.faces]
        assert (face_normals(strip.x, strip.faces)[:, 1] > 0).tolist() == [True, True, *[parts == "welded"] * 4, True, True]
        flip = [not (c == made.geometry["x"][f]).all() for c, f in zip(corners, faces)]
        assert sum(flip) == (4 if parts == "welded" else 0)
        assert all((c[::-1 if turn else 1] == made.geometry["x"][f]).all() and (st[::-1 if turn else 1] == own).all()
                   for c, st, f, own, turn in zip(corners, strip.uv, faces, uv, flip))
        assert np.einsum("mcd,md->mc", strip.normals, face_normals(strip.x, strip.faces)) == pytest.approx(1)
        assert len(strip.x) == (16 if parts == "cloths" else 10)
        assert [note[:36] for note in made.recording.notes] == ["4 of 8 triangles go round the other "] * (parts == "welded")
    for format in ("ply", "vtu", "pc2", "usda"):
        file = export(made.recording, format, tmp_path / "w", "welded")[0]
        if format in ("ply", "vtu"):
            mine = meshio.read(file).cells_dict["triangle"]
        elif format == "pc2":
            mine = read_obj(tmp_path / "w" / "strip.obj")["strip"].faces
        else:
            rows = re.findall(r"faceVertexIndices = \[(.*?)\]", file.read_text())
            mine = np.array(rows[0].split(","), dtype=int).reshape(-1, 3)
        assert len(mine) == 8 and runs_once_each_way(mine) and not runs_once_each_way(made.geometry["sewn"][faces])


def test_what_has_one_side_or_three_layers_is_not_turned():
    """A Moebius strip stays as it is; at an edge of three triangles none is another's neighbour, and elsewhere they are."""
    ring = np.array([[2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3] for k in range(6)])
    ring[-1, 2:] = [1, 0]
    strip = np.concatenate([ring[:, [0, 1, 2]], ring[:, [2, 1, 3]]])
    fan = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [1, 4, 5]])  # the last is turned against the one before
    other = np.array([[10, 11, 12], [12, 11, 13], [12, 13, 14], [14, 13, 15], [14, 15, 15]])
    other[1] = other[1, ::-1]
    faces = np.concatenate([strip, fan, other])
    out = turned(faces, np.array([0, 12, 16, 21]))
    assert not out[:12].any() and out[12:16].tolist() == [False, False, False, True]
    assert out[16:].tolist() == [False, True, False, False, False]


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
    for flag, vertices, names in (("--weld", [15], ["sheet"]), ("--panels", [9, 9], ["left", "right"])):
        assert cli.main(["export", str(tmp_path / "o"), "--format", "pc2", flag, "--to", str(tmp_path / flag)]) == 0
        faces = [read_obj(tmp_path / flag / f"{name}.obj")[name].faces for name in names]
        assert sum(map(len, faces)) == 16 and [f.max() + 1 for f in faces] == vertices
        edges = [np.unique(np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1), axis=0) for f in faces]
        assert sum(map(len, edges)) == (30 if flag == "--weld" else 32)  # two edges of the seam are one each
        assert np.ptp(read_pc2(tmp_path / flag / f"{names[0]}.pc2")[-1], axis=0)[1] > 0.01
