"""A .blend that its own user made, and its content, both by Blender's module bpy in a process of its own."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

ABSENT = "Blender's module bpy is not installed: pip install 'taichi-cloth[blender]'"
UNIT, FPS, FIRST = 0.1, 24, 11  # metres of its unit; frames a second; the scene's first frame

# "Curtain", a grid of quads that a rig leads, in a moving and turning parent, with later modifiers, materials and pins;
# "Flag", hidden, mirrored, in no collection that is seen; "Body", which moves.
MAKER = f"""
import math, sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", {UNIT}
scene.render.fps, scene.frame_start, scene.frame_end = {FPS}, {FIRST}, {FIRST + 30}

def keyed(item, path, values):
    for frame, value in zip(({FIRST}, {FIRST + 30}), values):
        setattr(item, path, value)
        item.keyframe_insert(path, frame=frame)

carrier = bpy.data.objects.new("Carrier", None)
scene.collection.objects.link(carrier)
keyed(carrier, "location", ((0, 0, 3), (4, 1, 2)))
keyed(carrier, "rotation_euler", ((0, 0, 0), (0.4, -0.3, 1.9)))
bpy.ops.object.armature_add()
rig = bpy.context.object
rig.name = "Rig"
rig.pose.bones[0].location = (0, 0.7, 0)
bpy.ops.mesh.primitive_grid_add(x_subdivisions=4, y_subdivisions=3, size=4)
curtain = bpy.context.object
curtain.name, curtain.parent, curtain.scale, curtain.rotation_euler = "Curtain", carrier, (1.5, 1, 0.5), (1.2, 0, 0.3)
bone = curtain.vertex_groups.new(name="Bone")
pins = curtain.vertex_groups.new(name="Pins")
bone.add(range(len(curtain.data.vertices)), 1.0, "REPLACE")
pins.add([0, 1, 2], 1.0, "REPLACE")
pins.add([3], 0.25, "REPLACE")
pins.add([4], 0.0, "REPLACE")
for name in ("cotton", "hem"):
    curtain.data.materials.append(bpy.data.materials.new(name))
curtain.data.polygons[0].material_index = 1
curtain.modifiers.new("Led", "ARMATURE").object = rig
curtain.modifiers.new("Finer", "SUBSURF").levels = 1
curtain.modifiers.new("Thick", "SOLIDIFY").thickness = 0.02
bpy.ops.mesh.primitive_cylinder_add(vertices=5, radius=1, depth=2, location=(6, 0, 1), end_fill_type="NGON")
flag = bpy.context.object
flag.name, flag.scale = "Flag", (-1, 1, 1)
scene.collection.objects.unlink(flag)
closet = bpy.data.collections.new("Closet")
scene.collection.children.link(closet)
closet.objects.link(flag)
bpy.context.view_layer.layer_collection.children["Closet"].exclude = True
flag.hide_viewport = True
label = bpy.data.images.new("label", 4, 4)
label.source, label.filepath, label.use_fake_user = "FILE", "//tex/label.png", True
bpy.ops.mesh.primitive_cube_add(size=1, location=(0, -5, 0))
body = bpy.context.object
body.name = "Body"
keyed(body, "location", ((0, -5, 0), (0, -5, 6)))
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""

# Writes the file's content, and places of objects at frames, with modifiers up to the cache alone.
READER = """
import json, os, sys
import bpy, numpy as np
file, out, frames = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
bpy.ops.wm.open_mainfile(filepath=file)
scene, got = bpy.context.scene, {}
kept = {}
for o in bpy.data.objects:
    kept[o.name] = [o.type, o.parent.name if o.parent else "", [list(row) for row in o.matrix_basis], o.hide_viewport,
                    [[m.name, m.type, m.show_viewport, m.show_render] for m in o.modifiers],
                    [s.material.name for s in o.material_slots], [c.name for c in o.users_collection]]
    if o.type == "MESH":
        kept[o.name] += [[list(v.co) for v in o.data.vertices], [list(p.vertices) for p in o.data.polygons],
                         [[g.name, g.index] for g in o.vertex_groups],
                         [[x.group, x.weight] for v in o.data.vertices for x in v.groups],
                         [list(d.uv) for u in o.data.uv_layers for d in u.data], [p.material_index for p in o.data.polygons]]
    cache = o.modifiers.get("taichi_cloth")
    got[f"path {o.name}"] = np.array(cache.filepath if cache else "")
kept[""] = [scene.frame_start, scene.frame_end, scene.render.fps, sorted(a.name for a in bpy.data.actions),
            sorted(m.name for m in bpy.data.materials), sorted(m.name for m in bpy.data.meshes),
            scene.unit_settings.scale_length, [os.path.normpath(bpy.path.abspath(i.filepath)) for i in bpy.data.images]]
got["kept"] = np.array(json.dumps(kept))
for hidden in bpy.context.view_layer.layer_collection.children:
    hidden.exclude = False
for o in bpy.data.objects:
    o.hide_viewport = False
    at = o.modifiers.find("taichi_cloth")
    for m in o.modifiers[at + 1:] if at >= 0 else ():
        m.show_viewport = False
for k in frames:
    scene.frame_set(int(k // 1), subframe=k % 1)
    graph = bpy.context.evaluated_depsgraph_get()
    for o in [o for o in bpy.data.objects if o.type == "MESH"]:
        item = o.evaluated_get(graph)
        world = np.array(item.matrix_world)
        x = np.array([v.co for v in item.to_mesh().vertices], dtype=float)
        got[f"{k:g} {o.name}"] = x @ world[:3, :3].T + world[:3, 3]
np.savez(out, **got)
"""


def with_blender(test):
    """Marks a test that needs Blender."""
    return pytest.mark.slow(pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)(test))


def run(code, *words):
    """Runs a script with bpy."""
    done = subprocess.run([sys.executable, "-c", code, *map(str, words)], capture_output=True, text=True, check=False,
                          timeout=200)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def content(file, frames=()):
    """(content but for caches, arrays): x (n, 3) [m] of "FRAME NAME", y up, and "path NAME" of caches."""
    out = file.with_suffix(".npz")
    run(READER, file, out, json.dumps(list(frames)))
    got = dict(np.load(out))
    kept = json.loads(str(got.pop("kept")))
    return kept, {key: a if a.ndim != 2 else UNIT * a[:, [0, 2, 1]] * [1, 1, -1] for key, a in got.items()}


@pytest.fixture(scope="session")
def made_blend(tmp_path_factory):
    """The file."""
    file = tmp_path_factory.mktemp("blend") / "shop.blend"
    run(MAKER, file)
    return file
