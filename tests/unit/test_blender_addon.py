"""The add-on, installed and used in a Blender without a window: it registers, bakes, refuses, and goes."""

import ast
import json
import os
import subprocess
import sys

import numpy as np
import pytest
from blends import FIRST, content, made_blend, with_blender  # noqa: F401  (a fixture)

from taichi_cloth.app.blending import ADDON
from taichi_cloth.app.cli import main
from taichi_cloth.output.recording import Recording

# Installs the add-on, sets objects up, bakes into a folder, and saves; then errors, one at a time, and an end before its time.
USER = """
import json, sys, time
from types import SimpleNamespace
import bpy
addon, file, folder, out, python = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=file)
bpy.ops.preferences.addon_install(filepath=addon)
bpy.ops.preferences.addon_enable(module="taichi_cloth_addon")
import taichi_cloth_addon as own
scene, told = bpy.context.scene, {}
curtain, body = bpy.data.objects["Curtain"], bpy.data.objects["Body"]

def bake(name):
    try:
        told[name] = sorted(bpy.ops.taichi_cloth.bake())
    except RuntimeError as error:
        told[name] = str(error)

bake("no Python")
bpy.context.preferences.addons["taichi_cloth_addon"].preferences.python = python
bake("no cloth")
scene.taichi_cloth.folder, scene.taichi_cloth.last = folder, scene.frame_start + 3
curtain.taichi_cloth.role, curtain.taichi_cloth.pins, body.taichi_cloth.role = "CLOTH", "Pons", "COLLIDER"
bake("no group")
curtain.taichi_cloth.pins, curtain.taichi_cloth.fabric = "Pins", "shorting"
bake("no fabric")
curtain.taichi_cloth.fabric, curtain.taichi_cloth.stiffness = "denim", 5.0
told["fabrics"] = own.fabrics(None, None, "DEN")
bake("good")
bpy.ops.wm.save_as_mainfile(filepath=out)

class Window:  # in place of Blender's, which the background has not: the operator is called as Blender would
    def __init__(self):
        self.said, self.shown, self.calls = [], [], []
        self.window_manager = self.workspace = self
        self.scene, self.window, self.object = scene, None, curtain

    def status_text_set(self, text):
        self.shown.append(text)

    def report(self, kind, text):
        self.said.append(text)

    def __getattr__(self, name):
        if name in own.BakeOperator.__dict__:
            return lambda *args: own.BakeOperator.__dict__[name](self, *args)
        return lambda *args, **more: self.calls.append(name)

window, scene.taichi_cloth.folder = Window(), folder + "2"
told["invoked"] = sorted(window.invoke(window, None))
while not window.bake.frames.is_dir():
    told["timer"] = sorted(window.modal(window, SimpleNamespace(type="TIMER")))
    time.sleep(0.05)
told["esc"] = sorted(window.modal(window, SimpleNamespace(type="ESC")))
told["shown"], told["said"], told["calls"] = window.shown, window.said, window.calls
told["ended"] = window.bake.process.returncode
told["kept"] = [m.name for m in curtain.modifiers]

class Layout:  # looks whether what is drawn is there
    def prop(self, data, name):
        told.setdefault("drawn", []).append([name, hasattr(data, name)])

    def prop_search(self, data, name, where, what):
        self.prop(data, name), self.prop(where, what)

    def operator(self, name, icon):
        told["button"] = name

own.Panel.draw(SimpleNamespace(layout=Layout()), window)
bpy.ops.preferences.addon_disable(module="taichi_cloth_addon")
told["gone"] = not hasattr(scene, "taichi_cloth") and not hasattr(bpy.types, "PHYSICS_PT_taichi_cloth")
print("TOLD" + json.dumps(told))
"""


@with_blender
def test_it_registers_bakes_and_goes(tmp_path, made_blend):  # noqa: F811
    addon, out = tmp_path / "taichi_cloth_addon.py", tmp_path / "out.blend"
    assert main(["blend", "--addon", str(addon)]) == 0
    own = dict(os.environ, BLENDER_USER_RESOURCES=str(tmp_path / "user"))
    done = subprocess.run([sys.executable, "-c", USER, *map(str, (addon, made_blend, tmp_path / "bake", out, sys.executable))],
                          capture_output=True, text=True, check=False, timeout=400, env=own)
    lines = [line for line in done.stdout.splitlines() if line.startswith("TOLD")]
    assert done.returncode == 0 and lines, done.stdout[-3000:] + done.stderr[-3000:]
    told = json.loads(lines[0][4:])
    assert "Name the Python that has taichi_cloth" in told["no Python"]
    assert "No object has the role Cloth" in told["no cloth"]
    assert "Curtain: no vertex group 'Pons' for pins" in told["no group"]
    assert "shorting" in told["no fabric"] and "did you mean 'shirting'" in told["no fabric"]
    assert told["fabrics"] == ["denim"] and told["good"] == ["FINISHED"] and told["gone"]
    assert told["invoked"] == ["RUNNING_MODAL"] and told["timer"] == ["PASS_THROUGH"] and told["esc"] == ["CANCELLED"]
    assert told["ended"] not in (None, 0) and told["said"] == ["The bake was ended; caches are as they were"]
    assert "% of 4 frames; Esc ends it" in told["shown"][0] and told["shown"][-1] is None
    assert {"modal_handler_add", "progress_update", "progress_end", "event_timer_remove"} <= set(told["calls"])
    assert told["button"] == "taichi_cloth.bake" and len(told["drawn"]) > 6 and all(there for _, there in told["drawn"])
    kept, got = content(out, range(FIRST, FIRST + 4))
    assert [m[0] for m in kept["Curtain"][4]] == ["Led", "taichi_cloth", "Finer", "Thick"]
    recording = Recording(tmp_path / "bake/run")
    assert recording.frames() == [0, 1, 2, 3]
    for k in range(4):
        assert np.abs(got[f"{FIRST + k} Curtain"] - recording.frame(k)["x"]).max() < 1e-6
    moved = np.abs(got[f"{FIRST + 3} Curtain"] - got[f"{FIRST} Curtain"]).max(axis=1)
    assert (moved[:3] < 1e-6).all() and moved[3] > 1e-5 and moved[4:].min() > 1e-3  # three pins hold, one gives a little


def test_it_is_one_file_that_needs_nothing():
    """Of the standard library, and Blender's own."""
    tree = ast.parse(ADDON.read_text())
    names = {a.name.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
    names |= {n.module.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
    assert names <= {*sys.stdlib_module_names, "bpy"}


@pytest.mark.parametrize("words, said", [
    (["--addon", "a.txt"], "must be a .py whose name is one word"), (["--addon", "a-b.py"], "whose name is one word"),
    (["run", "--addon", "a.py"], "--addon goes without a run"),
    ([], "blend needs a run's folder, or --addon")])
def test_what_it_is_not_written_to(tmp_path, monkeypatch, capsys, words, said):
    monkeypatch.chdir(tmp_path)
    assert main(["blend", *words]) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ") and said in told and told.count("\n") == 1 and not list(tmp_path.iterdir())
