"""FBX, Alembic, glTF and USD of one figure that Blender made and moved: positions against Blender's own, frame by frame."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.io import blender
from taichi_cloth.io.animation import kept

ABSENT = "Blender's module bpy is not installed: pip install 'taichi-cloth[blender]'"
with_blender = [pytest.mark.slow, pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)]
FRAMES = range(1, 31, 3)  # ten of them

# A tube with two bones and a shape key beside a box that turns; files of it, and an .npz of where they are, y up.
MAKER = """
import math, sys
import bpy, numpy as np
out = sys.argv[1]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 30
bpy.ops.mesh.primitive_cylinder_add(vertices=12, radius=0.2, depth=2, location=(0, 0, 1), end_fill_type="TRIFAN")
body = bpy.context.object
body.name = "Body"
bpy.ops.object.mode_set(mode="EDIT")
bpy.ops.mesh.select_all(action="SELECT")
bpy.ops.mesh.subdivide(number_cuts=2)
bpy.ops.object.mode_set(mode="OBJECT")
body.data.transform(body.matrix_world)
body.matrix_world.identity()
bpy.ops.object.armature_add(location=(0, 0, 0))
rig = bpy.context.object
rig.name = "Rig"
bpy.ops.object.mode_set(mode="EDIT")
lower = rig.data.edit_bones[0]
lower.name, lower.head, lower.tail = "Lower", (0, 0, 0), (0, 0, 1)
upper = rig.data.edit_bones.new("Upper")
upper.head, upper.tail, upper.parent, upper.use_connect = (0, 0, 1), (0, 0, 2), lower, True
bpy.ops.object.mode_set(mode="OBJECT")
groups = [body.vertex_groups.new(name=name) for name in ("Lower", "Upper")]
for v in body.data.vertices:
    w = min(max((v.co.z - 0.7) / 0.6, 0), 1)
    for group, part in zip(groups, (1 - w, w)):
        if part > 0:
            group.add([v.index], part, "REPLACE")
body.shape_key_add(name="Basis")
wide = body.shape_key_add(name="Wide")
for v in body.data.vertices:
    wide.data[v.index].co = (v.co.x * 1.5, v.co.y * 1.3, v.co.z)
for frame, value in ((1, 0), (30, 1)):
    wide.value = value
    wide.keyframe_insert("value", frame=frame)
body.modifiers.new("Armature", "ARMATURE").object = rig
body.parent = rig
bone = rig.pose.bones["Upper"]
bone.rotation_mode = "XYZ"
bpy.ops.mesh.primitive_cube_add(size=0.3, location=(0.6, 0.5, 0.2))
box = bpy.context.object
box.name = "Box"
for frame in range(1, 31):
    bone.rotation_euler = (math.sin(frame / 5) * 0.8, 0, frame / 30)
    bone.keyframe_insert("rotation_euler", frame=frame)
    rig.location = (frame * 0.05, 0, 0.1)
    rig.keyframe_insert("location", frame=frame)
    box.rotation_euler = (frame * 0.1, 0, 0)
    box.keyframe_insert("rotation_euler", frame=frame)
bpy.ops.export_scene.gltf(filepath=out + "/a.glb", export_force_sampling=True)
bpy.ops.wm.usd_export(filepath=out + "/a.usdc", export_animation=True, export_armatures=True, export_shapekeys=True)
bpy.ops.wm.alembic_export(filepath=out + "/a.abc", as_background_job=False)
bpy.ops.export_scene.fbx(filepath=out + "/a.fbx", bake_anim_use_all_actions=False, bake_anim_use_nla_strips=False)
bpy.ops.export_scene.fbx(filepath=out + "/usual.fbx")
bpy.ops.wm.save_as_mainfile(filepath=out + "/a.blend")
got = {}
for frame in range(1, 31):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    x = []
    for item in (body, box):
        evaluated = item.evaluated_get(graph)
        mesh = evaluated.to_mesh()
        at = np.array([v.co for v in mesh.vertices], dtype=float)
        world = np.array(evaluated.matrix_world)
        x.append(at @ world[:3, :3].T + world[:3, 3])
    got[f"{frame}"] = np.concatenate(x)[:, [0, 2, 1]] * [1, 1, -1]
