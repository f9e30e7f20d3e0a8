"""What Blender has of an exported run, read back by its module bpy in a process of its own."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from test_export import CAMERA, COLORS, FACES, FIRST, FPS, NAMES, SEWN, SOLID_FACES, make

from taichi_cloth.output.export import export

ABSENT = "Blender's module bpy is not installed: pip install 'taichi-cloth[blender]'"
pytestmark = [pytest.mark.slow, pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)]

# Writes an .npz with, for each object and frame, world positions, and uv, loops, colours, camera, frame range.
READER = """
import sys
import bpy, numpy as np
file, out, fps, frames = sys.argv[1], sys.argv[2], int(sys.argv[3]), [float(k) for k in sys.argv[4].split(",")]
if file.endswith(".blend"):
    bpy.ops.wm.open_mainfile(filepath=file)
else:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = fps
    if file.endswith(".abc"):
        bpy.ops.wm.alembic_import(filepath=file, as_background_job=False)
    elif file.endswith(".glb"):
        bpy.ops.import_scene.gltf(filepath=file)
    else:
        bpy.ops.wm.usd_import(filepath=file)
scene, got = bpy.context.scene, {}
for k in frames:
    scene.frame_set(int(k), subframe=k % 1)
    graph = bpy.context.evaluated_depsgraph_get()
    for o in [o for o in bpy.data.objects if o.type == "MESH"]:
        mesh = o.evaluated_get(graph).to_mesh()
        x = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        mesh.vertices.foreach_get("co", x)
        turn = np.array(o.matrix_world)
        got[f"x {k:g} {o.name}"] = x.reshape(-1, 3).astype(float) @ turn[:3, :3].T + turn[:3, 3]
        loops = np.empty(len(mesh.loops), dtype=np.int32)
        mesh.loops.foreach_get("vertex_index", loops)
        got[f"faces {o.name}"] = loops.reshape(-1, 3)
        if mesh.uv_layers:
            uv = np.empty(2 * len(mesh.loops), dtype=np.float32)
            mesh.uv_layers[0].uv.foreach_get("vector", uv)
            got[f"uv {o.name}"] = uv.reshape(-1, 3, 2)
        for m in o.data.materials:
            shader = next(n for n in m.node_tree.nodes if n.type == "BSDF_PRINCIPLED")
            got[f"color {o.name}"] = np.array(shader.inputs["Base Color"].default_value)
            got[f"view {o.name}"] = np.array(m.diffuse_color)
            got[f"object {o.name}"] = np.array(o.color)
            if shader.inputs["Base Color"].is_linked:
                node = shader.inputs["Base Color"].links[0].from_node
                pixels = np.empty(4 * node.image.size[0] * node.image.size[1], dtype=np.float32)
                node.image.pixels.foreach_get(pixels)
                got[f"image {o.name}"] = pixels.reshape(node.image.size[1], node.image.size[0], 4)
                got[f"extension {o.name}"] = np.array([node.extension, node.image.colorspace_settings.name])
        sharp = o.data.attributes.get("sharp_edge")
        got[f"sharp {o.name}"] = sum(v.value for v in sharp.data) if sharp else 0
camera = next(o for o in bpy.data.objects if o.type == "CAMERA")
got["camera"], got["fov"] = np.array(camera.matrix_world), camera.data.angle_y
got["scene"] = np.array([scene.frame_start, scene.frame_end, scene.render.fps / scene.render.fps_base])
got["is camera"] = np.array(scene.camera == camera)
np.savez(out, **got)
"""


def read(file, frames=(FIRST, FIRST + 1, FIRST + 2)):
    """What Blender has."""
    out = file.with_name("read.npz")
    done = subprocess.run([sys.executable, "-c", READER, str(file), str(out), str(FPS), ",".join(map(str, frames))],
                          capture_output=True, text=True, check=False, timeout=200)
    assert done.returncode == 0 and out.is_file(), done.stdout[-2000:] + done.stderr[-2000:]
    return dict(np.load(out))


def up(x):
    """Blender's axes."""
    return np.stack([x[..., 0], -x[..., 2], x[..., 1]], axis=-1)


def named(got, kind, number, frame=None):
    """An entry of the mesh with this number: importers change names."""
    words = ["shirt", "skirts", "tetrahedron", "sheet", "ground"]
    start = kind if frame is None else f"{kind} {frame:g}"
    found = [key for key in got if key.startswith(start + " ") and words[number] in key]
    assert len(found) == 1, (start, number, list(got))
    return got[found[0]]


def matched(triangles, want):
    """(largest difference, the triangle of `want` that each is, the corner of it that each corner is), in any order."""
    face = np.linalg.norm(triangles.mean(axis=1)[:, None] - want.mean(axis=1), axis=2).argmin(axis=1)
    apart = np.abs(triangles[:, :, None] - want[face][:, None]).max(axis=3)
    assert sorted(face) == list(range(len(want)))
    return apart.min(axis=2).max(), face, apart.argmin(axis=2)


PIECES = ((0, 0, 4, "x", FACES[:2]), (1, 4, 9, "x", FACES[2:]), (2, 0, 4, "solid_x", SOLID_FACES[:4]),
          (3, 4, 8, "solid_x", SOLID_FACES[4:]))


