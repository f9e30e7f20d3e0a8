"""Mesh files: seams, polygons, groups, patterns, and files that are broken."""

import pathlib
import re
import struct
import zipfile

import meshio
import numpy as np
import pytest

import taichi_cloth as tc

CUBE_SIDE = """# two quads with a seam along the edge 2-3
o box
v 0 0 0
v 1 0 0
v 1 1 0  # a comment
v 0 1 0
v 2 0 1
v 2 1 1
vt 0 0
vt 1 0
vt 1 1
vt 0 1
vt 3 0
vt 4.414 0
vt 4.414 1
vt 3 1
g front
f 1/1 2/2 3/3 4/4
g side
f -5/5 -2/6 \\
  -1/7 -4/8
"""


def write(tmp_path, text, name="a.obj"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_obj_keeps_seams_groups_and_negative_indices(tmp_path):
    mesh = tc.load(write(tmp_path, CUBE_SIDE))
    assert mesh.vertex_count == 6 and mesh.face_count == 4
    assert mesh.uv.shape == (4, 3, 2)
    assert mesh.select("front").tolist() == [0, 1, 2, 3] and mesh.select("side").tolist() == [1, 2, 4, 5]
    assert mesh.material_areas.sum() == pytest.approx(1 + 1.414)
    across = mesh.corner_uv[mesh.faces == 1]
    assert sorted(set(across[:, 0])) == [1, 3]  # vertex 1 lies at two places of the pattern
    assert mesh.notes == ()


def test_concave_polygon_is_cut_into_ears(tmp_path):
    arrow = "v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\nv 0 2 0\nf 1 2 3 4 5\n"
    mesh = tc.load(write(tmp_path, arrow))
    assert mesh.face_count == 3
    assert mesh.material_areas.sum() == pytest.approx(2.5)


def test_no_texture_flattens_and_says_so(tmp_path):
    fold = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.6 0.6 0.9\nf 1 2 3\nf 2 4 3\n"
    mesh = tc.load(write(tmp_path, fold), scale=0.1)
    assert any("flattened" in n for n in mesh.notes)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-3)))
    assert np.abs(tc.Simulation(scene).forces()).max() < 1e-12  # the given shape is at rest, the fold included


def test_texture_that_is_no_pattern(tmp_path):
    unit = CUBE_SIDE.replace("vt 4.414", "vt 4").replace("v 2 0 1", "v 2 0 0").replace("v 2 1 1", "v 2 1 0")
    mesh = tc.load(write(tmp_path, unit), scale=0.05)  # 5 cm a square, texture 1 a square: in the file's units
    assert mesh.notes == () and mesh.material_areas.sum() == pytest.approx(2 * 0.05**2)
    big = re.sub(r"^v (\d) (\d)", r"v \g<1>0 \g<2>0", unit, flags=re.M)
    mesh = tc.load(write(tmp_path, big))
    assert "scaled by 10" in mesh.notes[0] and mesh.material_areas.sum() == pytest.approx(200)
    squeezed = unit.replace("vt 3 ", "vt 3.99 ")
    mesh = tc.load(write(tmp_path, squeezed))
    assert "refused" in mesh.notes[0] and "flattened" in mesh.notes[1]
    with pytest.raises(tc.MeshError, match="has no area in the texture"):
        tc.load(write(tmp_path, "".join(f"v {i} {j} 0\nvt {i} {j}\n" for i in range(8) for j in range(2)) + "vt 0 0\n"
                      + "".join(f"f {a}/{a} {a + 2}/{a + 2} {a + 1}/{a + 1}\nf {a + 1}/{a + 1} {a + 2}/{a + 2} "
                                f"{a + 3}/{a + 3}\n" for a in range(1, 13, 2)) + "f 13/17 15/17 14/17\n"))


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".vtk", ".vtu", ".off"])
def test_other_formats(tmp_path, suffix):
    grid = tc.grid(1, 3, plane="xy")
    path = tmp_path / f"a{suffix}"
    meshio.write(path, meshio.Mesh(grid.x, [("triangle", grid.faces)]))
    mesh = tc.load(path)
    assert (mesh.vertex_count, mesh.face_count) == (16, 18)
    assert mesh.material_areas.sum() == pytest.approx(1)