np.savez(out + "/there.npz", **got)
"""


@pytest.fixture(scope="module")
def figure(tmp_path_factory):
    """A folder with its files."""
    folder = tmp_path_factory.mktemp("figure")
    subprocess.run([sys.executable, "-c", MAKER, str(folder)], check=True, capture_output=True, timeout=300)
    return folder


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv(kept.VARIABLE, str(tmp_path / "kept"))
    return tmp_path / "kept"


def farthest(a: np.ndarray, b: np.ndarray) -> float:
    """The largest distance of a point of one set to the nearest of the other, both ways."""
    away = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(max(away.min(axis=0).max(), away.min(axis=1).max()))


@pytest.mark.parametrize("suffix", [pytest.param(s, marks=with_blender) for s in (".glb", ".usdc", ".abc", ".fbx")])
def test_every_format_is_where_blender_has_it(figure, own_cache, suffix):
    if suffix in (".glb", ".usdc"):
        pytest.importorskip({".glb": "pygltflib", ".usdc": "pxr"}[suffix])
    body = tc.load_solid(figure / f"a{suffix}", fps=24)
    there = np.load(figure / "there.npz")
    assert len(body.x) == 30 and body.closed and sum(len(index) for index in body.groups.values()) >= body.x.shape[1]
    for frame in FRAMES:
        assert farthest(body.x[frame - 1], there[str(frame)]) < 1e-5
    if suffix in (".abc", ".fbx"):
        files = list(own_cache.glob("*.npz"))
        assert len(files) == 1
        again = tc.load_solid(figure / f"a{suffix}", fps=24)
        assert (again.x == body.x).all() and list(own_cache.glob("*.npz")) == files


@pytest.mark.parametrize("suffix", [pytest.param(s, marks=with_blender) for s in (".usdc", ".fbx", ".blend")])
def test_every_format_has_the_same_rest_pose(figure, own_cache, suffix):
    for package in ("pygltflib", "pxr"):
        pytest.importorskip(package)
    gltf, other = (tc.load_solid(figure / f"a{s}", fps=24, rest=0.4) for s in (".glb", suffix))
    assert len(gltf.x) == len(other.x) == 40  # the rig takes ten frames before the clip's thirty
    for k in (0, 4, 9, 10, 25):
        assert farthest(gltf.x[k], other.x[k]) < 1e-5


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)
def test_actions_of_several_objects_play_together(figure, own_cache):
    """Blender's usual FBX has a clip for the rig, one for the box, and the box's again for the rig, which comes first."""
    body = tc.load_solid(figure / "usual.fbx", fps=24)
    there = np.load(figure / "there.npz")
    assert "clip 'Box|BoxAction' and 'Rig|RigAction', 30 frames" in body.notes[0]
    for frame in FRAMES:
        assert farthest(body.x[frame - 1], there[str(frame)]) < 1e-5
    alone = tc.load_solid(figure / "usual.fbx", fps=24, clip="Rig|BoxAction")
    assert np.ptp(alone.x[:, alone.groups["Body"], 0].mean(axis=1)) < 0.1


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)
def test_a_subdivided_mesh_says_its_own_vertices(tmp_path):
    maker = """
import bpy, sys
bpy.ops.wm.read_factory_settings(use_empty=True)
for name, levels in (("Fine", 2), ("Plain", 0)):
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=4, size=1, location=(levels, 0, 0))
    bpy.context.object.name = name
    if levels:
        bpy.context.object.modifiers.new("Subdivision", "SUBSURF").levels = levels
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""
    subprocess.run([sys.executable, "-c", maker, str(tmp_path / "a.blend")], check=True, capture_output=True, timeout=300)
    body = tc.load_solid(tmp_path / "a.blend")
    said = [note for note in body.notes if "of its own" in note]
    assert said == ["part 'Fine' has 25 vertices of its own, and 289 behind its modifiers, which are read"]
    assert len(body.groups["Fine"]) == 289 and len(body.groups["Plain"]) == 25


