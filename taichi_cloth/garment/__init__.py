"""Garments: patterns of panels and stitches, meshed, placed and sewn. Meshing needs SciPy, the extra `garment`."""

from pathlib import Path

from .. import checks
from ..errors import SceneError
from ..io import UP
from .garmentcode import read_garmentcode
from .pattern import Pattern
from .stitched import StitchedPattern

OWN_UNITS, WITH_SIDE = (".svg", ".svgz", ".json"), (".svg", ".svgz", ".dxf", ".obj")


def load_pattern(path: str | Path, side: str | Path | None = None, scale: float = 1.0, up: str = "y",
                 size: str | None = None) -> Pattern | StitchedPattern:
    """Reads a sewing pattern from a file.

    Formats: GarmentCode's JSON, panels drawn in an SVG, a DXF of the apparel trade (AAMA, ASTM D6673; needs the extra
    `dxf`), and meshed panels in an OBJ.

    Args:
        side: for an SVG or a DXF, the JSON file with its stitches, labels and placement (see `garment.sidefile`); None takes
            the one of its name. For an OBJ, the .csv with its stitches (see `load_stitched`); None takes its own lines.
        scale: metres per unit of the file, for an OBJ and for a DXF that names no unit; others name their units.
        up: the file's axis that points up, "y" or "z", for an OBJ; others place their panels themselves.
        size: name of one of a DXF's sizes, if it has several.

    Raises:
        SceneError: a missing or unreadable file, or a pattern that cannot be sewn, with the panel or stitch that is wrong.
    """
    path = checks.path("path", path, SceneError)
    scale, up = checks.number("scale", scale, positive=True), checks.choice("up", up, UP)
    kind = path.suffix.lower()
    size = checks.maybe(size, checks.name, "size")
    if (scale != 1.0 and kind in OWN_UNITS) or (up != "y" and kind in (*OWN_UNITS, ".dxf")):
        raise SceneError(f"{path}: has its units and its axes itself: only an OBJ has a scale and an axis up")
    if size is not None and kind != ".dxf":
        raise SceneError(f"{path}: has one size: only a DXF may have several")
    beside = checks.path("side", side, SceneError) if side is not None and kind in WITH_SIDE else None
    if kind == ".dxf":
        from .dxf import read_dxf

        return read_dxf(path, beside, size, None if scale == 1.0 else scale)
    if kind in (".svg", ".svgz"):
        from .svg import read_svg

        return read_svg(path, beside)
    if kind == ".obj":
        return StitchedPattern(path, beside, scale, up)
    if kind != ".json":
        raise SceneError(f"{path}: patterns are read from .json files in GarmentCode's format, from .svg, .dxf and .obj files")
    if side is not None:
        raise SceneError(f"{path}: has its stitches itself: only an SVG, a DXF or an OBJ has a side file")
    return read_garmentcode(path)
