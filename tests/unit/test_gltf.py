"""Solids and cloth from glTF: files written by hand, positions computed afresh."""

import json
import os
import pathlib
import re
import struct

import numpy as np
import pytest
from glb import Glb

import taichi_cloth as tc
from taichi_cloth.app.cli import main
from taichi_cloth.io import solid

pytest.importorskip("pygltflib", reason="the package pygltflib is not installed: pip install 'taichi-cloth[gltf]'")

# A square post of three rings, 0, 1 and 2 m up, closed; a joint at its foot, one at 1 m.
RING = np.array([[0.2, 0, 0.2], [0.2, 0, -0.2], [-0.2, 0, -0.2], [-0.2, 0, 0.2]])
POST = np.concatenate([RING, RING + [0, 1, 0], RING + [0, 2, 0]])
SIDES = [(4 * r + k, 4 * r + (k + 1) % 4, 4 * r + 4 + (k + 1) % 4, 4 * r + 4 + k) for r in (0, 1) for k in range(4)]
FACES = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))] + [(0, 2, 1), (0, 3, 2), (8, 9, 10), (8, 10, 11)])
UPPER = np.repeat([0.0, 0.5, 1.0], 4)  # weight of the upper joint
WIDER = POST * [0.5, 0, 0.25]  # a morph target's displacements
FPS = 9.0
PATTERN = pathlib.Path(__file__).parents[2] / "scenes" / "patterns" / "skirt.json"


def turn_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def about_z(angle: float) -> list[float]:
    return [0, 0, float(np.sin(angle / 2)), float(np.cos(angle / 2))]


def spline(t: float) -> float:
    """The weight between keys 0 and .8 at 0 and 1 s, which leaves with 3/s and arrives with -1/s: Hermite's polynomials."""
    return 3 * (t - 2 * t**2 + t**3) + 0.8 * (3 * t**2 - 2 * t**3) - (t**3 - t**2)


def expected(t: float) -> np.ndarray:
    """(12, 3) where the post is at time t: each vertex by itself."""
    out = np.empty((12, 3))
    angle, moved = 1.5 * t, np.array([0.4 * t, 0, 0])
    for k, x in enumerate(POST + spline(t) * WIDER):
        lower = x + moved
        upper = turn_z(angle) @ (x - [0, 1, 0]) + [0, 1, 0] + moved
        out[k] = (1 - UPPER[k]) * lower + UPPER[k] * upper
    # the rig stands in a node that is turned by a quarter and twice as large
    return 2 * out @ turn_z(np.pi / 2).T + [0, 0, 3]


def skinned_post(joints="u1", weights="f4", indices="u2", spread=0) -> Glb:
    glb = Glb()
    scale = {"f4": 1, "u1": 255, "u2": 65535}[weights]
    w = np.column_stack([1 - UPPER, UPPER, 0 * UPPER, 0 * UPPER])
    w = w if weights == "f4" else np.round(w * scale)
    bind = np.tile(np.eye(4), (2, 1, 1))
    bind[1, :3, 3] = [0, -1, 0]
    attributes = {"POSITION": glb.add(POST, spread=spread), "JOINTS_0": glb.add(np.tile([0, 1, 0, 0], (12, 1)), joints),
                  "WEIGHTS_0": glb.add(w, weights, normalized=weights != "f4")}
    glb.document |= {
        "meshes": [{"primitives": [{"attributes": attributes, "indices": glb.add(FACES.reshape(-1, 1), indices), "material": 0,
                                    "targets": [{"POSITION": glb.sparse(12, range(12), WIDER)}]}]}],
        "materials": [{"name": "Wood"}],
        "skins": [{"joints": [2, 3], "inverseBindMatrices": glb.add(bind.transpose(0, 2, 1).reshape(2, 16))}],
        "nodes": [{"name": "Rig", "children": [1, 2], "translation": [0, 0, 3], "scale": [2, 2, 2],
                   "rotation": about_z(np.pi / 2)},
                  {"name": "Post", "mesh": 0, "skin": 0, "translation": [99, 0, 0]},  # a skin's node is nowhere
                  {"name": "Lower", "children": [3]}, {"name": "Upper", "translation": [0, 1, 0]}],
        "scenes": [{"nodes": [0]}], "scene": 0}
    glb.clip("Bend", translation_2=([0, 1], [[0, 0, 0], [0.4, 0, 0]], "LINEAR"),
             rotation_3=([0, 0.5, 1], [about_z(0), about_z(0.75), about_z(1.5)], "LINEAR"),
             weights_1=([0, 1], [0, 0, 3, -1, 0.8, 0], "CUBICSPLINE"))
    return glb


