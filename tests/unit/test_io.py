"""Mesh files: seams, polygons, groups, patterns, and files that are broken."""

import pathlib
import struct
import zipfile

import meshio
import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.io import read_surface

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


def obj(x, faces, uv):
    """An OBJ's text with a texture coordinate for each corner (m, 3, 2)."""
    rows = [f"v {a!r} {b!r} {c!r}\n" for a, b, c in x.tolist()] + [f"vt {a!r} {b!r}\n" for a, b in uv.reshape(-1, 2).tolist()]
    return "".join(rows + ["f " + " ".join(f"{v + 1}/{3 * k + j + 1}" for j, v in enumerate(face)) + "\n"
                           for k, face in enumerate(faces.tolist())])


def sides(corner):
    """(m, 3) lengths of triangles' edges."""
    return np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)


def test_a_curtain_with_coordinates_from_0_to_1_keeps_its_size(tmp_path):
    made = tc.grid((1.5, 1.0), (6, 4), plane="xy")
    turn = np.linalg.qr(np.arange(9.0).reshape(3, 3) ** 2 + np.eye(3))[0]  # it hangs somewhere in space
    x, own = made.x @ turn.T + [3, 1, 2], made.corner_uv / [1.5, 1.0]
    path = write(tmp_path, obj(x, made.faces, own))
    mesh = tc.load(path)
    assert np.ptp(mesh.uv, axis=0) == pytest.approx([1.5, 1.0]) and not mesh.flattened  # width along the texture's u
    assert mesh.uv == pytest.approx(made.uv, abs=1e-12) and (mesh.texture == own).all()
    assert "uv='pattern'" in mesh.notes[0] and "'flatten'" in mesh.notes[0] and "21%" in mesh.notes[0]
    flat = tc.load(path, uv="flatten")
    assert (flat.uv == mesh.uv).all() and (flat.texture == own).all() and len(flat.notes) == 1
    assert np.ptp(tc.load(path, 0.1).uv, axis=0) == pytest.approx([0.15, 0.1])
    pattern = tc.load(path, uv="pattern")
    assert (pattern.corner_uv == own).all() and pattern.texture is None
    assert len(pattern.notes) == 1 and "starts stretched or squeezed" in pattern.notes[0] and "35%" in pattern.notes[0]
    assert tc.load(write(tmp_path, obj(x, made.faces, 1.08 * made.corner_uv)), uv="pattern").notes == ()


def test_textures_of_curved_meshes_leave_them_their_lengths(tmp_path):
    flat = tc.grid(1.0, (24, 12)).corner_uv
    round_, up = 2 * np.pi * flat[..., 0], np.pi * (0.05 + 0.9 * flat[..., 1])
    ball = np.stack([np.cos(round_) * np.sin(up), np.cos(up), np.sin(round_) * np.sin(up)], axis=2).reshape(-1, 3)
    _, first, index = np.unique(ball.round(9), axis=0, return_index=True, return_inverse=True)  # closed at the seam
    mesh = tc.load(write(tmp_path, obj(ball[first], index.reshape(-1, 3), flat)))
    assert sides(mesh.corner_uv) == pytest.approx(sides(mesh.x[mesh.faces])) and mesh.flattened
    assert (mesh.texture == flat).all() and "not a pattern" in mesh.notes[0]
    du = np.linalg.solve(np.diff(flat, axis=1), np.diff(mesh.corner_uv, axis=1))  # rows: d(material) / du, dv
    assert (du[:, 0, 0] > 0).all() and np.abs(du[:, 0, 1]).max() < 1e-9 and (du[:, 1, 1] > 0).all()
    mirrored = tc.load(write(tmp_path, obj(ball[first], index.reshape(-1, 3), flat * [-1, 1])))
    assert sides(mirrored.corner_uv) == pytest.approx(sides(mesh.corner_uv))


@pytest.mark.parametrize("unit, scale, words", [
    (1, 1, None), (0.01, 1, "centimetres"), (0.001, 1, "millimetres"), (1, 0.01, "metres"), (0.01, 0.01, None),
    (0.7, 1, "scaled by 0.7")])
def test_patterns_are_known_by_their_lengths(tmp_path, unit, scale, words):
    tube = tc.cylinder(0.5, 2.0, (48, 6))
    x = tube.x * [1.015, 1, 1]  # hangs a little stretched
    mesh = tc.load(write(tmp_path, obj(x / scale, tube.faces, tube.corner_uv / unit)), scale)
    assert mesh.corner_uv == pytest.approx(tube.corner_uv, rel=0.02 if unit == 0.7 else 1e-12) and not mesh.flattened
    assert mesh.notes == () if words is None else words in mesh.notes[0]
    assert (mesh.texture is not None) == (unit == 0.7)


def test_panels_that_wide_triangles_join_are_a_pattern(tmp_path):
    left = tc.grid(1.0, 4, plane="xy")
    x = left.x + np.where(left.x[:, :1] > 0.6, [[0.9, 0, 0]], 0)  # a quarter of it bridges .9 m
    mesh = tc.load(write(tmp_path, obj(x, left.faces, left.corner_uv)))
    assert (mesh.corner_uv == left.corner_uv).all() and "75% of it has the mesh's lengths" in mesh.notes[0]


