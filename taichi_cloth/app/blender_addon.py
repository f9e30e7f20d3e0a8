"""An add-on of Blender: cloth of objects is baked by taichi_cloth in a process of its own, and comes back as their caches.

This file is all of it, and runs in Blender's Python: nothing of the package is imported here. Install it from the preferences,
and name there the Python that has taichi_cloth. Objects are set up in their physics tab; the bake is there too. All of a bake
is in a folder beside the .blend: a copy of that, the scene as a script that `taichi-cloth run` takes, the run, the caches.
"""

import json
import os
import pathlib
import subprocess
import tempfile
import time

import bpy
from bpy.props import EnumProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

bl_info = {"name": "taichi_cloth", "author": "the taichi_cloth authors", "version": (0, 2, 0), "blender": (4, 2, 0),
           "category": "Physics", "location": "Properties > Physics", "description": "Implicit cloth simulation"}
OWN = "taichi_cloth"  # name of the modifier
known_fabrics: list[str] = []  # asked for once


class Problem(Exception):
    """A sentence for whoever bakes."""


class Preferences(bpy.types.AddonPreferences):
    """Preferences of the add-on."""

    bl_idname = __name__
    python: StringProperty(name="Python", subtype="FILE_PATH", description="The Python in which taichi_cloth is installed",
                           default=os.environ.get("TAICHI_CLOTH_PYTHON", ""))

    def draw(self, context) -> None:
        """Its one line."""
        self.layout.prop(self, "python")


def fabrics(self, context, text: str) -> list[str]:
    """Names for the field of the fabric."""
    if not known_fabrics:
        try:
            told = subprocess.run([python(), "-c", "import taichi_cloth; print(*taichi_cloth.fabrics)"], capture_output=True,
                                  text=True, check=True, timeout=60).stdout
        except (Problem, OSError, subprocess.SubprocessError):
            return []
        known_fabrics.extend(told.split())
    return [name for name in known_fabrics if text.lower() in name]


class OfObject(bpy.types.PropertyGroup):
    """The part of an object in a bake."""

    role: EnumProperty(name="Role", items=[("NONE", "None", "It takes no part"), ("CLOTH", "Cloth", "It is simulated"),
                                           ("COLLIDER", "Collider", "Cloth meets it, as it moves")])
    fabric: StringProperty(name="Fabric", default="shirting", search=fabrics,
                           description="One that `taichi-cloth fabrics` lists")
    pins: StringProperty(name="Pins", description="Vertex group: weight 1 is held, weights below by springs")
    stiffness: FloatProperty(name="Pin stiffness", default=20.0, min=1e-6, description="Of a pin at weight one half [N/m]")
    thickness: FloatProperty(name="Thickness", default=0.004, min=1e-6, precision=4, description="Of contact [m]")
    friction: FloatProperty(name="Friction", default=0.3, min=0.0, description="Coulomb's coefficient")


class OfScene(bpy.types.PropertyGroup):
    """Settings of the bake as a whole."""

    folder: StringProperty(name="Folder", subtype="DIR_PATH", default="//taichi_cloth", description="For all that is baked")
    last: IntProperty(name="Last frame", default=0, min=0, description="0: the scene's; the first is always the scene's")


def python() -> str:
    """The Python that has taichi_cloth."""
    said = bpy.context.preferences.addons.get(__name__)
    path = said.preferences.python if said else os.environ.get("TAICHI_CLOTH_PYTHON", "")
    if not path:
        raise Problem("Name the Python that has taichi_cloth in the add-on's preferences")
    if not os.path.isfile(bpy.path.abspath(path)):
        raise Problem(f"No such Python: {path} (in the add-on's preferences)")
    return bpy.path.abspath(path)


def parts(scene, role: str) -> list:
    """Objects of a role."""
    return [item for item in scene.objects if item.type == "MESH" and item.taichi_cloth.role == role]


