"""glTF written by hand, with parts on joints of a scaled rig: positions against Blender's, and against matrices by hand."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest
from glb import Glb
from test_gltf import FACES, POST, UPPER, about_z, turn_z

import taichi_cloth as tc

ABSENT = "Blender's module bpy is not installed: pip install 'taichi-cloth[blender]'"

# Reads a glTF file as Blender has it, at times in seconds; the first key is at frame 1. Its usual import (5.0.1) divides the
# length of bones by the rig's scale, and shifts parts that hang on them by the whole length: .48 m here, .63 m of a robot.
READER = """
import json, sys
import bpy, numpy as np
path, out, fps, times = sys.argv[1], sys.argv[2], int(sys.argv[3]), json.loads(sys.argv[4])
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps = fps
bpy.ops.import_scene.gltf(filepath=path, bone_heuristic="FORTUNE")
for item in [*bpy.data.objects, *bpy.data.shape_keys]:
    if item.animation_data:
        item.animation_data.action = None
        for track in item.animation_data.nla_tracks:
            track.mute = False
got = {}
for t in times:
    frame = 1 + t * fps
    scene.frame_set(int(frame // 1), subframe=frame % 1)
    graph = bpy.context.evaluated_depsgraph_get()
    x = []
    for item in bpy.data.objects:
        if item.type == "MESH" and not item.hide_get():
            evaluated = item.evaluated_get(graph)
            at = np.array([v.co for v in evaluated.to_mesh().vertices], dtype=float)
            world = np.array(evaluated.matrix_world)
            x.append(at @ world[:3, :3].T + world[:3, 3])
    got[f"{t}"] = np.concatenate(x)[:, [0, 2, 1]] * [1, 1, -1]
np.savez(out, **got)
"""


def _away(a: np.ndarray, b: np.ndarray) -> float:
    """The largest distance of a point of one set to the nearest of the other, both ways."""
    away = np.linalg.norm(a[:, None] - b[None], axis=2)
    return float(max(away.min(axis=0).max(), away.min(axis=1).max()))


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)
def test_parts_on_joints_of_a_scaled_rig_are_where_blender_has_them(tmp_path):
    """A rig in centimetres, as FBX2glTF writes it: a skinned post, and a box on its upper joint; keys are uneven."""
    glb, fps = Glb(), 30
    t = np.array([0, 3, 4, 10, 21, 30]) / fps
    bind = np.tile(np.diag([0.01, 0.01, 0.01, 1]), (2, 1, 1))
    bind[1, 1, 3] = -0.01
    weights = np.column_stack([1 - UPPER, UPPER, 0 * UPPER, 0 * UPPER])
    skin = {"POSITION": glb.add(POST), "JOINTS_0": glb.add(np.tile([0, 1, 0, 0], (12, 1)), "u1"),
            "WEIGHTS_0": glb.add(weights)}
    index = glb.add(FACES.reshape(-1, 1), "u2")
    glb.document |= {
        "meshes": [{"primitives": [{"attributes": skin, "indices": index}]},
                   {"primitives": [{"attributes": {"POSITION": skin["POSITION"]}, "indices": index}]}],
        "skins": [{"joints": [2, 3], "inverseBindMatrices": glb.add(bind.transpose(0, 2, 1).reshape(2, 16))}],
        "nodes": [{"name": "Rig", "children": [1, 2], "scale": [100, 100, 100]}, {"name": "Post", "mesh": 0, "skin": 0},
                  {"name": "Lower", "children": [3]}, {"name": "Upper", "translation": [0, 0.01, 0], "children": [4]},
                  {"name": "Box", "mesh": 1, "translation": [0.002, 0.006, 0.001], "rotation": about_z(0.7),
                   "scale": [0.004, 0.003, 0.002]}],
        "scenes": [{"nodes": [0]}], "scene": 0}
    angle = np.array([0, 0.3, 1.4, -0.2, 2.0, 0.4])
    glb.clip("Bend", rotation_3=(t, [about_z(a) for a in angle], "LINEAR"),
             rotation_2=(t, [[np.sin(a / 4), 0, 0, np.cos(a / 4)] for a in angle], "LINEAR"),
             translation_2=(t, np.outer(angle, [0.002, 0, 0.001]), "LINEAR"))
    body = tc.load_solid(glb.write(tmp_path / "a.glb"), fps=fps, merge=False)
    subprocess.run([sys.executable, "-c", READER, str(tmp_path / "a.glb"), str(tmp_path / "there.npz"), str(fps),
                    json.dumps(t.tolist())], check=True, capture_output=True, timeout=300)
    there = np.load(tmp_path / "there.npz")
    for at in t:
        x = body.x[round(at * fps)]
        assert x.shape == there[f"{at}"].shape and _away(x, there[f"{at}"]) < 1e-5, at
    for k, (a, lower) in enumerate(zip(angle, angle / 2)):  # and by hand: the box's own corners
        box = POST * [0.004, 0.003, 0.002] @ turn_z(0.7).T + [0.002, 0.006, 0.001]
        box = box @ turn_z(a).T + [0, 0.01, 0]
        c, s = np.cos(lower), np.sin(lower)
        box = box @ np.array([[1, 0, 0], [0, c, -s], [0, s, c]]).T + a * np.array([0.002, 0, 0.001])
        assert _away(body.x[round(t[k] * fps)][body.groups["Box"]], 100 * box) < 1e-5
