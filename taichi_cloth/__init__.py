"""taichi_cloth: implicit cloth simulation after Baraff and Witkin (1998), on Taichi kernels.

Names are loaded when first used, so that describing a scene does not start Taichi.
"""

import importlib
import os
import sys

from .keywords import suggesting

for name in ("TAICHI", "QUADRANTS"):
    os.environ.setdefault(f"ENABLE_{name}_HEADER_PRINT", "0")  # read when it is imported, wherever that is
for name in ("TI", "QD"):
    os.environ.setdefault(f"{name}_SKIP_VERSION_CHECK", "ON")  # else each start asks a server for news, in a thread
del name
if os.name == "posix" and "HOME" not in os.environ:  # Taichi ends the process then, as under some services
    home = os.path.expanduser("~")
    os.environ["HOME"] = home if os.path.isabs(home) else os.sep
    del home

__version__ = "0.2.0"

_NAMES = {
    "scene.mesh": "TriMesh",
    "scene.shapes": "grid strip equilateral_strip disk cylinder",
    "io": "load",
    "io.solid": "load_solid",
    "scene.fabric": "Stretch Shear Bend Fabric ClothContact",
    "scene.fabrics": "fabrics bends",
    "scene.garment": "Garment", "io.garment": "load_garment",
    "garment": "load_pattern",
    "garment.stitched": "load_stitched",
    "garment.remesh": "remesh",
    "garment.pattern": "Pattern Panel", "garment.stitch": "Stitch",
    "garment.curves": "Curve",
    "garment.dressing": "dress", "garment.fitted": "fitted", "garment.worn": "Worn",
    "scene.scene": "Scene", "scene.cloth": "Cloth", "scene.air": "Air Gusts",
    "scene.primitives": "Plane Sphere Capsule Box Cylinder", "scene.solids": "SolidMesh Solid Prop",
    "scene.tear": "Tear",
    "scene.view": "Camera View",
    "scene.appearance": "Appearance Texture Weave",
    "forces.membrane_law": "MembraneLaw", "forces.bend_law": "BendLaw",
    "system.constraints": "Constraint",
    "options": "Options",
    "simulation": "Simulation",
    "recording.recorded": "Recording",
    "recording.still": "render render_frames passes",
    "sweeps.sweep": "sweep",
    "fitting.fit": "fit",
    "live.view": "view",
    "app.cli": "run", "app.recorder": "record",
    "errors": "ClothError MeshError SceneError BackendError OutputError ScriptError SimulationError",
}
_SHOWN = ("Scene", "Simulation")  # in notebooks by recording.shown; browsers by live.view: beyond the rooms that they are in
_SUGGESTING: set[str] = set()  # names whose errors about keywords suggest the right ones
_WHERE = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = ["__version__", *_WHERE]


def __getattr__(name: str):
    if name in _WHERE:
        module = importlib.import_module(f".{_WHERE[name]}", __name__)
        if name not in _SUGGESTING:
            _suggest()
        found = getattr(module, name)
        if name in _SHOWN:
            found._repr_html_ = _in_html
        if name == "Simulation":
            found.view = _view
        return found
    if name == "ti":  # the language of kernels, for laws of one's own
        return importlib.import_module(".backend.language", __name__).ti
    from .errors import nearest

    near = None if name.startswith("_") else nearest(name, __all__)
    hint = f"; did you mean {near!r}?" if near else ""
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}", name=name, obj=None)  # no hint of Python's


def _suggest() -> None:
    """Errors about keywords suggest the right ones in all public names whose modules are loaded."""
    for name, where in _WHERE.items():
        module = sys.modules.get(f"{__name__}.{where}")
        if hasattr(module, name):
            setattr(module, name, suggesting(getattr(module, name)))
            _SUGGESTING.add(name)


def _in_html(what) -> str:
    """A scene or a simulation in a notebook."""
    from .recording.shown import in_html

    return in_html(what)


def _view(sim, **options) -> None:
    """Shows the simulation in the browser as it goes on: `tc.view` with its arguments."""
    from .live.view import view

    view(sim, **options)


def __dir__() -> list[str]:
    return sorted(__all__)