def script(scene, last: int) -> str:
    """The scene for `taichi-cloth run`."""
    fps = scene.render.fps / scene.render.fps_base
    gravity = tuple(scene.gravity) if scene.use_gravity else (0.0, 0.0, 0.0)
    lines = ['"""Cloth of a .blend, as its add-on wrote it."""', "import pathlib", "", "import taichi_cloth as tc", "",
             'FILE = pathlib.Path(__file__).with_name("scene.blend")',
             f'RUN = {{"duration": {(last - scene.frame_start) / fps!r}, "fps": {fps!r}}}', "", "",
             "def build() -> tc.Scene:", f"    scene = tc.Scene(gravity={(gravity[0], gravity[2], -gravity[1])!r})"]
    for k, item in enumerate(parts(scene, "CLOTH")):
        own = item.taichi_cloth
        lines += [f"    mesh = tc.load(FILE, only={item.name!r})",
                  f"    cloth{k} = scene.add_cloth(mesh, tc.fabrics[{own.fabric!r}], name={item.name!r},",
                  f"                             contact=tc.ClothContact({own.thickness:.6g}, friction={own.friction:.6g}))"]
        if own.pins:
            lines.append(f"    scene.pin(cloth{k}, {own.pins!r}, stiffness={own.stiffness:.6g})")
    for item in parts(scene, "COLLIDER"):
        own = item.taichi_cloth
        lines.append(f"    scene.add_solid(tc.load_solid(FILE, only={item.name!r}), friction={own.friction:.6g},\n"
                     f"                    thickness={own.thickness:.6g}, name={item.name!r})")
    return "\n".join([*lines, "    return scene", ""])


class Bake:
    """A bake that goes on: a copy of the file, a script, and two processes one after the other.

    Attributes:
        count: frames that there will be.
    """

    def __init__(self, scene) -> None:
        self.scene, last = scene, scene.taichi_cloth.last or scene.frame_end
        self.count = last - scene.frame_start + 1
        self.program = python()
        self._refuse(scene, last)
        self.folder = pathlib.Path(bpy.path.abspath(scene.taichi_cloth.folder))
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            (self.folder / "scene.py").write_text(script(scene, last), encoding="utf-8")
        except OSError as error:
            raise Problem(f"Cannot write to {self.folder}: {error.strerror or error}") from None
        bpy.ops.wm.save_as_mainfile(filepath=str(self.folder / "scene.blend"), copy=True, check_existing=False)
        run = self.folder / "run"
        self.frames = run / "frames"
        file, copy, baked = (str(self.folder / name) for name in ("scene.py", "scene.blend", "baked.blend"))
        self.words = [["run", file, "--out", str(run), "--overwrite", "--no-images"],
                      ["blend", str(run), "--onto", copy, "--to", baked]]
        self.begun, self.told = time.time(), tempfile.TemporaryFile()
        self.process = self.started()

    def _refuse(self, scene, last: int) -> None:
        cloths = parts(scene, "CLOTH")
        if not cloths:
            raise Problem("No object has the role Cloth (in its physics tab)")
        if scene.taichi_cloth.folder.startswith("//") and not bpy.data.filepath:
            raise Problem("Save the file first: the bake goes beside it, or name a folder")
        if last <= scene.frame_start:
            raise Problem(f"The last frame, {last}, must come after the scene's first, {scene.frame_start}")
        for item in cloths:
            if item.taichi_cloth.pins and item.taichi_cloth.pins not in item.vertex_groups:
                raise Problem(f"{item.name}: no vertex group {item.taichi_cloth.pins!r} for pins")

    def started(self) -> subprocess.Popen:
        """The next process."""
        given = dict(os.environ)
        if bpy.app.binary_path:
            given["TAICHI_CLOTH_BLENDER"] = bpy.app.binary_path
        return subprocess.Popen([self.program, "-m", "taichi_cloth", *self.words.pop(0)], env=given, cwd=self.folder,
                                stdin=subprocess.DEVNULL, stdout=self.told, stderr=subprocess.STDOUT)

    def goes_on(self) -> bool:
        """Whether there is something to wait for; False once caches are on the objects."""
        code = self.process.poll()
        if code is None:
            return True
        if code:
            raise Problem(self.reason())
        if self.words:
            self.process = self.started()
            return True
        put(self.folder / "baked_cache" / "caches.json")
        return False

    def reason(self) -> str:
        """The last error of the process."""
        self.told.seek(0)
        lines = [line.strip() for line in self.told.read().decode("utf-8", "replace").splitlines() if line.strip()]
        errors = [line for line in lines if line.startswith("error: ") or "Error" in line]
        return (errors or lines or [f"taichi_cloth ended with code {self.process.returncode}"])[-1].removeprefix("error: ")

    def part(self) -> float:
        """Part of the frames that is there, 0 to 1."""
        made = [file for file in self.frames.glob("*.npz") if file.stat().st_mtime >= self.begun]
        return min(len(made) / self.count, 1.0)

    def end(self) -> None:
        """Ends the process, if it runs still."""
        if self.process.poll() is None:
            self.process.terminate()
            self.process.wait()
        self.told.close()