@pytest.mark.parametrize("name, text, words", [
    ("none.obj", None, "no such mesh file"),
    ("a.xyz", "x", "unknown mesh format"),
    ("a.obj", "v 0 0 0\n", "no faces"),
    ("a.obj", "v 0 0 0\nv 1 0 zero\n", "line 2: 'v 1 0 zero'"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "line 4: .* vertex 4 is out of range: there are 3"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "vertex 0 is out of range"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2\n", "at least 3 corners"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "vertex 2 is not finite"),
    *(("a.obj", f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt {bad} 0\nvt 0 1\nf 1/1 2/2 3/3\n", "coordinates: face 0 is not finite")
      for bad in ("nan", "inf")),
    ("a.ply", "not a ply", "cannot be read"),
])
def test_broken_files(tmp_path, name, text, words):
    path = tmp_path / name if text is None else write(tmp_path, text, name)
    with pytest.raises(tc.MeshError, match=words):
        tc.load(path)


@pytest.mark.parametrize("name, scale, vertices", [("tshirt", 0.1, 1921), ("skirt", 1, 1809), ("dress_pattern", 1, 15656)])
def test_real_garments(shared, name, scale, vertices):
    mesh = tc.load(shared / "data" / f"{name}.obj", scale)
    assert mesh.vertex_count == vertices
    assert (mesh.notes == ()) == (name == "dress_pattern")  # the only one whose texture is a pattern in metres


PLY_ROWS = [((0, 1, 2), 7), ((0, 2, 3, 4), 8), ((1, 0, 4), 9)]  # corners and a property that is passed over


def write_ply(path, x, order):
    """Triangles and a quad, with properties before and behind those that matter; text where order is ""."""
    head = ["ply", "format " + {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[order] + " 1.0",
            "comment nothing", f"element vertex {len(x)}", "property uchar red", *(f"property float {c}" for c in "xyz"),
            f"element face {len(PLY_ROWS)}", "property list uchar int vertex_index", "property short tag", "end_header"]
    if order == "":
        body = "".join("200 {} {} {}\n".format(*p) for p in x) + "".join(
            f"{len(c)} {' '.join(map(str, c))} {tag}\n" for c, tag in PLY_ROWS)
        path.write_text("\n".join(head) + "\n" + body)
        return
    body = b"".join(struct.pack(order + "Bfff", 200, *p) for p in x) + b"".join(
        struct.pack(f"{order}B{len(c)}ih", len(c), *c, tag) for c, tag in PLY_ROWS)
    path.write_bytes("\n".join(head).encode() + b"\n" + body)


@pytest.mark.parametrize("order", ["", "<", ">"])
def test_ply_of_many_kinds(tmp_path, order):
    x = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0.5], [1, 1.25, 0], [0, 1, 0]])
    write_ply(tmp_path / "a.ply", x, order)
    mesh = tc.load(tmp_path / "a.ply")
    assert (mesh.x == x).all() and mesh.face_count == 4
    assert mesh.faces[0].tolist() == [0, 1, 2] and mesh.faces[-1].tolist() == [1, 0, 4]
    assert sorted({*mesh.faces[1].tolist(), *mesh.faces[2].tolist()}) == [0, 2, 3, 4]
    data = (tmp_path / "a.ply").read_bytes()
    for end in range(0, len(data) - 1, 7):  # cut off anywhere, it is refused, and at once
        (tmp_path / "cut.ply").write_bytes(data[:end])
        with pytest.raises(tc.MeshError, match="cut.ply: cannot be read"):
            tc.load(tmp_path / "cut.ply")


def test_off_of_many_kinds(tmp_path):
    text = "OFF 5 2 0\n# a comment\n0 0 0\n1 0 0  # more\n1 1 0\n\n0 1 0\n0 0 1\n4 0 1 2 3  0.5 0.5 0.5\n3 1 0 4 255\n"
    mesh = tc.load(write(tmp_path, text, "a.off"))
    assert mesh.face_count == 3 and mesh.faces[-1].tolist() == [1, 0, 4] and mesh.x[4].tolist() == [0, 0, 1]
    for end in range(0, len(text) - 6, 5):
        with pytest.raises(tc.MeshError, match="cut.off: cannot be read"):
            tc.load(write(tmp_path, text[:end], "cut.off"))


