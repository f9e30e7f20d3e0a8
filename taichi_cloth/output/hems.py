"""Borders of cloth that faces are near to, for hems: edges that have a triangle on one side alone. numpy only."""

import numpy as np

NEAREST = 2  # borders that a face knows of: two in a corner
FAR = 1e6  # m: where there is no border


def half_edges(faces: np.ndarray) -> np.ndarray:
    """(3 m,) the same edge of the triangle on the other side, -1 if there is none; edge k of face f has number 3 f + k."""
    n = int(faces.max(initial=0)) + 1
    pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
    _, inverse, count = np.unique(pairs @ np.array([n, 1]), return_inverse=True, return_counts=True)
    order = np.argsort(inverse.reshape(-1), kind="stable")
    first = (np.cumsum(count) - count)[count == 2]
    other = np.full(len(pairs), -1)
    other[order[first]], other[order[first + 1]] = order[first + 1], order[first]
    other[order[np.repeat(count, count) > 2]] = -2  # no border either
    return other


def borders(faces: np.ndarray, uv: np.ndarray, width: np.ndarray) -> np.ndarray:
    """(m, 8) ends of the two borders in the pattern that are nearest to each face, FAR where they are beyond its hem.

    Args:
        faces: (m, 3), over one vertex for all that are sewn together.
        uv: (m, 3, 2) corners in the pattern [m].
        width: (m,) of each face's hem [m]; 0 for none.
    """
    other = half_edges(faces)
    ends = np.concatenate([uv, np.roll(uv, -1, axis=1)], axis=2).reshape(-1, 4)
    own = np.where(other == -1, np.arange(len(other)), -1).reshape(-1, 3)
    middle = uv.mean(axis=1)
    reach = np.where(width > 0, width + np.linalg.norm(uv - middle[:, None], axis=2).max(axis=1), -1.0)
    beside = np.where(other >= 0, other // 3, np.arange(len(other)) // 3).reshape(-1, 3)
    best = np.full((len(faces), NEAREST), -1)
    while True:
        known = np.concatenate([own, best, best[beside].reshape(len(faces), -1)], axis=1)
        away = distance(middle[:, None], ends[known])
        away[(known < 0) | (away > reach[:, None])] = np.inf
        found = _nearest(known, away)
        if (found == best).all():
            return np.where(best[..., None] < 0, FAR, ends[best]).reshape(-1, 4 * NEAREST)
        best = found


def distance(at: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Distance of points (..., 2) from segments (..., 4)."""
    a, way = ends[..., :2], ends[..., 2:] - ends[..., :2]
    t = ((at - a) * way).sum(axis=-1) / np.maximum((way**2).sum(axis=-1), 1e-30)
    return np.linalg.norm(at - a - np.clip(t, 0, 1)[..., None] * way, axis=-1)


def _nearest(known: np.ndarray, away: np.ndarray) -> np.ndarray:
    """(m, NEAREST) different ones of known (m, k) that are the least away, the first of those alike; -1 for none."""
    out = []
    for _ in range(NEAREST):
        k = away.argmin(axis=1)[:, None]
        one = np.where(np.isfinite(np.take_along_axis(away, k, axis=1)), np.take_along_axis(known, k, axis=1), -1)
        out.append(one)
        away = np.where(known == one, np.inf, away)
    return np.concatenate(out, axis=1)
