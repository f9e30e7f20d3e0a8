"""Cloth and solids from a .blend: places, order, polygons, groups and weights against figures worked out by hand."""

import re

import numpy as np
import pytest
from blends import FPS, UNIT, content, made_blend, run, with_blender  # noqa: F401  (a fixture)
from test_export import NAMES, make

import taichi_cloth as tc
from taichi_cloth.io import blender, blendfile
from taichi_cloth.output.export import export
from taichi_cloth.output.export.polygons import loops
from taichi_cloth.recording.record import as_built


def turn(axis, angle):
    """(3, 3) about an axis by its number."""
    a, b = (axis + 1) % 3, (axis + 2) % 3
    out = np.eye(3)
    out[[a, a, b, b], [a, b, a, b]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    return out


@pytest.fixture(scope="module")
def curtain(made_blend):  # noqa: F811
    return tc.load(made_blend, only="Curtain")


@with_blender
def test_cloth_is_the_object_as_it_stands(curtain):
    v, u = np.meshgrid(np.linspace(-2, 2, 4), np.linspace(-2, 2, 5), indexing="ij")  # Blender's grid
    own = np.stack([u, v, 0 * u], axis=2).reshape(-1, 3) * [1.5, 1, 0.5]
    there = own @ (turn(2, 0.3) @ turn(0, 1.2)).T + [0, 0, 3 + 0.7]  # in its parent, and led up by the rig
    assert np.abs(curtain.x - UNIT * there[:, [0, 2, 1]] * [1, 1, -1]).max() < 1e-6
    assert curtain.face_count == 24 and np.bincount(curtain.polygon).tolist() == [2] * 12
    assert curtain.texture.shape == (24, 3, 2) and np.ptp(curtain.texture, axis=(0, 1)) == pytest.approx([1, 1])
    assert curtain.select("hem").tolist() == [0, 1, 5, 6] and len(curtain.select("cotton")) == 19
    assert curtain.select("Pins").tolist() == [0, 1, 2, 3] and curtain.select_weights("Pins").tolist() == [1, 1, 1, 0.25]
    assert list(curtain.weights) == ["Pins"] and len(curtain.select("Bone")) == 20
    assert curtain.select_weights(["Pins", "hem"]).tolist() == [1, 1, 1, 0.25, 1, 1]


@with_blender
def test_a_mirrored_hidden_object_keeps_its_outside(made_blend):  # noqa: F811
    flag = tc.load(made_blend, only=["Flag"])
    a, b, c = (flag.x - flag.x.mean(axis=0))[flag.faces].transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(5 * np.sin(0.4 * np.pi) * UNIT**3, rel=1e-5)
    assert sorted(np.bincount(flag.polygon)) == [2] * 5 + [3] * 2  # sides, and two pentagons


@with_blender
def test_a_solid_moves_as_it_does(made_blend):  # noqa: F811
    body = tc.load_solid(made_blend, only="Body")
    assert len(body.x) == 31 and body.fps == FPS and body.closed
    middle = body.x.mean(axis=1)
    assert middle[[0, -1]] == pytest.approx(UNIT * np.array([[0, 0, 5], [0, 6, 5]]), abs=1e-6)
    with pytest.raises(tc.MeshError, match="only: no part 'Bdoy'; did you mean 'Body'"):
        tc.load_solid(made_blend, only="Bdoy")


@with_blender
@pytest.mark.parametrize("only, words", [
    (None, "cloth is one object of a .blend: name one of them .only=.: Body, Curtain, Flag"),
    ("Curtian", "has no mesh object 'Curtian'; did you mean 'Curtain'")])
def test_an_object_has_to_be_named(made_blend, only, words):  # noqa: F811
    with pytest.raises(tc.MeshError, match=words):
        tc.load(made_blend, only=only)


EXPORTER = """
import sys
import bpy
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
bpy.data.objects["Curtain"].modifiers.clear()
bpy.context.scene.frame_set(bpy.context.scene.frame_start)
bpy.ops.object.select_all(action="DESELECT")
bpy.data.objects["Curtain"].select_set(True)
bpy.ops.wm.obj_export(filepath=sys.argv[2], export_selected_objects=True)
"""


def quads(mesh):
    """The vertices of each polygon, in any order."""
    return {tuple(np.unique(mesh.faces[mesh.polygon == k])) for k in range(mesh.polygon.max() + 1)}


@with_blender
def test_an_obj_has_the_same_order_and_polygons(made_blend, curtain, tmp_path):  # noqa: F811
    run(EXPORTER, made_blend, tmp_path / "a.obj")
    mesh = tc.load(tmp_path / "a.obj", scale=UNIT)
    assert np.abs(mesh.x + [0, 0.7 * UNIT, 0] - curtain.x).max() < 1e-6  # without the rig's lift
    assert quads(mesh) == quads(curtain) and len(quads(mesh)) == 12  # which are sorted by their materials


def test_the_environment_names_a_program(tmp_path, monkeypatch):
    program = tmp_path / "my blender"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("TAICHI_CLOTH_BLENDER", str(program))
    words = blender.command(tmp_path / "script.py")
    assert words[0] == str(program) and words[-3:] == ["--python", str(tmp_path / "script.py"), "--"]
    monkeypatch.setenv("TAICHI_CLOTH_BLENDER", str(tmp_path / "none"))
    assert blender.command(tmp_path / "script.py") is None


@with_blender
def test_a_file_that_is_none(tmp_path):
    (tmp_path / "a.blend").write_bytes(b"BLENDER-v500" + bytes(500))
    for read in (tc.load, tc.load_solid):
        with pytest.raises(tc.MeshError, match=re.escape(f"{tmp_path / 'a.blend'}: cannot be read: Blender says")):
            read(tmp_path / "a.blend")


@with_blender
def test_a_file_of_a_newer_blender(made_blend, tmp_path):  # noqa: F811
    data = made_blend.read_bytes()
    version = re.search(rb"v0\d\d\d", data)[0]
    (tmp_path / "a.blend").write_bytes(data.replace(version, b"v0999", 1))
    for read in (tc.load, tc.load_solid):
        with pytest.raises(tc.MeshError, match="a.blend: Blender 9.99 saved it, and this is .*TAICHI_CLOTH_BLENDER"):
            read(tmp_path / "a.blend", only="Body")


def test_without_blender_it_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(blender, "command", lambda script: None)
    (tmp_path / "a.blend").write_bytes(b"any")
    for read in (tc.load, tc.load_solid):
        with pytest.raises(tc.MeshError, match="a.blend: a .blend is read by Blender, and neither its module bpy nor"):
            read(tmp_path / "a.blend")


def test_an_object_by_hand(tmp_path, monkeypatch):
    """Two quads that a mirror turns, 10 units a metre, z up."""
    x = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    world = np.diag([-1.0, 1.0, 1.0, 1.0])[None] + [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 3], [0, 0, 0, 0]]
    groups = {"Pins": (np.array([2, 0]), np.array([0.5, 1.0])), "Whole": (np.array([1]), np.array([1.0])),
              "hem": (np.array([5]), np.array([1.0])), "none": (np.zeros(0, dtype=int), np.zeros(0))}
    made = blendfile.Item(x, np.array([0, 1, 4, 5, 1, 2, 3, 4]), np.array([4, 4]), None, np.array([0, 1]), ["cotton", "hem"],
                          groups, world, "", [], False)
    monkeypatch.setattr(blendfile, "read", lambda path, only: blendfile.Blend(["a"], 24.0, (1, 2), 0.1, {"a": made}))
    (tmp_path / "a.blend").write_bytes(b"any")
    mesh = tc.load(tmp_path / "a.blend")
    assert mesh.x == pytest.approx(0.1 * np.column_stack([-x[:, 0], x[:, 2] + 3, -x[:, 1]]))
    a, b, c = mesh.x[mesh.faces].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 1] > 0).all() and mesh.polygon.tolist() == [0, 0, 1, 1]  # up still
    assert {name: index.tolist() for name, index in mesh.groups.items()} == {
        "cotton": [0, 1, 4, 5], "hem": [5], "Pins": [2, 0], "Whole": [1]}
    assert mesh.weights.keys() == {"Pins"} and mesh.select_weights("Pins").tolist() == [0.5, 1.0]


