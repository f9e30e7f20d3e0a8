"""Garments: patterns of panels and stitches, meshed, placed and sewn. Meshing needs SciPy, the extra `garment`."""

from pathlib import Path

from .. import checks
from ..errors import SceneError
from .garmentcode import read_garmentcode
from .pattern import Pattern


def load_pattern(path: str | Path) -> Pattern:
    """A sewing pattern from a file in GarmentCode's JSON format.

    Raises:
        SceneError: a missing or unreadable file, or a pattern that cannot be sewn, with the panel or stitch that is wrong.
    """
    path = checks.path("path", path, SceneError)
    if path.suffix.lower() != ".json":
        raise SceneError(f"{path}: patterns are read from .json files in GarmentCode's format")
    return read_garmentcode(path)
