"""Runs inside Blender: makes a scene from the arrays of `blend.arrays`, and saves it as .blend or .abc.

Positions are absolute shape keys, one a frame, all within the file. Nothing of the package is imported here: the Python that
runs this is Blender's.
"""

import os
import sys

import bpy
import numpy as np

STEP = 25.0  # of eval_time from one shape key to the next


def main(data: str, path: str) -> None:
    """Reads the arrays, makes the scene, writes the file."""
    arrays = np.load(data, allow_pickle=False)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    numbers, fps = arrays["numbers"], float(arrays["fps"])
    scene.frame_start, scene.frame_end = int(numbers[0]), int(numbers[-1])
    scene.render.fps = max(1, round(fps))
    scene.render.fps_base = scene.render.fps / fps
    scene.render.resolution_x, scene.render.resolution_y = 1280, 720
    scene.unit_settings.system, scene.unit_settings.scale_length = "METRIC", 1.0
    collections = {}
    for kind in ("cloth", "solid"):
        collections[kind] = bpy.data.collections.new(kind)
        scene.collection.children.link(collections[kind])
    for k, (name, kind) in enumerate(zip(arrays["names"].tolist(), arrays["kinds"].tolist())):
        made = add_mesh(collections[kind], name, arrays, k)
        if kind == "cloth" and not path.endswith(".abc"):
            thicken(made, float(arrays["thickness"][k]))
    add_camera(scene, arrays)
    if not path.endswith(".abc"):
        add_surroundings(scene, arrays)
        render_on_the_cpu(scene)
    scene.frame_set(scene.frame_start)
    if path.endswith(".abc"):
        bpy.ops.wm.alembic_export(filepath=path, start=scene.frame_start, end=scene.frame_end, as_background_job=False,
                                  check_existing=False)
    else:
        bpy.ops.wm.save_as_mainfile(filepath=path, compress=True, check_existing=False)


def add_mesh(collection, name: str, arrays, k: int):
    """The object of a mesh, with its faces, uv, material and, where it moves, shape keys."""
    corners, counts, x = (arrays[f"{kind}_{k}"] for kind in ("corners", "counts", "x"))
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(x.shape[1])
    mesh.vertices.foreach_set("co", x[0].ravel())
    mesh.loops.add(len(corners))
    mesh.loops.foreach_set("vertex_index", corners.astype(np.int32))
    mesh.polygons.add(len(counts))
    mesh.polygons.foreach_set("loop_start", (np.cumsum(counts) - counts).astype(np.int32))
    mesh.update(calc_edges=True)
    if f"uv_{k}" in arrays:
        mesh.uv_layers.new(name="pattern").uv.foreach_set("vector", arrays[f"uv_{k}"].ravel().astype(np.float32))
    shade(mesh, arrays[f"sharp_{k}"])
    made = material(name, arrays["colors"][k].tolist())
    mesh.materials.append(made)
    if f"image_{k}" in arrays:
        put_print(made, arrays[f"image_{k}"], bool(arrays[f"repeats_{k}"]))
    cloth = bpy.data.objects.new(name, mesh)
    cloth.color = (*arrays["colors"][k].tolist(), 1.0)
    collection.objects.link(cloth)
    if len(x) > 1:
        animate(cloth, x, arrays["numbers"])
    return cloth


def shade(mesh, sharp: np.ndarray) -> None:
    """Smooth, but for the sharp edges (k, 2)."""
    mesh.shade_smooth()
    if len(sharp):
        ends = np.empty(2 * len(mesh.edges), dtype=np.int32)
        mesh.edges.foreach_get("vertices", ends)
        code = np.sort(ends.reshape(-1, 2), axis=1).astype(np.int64) @ [len(mesh.vertices), 1]
        is_sharp = np.isin(code, sharp.astype(np.int64) @ [len(mesh.vertices), 1])
        mesh.attributes.new("sharp_edge", "BOOLEAN", "EDGE").data.foreach_set("value", is_sharp)


def animate(cloth, x: np.ndarray, numbers: np.ndarray) -> None:
    """A shape key a frame, gone through one after the other; half a frame on is halfway between two shapes.

    A key's place is eval_time / 100 when it is added. Steps of 25 make places exact in float32, and a keyframe at every
    frame makes eval_time so: positions are those of the file, not some that are blended with a rounded weight.
    """
    for place, (number, shape) in enumerate(zip(numbers.tolist(), x)):
        if place:
            cloth.data.shape_keys.use_relative = False
            cloth.data.shape_keys.eval_time = STEP * place
        key = cloth.shape_key_add(name=f"frame {number}", from_mix=False)
        key.data.foreach_set("co", shape.ravel())
        key.interpolation = "KEY_LINEAR"
    keys = cloth.data.shape_keys
    keys.eval_time = 0.0
    keys.keyframe_insert("eval_time", frame=int(numbers[0]))
    points = fcurves(keys)[0].keyframe_points
    points.add(len(x) - 1)
    points.foreach_set("co", np.column_stack([numbers, STEP * np.arange(len(x))]).ravel().astype(np.float32))
    for point in points:
        point.interpolation = "LINEAR"
    fcurves(keys)[0].update()


def fcurves(block):
    """The animation curves of a data block, where Blender of this version keeps them."""
    action = block.animation_data.action
    if hasattr(action, "fcurves"):
        return action.fcurves
    return action.layers[0].strips[0].channelbag(block.animation_data.action_slot).fcurves


