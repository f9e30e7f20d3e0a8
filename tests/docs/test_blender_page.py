"""The page about Blender: its scene and all of its commands are run, in order, on a small file."""

import importlib.util
import pathlib
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app.cli import main

PAGE = pathlib.Path(__file__).parents[2] / "docs/tutorials/blender.md"
ABSENT = "Blender's module bpy is not installed: pip install 'taichi-cloth[blender]'"

MAKER = """
import sys
import bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.frame_start, scene.frame_end = 1, 6
bpy.ops.mesh.primitive_grid_add(x_subdivisions=6, y_subdivisions=6, size=0.5, rotation=(1.5708, 0, 0), location=(0, 0, 1))
curtain = bpy.context.object
curtain.name = "Curtain"
pins = curtain.vertex_groups.new(name="Pins")
for v in curtain.data.vertices:
    if v.co.y > 0.2:
        pins.add([v.index], 1.0 if v.co.x < 0 else 0.5, "REPLACE")
curtain.modifiers.new("Finer", "SUBSURF")
bpy.ops.mesh.primitive_uv_sphere_add(segments=12, ring_count=8, radius=0.1, location=(0, 0.15, 0.95))
body = bpy.context.object
body.name = "Body"
for frame, y in ((1, 0.2), (6, 0.05)):
    body.location[1] = y
    body.keyframe_insert("location", frame=frame)
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("bpy") is None, reason=ABSENT)
def test_scene_and_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, "-c", MAKER, "shop.blend"], check=True, capture_output=True, timeout=200)
    code = re.search(r"^```py\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)[1]
    assert '"duration": 1.0' in code
    (tmp_path / "shop.py").write_text(code.replace('"duration": 1.0', '"duration": 0.2'))
    commands = re.findall(r"^taichi-cloth (.*)$", PAGE.read_text(), re.MULTILINE)
    assert len(commands) == 6
    for words in map(shlex.split, commands):
        assert main(words) == 0, words
    told = capsys.readouterr().out
    assert "group   'Body'" in told and "moves   6 frames at 24 a second" in told
    assert "the run ends at frame" not in told and "note: " not in told.split("written to")[1]
    there = {f.name for f in tmp_path.iterdir()}
    assert {"shop_cloth.blend", "shop_cloth_cache", "again.blend", "film.blend", "taichi_cloth_addon.py"} <= there
    recording = tc.Recording("out/shop")
    x = recording.frame(5)["x"] - recording.frame(0)["x"]
    top = tc.load("shop.blend", only="Curtain")
    held = top.select("Pins")[top.select_weights("Pins") == 1]
    assert len(held) == 3 and not x[held].any() and np.abs(x).max() > 1e-3