def test_texture_coordinates_without_area(tmp_path):
    mesh = tc.grid(1.0, 3)
    none = tc.load(write(tmp_path, obj(mesh.x, mesh.faces, 0 * mesh.corner_uv)))
    assert none.texture is None and "no area and are ignored" in none.notes[0]
    uv = mesh.corner_uv.copy()
    uv[4] = uv[4, :1]
    some = tc.load(write(tmp_path, obj(mesh.x, mesh.faces, uv)))
    assert "triangle 4 has no area in them (1 such" in some.notes[0] and some.material_areas.sum() == pytest.approx(1)
    with pytest.raises(tc.MeshError, match="triangle 4 .* has no area in the material plane"):
        tc.load(tmp_path / "a.obj", uv="pattern")


NAMES = """\ufeffv 0 0 0
v 1 0 0
v 2 0 0
v 0 1 0
v 1 1 0
v 2 1 0
o My Dress
usemtl Blue Cotton
g left front
f 1 2 5 4
usemtl left
g
f 2 3 6 5
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_names_and_marks_of_obj(tmp_path, encoding):
    path = tmp_path / "a.obj"
    path.write_text(NAMES.removeprefix("\ufeff") if encoding == "utf-16" else NAMES, encoding=encoding)
    mesh = tc.load(path)
    assert mesh.vertex_count == 6 and mesh.x[1].tolist() == [1, 0, 0]
    half = [0, 1, 3, 4]
    assert {name: index.tolist() for name, index in mesh.groups.items()} == {
        "My Dress": [0, 1, 2, 3, 4, 5], "Blue Cotton": half, "left": half, "front": half, "left front": half}
    inside = tc.load(path, groups="inside")
    assert inside.select("left").tolist() == [0, 3] and len(inside.select("My Dress")) == 6
    with pytest.raises(tc.SceneError, match="unknown groups 'outside'; did you mean 'inside'"):
        tc.load(path, groups="outside")


def test_a_mark_of_byte_order_is_no_part_of_a_file(tmp_path):
    grid = tc.grid(1.0, 2, plane="xy")
    for suffix in ("ply", "stl", "off"):
        path = tmp_path / f"a.{suffix}"
        meshio.write(path, meshio.Mesh(grid.x, [("triangle", grid.faces)]), **({"binary": False} if suffix != "off" else {}))
        path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
        assert tc.load(path).face_count == grid.face_count


def test_triangles_that_name_a_vertex_twice_are_left_out(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 5 5 5\ng a\nf 1 2 3\ng b\nf 5 5 1\nf 1 3 3 4\n"
    path = write(tmp_path, text)
    with pytest.warns(UserWarning, match="1 of 5 vertices"):
        mesh = tc.load(path)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3]] and "twice were left out: 1, the first is 1" in mesh.notes[0]
    assert mesh.groups["b"].tolist() == [0, 2, 3]
    with pytest.warns(UserWarning, match=r"a\.obj: triangles that name a vertex twice were left out: 1"):
        assert len(tc.load_solid(path).faces) == 2
    write_off = "OFF\n4 3 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 0 1\n4 0 2 2 3\n"
    assert tc.load(write(tmp_path, write_off, "a.off")).face_count == 2
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]], dtype="<f4").reshape(2, 3, 3)
    rows = b"".join(bytes(12) + c.tobytes() + bytes(2) for c in corners)
    (tmp_path / "a.stl").write_bytes(bytes(80) + struct.pack("<I", 2) + rows)
    assert tc.load(tmp_path / "a.stl").face_count == 1
    with pytest.raises(tc.MeshError, match="no faces with three vertices"):
        tc.load(write(tmp_path, "v 0 0 0\nv 1 0 0\nf 1 1 2\n"))


def most_at_an_edge(faces):
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(ends, axis=0, return_counts=True)[1].max()


def test_quads_are_cut_along_their_short_diagonals_and_stay_manifold(tmp_path):
    kite = "v 0 -2 0\nv 0.5 0 0\nv 0 2 0\nv -0.5 0 0\n"
    for turn in range(4):
        corners = " ".join(str((k + turn) % 4 + 1) for k in range(4))
        faces = tc.load(write(tmp_path, kite + f"f {corners}\n")).faces
        assert all({1, 3} <= set(face) for face in faces.tolist()), corners
    hollow = "v 0 0 0\nv 1 3 0\nv 0 1 0\nv -1 3 0\nf 1 2 3 4\n"  # the diagonal 1-3 is the one inside
    assert all({0, 2} <= set(face) for face in tc.load(write(tmp_path, hollow)).faces.tolist())
    doublet = "v 0 0 0\nv 1 0 0\nv 0.5 0.5 0.1\nv 1 1 0\nv 0 1 0\nf 2 4 3 1\nf 3 4 5 1\n"
    assert most_at_an_edge(tc.load(write(tmp_path, doublet)).faces) == 2
    # the short diagonals of both would be one edge, or an edge of a triangle that is there
    pillow = "v 0 -0.3 0\nv 1 0 0.3\nv 0 0.7 0\nv -1 0 0.3\nv 1.2 0 -0.3\nv -1.2 0 -0.3\n"
    for more in ("f 1 6 3 5\n", "f 1 3 5\n"):
        mesh = tc.load(write(tmp_path, pillow + "f 1 2 3 4\n" + more))
        assert most_at_an_edge(mesh.faces) <= 2


def test_polygons_of_many_corners(tmp_path):
    rng = np.random.default_rng(3011)
    for n in (5, 8, 300, 1500, 0):
        angle = np.sort(rng.uniform(0, 2 * np.pi, n))
        p = np.column_stack([np.cos(angle), np.sin(angle)]) * rng.uniform(0.3, 1.0, (n, 1))
        p = p if n % 8 else p[::-1]
        if n == 0:  # a needle reaches into the corner whose diagonal is the shortest
            p = np.array([[0, 0], [1, 0], [10, 0], [10, 9], [0.3, 0.3], [9, 10], [0, 10], [0, 1]])
        area = 0.5 * float(np.sum(p[:, 0] * np.roll(p[:, 1], -1) - np.roll(p[:, 0], -1) * p[:, 1]))
        text = "".join(f"v {a!r} 0.5 {b!r}\n" for a, b in p.tolist()) + "f " + " ".join(map(str, range(1, len(p) + 1))) + "\n"
        faces = read_surface(write(tmp_path, text))[1]
        a, b, c = (p[faces[:, k]] for k in range(3))
        areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2 * np.sign(area)
        assert len(faces) == len(p) - 2 and (areas > 0).all() and areas.sum() == pytest.approx(abs(area))  # none over another
        assert most_at_an_edge(faces) <= 2


def plain(text):
    """Vertices, faces of corners (vertex, texture or None), read word by word."""
    v, vt, faces = [], 0, []
    for words in map(str.split, text.splitlines()):
        if words[:1] == ["v"]:
            v.append([float(w) for w in words[1:4]])
        elif words[:1] == ["vt"]:
            vt += 1
        elif words[:1] == ["f"]:
            corners = [[int(k) if k else None for k in w.split("/")[:2]] for w in words[1:]]
            faces.append([c[0] - 1 if c[0] > 0 else len(v) + c[0] for c in corners])
    return v, faces


@pytest.mark.parametrize("style", ["{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}", "mixed"])
def test_obj_numbers_are_those_that_python_reads(tmp_path, style):
    rng = np.random.default_rng(3019)
    rows = []
    for n in range(3, 300):
        if n % 7 < 4:
            x = [f"{a:.{rng.integers(1, 18)}{'eg'[n % 2]}}" for a in rng.normal(size=3) * 10.0 ** rng.integers(-9, 9)]
            rows += [f"\tv {' '.join(x)} {'1.0' * (n % 5 == 0)}", f"vt {x[0]}" + f" {x[1]}" * (n % 3 > 0), "vn 0 0 1"]
        else:
            some = style if style != "mixed" else ("{0}", "{0}/{1}", "{0}//{2}", "{0}/{1}/{2}")[n % 4]
            count = 3 + sum(row.startswith("vt") for row in rows)
            at = rng.choice(count, 3, replace=False)
            at = at + 1 if n % 2 else at - count
            rows.append("f " + " ".join(some.format(k, k, k) for k in at))
    text = "\n".join(["v 0 0 0", "vt 0 0", "v 1 0 0", "vt 0 0", "v 0 1 0", "vt 0 1", *rows]) + "\n"
    x, faces, uv, _ = read_surface(write(tmp_path, text))
    wanted, wanted_faces = plain(text)
    assert x.tolist() == wanted and faces.tolist() == wanted_faces
    assert (uv is not None) == ("{1}" in style)


def test_continued_lines_are_joined_in_linear_time(tmp_path):
    n = 200_000
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 \\\n" + "\\\n" * n + "2 \\\n 3 # the end\nf 1 2 9\n"
    with pytest.raises(tc.MeshError, match=f"line {n + 7}: 'f 1 2 9'"):
        tc.load(write(tmp_path, text))
    assert tc.load(write(tmp_path, text.removesuffix("f 1 2 9\n"))).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".vtk", ".vtu", ".off"])
def test_other_formats(tmp_path, suffix):
    grid = tc.grid(1, 3, plane="xy")
    path = tmp_path / f"a{suffix}"
    meshio.write(path, meshio.Mesh(grid.x, [("triangle", grid.faces)]))
    mesh = tc.load(path)
    assert (mesh.vertex_count, mesh.face_count) == (16, 18)
    assert mesh.material_areas.sum() == pytest.approx(1)


@pytest.mark.parametrize("name, text, words", [
    ("none.obj", None, "no such mesh file"), (".", None, "is a folder"),
    ("a.xyz", "x", "unknown mesh format"),
    ("a.obj", "v 0 0 0\n", "no faces"), ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2-3 3\n", "line 4: 'f 1 2-3 3'"),
    ("a.obj", "v 0 0-1 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: 'v 0 0-1 0'"),
    ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", "line 4"),
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
