"""Are a file's texture coordinates the pattern that the cloth was cut from?"""

import numpy as np

from ..errors import MeshError
from ..scene.mesh import flatten

AS_IS = 1.2  # lengths of pattern and mesh that agree to this factor are taken to be the same metres
BAD_STRETCH = 2.0  # a triangle stretched or squeezed by more than this, after scaling, is badly mapped
BAD_SHARE = 0.1  # share of the area that may be so


def fit_pattern(x: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray,
                scale: float) -> tuple[np.ndarray | None, str]:
    """Material coordinates from texture coordinates.

    Args:
        x: (n, 3) positions [m], already scaled.
        corner_uv: (m, 3, 2) as in the file.
        scale: metres per unit of the file.

    Returns:
        (m, 3, 2) material coordinates [m], or None where the file's have no area or are distorted beyond sense,
        and a sentence that says what was done (empty where they were taken as they are).

    Raises:
        MeshError: a triangle without area in coordinates that make sense elsewhere.
    """
    rest, uv = _edges(flatten(x, faces)), _edges(corner_uv)
    area, area_uv = np.abs(np.linalg.det(rest)) / 2, np.abs(np.linalg.det(uv)) / 2
    if not (area_uv > 0).any():
        return None, "the file's texture coordinates have no area and are ignored"
    ratio = np.sqrt(area.sum() / area_uv.sum())
    as_is = 1 / AS_IS <= ratio / scale <= AS_IS
    factor = scale if as_is else ratio
    missing = np.flatnonzero(area_uv <= 1e-12 * area_uv.max())
    there = np.setdiff1d(np.arange(len(faces)), missing)
    stretch = np.linalg.svd(rest[there] @ np.linalg.inv(uv[there] * factor), compute_uv=False)
    bad = (stretch[:, 0] > BAD_STRETCH) | (stretch[:, 1] < 1 / BAD_STRETCH)
    share = (area[there][bad].sum() + area[missing].sum()) / area.sum()
    if share > BAD_SHARE:
        return None, (f"the file's texture coordinates are refused, they are no pattern: scaled to the mesh's area they "
                      f"misfit {share:.0%} of it by more than {BAD_STRETCH:g} times (worst: triangle "
                      f"{there[np.argmax(stretch[:, 0])]})")
    if len(missing):
        raise MeshError(f"triangle {missing[0]} has no area in the texture coordinates ({len(missing)} such triangles);"
                        " repair them, or uv='flatten' ignores them all")
    if as_is:
        return corner_uv * factor, ""
    return corner_uv * factor, (f"texture coordinates scaled by {factor:.4g} to the mesh's area: pattern and given shape "
                                f"differ by {np.sqrt(np.mean((stretch - 1) ** 2)):.0%} in length (RMS)")


def _edges(corners: np.ndarray) -> np.ndarray:
    """(m, 2, 2) with the edges 0-1 and 0-2 as columns."""
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)
