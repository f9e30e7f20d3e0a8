"""Runs inside Blender: imports an FBX or Alembic file, or opens a .blend, and writes its meshes, frame by frame, as arrays.

Arguments: the file, the .npz to write, and a JSON object of choices: `clip` (names or numbers, or null), `fps`, `only`,
`moves` and `rest`: seconds from the rest pose to the first frame, or null.
Nothing of the package is imported here: the Python that runs this is Blender's.
"""

import json
import sys

import bpy
import numpy as np
from mathutils import Matrix, Quaternion, Vector


def main(path: str, out: str, choices: str) -> None:
    """Imports, evaluates, writes."""
    wanted = json.loads(choices)
    own = path.lower().endswith(".blend")
    if own:
        bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    else:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    clips: list = []
    if own:
        first, last = scene.frame_start, scene.frame_end
        if bpy.data.version[:2] > bpy.app.version[:2]:
            told = f"Blender {bpy.data.version[0]}.{bpy.data.version[1]} saved it, and this is {bpy.app.version_string}"
            return save(out, {"refused": np.array(f"{told}: name that one by TAICHI_CLOTH_BLENDER")})
    elif path.lower().endswith(".abc"):
        scene.frame_start = scene.frame_end = 1
        rate = wanted["fps"] or 24.0
        scene.render.fps, scene.render.fps_base = max(1, round(rate)), max(1, round(rate)) / rate
        bpy.ops.wm.alembic_import(filepath=path, as_background_job=False)
        first, last = scene.frame_start, scene.frame_end
    elif not hasattr(bpy.ops.wm, "fbx_import") or bpy.app.version < (4, 5):
        return save(out, {"refused": np.array(f"FBX is read by Blender 4.5 or later, and this is {bpy.app.version_string}")})
    else:
        bpy.ops.wm.fbx_import(filepath=path)
        clips = sorted(bpy.data.actions, key=lambda action: action.name)
        first, last = play(clips, wanted)
    native = scene.render.fps / scene.render.fps_base
    fps = wanted["fps"] or native
    unit = 1.0 if scene.unit_settings.system == "NONE" or not own else scene.unit_settings.scale_length
    got = {"fps": np.array(fps), "unit": np.array(unit), "clips": np.array([action.name for action in clips], dtype=str),
           "seconds": np.array([np.ptp(action.frame_range) / native for action in clips]),
           "taken": np.array([k for k, action in enumerate(clips) if action.get("taken")], dtype=np.int64)}
    moves = wanted["moves"] and last > first
    count = int(np.ceil((last - first) / native * fps * (1 - 1e-6))) + 1 if moves else 1
    names = sorted(name for name, _, _ in shown(first))
    got["names"] = np.array(names, dtype=str)
    way = lead(wanted["rest"], fps) if moves and wanted["rest"] is not None and any(
        bone.parent for rig in rigs() for bone in rig.pose.bones) else []
    held = sorted({rig.name for rig in rigs() for bone in rig.pose.bones if bone.constraints})
    if way and held:
        return save(out, {"refused": np.array(f"rest: bones of {held[0]!r} have constraints: bake its action first")})
    if all(name in names for name in wanted["only"] or ()):
        got |= meshes([(first, u) for u in way] + [(k / fps * native + first, 1.0) for k in range(count)], wanted["only"])
    got["way"] = np.array(way)
    if way:
        got["bones"] = bones(first, [*way, 1.0])
    return save(out, got)


def rigs():
    """The armatures of the scene."""
    return [item for item in bpy.context.scene.objects if item.type == "ARMATURE"]


def lead(seconds: float, fps: float) -> list:
    """As `rest.lead` has it."""
    count = max(1, int(np.ceil(seconds * fps * (1 - 1e-6))))
    return [s * s * (3 - 2 * s) for s in (np.arange(count) / count).tolist()]


def at(frame: float, way: float) -> None:
    """The scene at a frame; bones below others are a part of the way there from their rest pose."""
    scene = bpy.context.scene
    scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))
    if way == 1:
        return
    for rig in rigs():
        for bone in rig.pose.bones:
            if bone.parent:
                move, turn, size = bone.matrix_basis.decompose()
                size = way * size + (1 - way) * Vector((1, 1, 1))
                bone.matrix_basis = Matrix.LocRotScale(way * move, Quaternion().slerp(turn, way), size)
    bpy.context.view_layer.update()


def bones(first: float, way: list) -> np.ndarray:
    """(frames, bones, 4, 4) world matrices on the way of the bones right below the topmost ones."""
    out = []
    for u in way:
        at(first, u)
        out.append([np.array(rig.matrix_world @ bone.matrix) for rig in rigs() for bone in rig.pose.bones
                    if bone.parent and not bone.parent.parent])
    return np.array(out)


