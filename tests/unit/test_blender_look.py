"""How a .blend looks when it is rendered: light, background and thickness, by pictures of Cycles."""

import json

import numpy as np
import pytest
from blends import run, with_blender
from test_export import make

from taichi_cloth.output.export import export

LIGHT = np.array([0.6, 0.6, -0.3])  # towards the key light

# Settings; the colour of a white matt plane in place of all meshes, seen from above; that of the sky, low and high.
READER = """
import json, sys
import bpy
from mathutils import Euler
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
scene, told = bpy.context.scene, {}
told["set"] = [scene.render.engine, scene.cycles.device, scene.view_settings.view_transform, scene.render.film_transparent]
told["modifiers"] = {o.name: [[m.type, m.show_viewport, m.show_render, getattr(m, "thickness", 0)] for m in o.modifiers]
                     for o in bpy.data.objects if o.type == "MESH"}
for o in [o for o in bpy.data.objects if o.type == "MESH"]:
    bpy.data.objects.remove(o)
bpy.ops.mesh.primitive_plane_add(size=1000)
white = bpy.data.materials.new("white")
white.use_nodes = True
shader = next(n for n in white.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
shader.inputs["Base Color"].default_value = (1, 1, 1, 1)
shader.inputs["Roughness"].default_value, shader.inputs["Specular IOR Level"].default_value = 1, 0
bpy.context.object.data.materials.append(white)
scene.render.resolution_x = scene.render.resolution_y = 8
scene.cycles.samples, scene.cycles.use_denoising, scene.render.image_settings.file_format = 256, False, "OPEN_EXR"
camera = scene.camera
camera.animation_data_clear()
camera.data.angle, camera.location, camera.rotation_mode = 0.01, (0, 0, 5), "XYZ"
for name, tilt in (("down", 0.0), ("level", 1.5708 + 0.02), ("up", 3.14159)):
    camera.rotation_euler = Euler((tilt, 0, 0))
    scene.render.filepath = sys.argv[2] + name + ".exr"
    bpy.ops.render.render(write_still=True)
    pixels = list(bpy.data.images.load(scene.render.filepath).pixels)
    told[name] = [sum(pixels[c::4]) / 64 for c in range(4)]
open(sys.argv[2] + "told.json", "w").write(json.dumps(told))
"""


def seen(made, folder):
    file = export(made.recording, "blend", folder / "x.blend")[0]
    run(READER, file, str(folder) + "/")
    return json.loads((folder / "told.json").read_text())


@with_blender
def test_light_and_sky_are_those_of_pictures(tmp_path, rng):
    """White matt ground gets .76 of the key light by its slope and .37 of a blueish sky, as in the run's pictures."""
    told = seen(make(tmp_path / "run", rng, light=LIGHT, cloth_thickness=np.array([0.004, np.nan])), tmp_path)
    assert told["set"] == ["CYCLES", "CPU", "Standard", False]
    assert told["down"][:3] == pytest.approx(0.76 * 0.6 / 0.9 + 0.37 * np.array([0.85, 0.93, 1.05]), rel=0.02)
    horizon, zenith, part = np.array([0.80, 0.86, 0.93]), np.array([0.42, 0.60, 0.86]), np.sin(0.02) ** 0.5  # of the height
    assert told["level"][:3] == pytest.approx(horizon + part * (zenith - horizon), rel=0.01)
    assert told["up"][:3] == pytest.approx(zenith, rel=0.01)
    thin, other = (next(m for name, m in told["modifiers"].items() if word in name) for word in ("shirt", "skirts"))
    assert thin[0][:3] == ["SUBSURF", False, True] and thin[1] == ["SOLIDIFY", False, True, pytest.approx(0.004)]
    assert [m[0] for m in other] == ["SUBSURF"] and not told["modifiers"]["tetrahedron"]
    assert "ground" in told["modifiers"]


@with_blender
@pytest.mark.parametrize("background", ["transparent", (0.1, 0.7, 0.2)])
def test_other_backgrounds(tmp_path, rng, background):
    told = seen(make(tmp_path / "run", rng, background=np.array(background), ground=np.array(np.nan)), tmp_path)
    assert ("ground" in told["modifiers"]) != (background == "transparent")
    assert told["set"][3] is (background == "transparent")
    assert told["up"] == pytest.approx([0, 0, 0, 0] if background == "transparent" else [*background, 1], abs=1e-3)
