"""Places of triangles that are nearest to points. numpy only."""

import numpy as np


def closest(p: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """(..., 3) weights of the places of triangles (..., 3, 3) that are nearest to points (..., 3)."""
    a, b, c = (corner[..., k, :] for k in range(3))

    def on_edge(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        way = v - u
        return np.clip(((p - u) * way).sum(axis=-1) / np.maximum((way**2).sum(axis=-1), 1e-300), 0, 1)

    n = np.cross(b - a, c - a)
    size = np.maximum((n**2).sum(axis=-1), 1e-300)
    inner = np.stack([(np.cross(c - b, p - b) * n).sum(axis=-1), (np.cross(a - c, p - c) * n).sum(axis=-1),
                      (np.cross(b - a, p - a) * n).sum(axis=-1)], axis=-1) / size[..., None]
    zero, choices = np.zeros(inner.shape[:-1]), []
    for k, (u, v) in enumerate(((a, b), (b, c), (c, a))):
        t = on_edge(u, v)
        rows = [zero, zero, zero]
        rows[k], rows[(k + 1) % 3] = 1 - t, t
        choices.append(np.stack(rows, axis=-1))
    weights = np.stack(choices)
    points = np.einsum("e...a,...ai->e...i", weights, np.broadcast_to(corner, (*zero.shape, 3, 3)))
    nearest = np.linalg.norm(points - p, axis=-1).argmin(axis=0)
    border = np.take_along_axis(weights, nearest[None, ..., None], axis=0)[0]
    return np.where((inner >= 0).all(axis=-1)[..., None], inner, border)