def play(clips, wanted) -> tuple[float, float]:
    """Gives objects and shape keys the actions that are wanted; returns the frames of the first and the last."""
    owners = {}
    for item in [*bpy.data.objects, *bpy.data.shape_keys]:
        owners[("OB" if isinstance(item, bpy.types.Object) else "KE") + item.name] = item
        if item.animation_data:
            item.animation_data.action = None
    names = [action.name for action in clips]
    if wanted["clip"] is None:
        chosen = together([moves(action, owners) for action in clips])
    else:
        chosen = [names.index(one) if one in names else one for one in wanted["clip"]]
        chosen = [k for k in chosen if isinstance(k, int) and k < len(clips)]
    moved: set[str] = set()
    spans = []
    for k in chosen if wanted["moves"] else ():
        for slot in clips[k].slots:
            if slot.identifier in owners and slot.identifier not in moved:
                data = owners[slot.identifier].animation_data or owners[slot.identifier].animation_data_create()
                data.action, data.action_slot = clips[k], slot
                moved.add(slot.identifier)
        clips[k]["taken"] = 1
        spans.append(tuple(clips[k].frame_range))
    return (min(a for a, _ in spans), max(b for _, b in spans)) if spans else (1.0, 1.0)


def moves(action, owners) -> dict[str, dict]:
    """By each slot of an object or shape keys, the keys of its curves that are not constant."""
    out: dict[str, dict] = {slot.identifier: {} for slot in action.slots if slot.identifier in owners}
    for bag in [bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags]:
        for curve in bag.fcurves if bag.slot.identifier in out else ():
            keys = [(round(key.co[0], 4), round(key.co[1], 4)) for key in curve.keyframe_points]
            if len({value for _, value in keys}) > 1:
                out[bag.slot.identifier][curve.data_path, curve.array_index] = keys
    return out


def together(clips: list[dict[str, dict]]) -> list[int]:
    """Numbers of the clips, as `moves` has them, that play where none is named: the first, and others that it agrees with.

    Blender writes each object's action for all other objects, too: such copies move only objects that nothing else moves.
    """
    taken: list[int] = []
    held: dict[str, dict] = {}
    for copies in (False, True):
        for k, clip in enumerate(clips):
            fresh = [curves for slot, curves in clip.items() if slot not in held]
            clashes = any(held.get(slot, curves) != curves for slot, curves in clip.items())
            copied = any(curves and curves in held.values() for curves in fresh)
            if fresh and not clashes and (copies or not copied):
                taken.append(k)
                held = clip | held
    return taken


def shown(frame: float, way: float = 1.0):
    """(name, evaluated object, world matrix) of each mesh and instance at a frame, or on the way to it."""
    at(frame, way)
    seen: dict[str, int] = {}
    for instance in bpy.context.evaluated_depsgraph_get().object_instances:
        if instance.object.type == "MESH":
            name = instance.object.name
            seen[name] = seen.get(name, 0) + 1
            yield (name if seen[name] == 1 else f"{name} {seen[name]}"), instance.object, np.array(instance.matrix_world)


def meshes(frames, only):
    """Arrays of all meshes at frames, each with its part of the way."""
    got, xs, counts = {}, {}, {}
    for frame, way in frames:
        for name, item, world in shown(frame, way):
            if only is not None and name not in only:
                continue
            mesh = item.to_mesh()
            x = np.empty(3 * len(mesh.vertices), dtype=np.float32)
            mesh.vertices.foreach_get("co", x)
            loops = np.empty(len(mesh.loops), dtype=np.int32)
            mesh.loops.foreach_get("vertex_index", loops)
            if name not in xs:
                xs[name], counts[name] = [], loops
                got |= first_of(name, mesh, item, loops, world)
            if not np.array_equal(loops, counts[name]):
                return {"refused": np.array(f"part {name!r}: has other faces at frame {frame:g} than before: a body keeps its "
                                            "vertices and faces; leave the part out (only=)")}
            x = x.reshape(-1, 3).astype(np.float64) @ world[:3, :3].T + world[:3, 3]
            x = np.stack([x[:, 0], x[:, 2], -x[:, 1]], axis=1)
            same = bool(xs[name]) and np.array_equal(xs[name][-1], x)
            xs[name].append(xs[name][-1] if same else x)
    for name, frames_of in xs.items():
        if len(frames_of) != len(frames):
            return {"refused": np.array(f"part {name!r}: is there in {len(frames_of)} of {len(frames)} frames: leave it out "
                                        "(only=)")}
        still = all(x is frames_of[0] for x in frames_of)
        got[f"x {name}"] = np.stack(frames_of[:1] if still else frames_of)
    return got


def first_of(name, mesh, item, loops, world):
    """Faces, texture coordinates and materials of a mesh."""
    start = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("loop_start", start)
    material = np.empty(len(mesh.polygons), dtype=np.int32)
    mesh.polygons.foreach_get("material_index", material)
    got = {f"corners {name}": loops, f"counts {name}": np.diff([*start, len(loops)]), f"material {name}": material,
           f"materials {name}": np.array([m.name if m else "" for m in item.data.materials], dtype=str),
           f"own {name}": np.array(len(getattr(item.original.data, "vertices", ()))),
           f"world {name}": world[:3, :3].copy(), f"mirrored {name}": np.array(np.linalg.det(world[:3, :3]) < 0)}
    if mesh.uv_layers:
        uv = np.empty(2 * len(loops), dtype=np.float32)
        mesh.uv_layers[0].uv.foreach_get("vector", uv)
        got[f"uv {name}"] = uv.reshape(-1, 2)
    return got


def save(out: str, arrays) -> None:
    """Writes the arrays."""
    with open(out, "wb") as file:
        np.savez(file, **arrays)


main(*sys.argv[sys.argv.index("--") + 1:])
