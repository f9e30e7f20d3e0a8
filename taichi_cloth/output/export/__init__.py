"""Recorded runs as files that other tools read: one format a module, each with `write(recording, folder, fields)`.

All are in metres with y up; positions are the recorded float32. Each returns the files that it wrote.
"""

import importlib
import pathlib
from collections.abc import Callable

import numpy as np

from ... import checks
from ...errors import OutputError
from ..recording import Recording
from .pieces import PARTS, cut

FORMATS = {"pc2": "pc2", "usda": "usd", "usdc": "usd", "vtu": "vtu", "ply": "ply"}
Fields = dict[str, Callable[[dict[str, np.ndarray]], np.ndarray]]


def export(recording: Recording, format: str, folder: pathlib.Path, fields: Fields,
           parts: str = "cloths") -> list[pathlib.Path]:
    """Writes a run in a format.

    Args:
        fields: by name, functions of a frame that give (n,) or (n, 3) values on vertices; for formats that have them.
        parts: one mesh for each of the "cloths", of the "panels" of garments, or garments "welded" over their seams.

    Raises:
        SceneError: an unknown format.
        OutputError: no frames, files that cannot be written, a package that is not there.
    """
    checks.choice("format", format, FORMATS)
    pieces = cut(recording, checks.choice("parts", parts, PARTS))
    recording.frames()
    module = importlib.import_module(f"{__name__}.{FORMATS[format]}")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return module.write(pieces, folder, {name: pieces.of(field) for name, field in fields.items()}, format)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None


def uv_vertices(faces: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(different uv (k, 2), index of each corner (m, 3)) of corner coordinates (m, 3, 2): seams keep their two sides."""
    table, index = np.unique(uv.reshape(-1, 2), axis=0, return_inverse=True)
    return table, index.reshape(faces.shape)
