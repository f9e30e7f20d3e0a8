"""Polygons cut into triangles."""

from collections.abc import Sequence

import numpy as np

MOST = 256  # corners: the search for ears grows with their cube


def cut(p: np.ndarray) -> list[tuple[int, int, int]]:
    """Triangles, as places in p (k, 3), of a polygon: ears are cut off, so that concave ones come out right too.

    Raises:
        ValueError: fewer than three corners, or more than can be cut in reasonable time.
    """
    if len(p) < 3:
        raise ValueError(f"a face needs at least 3 corners, not {len(p)}")
    if len(p) > MOST:
        raise ValueError(f"a face of {len(p)} corners: at most {MOST} can be read")
    normal = np.cross(np.roll(p, 1, axis=0), p).sum(axis=0)
    left, out = list(range(len(p))), []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(p, normal, left, k)), 0)
        out.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*out, (left[0], left[1], left[2])]


def triangles_of(x: np.ndarray, polygons: Sequence | np.ndarray) -> np.ndarray:
    """(m, 3) triangles of polygons: lists of rows of x (n, 3), or an array of them.

    Raises:
        ValueError: a face that cannot be cut, or that names a vertex out of range, by its number.
    """
    if isinstance(polygons, np.ndarray) and polygons.shape[1] == 3 and (polygons >= 0).all() and (polygons < len(x)).all():
        return polygons.astype(np.int64)
    out: list[list[int]] = []
    for number, corners in enumerate(polygons):
        corners = [int(c) for c in corners]
        bad = [c for c in corners if not 0 <= c < len(x)]
        if bad:
            raise ValueError(f"face {number} names vertex {bad[0]} out of range: there are {len(x)}")
        if len(corners) == 3:
            out.append(corners)
            continue
        try:
            out += [[corners[k] for k in t] for t in cut(x[corners])]
        except ValueError as error:
            raise ValueError(f"face {number}: {error}") from None
    return np.array(out, dtype=np.int64).reshape(-1, 3)


def _is_ear(p: np.ndarray, normal: np.ndarray, left: list[int], k: int) -> bool:
    a, b, c = p[left[k - 1]], p[left[k]], p[left[(k + 1) % len(left)]]
    if np.dot(np.cross(b - a, c - b), normal) <= 0:
        return False
    others = p[[i for i in left if i not in (left[k - 1], left[k], left[(k + 1) % len(left)])]]
    inside = [np.einsum("ij,j->i", np.cross(t - s, others - s), normal) >= 0 for s, t in ((a, b), (b, c), (c, a))]
    return not np.logical_and.reduce(inside).any()
