"""Files with a scene: parts that move by joints, morph targets, transforms and caches. Each reader is imported where used."""

from __future__ import annotations

import importlib
from pathlib import Path

from ...errors import ClothError, MeshError
from .motion import Motion, Wanted

READERS = {".glb": "gltf", ".gltf": "gltf", ".usd": "usd", ".usda": "usd", ".usdc": "usd", ".usdz": "usd",
           ".abc": "blender", ".fbx": "blender", ".blend": "blender"}


def read(path: Path, wanted: Wanted) -> Motion:
    """The parts of a file.

    Raises:
        MeshError: it is missing, damaged, or has no mesh; or the package that reads it is not installed.
    """
    reader = importlib.import_module(f".{READERS[path.suffix.lower()]}", __name__)
    try:
        return reader.read(path, wanted)
    except ClothError as error:
        raise type(error)(f"{path}: {error}") from None
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise MeshError(f"{path}: is too large for this machine's memory") from None
    except Exception as error:  # of damaged files, in as many ways as there are fields
        raise MeshError(f"{path}: is damaged: {type(error).__name__}: {error}") from None