@pytest.mark.parametrize("how", ["inside", "uri", "beside"])
def test_a_skinned_and_morphed_body_is_where_it_should_be(tmp_path, how):
    body = tc.load_solid(skinned_post().write(tmp_path / ("a.glb" if how == "inside" else "a.gltf"), how), fps=FPS)
    assert body.x.shape == (10, 12, 3) and body.fps == FPS and body.closed and body.start == 0
    for k in range(10):
        assert np.abs(body.x[k] - expected(k / FPS)).max() < 1e-5
    assert set(body.groups) == {"Post", "Wood"} and len(body.groups["Wood"]) == 12
    assert "one part, 'Post'; clip 'Bend', 10 frames at 9 a second; 0.8 m high" in body.notes[0]  # it lies


@pytest.mark.parametrize("joints, weights, indices, spread",
                         [("u1", "f4", "u1", 4), ("u2", "u1", "u4", 0), ("u2", "u2", "u2", 20)])
def test_every_kind_of_number(tmp_path, joints, weights, indices, spread):
    body = tc.load_solid(skinned_post(joints, weights, indices, spread).write(tmp_path / "a.glb"), fps=FPS)
    worst = max(np.abs(body.x[k] - expected(k / FPS)).max() for k in range(10))
    assert worst < (1e-5 if weights == "f4" else 4 / {"u1": 255, "u2": 65535}[weights])
    assert body.notes[1:] == ()  # a byte's rounding is no fault of the weights


def test_a_clip_begins_in_the_rest_pose(tmp_path):
    """The upper joint turns by .8 to 1.5 in its clip, and not at all at rest; the lower one is where the clip has it."""
    glb = skinned_post()
    glb.document["animations"] = []
    glb.clip("Bend", translation_2=([0, 1], [[0.3, 0, 0], [0.4, 0, 0]], "LINEAR"),
             rotation_3=([0, 1], [about_z(0.8), about_z(1.5)], "LINEAR"))
    glb.write(tmp_path / "a.glb")
    plain, body = (tc.load_solid(tmp_path / "a.glb", fps=10, rest=rest) for rest in (None, 0.5))
    assert len(body.x) == 16 and body.fps == 10 and (body.x[5:] == plain.x).all()
    for k in range(6):
        s = k / 5
        upper = (POST - [0, 1, 0]) @ turn_z(0.8 * s * s * (3 - 2 * s)).T + [0, 1, 0]
        there = (1 - UPPER[:, None]) * POST + UPPER[:, None] * upper + [0.3, 0, 0]
        assert np.abs(body.x[k] - 2 * there @ turn_z(np.pi / 2).T - [0, 0, 3]).max() < 1e-5


def test_the_rest_pose_faces_as_the_first_frame(tmp_path):
    """The second joint turns the body about the vertical in the clip: it is turned so at rest too, over the same place."""
    glb = skinned_post()
    glb.document["nodes"][0] = {"name": "Rig", "children": [1, 2]}
    glb.document["animations"] = []
    half = float(np.sin(0.6)), float(np.cos(0.6))
    glb.clip("Turn", translation_2=([0, 1], [[0.3, 0, 0.2]] * 2, "LINEAR"),
             rotation_3=([0, 1], [[0, half[0], 0, half[1]]] * 2, "LINEAR"), weights_1=([0, 1], [0, 0], "LINEAR"))
    body = tc.load_solid(glb.write(tmp_path / "a.glb"), fps=10, rest=0.5)
    top = POST[:, 1] > 1.5
    for x in body.x[:5]:
        assert np.abs(x[top] - body.x[5][top]).max() < 1e-5


