"""Garments: patterns of panels and stitches, meshed, placed and sewn. Meshing needs SciPy, the extra `garment`."""

from pathlib import Path

from .. import checks
from ..errors import SceneError
from ..io import UP
from .garmentcode import read_garmentcode
from .pattern import Pattern
from .stitched import StitchedPattern


def load_pattern(path: str | Path, side: str | Path | None = None, scale: float = 1.0,
                 up: str = "y") -> Pattern | StitchedPattern:
    """A sewing pattern from a file in GarmentCode's JSON format, from panels drawn in an SVG, or from meshed panels in an OBJ.

    Args:
        side: of an SVG, the JSON file with its stitches, labels and placement (see `garment.svg`); the one of its name where
            None. Of an OBJ, the .csv with its stitches (see `load_stitched`); its own lines where None.
        scale: of an OBJ, metres per unit of the file; others name their units.
        up: of an OBJ, the file's axis that points up, "y" or "z"; others place their panels themselves.

    Raises:
        SceneError: a missing or unreadable file, or a pattern that cannot be sewn, with the panel or stitch that is wrong.
    """
    path = checks.path("path", path, SceneError)
    scale, up = checks.number("scale", scale, positive=True), checks.choice("up", up, UP)
    if (scale, up) != (1.0, "y") and path.suffix.lower() in (".svg", ".svgz", ".json"):
        raise SceneError(f"{path}: has its units and its axes itself: only an OBJ has a scale and an axis up")
    if path.suffix.lower() in (".svg", ".svgz"):
        from .svg import read_svg

        return read_svg(path, None if side is None else checks.path("side", side, SceneError))
    if path.suffix.lower() == ".obj":
        return StitchedPattern(path, side, scale, up)
    if path.suffix.lower() != ".json":
        raise SceneError(f"{path}: patterns are read from .json files in GarmentCode's format, from .svg and from .obj files")
    if side is not None:
        raise SceneError(f"{path}: has its stitches itself: only an SVG or an OBJ has a side file")
    return read_garmentcode(path)