OBJ = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\nv 0 1 0\nf 1 2 5 6\nf 2 3 4\nf 2 4 5\n"


def test_quads_of_an_obj_come_into_the_record(tmp_path):
    (tmp_path / "a.obj").write_text(OBJ)
    mesh = tc.load(tmp_path / "a.obj")
    assert mesh.polygon.tolist() == [0, 0, 1, 2]
    scene = tc.Scene()
    for k in range(2):
        scene.add_cloth(mesh if k else tc.grid(1.0, 1), tc.Fabric(0.2, tc.Stretch(500)), name=f"a{k}")
    assert as_built(scene)["polygon"].tolist() == [0, 1, 2, 2, 3, 4]
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 1), tc.Fabric(0.2, tc.Stretch(500)))
    assert "polygon" not in as_built(scene)


def test_polygons_are_put_together_again():
    faces = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4], [7, 8, 9], [2, 6, 3]])
    places, counts = loops(faces, np.array([0, 0, 1, 1, 2, 2]))  # the last two do not touch
    assert counts.tolist() == [4, 4, 3, 3]
    rings = np.split(faces.ravel()[places], np.cumsum(counts)[:-1])
    rolled = [np.roll(r, -int(r.argmin())).tolist() for r in rings]
    assert rolled == [[0, 1, 4, 5], [1, 2, 3, 4], [7, 8, 9], [2, 6, 3]]
    assert loops(faces, None)[1].tolist() == [3] * 6


@with_blender
def test_a_blend_has_the_polygons(tmp_path, rng):
    made = make(tmp_path / "run", rng, polygon=np.array([0, 0, 1, 1, 1]))
    kept = content(export(made.recording, "blend", tmp_path / "x.blend")[0])[0]
    found = {name: [sorted(p) for p in kept[name][8]] for name in NAMES}
    assert found == {NAMES[0]: [[0, 1, 2, 3]], NAMES[1]: [[0, 1, 2, 3, 4]]}