@pytest.mark.parametrize("name, data, words", [
    ("a.ply", b"ply\nformat ascii 1.0\nelement vertex 99999999999\nproperty float x\nend_header\n", "99999999999 of 'vertex'"),
    ("a.ply", b"ply\nformat ascii 1.0\nelement vertex -2\nproperty float x\nend_header\n1\n", "-2 of 'vertex'"),
    ("a.off", b"OFF\n-1 1 0\n0 0 0\n", "-1 vertices"),
    ("a.off", b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "face 0 names vertex 3"),
    ("a.stl", b"binary " + bytes(73) + struct.pack("<I", 4_000_000_000), "4000000000 triangles"),
    ("a.stl", b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "does not end with endsolid"),
    ("a.vtk", b"# vtk DataFile Version 5.1\n\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS 99999999999 double\n",
     "POINTS 99999999999"),
    ("a.vtu", b"<VTKFile><Piece NumberOfPoints=\"99999999999\" NumberOfCells=\"1\"/></VTKFile>",
     "NumberOfPoints 99999999999"),
    ("a.obj", ("".join(f"v {k} {k * k} 0\n" for k in range(300)) + "f " + " ".join(map(str, range(1, 301)))).encode(),
     "300 corners"),
])
def test_sizes_that_lie_are_refused_before_anything_is_made_of_them(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(tc.MeshError, match=words):
        tc.load(tmp_path / name)


def npz_with_header(path, header: bytes) -> None:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("positions.npy", header)
        file.writestr("faces.npy", header)


def test_solids_from_damaged_files(tmp_path):
    x, faces = tc.grid(1.0, 2).x, tc.grid(1.0, 2).faces
    path = tmp_path / "a.npz"
    np.savez_compressed(path, positions=np.stack([x, x + 1]), faces=faces, fps=20.0)
    good = tc.load_solid(path)
    assert good.fps == 20 and (good.x[1] == x + 1).all() and tc.load_solid(path, fps=5).fps == 5
    data = path.read_bytes()
    for end in range(0, len(data), 23):
        path.write_bytes(data[:end])
        with pytest.raises(tc.MeshError, match=r"a\.npz: cannot be read"):
            tc.load_solid(path)
    text = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999, 3), }".ljust(117) + "\n"
    npz_with_header(path, b"\x93NUMPY\x01\x00" + struct.pack("<H", 118) + text.encode() + bytes(48))
    with pytest.raises(tc.MeshError, match="needs 2399999999976 bytes, and has 48"):
        tc.load_solid(path)
    for arrays, words in (({"positions": x}, "no array 'faces'"), ({"positions": x.astype(str), "faces": faces},
                                                                             "not numbers"),
                          ({"positions": x, "faces": faces + 0.5}, "not whole numbers"),
                          ({"positions": x, "faces": faces, "fps": "x"}, "fps must be one number")):
        np.savez(path, **arrays)
        with pytest.raises(tc.MeshError, match=words):
            tc.load_solid(path)
    np.savez(path, positions=np.stack([x, x]), faces=faces, fps=np.inf)
    for fps in (None, np.inf, np.nan, -1.0, 0.0):
        with pytest.raises(tc.SceneError, match="fps = .*: must be (a )?positive"):
            tc.load_solid(path, fps=fps)
    topology = write(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "t.obj")
    for count, frames in ((-3, -2), (3, -2), (-1, 1), (0, 0), (3, 2_000_000_000)):
        (tmp_path / "a.pc2").write_bytes(b"POINTCACHE2\0" + struct.pack("<iiffi", 1, count, 0, 1, frames) + bytes(72))
        with pytest.raises(tc.MeshError, match=f"its header says {frames} frames of {count} points"):
            tc.load_solid(tmp_path / "a.pc2", mesh=topology, fps=24)


@pytest.mark.parametrize("seed", range(3007, 3037))
def test_random_files_load_or_are_refused(seed, monkeypatch):
    monkeypatch.syspath_prepend(str(pathlib.Path(__file__).parents[2] / "scripts"))
    from fuzzing.files import trial

    outcome = trial(seed, "f64")
    assert outcome.verdict == "ok", outcome.text
