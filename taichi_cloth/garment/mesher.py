"""Triangles in a closed line: a hexagonal lattice inside, the line's own points on the border, Delaunay, smoothed."""

import numpy as np

from ..errors import MeshError
from ..scene.shapes import MOST_TRIANGLES

CLEAR = 0.62  # of the spacing that lattice points keep from the border
SMOOTHED = 12  # passes
FLAT = 1e-6  # of the spacing squared: less area is no triangle
CHUNK = 1 << 22  # numbers looked at together


def mesh_polygon(border: np.ndarray, spacing: float, name: str) -> tuple[np.ndarray, np.ndarray]:
    """(points (n, 2), triangles (m, 3) that go round to the left); the first points are the border's, in its order.

    Args:
        border: (k, 2) of a closed line that does not cross itself, the last joined to the first.
        spacing: length [m] of edges inside.
        name: of the panel, for errors.

    Raises:
        MeshError: SciPy is missing, the line crosses itself, or the spacing is too large for its shape.
    """
    try:
        from scipy.spatial import Delaunay, QhullError
    except ImportError:
        raise MeshError("meshing patterns needs SciPy: pip install 'taichi_cloth[garment]'") from None
    crossed = crossing(border)
    if crossed is not None:
        raise MeshError(f"panel {name!r}: its border crosses itself near {border[crossed[0]].round(4).tolist()} m")
    k = len(border)
    points = np.concatenate([border, _lattice(border, spacing)])
    for again in range(SMOOTHED + 1):
        try:
            faces = _inside(points, Delaunay(points).simplices, border, spacing)
        except QhullError:
            raise MeshError(f"panel {name!r}: its border of {k} points has no area: take a smaller spacing") from None
        if again < SMOOTHED and len(points) > k:
            points[k:] = _smoothed(points, faces, k)
    used = np.unique(faces)
    edges = {frozenset(e) for f in faces.tolist() for e in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))}
    lost = [i for i in range(k) if frozenset((i, (i + 1) % k)) not in edges]
    if lost:
        raise MeshError(f"panel {name!r}: its border is lost near {border[lost[0]].round(4).tolist()} m: "
                        "take a smaller spacing")
    keep = np.union1d(used, np.arange(k))
    new = np.full(len(points), -1)
    new[keep] = np.arange(len(keep))
    return points[keep], new[faces]


def refuse_fine(area: float, border: float, spacing: float) -> None:
    """Refuses a spacing [m] with which panels of an area [m^2] and borders [m] would have too many triangles.

    Raises:
        MeshError: it is so small.
    """
    count = area / (np.sqrt(3) / 4 * spacing**2) + border / spacing if spacing**2 > 0 else np.inf
    if not count <= MOST_TRIANGLES:
        raise MeshError(f"spacing = {spacing:g} m makes {count:.3g} triangles: at most {MOST_TRIANGLES:,}")


def _lattice(border: np.ndarray, spacing: float) -> np.ndarray:
    """(j, 2) lattice points inside that keep clear of the border."""
    low, high = border.min(axis=0), border.max(axis=0)
    rows = np.arange(low[1], high[1], spacing * np.sqrt(3) / 2)
    out = [np.column_stack([np.arange(low[0] + (r % 2) * spacing / 2, high[0], spacing),
                            np.full(len(np.arange(low[0] + (r % 2) * spacing / 2, high[0], spacing)), y)])
           for r, y in enumerate(rows)]
    points = np.concatenate(out) if out else np.zeros((0, 2))
    if not len(points):
        return points
    points = points[contains(border, points)]
    return points[_distance(border, points) > CLEAR * spacing]


def contains(border: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(j,) whether points (j, 2) are inside a closed line (k, 2)."""
    a, b = border, np.roll(border, -1, axis=0)
    out = np.zeros(len(points), dtype=bool)
    step = max(1, CHUNK // len(border))
    for first in range(0, len(points), step):
        p = points[first:first + step, None]
        spans = (a[None, :, 1] > p[:, :, 1]) != (b[None, :, 1] > p[:, :, 1])
        rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
        at = a[:, 0] + (p[:, :, 1] - a[:, 1]) / rise * (b[:, 0] - a[:, 0])
        out[first:first + step] = (spans & (p[:, :, 0] < at)).sum(axis=1) % 2 == 1
    return out


def _distance(border: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(j,) [m] of points from the line."""
    a, way = border, np.roll(border, -1, axis=0) - border
    out = np.empty(len(points))
    step = max(1, CHUNK // len(border))
    for first in range(0, len(points), step):
        p = points[first:first + step, None]
        t = np.clip(((p - a) * way).sum(axis=2) / np.maximum((way**2).sum(axis=1), 1e-300), 0, 1)
        out[first:first + step] = np.linalg.norm(p - a - t[:, :, None] * way, axis=2).min(axis=1)
    return out


def _inside(points: np.ndarray, faces: np.ndarray, border: np.ndarray, spacing: float) -> np.ndarray:
    """The triangles inside the line that have an area, turned to the left."""
    corner = points[faces]
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area = (e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]) / 2
    faces = np.where((area < 0)[:, None], faces[:, ::-1], faces)
    return faces[(np.abs(area) > FLAT * spacing**2) & contains(border, corner.mean(axis=1))].astype(np.int64)


def _smoothed(points: np.ndarray, faces: np.ndarray, k: int) -> np.ndarray:
    """Inner points, from k on, at the mean of the centres of their triangles, by area."""
    corner = points[faces]
    e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    area, centre = np.abs(e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]), corner.mean(axis=1)
    weight = np.bincount(faces.ravel(), np.repeat(area, 3), len(points))
    total = np.stack([np.bincount(faces.ravel(), np.repeat(area * centre[:, d], 3), len(points)) for d in (0, 1)], axis=1)
    out = points.copy()
    out[weight > 0] = total[weight > 0] / weight[weight > 0, None]
    return out[k:]


def crossing(border: np.ndarray) -> tuple[int, int] | None:
    """The first two pieces of a closed line (k, 2) that cross or touch, beside neighbours at their common point; or None.

    Piece i goes from point i to the next.
    """
    a, b = border, np.roll(border, -1, axis=0)
    n = len(a)

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    for i in range(n):
        j = np.arange(i + 2, n if i else n - 1)
        apart = np.any(np.maximum(a[i], b[i]) < np.minimum(a[j], b[j]), axis=1)
        apart |= np.any(np.maximum(a[j], b[j]) < np.minimum(a[i], b[i]), axis=1)
        hit = ((side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) <= 0)
               & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) <= 0) & ~apart)
        if hit.any():
            return i, int(j[np.argmax(hit)])
    return None
