"""Points of one run's cloth found in another run's, of another resolution, by their material coordinates."""

import numpy as np

from ..errors import OutputError

OUTSIDE = 0.02  # part of the vertices that may lie outside the other's pattern, by more than an edge of it
CELLS = 2.0  # size of a cell of the search, in edges


class SameMaterial:
    """For each vertex of a, the triangle of b at its material coordinates, and the weights of that triangle's corners.

    Args:
        a, b: geometries of recorded runs, with the same cloths; panels of garments are told apart by their names.

    Raises:
        OutputError: other cloths or panels, or patterns that do not lie over each other.
    """

    def __init__(self, a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> None:
        self.corners = np.zeros((len(a["x"]), 3), dtype=np.int64)
        self.weights = np.zeros((len(a["x"]), 3))
        self.used = np.zeros(len(a["x"]), dtype=bool)
        self.area = np.zeros(len(a["x"]))
        parts, others = _parts(a), _parts(b)
        if set(parts) != set(others):
            raise OutputError(f"the runs are of other cloths: {', '.join(sorted(parts))} and {', '.join(sorted(others))}")
        for name, faces in parts.items():
            self._match(name, a, b, faces, others[name])

    def at(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) positions of b's cloth x (k, 3) at a's vertices."""
        return np.einsum("nc,nck->nk", self.weights, x[self.corners])

    def _match(self, name: str, a: dict, b: dict, faces: np.ndarray, others: np.ndarray) -> None:
        vertices, first = np.unique(a["faces"][faces], return_index=True)
        points = a["uv"][faces].reshape(-1, 2)[first].astype(np.float64)
        pattern = b["uv"][others].astype(np.float64)
        row, weights, off = locate(points, pattern)
        edge = float(np.sqrt(np.abs(_cross(pattern[:, 1] - pattern[:, 0], pattern[:, 2] - pattern[:, 0])).mean()))
        if np.mean(off > edge) > OUTSIDE:
            raise OutputError(f"{name}: {int((off > edge).sum())} of {len(points)} vertices lie outside the other run's "
                              "pattern: they are not the same piece of cloth")
        self.corners[vertices], self.weights[vertices] = b["faces"][others][row], weights
        self.used[vertices] = True
        corner_uv = a["uv"][faces].astype(np.float64)
        twice = np.abs(_cross(corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]))
        np.add.at(self.area, a["faces"][faces].reshape(-1), np.repeat(twice / 6, 3))


def locate(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For points (n, 2): the triangle of (m, 3, 2) that each is in or nearest to; weights (n, 3); distance outside (n,)."""
    low = triangles.min(axis=(0, 1))
    size = CELLS * float(np.sqrt(np.abs(_cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])).mean()))
    first = np.floor((triangles.min(axis=1) - low) / size - 0.5).astype(np.int64)  # half a cell more, for points outside
    last = np.floor((triangles.max(axis=1) - low) / size + 0.5).astype(np.int64)
    counts = last - first + 1
    total = counts.prod(axis=1)
    row = np.repeat(np.arange(len(triangles)), total)
    k = np.arange(total.sum()) - np.repeat(np.cumsum(total) - total, total)
    cell = first[row] + np.column_stack([k // counts[row, 1], k % counts[row, 1]])
    wide = int(last[:, 1].max() - first[:, 1].min()) + 3
    key = cell[:, 0] * wide + cell[:, 1]
    order = np.argsort(key, kind="stable")
    key, row = key[order], row[order]
    at = np.floor((points - low) / size).astype(np.int64)
    inside = (at[:, 1] >= first[:, 1].min()) & (at[:, 1] <= last[:, 1].max())
    mine = np.where(inside, at[:, 0] * wide + at[:, 1], np.iinfo(np.int64).max)
    begin, end = np.searchsorted(key, mine, "left"), np.searchsorted(key, mine, "right")
    best, weights, off = np.zeros(len(points), dtype=np.int64), np.zeros((len(points), 3)), np.full(len(points), np.inf)
    for j in range(int((end - begin).max(initial=0))):
        p = np.flatnonzero((begin + j < end) & (off > 0))
        _take(points, triangles, p, row[begin[p] + j], best, weights, off)
    for far in np.flatnonzero(np.isinf(off)):
        nearest = np.argmin(np.sum((triangles.mean(axis=1) - points[far]) ** 2, axis=1))
        _take(points, triangles, np.array([far]), np.array([nearest]), best, weights, off)
    return best, weights, off


def _take(points: np.ndarray, triangles: np.ndarray, p: np.ndarray, row: np.ndarray, best: np.ndarray, weights: np.ndarray,
          off: np.ndarray) -> None:
    """Takes triangles `row` for points p where they are nearer than the present ones."""
    a, b, c = (triangles[row, j] for j in range(3))
    whole = _cross(b - a, c - a)
    whole = np.where(whole == 0, np.inf, whole)
    v, w = _cross(points[p] - a, c - a) / whole, _cross(b - a, points[p] - a) / whole
    bary = np.maximum(np.column_stack([1 - v - w, v, w]), 0.0)
    bary /= bary.sum(axis=1, keepdims=True)
    here = np.einsum("nc,ncd->nd", bary, triangles[row])
    distance = np.linalg.norm(points[p] - here, axis=1)
    distance[distance < 1e-4 * np.sqrt(np.abs(whole))] = 0.0  # rounding of f32 records
    nearer = distance < off[p]
    q = p[nearer]
    best[q], weights[q], off[q] = row[nearer], bary[nearer], distance[nearer]


def _parts(g: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Rows of faces of each panel, or of each cloth if there are none, by name."""
    if "panel" in g:
        return {str(name): np.flatnonzero(g["panel"] == k) for k, name in enumerate(g["panel_names"])}
    ends = g["cloth_faces"]
    return {str(name): np.arange(ends[k], ends[k + 1]) for k, name in enumerate(g["cloth_names"])}


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
