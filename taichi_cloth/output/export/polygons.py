"""Polygons that triangles were cut from, put together again, for formats that have them."""

import numpy as np


def loops(faces: np.ndarray, polygon: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """(k,) places in `faces.ravel()` of the corners of all polygons, one after the other, and (f,) how many each has.

    Args:
        faces: (m, 3); polygon: (m,) a number of each, or None if all are on their own. Triangles of a number that have no
            single border stay triangles.
    """
    if polygon is None:
        return np.arange(faces.size), np.full(len(faces), 3)
    order = np.argsort(polygon, kind="stable")
    cuts = np.flatnonzero(np.diff(polygon[order])) + 1
    corners: list[int] = []
    counts: list[int] = []
    for rows in np.split(order, cuts):
        ring = _ring(faces, rows.tolist()) if len(rows) > 1 else []
        for some in [ring] if ring else [[3 * row, 3 * row + 1, 3 * row + 2] for row in rows.tolist()]:
            corners += some
            counts.append(len(some))
    return np.array(corners, dtype=np.int64), np.array(counts, dtype=np.int64)


def _ring(faces: np.ndarray, rows: list[int]) -> list[int]:
    """Places of the corners round triangles, in order; none where their border is not one ring through all of them."""
    sides = {(int(faces[row, k]), int(faces[row, (k + 1) % 3])): 3 * row + k for row in rows for k in range(3)}
    onward = {a: (b, place) for (a, b), place in sides.items() if (b, a) not in sides}
    start = at = next(iter(onward), -1)
    out: list[int] = []
    while at in onward and len(out) < len(rows) + 2:
        at, place = onward[at]
        out.append(place)
        if at == start:
            break
    return out if at == start and len(out) == len(rows) + 2 == len(onward) else []
