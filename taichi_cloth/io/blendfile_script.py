"""Runs inside Blender: writes the content of a .blend's mesh objects as arrays, and leaves the file as it is.

Arguments: the file, the .npz to write, and a JSON object: `only` (names of objects, or null) and `times` [s] after the scene's
first frame, at which their transforms are wanted.
Nothing of the package is imported here: the Python that runs this is Blender's.
"""

import json
import os
import sys

import bpy
import numpy as np

OWN = "taichi_cloth"  # the modifier of an earlier bake
# Modifiers by which something else leads an object's vertices: cloth starts where they put it, and its cache replaces them.
LEAD = ("ARMATURE", "CLOTH", "CURVE", "HOOK", "LATTICE", "MESH_CACHE", "MESH_DEFORM", "SOFT_BODY", "SURFACE_DEFORM")


def main(path: str, out: str, choices: str) -> None:
    """Opens, evaluates, writes."""
    wanted = json.loads(choices)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    if bpy.data.version[:2] > bpy.app.version[:2]:
        told = f"Blender {bpy.data.version[0]}.{bpy.data.version[1]} saved it, and this is {bpy.app.version_string}"
        return save(out, {"refused": np.array(f"{told}: name that one by TAICHI_CLOTH_BLENDER")})
    scene = bpy.context.scene
    items = {item.name: item for item in bpy.data.objects if item.type == "MESH"}
    unit = scene.unit_settings
    got = {"names": np.array(sorted(items), dtype=str), "fps": np.array(scene.render.fps / scene.render.fps_base),
           "frames": np.array([scene.frame_start, scene.frame_end]),
           "unit": np.array(1.0 if unit.system == "NONE" else unit.scale_length)}
    chosen = [items[name] for name in (items if wanted["only"] is None else wanted["only"]) if name in items]
    if len(chosen) == len(wanted["only"] or items):
        for item in chosen:
            show(item)
            got |= topology(item) | groups(item)
        at(scene, 0.0)
        for item in chosen:
            got |= standing(item)
        got |= transforms(scene, chosen, wanted["times"], float(got["fps"]))
    return save(out, got)


def at(scene, frame: float) -> None:
    """Goes to a frame, counted from the scene's first."""
    whole = int(np.floor(frame))
    scene.frame_set(scene.frame_start + whole, subframe=frame - whole)


def show(item) -> None:
    """Makes an object one that Blender evaluates, hidden or not."""
    if item.name not in bpy.context.view_layer.objects:
        bpy.context.scene.collection.objects.link(item)
    item.hide_viewport = False
    item.hide_set(False)


def topology(item) -> dict:
    """Polygons, texture coordinates and materials of an object's own mesh."""
    mesh, name = item.data, item.name
    counts, corners = (np.empty(n, dtype=np.int32) for n in (len(mesh.polygons), len(mesh.loops)))
    mesh.polygons.foreach_get("loop_total", counts)
    mesh.loops.foreach_get("vertex_index", corners)
    of = np.empty(len(counts), dtype=np.int32)
    mesh.polygons.foreach_get("material_index", of)
    got = {f"counts {name}": counts, f"corners {name}": corners, f"material {name}": of,
           f"linked {name}": np.array(item.library is not None),
           f"materials {name}": np.array([s.material.name if s.material else "" for s in item.material_slots], dtype=str)}
    if mesh.uv_layers.active:
        uv = np.empty(2 * len(corners), dtype=np.float32)
        mesh.uv_layers.active.uv.foreach_get("vector", uv)
        got[f"uv {name}"] = uv.reshape(-1, 2)
    return got


def groups(item) -> dict:
    """Vertices and weights of an object's vertex groups, without those of weight 0."""
    rows = [(g.group, v.index, g.weight) for v in item.data.vertices for g in v.groups if g.weight > 0]
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    got = {f"groups {item.name}": np.array([g.name for g in item.vertex_groups], dtype=str)}
    for k in range(len(item.vertex_groups)):
        mine = table[table[:, 0] == k]
        got |= {f"group {k} {item.name}": mine[:, 1].astype(np.int32), f"weight {k} {item.name}": mine[:, 2]}
    return got


def standing(item) -> dict:
    """Local positions now, where cloth starts, and how many modifiers come before its cache."""
    for modifier in item.modifiers:
        modifier.show_viewport = modifier.show_viewport and modifier.name != OWN
    stack = [modifier for modifier in item.modifiers if modifier.name != OWN]
    before = max((k + 1 for k, modifier in enumerate(stack) if modifier.type in LEAD), default=0)
    x = evaluated(item, stack[before:])
    if len(x) != len(item.data.vertices):
        x, before = evaluated(item, stack), 0
    after = [modifier.name for modifier in stack[before:] if modifier.type in LEAD]
    return {f"x {item.name}": x, f"before {item.name}": np.array(stack[before - 1].name if before else ""),
            f"leads after {item.name}": np.array(after, dtype=str)}


def evaluated(item, without) -> np.ndarray:
    """(n, 3) positions by the modifiers but for some."""
    for modifier in without:
        modifier.show_viewport = False
    bpy.context.view_layer.update()
    mesh = item.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    x = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", x)
    return x.reshape(-1, 3)


def transforms(scene, items, times, fps: float) -> dict:
    """World matrices at times."""
    rows: dict = {item.name: [] for item in items}
    for t in times:
        at(scene, round(t * fps, 6))
        graph = bpy.context.evaluated_depsgraph_get()
        for item in items:
            rows[item.name].append(np.array(item.evaluated_get(graph).matrix_world, dtype=np.float64))
    return {f"world {name}": np.array(some) for name, some in rows.items()}


def save(out: str, arrays) -> None:
    """Writes the arrays."""
    with open(out, "wb") as file:
        np.savez(file, **arrays)


main(*sys.argv[sys.argv.index("--") + 1:])
sys.stdout.flush()
os._exit(0)  # Blender's own end may crash after all is written
