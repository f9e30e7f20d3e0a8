"""Exact count of crossings between triangle meshes, or of one with itself: edges through triangles. numpy only.

Signs of volumes are computed in floating point with an error bound, and in rational arithmetic where that leaves a
doubt, so that no crossing is missed or made up. Touching counts as no crossing.
"""

from fractions import Fraction

import numpy as np

from .mesh import face_edges

BOUND = 1e-14  # of the product of the three lengths: a smaller volume's sign is doubtful


def count_crossings(x_a: np.ndarray, faces_a: np.ndarray, x_b: np.ndarray, faces_b: np.ndarray) -> int:
    """Number of (edge, triangle) pairs that cross, edges of a with triangles of b and the other way round.

    Args:
        x_a, x_b: (n, 3) positions [m]; faces_a, faces_b: (m, 3).
    """
    return _through(x_a, _edges(faces_a), x_b, faces_b) + _through(x_b, _edges(faces_b), x_a, faces_a)


def count_self_crossings(x: np.ndarray, faces: np.ndarray) -> int:
    """Number of (edge, triangle) pairs of one mesh that cross; what shares a vertex does not count.

    Args:
        x: (n, 3) positions [m]; faces: (m, 3).
    """
    return _through(x, _edges(faces), x, faces, same=True)


def self_crossings(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The pairs that `count_self_crossings` counts: ends of edges (k, 2), and rows of `faces` (k,)."""
    edges = _edges(faces)
    e, t = _pairs_through(x, edges, x, faces, same=True)
    return edges[e], t


def _edges(faces: np.ndarray) -> np.ndarray:
    edges = np.unique(np.sort(face_edges(faces), axis=1), axis=0)
    return edges[edges[:, 0] != edges[:, 1]]


def _through(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray, same: bool = False) -> int:
    """Number of edges of x through triangles of y; with `same` they are one mesh."""
    return len(_pairs_through(x, edges, y, faces, same)[0])


def _pairs_through(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray,
                   same: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Rows of edges and of faces that cross."""
    e, t = _near(x[edges], y[faces])
    if same:
        apart = ~(edges[e][:, :, None] == faces[t][:, None, :]).any(axis=(1, 2))
        e, t = e[apart], t[apart]
    if not len(e):
        return e, t
    p, q = x[edges[e, 0]], x[edges[e, 1]]
    a, b, c = (y[faces[t, k]] for k in range(3))
    sides = _sign(p, a, b, c) * _sign(q, a, b, c) < 0
    e, t, p, q, a, b, c = (v[sides] for v in (e, t, p, q, a, b, c))
    turns = np.stack([_sign(p, q, a, b), _sign(p, q, b, c), _sign(p, q, c, a)])
    through = (turns > 0).all(axis=0) | (turns < 0).all(axis=0)
    return e[through], t[through]


def _sign(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Sign of the volume of tetrahedra (k, 3) x 4."""
    u, v, w = b - a, c - a, d - a
    volume = np.einsum("ki,ki->k", u, np.cross(v, w))
    size = np.linalg.norm(u, axis=1) * np.linalg.norm(v, axis=1) * np.linalg.norm(w, axis=1)
    # differences are rounded too: relative to the coordinates themselves
    reach = np.abs(np.stack([a, b, c, d])).max(axis=(0, 2)) + 1e-300
    shortest = np.minimum(np.linalg.norm(u, axis=1), np.minimum(np.linalg.norm(v, axis=1), np.linalg.norm(w, axis=1)))
    doubtful = np.abs(volume) <= BOUND * size * (1 + reach / np.maximum(shortest, 1e-300))
    sign = np.sign(volume).astype(np.int64)
    for k in np.flatnonzero(doubtful):
        sign[k] = _exact_sign(a[k], b[k], c[k], d[k])
    return sign


def _exact_sign(*points: np.ndarray) -> int:
    a, b, c, d = ([Fraction(float(v)) for v in p] for p in points)
    u, v, w = ([q - p for p, q in zip(a, other)] for other in (b, c, d))
    volume = (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
              + u[2] * (v[0] * w[1] - v[1] * w[0]))
    return (volume > 0) - (volume < 0)


def _near(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(i, j) of all items a (n, k, 3), b (m, l, 3) whose boxes meet, by a sweep over cells of a grid."""
    low_a, high_a, low_b, high_b = a.min(axis=1), a.max(axis=1), b.min(axis=1), b.max(axis=1)
    inside = ((low_a <= high_b.max(axis=0)) & (high_a >= low_b.min(axis=0))).all(axis=1)
    ia = np.flatnonzero(inside)
    if not len(ia):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    cell = max(float(np.median((high_b - low_b).max(axis=1))), float(np.median((high_a - low_a).max(axis=1)))) * 1.5 + 1e-30
    origin = np.minimum(low_a.min(axis=0), low_b.min(axis=0))
    code_a, item_a = _cells(low_a[ia], high_a[ia], origin, cell)
    code_b, item_b = _cells(low_b, high_b, origin, cell)
    order = np.argsort(code_b, kind="stable")
    code_b, item_b = code_b[order], item_b[order]
    first, last = np.searchsorted(code_b, code_a, "left"), np.searchsorted(code_b, code_a, "right")
    count = last - first
    i = np.repeat(ia[item_a], count)
    j = item_b[np.repeat(first, count) + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)]
    meet = np.ones(len(i), dtype=bool)
    for c in range(3):  # an axis at a time: most pairs are gone after the first
        meet[meet] = (low_a[i[meet], c] <= high_b[j[meet], c]) & (high_a[i[meet], c] >= low_b[j[meet], c])
    pairs = np.unique(i[meet] * len(b) + j[meet])
    return pairs // len(b), pairs % len(b)


def _cells(low: np.ndarray, high: np.ndarray, origin: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """(code of a cell, item) for every cell that a box meets."""
    first = np.floor((low - origin) / cell).astype(np.int64)
    span = np.floor((high - origin) / cell).astype(np.int64) - first + 1
    count = span.prod(axis=1)
    item = np.repeat(np.arange(len(low)), count)
    k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    s = span[item]
    at = first[item] + np.column_stack([k // (s[:, 1] * s[:, 2]), k // s[:, 2] % s[:, 1], k % s[:, 2]])
    return (at[:, 0] * 73856093) ^ (at[:, 1] * 19349663) ^ (at[:, 2] * 83492791), item
