"""taichi_cloth: implicit cloth simulation after Baraff and Witkin (1998), on Taichi kernels.

Names are loaded when first used, so that describing a scene does not start Taichi.
"""

import importlib
import os

os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")  # read when taichi is imported, wherever that is

__version__ = "0.1.0"

_WHERE = {
    "TriMesh": "mesh",
    "grid": "shapes", "strip": "shapes", "equilateral_strip": "shapes", "disk": "shapes", "cylinder": "shapes",
    "load": "io", "load_solid": "io.solid",
    "Stretch": "fabric", "Shear": "fabric", "Bend": "fabric", "Fabric": "fabric",
    "ClothContact": "fabric",
    "Scene": "scene", "Cloth": "scene", "Air": "scene",
    "Plane": "solids", "Sphere": "solids", "Capsule": "solids", "Box": "solids", "Cylinder": "solids",
    "SolidMesh": "solids", "Solid": "solids",
    "Camera": "view", "View": "view",
    "Constraint": "constraints",
    "Simulation": "simulation",
    "run": "cli",
    "ClothError": "errors", "MeshError": "errors", "SceneError": "errors", "BackendError": "errors",
    "OutputError": "errors", "ScriptError": "errors", "SimulationError": "errors",
}

__all__ = ["__version__", *_WHERE]


def __getattr__(name: str):
    if name in _WHERE:
        return getattr(importlib.import_module(f".{_WHERE[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
