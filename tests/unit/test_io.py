"""Mesh files: seams, polygons, groups, patterns, and files that are broken."""

import re

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
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n", "vertex 2 has a coordinate that is not finite"),
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
