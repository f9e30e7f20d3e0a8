"""Are a file's texture coordinates the pattern that the cloth was cut from, or only where images go?"""

import numpy as np

from ..scene.ownshape import flatten, stretches, twice_area

SAME = 0.03  # lengths on pattern and mesh that differ by no more are the same; cloth may hang a little stretched
MOST = 0.5  # part of a pattern that has the mesh's lengths at least: wide triangles may join panels that are not sewn yet
UNLIKE = 0.1  # lengths that differ by more are told of where the pattern was asked for
UNITS = {1.0: "metres", 0.01: "centimetres", 0.001: "millimetres"}


def fit_pattern(x: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray, scale: float) -> tuple[np.ndarray | None, bool, str]:
    """Material coordinates from texture coordinates, where these have the mesh's own lengths.

    Args:
        x: (n, 3) positions [m], already scaled.
        corner_uv: (m, 3, 2) as in the file, some triangle with area.
        scale: metres per unit of the file.

    Returns:
        (m, 3, 2) material coordinates [m], or None if their lengths differ from the mesh's; whether the texture coordinates
        are kept besides, for images; and a sentence on it (empty if they are the pattern, in the file's unit).
    """
    own = flatten(x, faces)
    shape = ("the mesh's own shape is the rest shape, as with uv='flatten', and they stay for images and exports; "
             "uv='pattern' takes them as the pattern")
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        area, area_uv = np.abs(twice_area(own)), np.abs(twice_area(corner_uv))
        if not area_uv.all():
            return None, True, (f"the file's texture coordinates are not a pattern: triangle {np.argmin(area_uv)} has no area "
                                f"in them ({int((area_uv == 0).sum())} such triangles): {shape}")
        lengths, ratio = stretches(corner_uv, own), float(np.sqrt(area.sum() / area_uv.sum()))
        for unit in dict.fromkeys((scale, *UNITS)):
            same = (np.abs(lengths / unit - 1) <= SAME).all(axis=1)
            share = float(area_uv[same].sum() / area_uv.sum())
            if share >= MOST:
                return corner_uv * unit, False, _said(unit, scale, share if _misfit(lengths / unit, area) > SAME else 1.0)
        misfit = _misfit(lengths / ratio, area)
    if misfit <= SAME:
        return corner_uv * ratio, True, (f"texture coordinates scaled by {ratio:.4g} are the pattern, as they have the mesh's "
                                         "lengths then; uv='pattern' takes them as they are, uv='flatten' the mesh's own "
                                         "shape")
    return None, True, (f"the file's texture coordinates are not a pattern: scaled to the mesh's area, their lengths differ "
                        f"from the mesh's by {misfit:.0%} (RMS): {shape}")


def unlike(x: np.ndarray, faces: np.ndarray, material: np.ndarray) -> str:
    """A sentence on a pattern (m, 3, 2) [m] whose lengths are not those of the mesh; empty if they are, to a tenth."""
    own = flatten(x, faces)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        misfit = _misfit(stretches(material, own), np.abs(twice_area(own)))
    if misfit <= UNLIKE:
        return ""
    return (f"uv='pattern': the mesh's lengths differ from the pattern's by {misfit:.0%} (RMS), so that the cloth starts "
            "stretched or squeezed; texture coordinates from 0 to 1 are seldom a pattern")


def _said(unit: float, scale: float, share: float) -> str:
    """A note on coordinates that are a pattern; share: part of it that has the mesh's lengths."""
    where = f", in {UNITS[unit]}" if unit != scale else ""
    if share < 1:
        return (f"the file's texture coordinates are the pattern{where}: {share:.0%} of it has the mesh's lengths, the rest "
                "is placed stretched or squeezed; uv='flatten' takes the mesh's own shape")
    return f"the file's texture coordinates are the pattern{where}" if where else ""


def _misfit(lengths: np.ndarray, area: np.ndarray) -> float:
    """Root of the mean square, over the area, of by how much stretches (m, 2) differ from 1."""
    return float(np.sqrt(((lengths - 1) ** 2).mean(axis=1) @ area / area.sum()))