def put(listed: pathlib.Path) -> None:
    """Gives objects of the open file their caches."""
    for cache in json.loads(listed.read_text(encoding="utf-8")):
        item = bpy.data.objects.get(cache["object"])
        if item is None:
            raise Problem(f"{cache['object']} is gone; its cache is {listed.parent / cache['file']}")
        old = item.modifiers.get(OWN)
        if old is not None:
            item.modifiers.remove(old)
        made = item.modifiers.new(OWN, "MESH_CACHE")
        made.cache_format, made.interpolation, made.filepath = "PC2", "LINEAR", place(listed.parent / cache["file"])
        made.frame_start, made.frame_scale = cache["start"], cache["scale"]
        item.modifiers.move(len(item.modifiers) - 1, item.modifiers.find(cache["before"]) + 1)


def place(file: pathlib.Path) -> str:
    """A path as the open file has it: beside it where it is, else the whole."""
    home = os.path.dirname(bpy.data.filepath)
    return bpy.path.relpath(str(file)) if home and str(file).startswith(home + os.sep) else str(file)


class BakeOperator(bpy.types.Operator):
    """Simulates all cloth from the scene's first frame on, and gives the objects their caches."""

    bl_idname, bl_label, bl_options = "taichi_cloth.bake", "Bake", {"UNDO"}

    def execute(self, context):
        """Bakes and waits, as scripts and the background have it."""
        bake = None
        try:
            bake = Bake(context.scene)
            while bake.goes_on():
                time.sleep(0.1)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        finally:
            if bake is not None:
                bake.end()
        return {"FINISHED"}

    def invoke(self, context, event):
        """Bakes while Blender goes on."""
        try:
            self.bake = Bake(context.scene)
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return {"CANCELLED"}
        self.timer = context.window_manager.event_timer_add(0.25, window=context.window)
        context.window_manager.progress_begin(0, 100)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Shows how far it is; Esc ends it."""
        if event.type == "ESC":
            return self.over(context, {"CANCELLED"}, "The bake was ended; caches are as they were")
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        try:
            if self.bake.goes_on():
                done = self.bake.part()
                context.window_manager.progress_update(100 * done)
                context.workspace.status_text_set(f"taichi_cloth: {100 * done:.0f} % of {self.bake.count} frames; Esc ends it")
                return {"PASS_THROUGH"}
        except Problem as problem:
            self.report({"ERROR"}, str(problem))
            return self.over(context, {"CANCELLED"})
        return self.over(context, {"FINISHED"}, f"{self.bake.count} frames are baked")

    def cancel(self, context) -> None:
        """Called by Blender where another file is opened meanwhile."""
        self.bake.end()

    def over(self, context, result, told=""):
        """Ends timer, process and progress."""
        self.bake.end()
        context.window_manager.event_timer_remove(self.timer)
        context.window_manager.progress_end()
        context.workspace.status_text_set(None)
        if told:
            self.report({"INFO"}, told)
        return result


class Panel(bpy.types.Panel):
    """In the physics tab of a mesh."""

    bl_idname, bl_label = "PHYSICS_PT_taichi_cloth", "taichi_cloth"
    bl_space_type, bl_region_type, bl_context = "PROPERTIES", "WINDOW", "physics"

    @classmethod
    def poll(cls, context) -> bool:
        """Shown for meshes alone."""
        return context.object is not None and context.object.type == "MESH"

    def draw(self, context) -> None:
        """The object's fields, then those of the bake."""
        own, whole, layout = context.object.taichi_cloth, context.scene.taichi_cloth, self.layout
        layout.use_property_split = True
        layout.prop(own, "role")
        if own.role == "CLOTH":
            layout.prop(own, "fabric")
            layout.prop_search(own, "pins", context.object, "vertex_groups")
            layout.prop(own, "stiffness")
        if own.role != "NONE":
            layout.prop(own, "thickness")
            layout.prop(own, "friction")
        layout.prop(whole, "folder")
        layout.prop(whole, "last")
        layout.operator(BakeOperator.bl_idname, icon="PHYSICS")


CLASSES = (Preferences, OfObject, OfScene, BakeOperator, Panel)


def register() -> None:
    """Called by Blender."""
    for one in CLASSES:
        bpy.utils.register_class(one)
    bpy.types.Object.taichi_cloth = PointerProperty(type=OfObject)
    bpy.types.Scene.taichi_cloth = PointerProperty(type=OfScene)


def unregister() -> None:
    """Called by Blender."""
    del bpy.types.Object.taichi_cloth, bpy.types.Scene.taichi_cloth
    for one in reversed(CLASSES):
        bpy.utils.unregister_class(one)