def test_a_body_without_a_rest_pose_says_so(tmp_path):
    glb = Glb(nodes=[{"mesh": 0}])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    glb.clip("c", translation_0=([0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
    glb.write(tmp_path / "a.glb")
    with pytest.raises(tc.MeshError, match="rest = 0.5: it has no skeleton that an animation moves away from a rest pose"):
        tc.load_solid(tmp_path / "a.glb", rest=0.5)
    np.savez(tmp_path / "a.npz", positions=POST, faces=FACES)
    with pytest.raises(tc.MeshError, match="rest: has no skeleton; files that have: "):
        tc.load_solid(tmp_path / "a.npz", rest=0.5)


def box(glb: Glb, **more) -> dict:
    """A primitive with the post."""
    return {"attributes": {"POSITION": glb.add(POST)}, "indices": glb.add(FACES.reshape(-1, 1), "u2"), **more}


def moving(tmp_path, kind, t, values, path="translation", fps=10.0, **node):
    """(frames, 12, 3) positions of the post under an animation of its node."""
    glb = Glb(nodes=[{"mesh": 0, **node}])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    glb.clip("c", **{f"{path}_0": (t, values, kind)})
    return tc.load_solid(glb.write(tmp_path / "a.glb"), fps=fps).x


def test_keys_between_keys(tmp_path):
    values = [[0, 0, 0], [1, 2, 0], [0, 0, 4]]
    straight = moving(tmp_path, "LINEAR", [0, 0.4, 1.0], values)
    for k, (a, b, u) in {0: (0, 1, 0.0), 2: (0, 1, 0.5), 7: (1, 2, 0.5), 10: (1, 2, 1.0)}.items():
        assert np.allclose(straight[k] - POST, (1 - u) * np.array(values[a]) + u * np.array(values[b]), atol=1e-6)
    steps = moving(tmp_path, "STEP", [0, 0.45, 1.0], values)
    assert [int(np.argmin([np.abs(x - POST - v).max() for v in values])) for x in steps] == [0] * 5 + [1] * 5 + [2]
    turned = moving(tmp_path, "LINEAR", [0, 1], [about_z(0), about_z(2.8)], "rotation")
    assert all(np.allclose(x, POST @ turn_z(2.8 * k / 10).T, atol=1e-6) for k, x in enumerate(turned))  # at an even pace
    other = moving(tmp_path, "LINEAR", [0, 1], [about_z(0), [-q for q in about_z(2.8)]], "rotation")
    assert np.allclose(turned, other, atol=1e-6)  # the shorter way round
    late = moving(tmp_path, "LINEAR", [2.0, 2.5], values[:2])
    assert len(late) == 6 and np.allclose(late[0], POST) and np.allclose(late[5], POST + values[1])


def test_a_clip_is_sampled_at_its_own_keys(tmp_path):
    for step, fps, count in ((1 / 24, 24, 25), (1 / 60, 60, 61), (1 / 10, 30, 31), (1.0, 24, 25)):
        glb = Glb(nodes=[{"mesh": 0}])
        glb.document["meshes"] = [{"primitives": [box(glb)]}]
        t = np.arange(0, 1 + step / 2, step)
        glb.clip("c", translation_0=(t, np.outer(t, [1, 0, 0]), "LINEAR"))
        body = tc.load_solid(glb.write(tmp_path / "a.glb"))
        assert (body.fps, len(body.x)) == (fps, count)


def test_nodes_instances_and_mirrors(tmp_path):
    """A child of a turned, scaled parent; a mesh in two nodes, one of them mirrored; and one with instances of its own."""
    glb = Glb(nodes=[{"name": "A", "children": [1], "scale": [1, 3, 1], "rotation": about_z(np.pi / 2)},
                     {"name": "B", "mesh": 0, "translation": [5, 0, 0]}, {"name": "B", "mesh": 0, "scale": [-1, 1, 1]},
                     {"name": "M", "mesh": 0, "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, -9, 1]}],
              scenes=[{"nodes": [0, 2, 3]}])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    places = glb.add([[0, 0, 20], [7, 0, 20]])
    instances = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}
    glb.document["nodes"].append({"mesh": 0, "extensions": instances})
    glb.document["scenes"][0]["nodes"].append(4)
    glb.document["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    body = tc.load_solid(glb.write(tmp_path / "a.glb"))
    wanted = {"B": (POST + [5, 0, 0]) * [1, 3, 1] @ turn_z(np.pi / 2).T, "B 2": POST * [-1, 1, 1],
              "M": POST @ np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]).T + [0, 0, -9],
              "node 4": POST + [0, 0, 20], "node 4 2": POST + [7, 0, 20]}
    assert set(body.groups) == set(wanted) and body.closed
    for name, x in wanted.items():
        mine = body.groups[name]
        assert np.allclose(np.sort(body.x[0][mine].round(6), axis=0), np.sort(x.round(6), axis=0), atol=1e-5)
        corner = body.x[0][body.faces[np.isin(body.faces, mine).all(axis=1)]]
        assert np.linalg.det(corner - corner[0, 0]).sum() > 0, name  # none is inside out
    assert body.notes[1:] == (
        "mirrored by its transform: 'B 2'; triangles are turned there, so that the outside stays outside",
        "sheared by its transform: 'M'; positions are those of the file")


@pytest.mark.parametrize("cap", [4, 2])
def test_a_skin_on_mirrored_joints_keeps_its_outside(tmp_path, cap):
    """Closed, and without the lid, where nothing but the transform says which side is outside."""
    glb = skinned_post()
    glb.document["nodes"][0]["scale"] = [2, -2, 2]
    glb.document["meshes"][0]["primitives"][0]["indices"] = glb.add(FACES[: 16 + cap].reshape(-1, 1), "u2")
    body = tc.load_solid(glb.write(tmp_path / "a.glb"), fps=FPS)
    corner = body.x[0][body.faces]
    assert np.linalg.det(corner - body.x[0].mean(axis=0)).sum() > 0
    assert "mirrored by its transform: 'Post'; triangles are turned there, so that the outside stays outside" in body.notes
    assert not any("inside out" in note for note in body.notes)


def two_parts(tmp_path, **more):
    """A post, and a second on top of it: its foot is the first one's head."""
    glb = Glb(nodes=[{"name": "leg", "mesh": 0}, {"name": "arm", "mesh": 1}], **more)
    half = FACES[:-2]  # without its lid
    top = np.concatenate([FACES[:-4], FACES[-2:]])  # without its floor
    glb.document["meshes"] = [{"primitives": [{"attributes": {"POSITION": glb.add(POST + [0, y, 0])},
                                               "indices": glb.add(faces.reshape(-1, 1), "u2")}]}
                              for y, faces in ((0, half), (2, top))]
    return glb.write(tmp_path / "a.glb")


def test_the_command_that_dresses_reads_the_parts_that_it_is_told(tmp_path, capsys):
    pytest.importorskip("scipy", reason="meshing patterns needs the extra `garment`")
    command = ["dress", str(PATTERN), "--body", str(two_parts(tmp_path)), "--out", str(tmp_path / "a.npz"), "--spacing", "0.2",
               "--fit", "--only"]
    for part, said in (("amr", "only: no part 'amr'; did you mean 'arm'"), ("arm", "the body has no legs")):
        assert main([*command, part]) == 2 and said in capsys.readouterr().err
    assert main([*command, "leg", "--rest"]) == 2 and "rest = 1: it has no skeleton" in capsys.readouterr().err


def test_parts_are_joined_or_stay_apart(tmp_path):
    path = two_parts(tmp_path)
    joined, apart = tc.load_solid(path), tc.load_solid(path, merge=False)
    assert joined.closed and joined.x.shape[1] == 20 and not apart.closed and apart.x.shape[1] == 24
    assert any("8 border edges in 2 loops" in note for note in apart.notes)
    for body in (joined, apart):
        solid = tc.Scene().add_solid(body, friction=0.1, thickness=0.01, parts={"leg": 0.9, "arm": None})
        friction = solid.face_friction()
        height = body.x[0][body.faces].mean(axis=1)[:, 1]
        assert (friction[height < 1.9] == 0.9).all() and np.isnan(friction[height > 2.1]).all() and len(friction) == 36
    one = tc.load_solid(path, only="arm")
    assert set(one.groups) == {"arm"} and one.x[0][:, 1].min() == pytest.approx(2)
    with pytest.raises(tc.MeshError, match="a.glb: only: no part 'amr'; did you mean 'arm'"):
        tc.load_solid(path, only=["amr"])


def clips(tmp_path):
    glb = Glb(nodes=[{"name": "a", "mesh": 0}, {"name": "b", "mesh": 0, "translation": [9, 0, 0]}])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    for name, node, far in (("Walk", 0, 1), ("Run", 0, 2), ("Wave", 1, 4)):
        glb.clip(name, **{f"translation_{node}": ([0, 1], [[9 * node, 0, 0], [9 * node, far, 0]], "LINEAR")})
    glb.clip("Both", translation_0=([0, 1], [[0, 0, 0], [0, 8, 0]], "LINEAR"),
             translation_1=([0, 1], [[9, 0, 0], [9, 8, 0]], "LINEAR"))
    return glb.write(tmp_path / "a.glb")


@pytest.mark.parametrize("clip, far", [(None, (1, 4)), ("Walk", (1, 0)), (1, (2, 0)), ("Wave", (0, 4)), (["Run", 2], (2, 4)),
                                       (["Run", "Walk"], (2, 0)), (["Run", "Both"], (2, 8))])
def test_clips_by_name_by_number_and_together(tmp_path, clip, far):
    body = tc.load_solid(clips(tmp_path), clip=clip)
    for name, height in zip("ab", far):
        mine = body.groups[name]
        assert (body.x[-1] - body.x[0])[mine, 1] == pytest.approx(height)


def test_a_missing_file_is_missed_first(tmp_path):
    clips(tmp_path)
    with pytest.raises(tc.MeshError, match="no such file: .*b.glb; did you mean .*a.glb"):
        tc.load_solid(tmp_path / "b.glb", clip="Walk")
    (tmp_path / "a1.glb").write_bytes((tmp_path / "a.glb").read_bytes())
    (tmp_path / "a2.glb").write_bytes((tmp_path / "a.glb").read_bytes())
    assert len(tc.load_solid(tmp_path / "a?.glb", fps=24).x) == 2  # a sequence of files


def test_scenes(tmp_path):
    glb = Glb(nodes=[{"name": "a", "mesh": 0}, {"name": "b", "mesh": 0}, {"name": "c", "mesh": 0}], scene=1,
              scenes=[{"nodes": [0], "name": "old"}, {"nodes": [1, 2]}])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    body = tc.load_solid(glb.write(tmp_path / "a.glb"), merge=False)
    assert set(body.groups) == {"b", "c"} and any("others: 'old'" in note for note in body.notes)


def test_quantized_positions_and_sparse_ones(tmp_path):
    glb = Glb(nodes=[{"name": "a", "mesh": 0, "scale": [2, 2, 2]}, {"name": "b", "mesh": 1}, {"name": "c", "mesh": 2}],
              extensionsRequired=["KHR_mesh_quantization", "KHR_materials_unlit"])
    short = glb.add(np.column_stack([np.round(POST / 2 * 32767), np.zeros(12)])[:, :3], "i2", spread=2, normalized=True)
    other = POST.copy()
    other[3] = [8, 8, 8]
    glb.document["meshes"] = [{"primitives": [box(glb) | {"attributes": {"POSITION": p}}]}
                              for p in (short, glb.sparse(12, [3], [[8, 8, 8]], POST), glb.sparse(12, range(12), POST))]
    path = glb.write(tmp_path / "a.glb")
    for name, x, off in (("a", POST, 1e-4), ("b", other, 1e-6), ("c", POST, 1e-6)):
        body = tc.load_solid(path, only=name)
        assert np.abs(body.x[0] - x).max() < off


@pytest.mark.parametrize("mode, index, faces", [
    (5, [0, 1, 2, 3], {(0, 1, 2), (2, 1, 3)}), (6, [0, 1, 2, 3], {(0, 1, 2), (0, 2, 3)}), (4, None, {(0, 1, 2)})])
def test_strips_fans_and_no_indices(tmp_path, mode, index, faces):
    glb = Glb(nodes=[{"mesh": 0}])
    x = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1.5, 0]][: 4 if index else 3]
    primitive = {"attributes": {"POSITION": glb.add(x)}, "mode": mode}
    glb.document["meshes"] = [{"primitives": [primitive | ({} if index is None else {"indices": glb.add(index, "u1")})]}]
    made = tc.load(glb.write(tmp_path / "a.glb"))  # which turns no triangle
    cycles = {tuple(int(v) for v in np.roll(f, -int(np.argmin(f)))) for f in made.faces}
    assert cycles == {tuple(np.roll(f, -int(np.argmin(f)))) for f in faces}


def test_cloth_keeps_its_texture_coordinates(tmp_path):
    """A sheet whose halves are two primitives: the vertices between them are there twice, with other coordinates."""
    glb = Glb(nodes=[{"name": "sheet", "mesh": 0, "translation": [0, 2, 0]}], materials=[{"name": "red"}, {"name": "blue"}])
    x = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    uv = [x[:, :2], x[:, :2] + [2, 0]]
    glb.document["meshes"] = [{"primitives": [
        {"attributes": {"POSITION": glb.add(x + [k, 0, 0]), "TEXCOORD_0": glb.add(uv[k] * [1, -1] + [0, 1])},
         "indices": glb.add([0, 1, 2, 0, 2, 3], "u1"), "material": k} for k in (0, 1)]}]
    mesh = tc.load(glb.write(tmp_path / "a.glb"))
    assert mesh.vertex_count == 6 and set(mesh.groups) == {"sheet", "red", "blue"}
    assert np.allclose(mesh.corner_uv[:2], x[:, :2][[[0, 1, 2], [0, 2, 3]]]) and np.allclose(mesh.corner_uv[2:, :, 0].min(), 2)
    assert mesh.x[:, 1].min() == 2
    still = tc.load(skinned_post().write(tmp_path / "b.glb"))
    assert np.allclose(still.x, 2 * POST @ turn_z(np.pi / 2).T + [0, 0, 3], atol=1e-5)  # before any animation


def test_weights_that_do_not_sum_to_one(tmp_path):
    glb = skinned_post()
    mesh = glb.document["meshes"][0]["primitives"][0]["attributes"]
    w = np.column_stack([1 - UPPER, UPPER, 0 * UPPER, 0 * UPPER])
    w[3:6] *= 0.7
    mesh["WEIGHTS_0"] = glb.add(w)
    body = tc.load_solid(glb.write(tmp_path / "a.glb"), fps=FPS)
    assert "part 'Post': the skin weights of 3 vertices do not sum to 1 (0.7 to 1), and are scaled so" in body.notes
    assert max(np.abs(body.x[k] - expected(k / FPS)).max() for k in range(10)) < 1e-5
    w[7] = 0
    mesh["WEIGHTS_0"] = glb.add(w)
    with pytest.raises(tc.MeshError, match=r"part 'Post': the skin weights of vertex 7 are .* \(1 such vertices\)"):
        tc.load_solid(glb.write(tmp_path / "a.glb"))


def spoilt(glb: Glb, what: str) -> None:
    """Makes a file wrong in one way."""
    d = glb.document
    primitive = d["meshes"][0]["primitives"][0]
    if what == "no mesh":
        d["nodes"][1].pop("mesh")
    elif what == "no clip":
        d.pop("animations")
    elif what in ("Draco", "meshopt", "unknown"):
        names = {"Draco": "KHR_draco_mesh_compression", "meshopt": "EXT_meshopt_compression"}
        d["extensionsRequired"] = [names.get(what, "XYZ")]
    elif what == "Draco alone":
        primitive["extensions"] = {"KHR_draco_mesh_compression": {}}
        d["accessors"][primitive["attributes"]["POSITION"]].pop("bufferView")
    elif what == "two parents":
        d["nodes"][3]["children"] = [1]
    elif what == "circle":
        d["nodes"][3]["children"] = [0]
    elif what == "joint":
        primitive["attributes"]["JOINTS_0"] = glb.add(np.tile([0, 7, 0, 0], (12, 1)), "u1")
    elif what == "no weights":
        primitive["attributes"].pop("WEIGHTS_0")
    elif what == "index":
        primitive["indices"] = glb.add([0, 1, 99], "u1")
    elif what == "keys":
        d["animations"][0]["samplers"][0]["input"] = glb.add([1, 0])
    elif what == "count":
        d["accessors"][primitive["attributes"]["POSITION"]]["count"] = 10**9
    elif what == "beyond":
        d["bufferViews"][0]["byteOffset"] = 10**6
    elif what == "version":
        d["asset"]["version"] = "1.0"
    elif what == "shrinks":
        d["nodes"][1] |= {"translation": [0, 0, 0]}
        d["nodes"][1].pop("skin")
        glb.clip("Gone", scale_1=([0, 1], [[1, 1, 1], [0, 0, 0]], "LINEAR"))
    elif what == "turns":
        d["nodes"][1].pop("skin")
        glb.clip("Gone", scale_1=([0, 1], [[1, 1, 1], [-1, 1, 1]], "LINEAR"))


@pytest.mark.parametrize("what, options, message", [
    ("no mesh", {}, "has no mesh: it has 4 nodes and 1 animations"),
    ("no clip", {"clip": "Walk"}, "clip = 'Walk': the file has no animation"),
    ("", {"clip": "Bnd"}, "clip = 'Bnd': no such animation; did you mean 'Bend'"),
    ("", {"clip": 3}, "clip = 3: the file has 1, from 0: Bend"),
    ("Draco", {}, "is compressed with Draco"), ("meshopt", {}, "is compressed with meshopt"),
    ("Draco alone", {}, "part 'Post': is compressed with Draco"),
    ("unknown", {}, "needs the extension XYZ"),
    ("two parents", {}, "node 'Post' has two parents"), ("circle", {}, "node 'Rig' is among its own parents"),
    ("joint", {}, "part 'Post': vertex 4 follows joints .*, and its skin has 2"),
    ("no weights", {}, "part 'Post': has a skin, and vertices without joints or weights"),
    ("index", {}, "part 'Post': its triangles name vertex 99, and there are 12"),
    ("keys", {}, "the animation of translation of 'Lower': times of keys must rise"),
    ("count", {}, "part 'Post': POSITION: says that it has 1000000000 rows"),
    ("beyond", {}, "part 'Post': POSITION: reaches beyond its buffer"),
    ("version", {}, "is of glTF version 1.0: 2.0 is read"),
    ("shrinks", {"clip": "Gone"}, "part 'Post': its transform shrinks it to nothing at 1 s"),
    ("turns", {"clip": "Gone"}, "part 'Post': its transform .* at 0.5"),
])
def test_bad_files_are_refused_by_name(tmp_path, what, options, message):
    glb = skinned_post()
    spoilt(glb, what)
    with pytest.raises(tc.MeshError, match=f"a.glb: {message}") as caught:
        tc.load_solid(glb.write(tmp_path / "a.glb"), **options)
    assert "\n" not in str(caught.value)


def test_buffers_that_are_not_there(tmp_path):
    path = skinned_post().write(tmp_path / "a.gltf", "beside")
    (tmp_path / "a buffer.bin").unlink()
    with pytest.raises(tc.MeshError, match="a.gltf: its buffer .*a buffer.bin cannot be read: No such file"):
        tc.load_solid(path)
    path.write_text(path.read_text().replace("a%20buffer.bin", "https://example.org/a.bin"))
    with pytest.raises(tc.MeshError, match="nothing is fetched"):
        tc.load_solid(path)
    whole = skinned_post().write(tmp_path / "b.glb").read_bytes()
    (tmp_path / "b.glb").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(tc.MeshError, match="b.glb: "):
        tc.load_solid(tmp_path / "b.glb")


def test_damaged_files_load_or_are_refused(tmp_path):
    whole = skinned_post().write(tmp_path / "a.glb").read_bytes()
    length = struct.unpack("<I", whole[12:16])[0]
    text, refused = whole[20:20 + length].decode(), 0
    numbers = list(re.finditer(r"(?<=[:\[,])-?\d+(?=[,\]}])", text.replace(" ", "")))
    text = text.replace(" ", "")
    for k, place in enumerate(numbers):
        for value in ("-1", "1000000", '"x"', "null", "1e99")[k % 5:: 2]:
            other = json.loads(text[: place.start()] + value + text[place.end():])
            glb = Glb()
            glb.document, glb.blob = other, whole[28 + length:]
            buffers = glb.document.pop("buffers")
            glb.document["extras"] = buffers
            try:
                made = tc.load_solid(glb.write(tmp_path / "b.glb"))
                assert np.isfinite(made.x).all()
            except tc.ClothError as error:
                assert "b.glb" in str(error)
                refused += 1
    assert refused > len(numbers) / 2


def test_without_the_package_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pygltflib", None)
    with pytest.raises(tc.MeshError, match=r"a.glb: glTF is read by .* pygltflib: pip install 'taichi-cloth\[gltf\]'"):
        tc.load_solid(skinned_post().write(tmp_path / "a.glb"))


def walker(path):
    """A trunk and two legs that swing as it walks, .9 m high: three parts, each of which is a post."""
    glb = Glb(nodes=[{"name": "root", "children": [1, 2, 3]},
                     {"name": "trunk", "mesh": 0, "translation": [0, 0.45, 0], "scale": [0.9, 0.225, 0.6]},
                     *({"name": f"{side} leg", "mesh": 0, "translation": [x, 0.5, 0], "rotation": [1, 0, 0, 0],
                        "scale": [0.3, 0.25, 0.3]} for side, x in (("left", 0.1), ("right", -0.1)))])
    glb.document["meshes"] = [{"primitives": [box(glb)]}]
    swing = [[float(np.cos(a / 2)), 0, 0, float(-np.sin(a / 2))] for a in (0, 0.6, -0.6, 0.6)]  # about x, from hanging down
    glb.clip("Walk", translation_0=([0, 0.6], [[0, 0, 0], [0, 0, 0.5]], "LINEAR"),
             rotation_2=([0, 0.2, 0.4, 0.6], swing, "LINEAR"),
             rotation_3=([0, 0.2, 0.4, 0.6], [[q[0], 0, 0, -q[3]] for q in swing], "LINEAR"))
    return glb.write(path)


def winding(points, x, faces) -> np.ndarray:
    """(k,) how often closed surfaces go round each point: the sum of the triangles' solid angles."""
    a, b, c = (x[faces[:, k]][None] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(v, axis=2) for v in (a, b, c))
    above = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(axis=2) * lc + (b * c).sum(axis=2) * la + (c * a).sum(axis=2) * lb
    return np.arctan2(above, below).sum(axis=1) / (2 * np.pi)


@pytest.mark.slow
def test_no_vertex_of_a_cloth_is_inside_a_figure_that_walks(tmp_path):
    body = tc.load_solid(walker(tmp_path / "walk.glb"), fps=50)
    top, middle = body.x[0][:, 1].max(), np.array([[0, body.x[0][:, 1].max() - 0.1, 0]])
    assert body.closed and len(body.x) == 31 and winding(middle, body.x[0], body.faces) == pytest.approx(1)
    scene = tc.Scene()
    solid = scene.add_solid(body, friction=0.5, thickness=0.01, parts={"left leg": 0.1})
    mesh = tc.grid(0.8, 14, centred=True)
    fabric = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))
    scene.add_cloth(mesh, fabric, positions=mesh.x + [0, top + 0.02, 0])
    sim = tc.Simulation(scene, h=1 / 100)
    for _ in range(12):
        sim.run(0.05, fps=20)
        x = sim.positions()
        assert (winding(x, solid.surface_at(sim.time), body.faces) < 0.5).all()
    assert x[:, 2].mean() > 0.3 and x[:, 1].min() < top - 0.2 and abs(x[:, 1].max() - top) < 0.04  # worn


def test_a_file_that_is_loaded_again_is_read_once_while_it_stays(tmp_path, monkeypatch):
    """Each load has arrays of its own; a file that was written again is read again."""
    read, path = [], tmp_path / "post.glb"
    monkeypatch.setattr(solid, "_scene_of", lambda *given, of=solid._scene_of: read.append(given) or of(*given))
    skinned_post().write(path)
    first = tc.load_solid(path)
    x = first.x.copy()
    first.x[:] = 0
    assert np.array_equal(tc.load_solid(path).x, x) and len(read) == 1
    assert len(tc.load_solid(path, fps=3.0).x) != len(x) and len(read) == 2, "other choices"
    os.utime(path, ns=(1, 1))
    tc.load_solid(path, fps=3.0)
    assert len(read) == 3, "a file of another time"
