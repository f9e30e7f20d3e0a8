"""Exact count of crossings between triangle meshes, or of one with itself: edges through triangles. numpy only.

Signs of volumes are computed in floating point with an error bound, and in whole numbers of any size where that leaves a
doubt, so that no crossing is missed or made up. Touching counts as no crossing.
"""

import numpy as np

from .boxes import near
from .mesh import distinct, face_edges

BOUND = 1e-14  # of the product of the three lengths: a smaller volume's sign is doubtful
TINY = 1e-290  # m^3: below it numbers have fewer digits


def count_crossings(x_a: np.ndarray, faces_a: np.ndarray, x_b: np.ndarray, faces_b: np.ndarray) -> int:
    """Number of (edge, triangle) pairs that cross, edges of a with triangles of b and the other way round.

    Args:
        x_a, x_b: (n, 3) positions [m]; faces_a, faces_b: (m, 3).
    """
    return _through(x_a, _edges(faces_a), x_b, faces_b) + _through(x_b, _edges(faces_b), x_a, faces_a)


def count_self_crossings(x: np.ndarray, faces: np.ndarray) -> int:
    """Number of (edge, triangle) pairs of one mesh that cross; pairs that share a vertex do not count.

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
    edges, _ = distinct(face_edges(faces))
    return edges[edges[:, 0] != edges[:, 1]]


def _through(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray, same: bool = False) -> int:
    """Number of edges of x through triangles of y; with `same` they are one mesh."""
    return len(_pairs_through(x, edges, y, faces, same)[0])


def _pairs_through(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray,
                   same: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Rows of edges and of faces that cross, in order."""
    long = np.flatnonzero((x[edges[:, 0]] != x[edges[:, 1]]).any(axis=1))  # points and lines are not passed through
    a, b, c = (y[faces[:, k]] for k in range(3))
    wide = np.flatnonzero((a != b).any(axis=1) & (b != c).any(axis=1) & (c != a).any(axis=1))
    for k in range(3):  # where all triangles are in planes of constant x, y or z, as flat sheets are, such edges pass none
        if (a[wide, k] == b[wide, k]).all() and (b[wide, k] == c[wide, k]).all():
            long = long[x[edges[long, 0], k] != x[edges[long, 1], k]]
    found = [_crossing(x, edges, y, faces, long[e], wide[t], same) for e, t in near(x[edges[long]], y[faces[wide]])]
    e, t = (np.concatenate([part[k] for part in found] + [np.zeros(0, dtype=np.int64)]) for k in (0, 1))
    order = np.lexsort((t, e))
    return e[order], t[order]


def _crossing(x: np.ndarray, edges: np.ndarray, y: np.ndarray, faces: np.ndarray, e: np.ndarray, t: np.ndarray,
              same: bool) -> tuple[np.ndarray, np.ndarray]:
    """Those of the pairs (rows e of edges, rows t of faces) that cross."""
    if same:
        apart = ~(edges[e][:, :, None] == faces[t][:, None, :]).any(axis=(1, 2))
        e, t = e[apart], t[apart]
    p, q = x[edges[e, 0]], x[edges[e, 1]]
    a, b, c = (y[faces[t, k]] for k in range(3))
    sides = _sign(p, a, b, c) * _sign(q, a, b, c) < 0
    e, t, p, q, a, b, c = (v[sides] for v in (e, t, p, q, a, b, c))
    turns = np.stack([_sign(p, q, a, b), _sign(p, q, b, c), _sign(p, q, c, a)])
    through = (turns > 0).all(axis=0) | (turns < 0).all(axis=0)
    return e[through], t[through]


def _sign(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Sign of the volume of tetrahedra (k, 3) x 4."""
    with np.errstate(all="ignore"):  # overflow and underflow are doubtful
        u, v, w = b - a, c - a, d - a
        volume = np.einsum("ki,ki->k", u, np.cross(v, w))
        lengths = np.stack([np.linalg.norm(s, axis=1) for s in (u, v, w)])
        # differences are rounded too: relative to the coordinates themselves
        reach = np.abs(np.stack([a, b, c, d])).max(axis=(0, 2))
        slack = BOUND * lengths.prod(axis=0) * (1 + reach / np.maximum(lengths.min(axis=0), 1e-300)) + TINY
        flat = ((u == 0) & (v == 0) & (w == 0)).any(axis=1)  # in a plane of constant x, y or z: exactly 0
        volume[flat] = 0.0
        doubtful = ~(flat | (np.abs(volume) > slack))
        sign = np.sign(np.where(doubtful, 0.0, volume)).astype(np.int64)
    if doubtful.any():
        sign[doubtful] = _exact_sign(np.stack([a, b, c, d], axis=1)[doubtful])
    return sign


def _exact_sign(points: np.ndarray) -> np.ndarray:
    """The same of points (k, 4, 3) in whole numbers of any size: each coordinate is one times a common power of two."""
    fraction, exponent = np.frexp(points.reshape(-1, 12))
    exponent = np.where(fraction == 0, np.iinfo(exponent.dtype).max, exponent)  # a zero sets no power
    shift = np.where(fraction == 0, 0, exponent - exponent.min(axis=1, keepdims=True))
    whole = np.ldexp(fraction, 53).astype(np.int64).astype(object) << shift.astype(object)
    a, b, c, d = np.moveaxis(whole.reshape(-1, 4, 3), (1, 2), (0, 1))
    u, v, w = b - a, c - a, d - a
    volume = (u[0] * (v[1] * w[2] - v[2] * w[1]) - u[1] * (v[0] * w[2] - v[2] * w[0])
              + u[2] * (v[0] * w[1] - v[1] * w[0]))
    return (volume > 0).astype(np.int64) - (volume < 0).astype(np.int64)