def material(name: str, color: list[float]):
    """A plain cloth-like material of a linear colour."""
    out = bpy.data.materials.new(name)
    out.diffuse_color, out.roughness = (*color, 1.0), 0.8
    if out.node_tree is None:  # up to Blender 4.5 it has to be asked for
        out.use_nodes = True
    surface = next(node for node in out.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    surface.inputs["Roughness"].default_value = 0.8
    return out


def put_print(material, image: np.ndarray, repeats: bool) -> None:
    """An image (h, w, 3) of sRGB bytes, first row on top, in a material's colour; the file has it within."""
    height, width = image.shape[:2]
    picture = bpy.data.images.new(material.name, width, height)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = image[::-1] / 255
    picture.pixels.foreach_set(pixels.ravel())
    picture.pack()
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image, node.extension = picture, "REPEAT" if repeats else "EXTEND"
    surface = next(n for n in material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
    material.node_tree.links.new(node.outputs["Color"], surface.inputs["Base Color"])


def add_camera(scene, arrays) -> None:
    """The camera, keyed at every frame where it moves."""
    from mathutils import Matrix

    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit = "VERTICAL"
    lens.clip_start, lens.clip_end = arrays["clip"].tolist()
    camera = bpy.data.objects.new("camera", lens)
    camera.rotation_mode = "QUATERNION"
    scene.collection.objects.link(camera)
    scene.camera = camera
    many = len(arrays["eye"]) > 1
    for number, eye, axes, fov in zip(arrays["numbers"].tolist(), arrays["eye"], arrays["axes"], arrays["fov"].tolist()):
        turned = Matrix(axes.T.tolist()).to_quaternion()
        if many:
            turned.make_compatible(camera.rotation_quaternion)
        lens.angle_y, camera.location, camera.rotation_quaternion = fov, eye.tolist(), turned
        if many:
            camera.keyframe_insert("location", frame=number)
            camera.keyframe_insert("rotation_quaternion", frame=number)
            lens.keyframe_insert("lens", frame=number)
    for curve in [*fcurves(camera), *fcurves(lens)] if many else []:
        for point in curve.keyframe_points:
            point.interpolation = "LINEAR"


def thicken(cloth, thickness: float) -> None:
    """Rounder and as thick as in the run, when it is rendered; in the viewport it stays as it was simulated."""
    rounder = cloth.modifiers.new("rounder", "SUBSURF")
    rounder.levels, rounder.render_levels, rounder.boundary_smooth = 0, 1, "PRESERVE_CORNERS"
    rounder.show_viewport = False
    if thickness > 0:
        thick = cloth.modifiers.new("thickness", "SOLIDIFY")
        thick.thickness, thick.offset, thick.show_viewport = thickness, 0.0, False


def add_surroundings(scene, arrays) -> None:
    """The lights, the light from everywhere, and the background, as the run's own pictures have them."""
    for k, (way, power) in enumerate(zip(arrays["lights"], arrays["powers"])):
        add_sun(scene, way, power, float(arrays["sun"]) if k == 0 else None)
    scene.view_settings.view_transform = "Standard"
    scene.world = bpy.data.worlds.new("world")
    if scene.world.node_tree is None:
        scene.world.use_nodes = True
    nodes, links = scene.world.node_tree.nodes, scene.world.node_tree.links
    height = nodes.new("ShaderNodeSeparateXYZ")
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], height.inputs[0])
    half = nodes.new("ShaderNodeMath")
    half.operation, half.inputs[1].default_value, half.inputs[2].default_value = "MULTIPLY_ADD", 0.5, 0.5
    links.new(height.outputs["Z"], half.inputs[0])
    middle, grows = arrays["everywhere"]
    color = mix(nodes, links, half.outputs[0], middle - grows, middle + grows)
    if len(arrays["sky"]):
        root = nodes.new("ShaderNodeMath")  # paler only near the horizon
        root.operation, root.inputs[1].default_value = "POWER", 0.5
        links.new(height.outputs["Z"], root.inputs[0])
        seen = mix(nodes, links, root.outputs[0], *arrays["sky"])
        color = mix(nodes, links, nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], color, seen)
    scene.render.film_transparent = not len(arrays["sky"])
    links.new(color, next(node for node in nodes if node.type == "BACKGROUND").inputs["Color"])


def add_sun(scene, way, power, angle: float | None) -> None:
    """A light from far away, of linear RGB (3,); without an angle under which it is seen it throws no shadow."""
    from mathutils import Vector

    most = float(max(power))
    if not most > 0:
        return
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.color, sun.angle, sun.use_shadow = np.pi * most, power / most, angle or 0.0, angle is not None
    light = bpy.data.objects.new("sun", sun)
    light.rotation_euler = Vector(way.tolist()).to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(light)


def mix(nodes, links, factor, *ends):
    """The output of a node between two colours, each an array or another output."""
    node = nodes.new("ShaderNodeMix")
    node.data_type = "RGBA"
    links.new(factor, node.inputs[0])
    for end, socket in zip(ends, node.inputs[6:8]):
        if isinstance(end, np.ndarray):
            socket.default_value = (*end.tolist(), 1.0)
        else:
            links.new(end, socket)
    return node.outputs[2]


def render_on_the_cpu(scene) -> None:
    """Cycles, which needs no GPU, few samples and a denoiser, where this Blender has them."""
    if not hasattr(scene, "cycles"):
        return
    scene.render.engine = "CYCLES"
    scene.cycles.device, scene.cycles.samples = "CPU", 64
    try:
        scene.cycles.denoiser, scene.cycles.use_denoising = "OPENIMAGEDENOISE", True
    except TypeError:  # built without it
        scene.cycles.use_denoising = False


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1:]
    main(*arguments)
    sys.stdout.flush()
    os._exit(0)  # Blender's own end may crash after all is written
