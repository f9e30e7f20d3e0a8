"""Attachment to a solid: vertices ride at the nearest place of its surface, in that place's own frame. numpy only."""

from dataclasses import dataclass

import numpy as np

from .closest import closest
from .solids import Placed, SolidMesh

CHUNK = 1 << 21  # pairs of a point and a triangle that are looked at together
ROUNDING = 1 + 1e-9  # by which distances may be off


@dataclass(frozen=True)
class Places:
    """Places on or near a solid.

    Attributes:
        faces: (k, 3) vertices of the solid's surface, for solids that deform; None for those that do not.
        weights: (k, 3) of the nearest place of that triangle.
        offset: (k, 3) from it, in the triangle's frame [m]; of a solid that does not deform, the places in its own frame.
    """

    faces: np.ndarray | None
    weights: np.ndarray
    offset: np.ndarray

    def at(self, solid: Placed, t: float) -> np.ndarray:
        """(k, 3) where they are at time t [s]."""
        R, p = solid.pose(t)
        if self.faces is None:
            return self.offset @ R.T + p
        assert isinstance(solid.shape, SolidMesh)
        corner = solid.shape.shape_at(t)[self.faces] @ R.T + p
        return np.einsum("ka,kai->ki", self.weights, corner) + np.einsum("kij,kj->ki", _frames(corner), self.offset)


def places(solid: Placed, t: float, points: np.ndarray) -> Places:
    """Places on a solid of points (k, 3) [m] at time t [s]."""
    if not (isinstance(solid.shape, SolidMesh) and solid.deforms):
        R, p = solid.pose(t)
        return Places(None, np.zeros((len(points), 3)), (points - p) @ R)
    x, faces = solid.surface_at(t), solid.shape.faces
    corner = x[faces]
    face, weights = np.empty(len(points), dtype=np.int64), np.empty((len(points), 3))
    middle = corner.mean(axis=1)
    reach = np.linalg.norm(corner - middle[:, None], axis=2).max(axis=1)
    step = max(1, CHUNK // len(faces))
    for first in range(0, len(points), step):
        here = points[first:first + step]
        far = np.linalg.norm(here[:, None] - middle, axis=2)
        k, f = np.nonzero(far - reach <= ROUNDING * (far + reach).min(axis=1, keepdims=True))  # one of them is the nearest
        w = closest(here[k], corner[f])
        order = np.lexsort((f, np.linalg.norm(np.einsum("ka,kai->ki", w, corner[f]) - here[k], axis=1), k))
        best = order[np.unique(k[order], return_index=True)[1]]
        face[first:first + step], weights[first:first + step] = f[best], w[best]
    mine = corner[face]
    away = points - np.einsum("ka,kai->ki", weights, mine)
    return Places(faces[face], weights, np.einsum("kij,ki->kj", _frames(mine), away))


def _frames(corner: np.ndarray) -> np.ndarray:
    """(k, 3, 3) columns: along the first edge, across it, normal, of triangles (k, 3, 3)."""
    e = corner[:, 1] - corner[:, 0]
    n = np.cross(e, corner[:, 2] - corner[:, 0])
    e, n = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300) for v in (e, n))
    return np.stack([e, np.cross(n, e), n], axis=2)
