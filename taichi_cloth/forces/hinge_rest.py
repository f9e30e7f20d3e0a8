"""The rows of hinges: stiffness, damping and rest angle, from fabrics, creases and seams."""

import numpy as np

from ..scene.cloth import Cloth
from ..scene.fabric import pair
from ..scene.scene import Scene
from ..scene.sewing import Seam
from ..system.elements import Hinges
from .hinge import COLLAPSED


def rest_of(cloth: Cloth, h: Hinges) -> np.ndarray:
    """(hinges, 4): k [N m], k_d [N m s], theta_0, and the least squared normal [m^4]."""
    bend = next(f.bend for f in cloth.fabrics if f.bend)
    if isinstance(bend.rest, tuple):
        return _rows(cloth, h, np.array(bend.rest))  # hinges are in the order of `TriMesh.inner_edges`
    given = bend.rest == "given" or (bend.rest is None and cloth.mesh.flattened)
    return _rows(cloth, h, h.angle if given else 0.0)


def creased(scene: Scene, cloth: Cloth, h: Hinges, rest: np.ndarray) -> np.ndarray:
    """The rows `rest` (hinges, 4), with those of creased edges as their creases give them."""
    plain = rest[:, :2].copy()
    code = np.sort(h.vertices[:, :2], axis=1) @ np.array([cloth.mesh.vertex_count, 1])
    order = np.argsort(code)
    for crease in scene.creases:
        if crease.cloth is cloth:
            wanted = crease.edges @ np.array([cloth.mesh.vertex_count, 1])
            rows = order[np.searchsorted(code, wanted, sorter=order)]
            rest[rows, :2], rest[rows, 2] = crease.stiffness * plain[rows], crease.angle
    return rest


def seam_rest(seam: Seam, h: Hinges) -> np.ndarray:
    """(hinges, 4) the same for a seam's hinges."""
    return _rows(seam.cloth, h, h.angle if seam.rest == "given" else seam.rest, seam.stiffness)


def _rows(cloth: Cloth, h: Hinges, theta_0, factor: float = 1.0) -> np.ndarray:
    """Stiffness and damping of a hinge are the mean of its two sides'."""
    weight, of = factor * h.length2 / h.areas.sum(axis=1), cloth.fabric_of[h.faces]
    k, k_d = np.zeros((2, len(of)))
    for name, total in (("D", k), ("k_d", k_d)):
        values = np.array([pair(getattr(f.bend, name)) if f.bend else (0.0, 0.0) for f in cloth.fabrics])
        total[:] = weight * np.einsum("hj,hj->h", h.across, values[of].mean(axis=1))
    return np.column_stack([k, k_d, np.broadcast_to(theta_0, k.shape), least_normal(h)])


def least_normal(h: Hinges) -> np.ndarray:
    """(hinges,) squared normal [m^4] below which a triangle fades."""
    return (2 * COLLAPSED * h.areas.min(axis=1)) ** 2