@pytest.mark.parametrize("format", ["blend", "abc", "usdc", "glb"])
def test_blender_has_the_run(tmp_path, rng, format):
    made = make(tmp_path / "run", rng)
    got = read(export(made.recording, format, tmp_path / f"x.{format}")[0],
               np.arange(3) if format == "glb" else (FIRST, FIRST + 1, FIRST + 2))
    for number, first, last, key, faces in PIECES:
        for k, frame in enumerate(made.frames):
            x = named(got, "x", number, k if format == "glb" else FIRST + k)
            want = up(frame[key][first:last].astype(np.float64))
            apart, face, corner = matched(x[named(got, "faces", number)], want[faces - first])
            assert apart <= (2e-7 if format == "glb" else 1e-7) * np.abs(want).max() and len(face) == len(faces)
            if format != "glb":  # where vertices keep their order too
                assert np.abs(x - want).max() <= 1e-7 * np.abs(want).max()
        if key == "x":
            uv = made.geometry["uv"][:2] if number == 0 else made.geometry["uv"][2:]
            assert np.abs(named(got, "uv", number) - uv[face[:, None], corner]).max() <= 1e-7
        if format != "abc":
            color = {0: COLORS[0], 2: made.geometry["solid_colors"][0]}.get(number)
            assert color is None or named(got, "color", number) == pytest.approx([*color, 1], abs=1e-6)
    aim = up(CAMERA[3:6] - CAMERA[:3])
    assert got["camera"][:3, 3] == pytest.approx(up(CAMERA[:3]), abs=1e-6)
    assert -got["camera"][:3, 2] == pytest.approx(aim / np.linalg.norm(aim), abs=1e-6)
    assert np.degrees(got["fov"]) == pytest.approx(CAMERA[6], abs=1e-3)
    if format != "glb":  # glTF has seconds, and no frames
        assert got["scene"][:2].tolist() == [FIRST, FIRST + 2]


def test_a_blend_has_all_that_blender_has_a_place_for(tmp_path, rng):
    made = make(tmp_path / "run", rng, **SEWN)
    got = read(export(made.recording, "blend", tmp_path / "x.blend")[0], (FIRST, FIRST + 0.5))
    assert got["scene"] == pytest.approx([FIRST, FIRST + 2, FPS]) and got["is camera"]
    for kind in ("view", "object"):
        assert named(got, kind, 0) == pytest.approx([*COLORS[0], 1], abs=1e-6)
    assert named(got, "sharp", 2) == 6 and named(got, "sharp", 0) == 0
    half = (made.frames[0]["x"][:4] + made.frames[1]["x"][:4]) / 2
    assert named(got, "x", 0, FIRST + 0.5) == pytest.approx(up(half), abs=1e-6)
    assert {key[6:] for key in got if key.startswith("faces ")} == {NAMES[0], NAMES[1], "tetrahedron", "sheet", "ground"}
    got = read(export(made.recording, "blend", tmp_path / "w.blend", "welded")[0], (FIRST,))
    take = [1, 3, 4, 7, 8]
    assert named(got, "x", 1, FIRST) == pytest.approx(up(made.frames[0]["x"][take]), abs=1e-7)
    assert named(got, "uv", 1) == pytest.approx(made.geometry["uv"][2:], abs=1e-6)
    got = read(export(made.recording, "blend", tmp_path / "p.blend", "panels")[0], (FIRST,))
    for name, first, last in (("a", 0, 2), ("b", 2, 4), ("c", 4, 5)):
        assert got[f"uv {name}"] == pytest.approx(made.geometry["uv"][first:last], abs=1e-6)
        corners = up(made.frames[0]["x"][FACES[first:last]])
        assert got[f"x {FIRST:g} {name}"][got[f"faces {name}"]] == pytest.approx(corners, abs=1e-7)


def test_a_long_run_is_exact_to_its_end(tmp_path, rng):
    made = make(tmp_path / "run", rng, frames=400)
    file = export(made.recording, "blend", tmp_path / "x.blend")[0]
    frames = (FIRST + 1, FIRST + 333, FIRST + 399)
    got = read(file, frames)
    for k in frames:
        assert (named(got, "x", 1, k) == up(made.frames[k - FIRST]["x"][4:].astype(np.float64))).all()


def test_a_blend_has_prints_and_the_colours_of_panels(tmp_path, rng):
    """Of each face the pixel at its middle: two colours of a palette, and an image that goes on."""
    pair = np.array([[0.8, 0.1, 0.1], [0.1, 0.2, 0.7]])
    colors = np.full((5, 3), np.nan)
    colors[:2] = pair
    image = np.uint8([[[255, 0, 0, 255], [0, 255, 0, 255]], [[9, 99, 199, 255], [50, 60, 70, 255]]])
    made = make(tmp_path / "run", rng, face_colors=colors, texture_1=image,
                texture_place_1=np.array([0.5, 0.25, 0.1, -0.2, 1.0]))
    got = read(export(made.recording, "blend", tmp_path / "x.blend")[0], (FIRST,))
    panels, printed = named(got, "image", 0), named(got, "image", 1)
    at = named(got, "uv", 0).mean(axis=1) * panels.shape[1::-1]
    seen = panels[at[:, 1].astype(int), at[:, 0].astype(int), :3]
    linear = np.where(seen <= 0.04045, seen / 12.92, ((seen + 0.055) / 1.055) ** 2.4)
    assert linear == pytest.approx(pair, abs=5e-3)
    assert (np.round(255 * printed[::-1]) == image).all()
    assert [named(got, "extension", k).tolist() for k in (0, 1)] == [["EXTEND", "sRGB"], ["REPEAT", "sRGB"]]