# A ball with two shape keys beside a box with one, in two takes: the ball goes along x, or up. Keys are animated in both.
TAKES = """
import math, sys
import bpy, numpy as np
out = sys.argv[1]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 20
bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8, radius=0.3, location=(0.2, 0.1, 1))
ball = bpy.context.object
bpy.ops.mesh.primitive_cube_add(size=0.3, location=(0.8, 0.5, 0.2))
box = bpy.context.object
ball.name, box.name = "Ball", "Box"
for item, names, factor in ((ball, ("Wide", "Tall"), 1.5), (box, ("Fat",), 2.0)):
    item.shape_key_add(name="Basis")
    for axis, name in enumerate(names):
        key = item.shape_key_add(name=name)
        for v in item.data.vertices:
            co = v.co.copy()
            co[2 * axis] *= factor
            key.data[v.index].co = co
        for frame in range(1, 21):
            key.value = 0.5 - 0.5 * math.cos(frame / (3 + axis)) if item is ball else frame / 40
            key.keyframe_insert("value", frame=frame)
takes = {}
for name, way in (("Along", (0.05, 0, 0)), ("Up", (0, 0, 0.03))):
    ball.animation_data_create().action = bpy.data.actions.new(name)
    for frame in range(1, 21):
        ball.location = (0.2 + way[0] * frame, 0.1, 1 + way[2] * frame)
        ball.keyframe_insert("location", frame=frame)
    takes[name] = ball.animation_data.action, ball.animation_data.action_slot
got = {}
for name, (action, slot) in takes.items():
    ball.animation_data.action, ball.animation_data.action_slot = action, slot
    for frame in range(1, 21):
        scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        for item in (ball, box):
            evaluated = item.evaluated_get(graph)
            at = np.array([v.co for v in evaluated.to_mesh().vertices], dtype=float)
            world = np.array(evaluated.matrix_world)
            got[f"{name} {item.name} {frame}"] = (at @ world[:3, :3].T + world[:3, 3])[:, [0, 2, 1]] * [1, 1, -1]
np.savez(out + "/takes.npz", **got)
ball.animation_data.action, ball.location = None, (0.2, 0.1, 1)  # the exporter leaves out what a take does not change
bpy.ops.export_scene.fbx(filepath=out + "/takes.fbx", bake_anim_use_all_actions=True, bake_anim_use_nla_strips=False)
"""


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)
def test_takes_with_shape_keys_are_where_blender_has_them(tmp_path, own_cache):
    subprocess.run([sys.executable, "-c", TAKES, str(tmp_path)], check=True, capture_output=True, timeout=300)
    there = np.load(tmp_path / "takes.npz")
    for k, take in enumerate(("Along", "Up")):
        body = tc.load_solid(tmp_path / "takes.fbx", fps=24, clip=k, merge=False)
        assert len(body.x) == 20
        for frame in range(1, 21):
            for part in ("Ball", "Box"):
                away = farthest(body.x[frame - 1][body.groups[part]], there[f"{take} {part} {frame}"])
                assert away < 1e-5, (take, part, frame)


@pytest.mark.parametrize("suffix, words", [pytest.param(suffix, words, marks=with_blender) for suffix, words in (
    (".fbx", "clip = 'Walk': no such animation; .*known: "), (".abc", "clip = 'Walk': the file has no animation"))])
def test_choices_that_a_file_has_not(figure, own_cache, suffix, words):
    with pytest.raises(tc.MeshError, match=f"a{suffix}: {words}"):
        tc.load_solid(figure / f"a{suffix}", clip="Walk")
    with pytest.raises(tc.MeshError, match=f"a{suffix}: only: no part 'Bdoy'; did you mean 'Body'"):
        tc.load_solid(figure / f"a{suffix}", only="Bdoy")
    (own_cache.parent / f"b{suffix}").write_bytes((figure / f"a{suffix}").read_bytes()[:3000])
    with pytest.raises(tc.MeshError, match=f"b{suffix}: (cannot be read: Blender|has no mesh)"):
        tc.load_solid(own_cache.parent / f"b{suffix}")


@pytest.mark.parametrize("suffix, kind", [(".fbx", "FBX"), (".abc", "Alembic")])
def test_without_blender_it_is_named(tmp_path, monkeypatch, own_cache, suffix, kind):
    monkeypatch.setattr(blender, "command", lambda script: None)
    (tmp_path / f"a{suffix}").write_bytes(b"any")
    with pytest.raises(tc.MeshError, match=f"a{suffix}: {kind} is read by Blender, and neither its module bpy nor"):
        tc.load_solid(tmp_path / f"a{suffix}")


def test_what_is_kept_is_used_again_mended_and_forgotten(tmp_path, monkeypatch, own_cache):
    made = []

    def make():
        made.append(1)
        return {"a": np.arange(1000) + len(made)}

    file = tmp_path / "a.fbx"
    file.write_bytes(b"one")
    first = kept.arrays(file, "how", make)
    assert (kept.arrays(file, "how", make)["a"] == first["a"]).all() and len(made) == 1
    place = next(own_cache.glob("*.npz"))
    place.write_bytes(place.read_bytes()[:100])  # damaged: made again
    assert (kept.arrays(file, "how", make)["a"] == first["a"] + 1).all() and len(made) == 2
    file.write_bytes(b"two")
    kept.arrays(file, "how", make)
    kept.arrays(file, "other", make)
    assert len(made) == 4 and len(list(own_cache.glob("*"))) == 3
    monkeypatch.setattr(kept, "MOST", 20_000)
    kept.arrays(file, "third", make)
    assert len(list(own_cache.glob("*"))) == 2
    monkeypatch.setenv(kept.VARIABLE, str(file / "nowhere"))  # where nothing can be written
    assert len(kept.arrays(file, "third", make)) == 1 and len(made) == 6
