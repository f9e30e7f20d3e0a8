"""Whether solids leave cloth room where a step ends inside them, or across. numpy only.

Such a step is tried smaller, however small it gets, and is taken as it is only where no step can do better. There cloth
is between two surfaces that face each other nearer than it should keep from both, or is pinned itself.
"""

from dataclasses import dataclass

import numpy as np

from .pairs import Pairs
from .vertices import VertexContacts

ABOVE = 1e-2  # of the thickness that a wall must be above another's plane for there to be room between
FACING = -0.5  # cosine between the normals of two surfaces below which they face each other


@dataclass(frozen=True)
class Walls:
    """Places of solids that cloth is near.

    Attributes:
        particles: (k, 3) the cloth's there.
        solid: (k,) index.
        point: (k, 3) on the solid's surface [m]; normal: (k, 3) from the solid to the cloth.
    """

    particles: np.ndarray
    solid: np.ndarray
    point: np.ndarray
    normal: np.ndarray


def walls(found: VertexContacts, near: Pairs | None, x: np.ndarray, thickness: np.ndarray) -> Walls:
    """Surfaces that particles at x (n, 3) touch, and the places of pairs; thickness (solids,) [m]."""
    height = found.gap + thickness[found.solid]
    parts = [(np.repeat(found.index[:, None], 3, axis=1), found.solid, x[found.index] - height[:, None] * found.normal,
              found.normal)]
    if near is not None:
        parts.append((near.vertices, near.solid, near.point - near.distance[:, None] * near.normal, near.normal))
    return Walls(*(np.concatenate(rows) for rows in zip(*parts)))


def has_room(rows: np.ndarray, faces: np.ndarray, around: Walls, thickness: np.ndarray, yields: np.ndarray,
             pinned: np.ndarray) -> np.ndarray:
    """(k,) whether there is room for the places of cloth whose particles are rows (k, 3).

    Args:
        faces: (m, 3) of the cloth: particles that share one with a place are near it.
        thickness: (solids,) [m]; yields: (solids,) whether a solid deforms, and so may close on itself.
        pinned: (n,) whether pins hold a particle.
    """
    out = ~pinned[rows].all(axis=1)
    for k in np.flatnonzero(out):
        close = faces[np.isin(faces, rows[k]).any(axis=1)]
        mine = np.flatnonzero(np.isin(around.particles, close).any(axis=1))
        out[k] = not _closes(mine, around, thickness, yields)
    return out


def _closes(mine: np.ndarray, w: Walls, thickness: np.ndarray, yields: np.ndarray) -> bool:
    """Whether two of some walls face each other and are nearer than both keep."""
    n, p, s = w.normal[mine], w.point[mine], w.solid[mine]
    between = np.einsum("ij,kij->ki", n, p[:, None] - p[None, :])  # of wall k above the plane of wall i
    facing = n @ n.T < FACING
    near = between < thickness[s][:, None] + thickness[s][None, :]
    above = between > ABOVE * thickness[s][:, None]  # both ways, or they are the sides of a point or an edge
    apart = (s[:, None] != s[None, :]) | yields[s][None, :] | (above & above.T)  # else one body lies between them
    return bool((facing & near & apart).any())
