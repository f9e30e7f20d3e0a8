"""How near two pieces of cloth are, by all vertices of each and all triangles of the other."""

import numpy as np


def to_triangle(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Distances [m] of points p (n, 1, 3) from triangles with corners a, b, c (1, m, 3): (n, m)."""
    normal = np.cross(b - a, c - a)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    height = np.einsum("nmi,nmi->nm", p - a, np.broadcast_to(normal, (len(p), *normal.shape[1:])))
    inside = np.ones_like(height, dtype=bool)
    near = np.full_like(height, np.inf)
    for q, r in ((a, b), (b, c), (c, a)):
        side = r - q
        inside &= np.einsum("nmi,mi->nm", p - q, np.cross(normal, side)[0]) >= 0
        along = np.clip(np.einsum("nmi,mi->nm", p - q, side[0]) / np.sum(side**2, axis=-1), 0, 1)
        near = np.minimum(near, np.linalg.norm(p - q - along[..., None] * side, axis=-1))
    return np.where(inside, np.abs(height), near)


def apart(x: np.ndarray, y: np.ndarray, faces: np.ndarray) -> float:
    """The least distance [m] between cloths of one mesh at x and y (n, 3), of vertices of one from triangles of the other."""
    return min(float(to_triangle(p[:, None], *(q[faces[:, k]][None] for k in range(3))).min()) for p, q in ((x, y), (y, x)))
