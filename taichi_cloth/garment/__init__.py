"""Garments: patterns of panels and stitches, meshed, placed and sewn. Meshing needs SciPy, the extra `garment`."""

from pathlib import Path

from .. import checks
from ..errors import SceneError
from .garmentcode import read_garmentcode
from .pattern import Pattern
from .stitched import StitchedPattern


def load_pattern(path: str | Path, side: str | Path | None = None) -> Pattern | StitchedPattern:
    """A sewing pattern from a file in GarmentCode's JSON format, from panels drawn in an SVG, or from meshed panels in an OBJ.

    Args:
        side: of an SVG, the JSON file with its stitches, labels and placement (see `garment.svg`); the one of its name where
            None. Of an OBJ, the .csv with its stitches (see `load_stitched`); its own lines where None.

    Raises:
        SceneError: a missing or unreadable file, or a pattern that cannot be sewn, with the panel or stitch that is wrong.
    """
    path = checks.path("path", path, SceneError)
    if path.suffix.lower() in (".svg", ".svgz"):
        from .svg import read_svg

        return read_svg(path, None if side is None else checks.path("side", side, SceneError))
    if path.suffix.lower() == ".obj":
        return StitchedPattern(path, side)
    if path.suffix.lower() != ".json":
        raise SceneError(f"{path}: patterns are read from .json files in GarmentCode's format, from .svg and from .obj files")
    if side is not None:
        raise SceneError(f"{path}: has its stitches itself: only an SVG or an OBJ has a side file")
    return read_garmentcode(path)
