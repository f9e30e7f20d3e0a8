"""Meshing of a closed line: a hexagonal lattice inside, the line's own points on the border, Delaunay, smoothed.

Time and memory grow about as the number of vertices.
"""

import math
from collections.abc import Iterator

import numpy as np

from ..errors import MeshError
from ..scene.boxes import near
from .kept import kept

CLEAR = 0.62  # of the spacing that lattice points keep from the border
SMOOTHED = 12  # passes
FLAT = 1e-6  # of the spacing squared: less area is no triangle
CHUNK = 1 << 20  # points, or pairs of a point and a piece of the border, looked at together
CELL = math.sqrt(3) / 2  # of the spacing squared: area of the lattice for each vertex
MOST_VERTICES = 2_000_000  # of all panels together: some 4 GB while they are meshed
SWEPT = 32  # pairs of pieces for each, of which as many are found by sorting along an axis
NO_POINTS, NO_LINES = np.zeros((0, 2)), np.zeros((0, 2), dtype=np.int64)


def refuse_too_many(what: str, spacing: float, area: float, border: float, corners: int) -> None:
    """Refuses a spacing [m] at which panels have more vertices than `MOST_VERTICES`.

    Args:
        area: of the panels [m^2].
        border: length of their borders [m].
        corners: at which there are vertices at any spacing.

    Raises:
        MeshError: with the number of vertices, and the spacing that fits.
    """
    half = border / 2  # those inside are area / CELL less the other half [Pick's theorem]
    vertices = area / CELL / spacing / spacing + half / spacing + corners
    if vertices <= MOST_VERTICES:
        return
    inside = MOST_VERTICES - corners
    if inside <= 0:
        raise MeshError(f"{what}: borders with {corners:,} corners; {MOST_VERTICES:,} vertices are allowed: draw them simpler")
    least = (half + math.sqrt(half**2 + 4 * inside * area / CELL)) / (2 * inside)
    step = 10.0 ** (math.floor(math.log10(least)) - 1)
    raise MeshError(f"{what}: spacing = {spacing:g} m makes about {vertices:.2g} vertices; {MOST_VERTICES:,} are allowed: "
                    f"take {math.ceil(least / step) * step:.2g} m or more")


@kept
def mesh_polygon(border: np.ndarray, spacing: float, name: str, inside: np.ndarray = NO_POINTS,
                 lines: np.ndarray = NO_LINES) -> tuple[np.ndarray, np.ndarray]:
    """(points (n, 2), triangles (m, 3) that go round to the left); the first points are the border's, in its order, and then
    those that have to be inside.

    Args:
        border: (k, 2) of a closed line that does not cross itself, the last joined to the first.
        spacing: length [m] of edges inside.
        name: of the panel, for errors.
        inside: (j, 2) further points; lines: (p, 2) numbers of points that an edge has to join.

    Raises:
        MeshError: SciPy is missing, the line crosses itself, lines inside cross, or the spacing is too large for its shape.
    """
    try:
        from scipy.spatial import Delaunay, QhullError
    except ImportError:
        raise MeshError("meshing patterns needs SciPy: pip install 'taichi_cloth[garment]'") from None
    crossed = crossing(border)
    if crossed is not None:
        raise MeshError(f"panel {name!r}: its border crosses itself near {border[crossed[0]].round(4).tolist()} m")
    fixed, k = np.concatenate([border, inside]), len(border) + len(inside)
    pieces = np.concatenate([np.column_stack([np.arange(len(border)), (np.arange(len(border)) + 1) % len(border)]), lines])
    alone = np.repeat(np.arange(len(border), k), 2).reshape(-1, 2)
    points = np.concatenate([fixed, _lattice(border, fixed[np.concatenate([pieces, alone])], spacing)])
    for again in range(SMOOTHED + 1):
        try:
            faces = Delaunay(points).simplices
        except QhullError:
            raise MeshError(f"panel {name!r}: its border of {k} points has no area: take a smaller spacing") from None
        faces = _inside(points, faces, border, spacing)
        if again < SMOOTHED and len(points) > k:
            points[k:] = _smoothed(points, faces, k)
    used = np.unique(faces)
    lost = _lost(faces, pieces, k)
    if len(lost):
        what = "its border" if lost[0] < len(border) else "a line within it that is sewn"
        raise MeshError(f"panel {name!r}: {what} is lost near {fixed[pieces[lost[0], 0]].round(4).tolist()} m: "
                        "take a smaller spacing, and no lines that cross")
    keep = np.union1d(used, np.arange(k))
    new = np.full(len(points), -1)
    new[keep] = np.arange(len(keep))
    return points[keep], new[faces]


def _lost(faces: np.ndarray, pieces: np.ndarray, k: int) -> np.ndarray:
    """Those of pieces (p, 2) between the first k points that are no edge of a triangle."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    edges = np.sort(edges[(edges < k).all(axis=1)], axis=1)
    return np.flatnonzero(~np.isin(np.sort(pieces, axis=1) @ [k, 1], edges @ [k, 1]))


def _lattice(border: np.ndarray, pieces: np.ndarray, spacing: float) -> np.ndarray:
    """(j, 2) lattice points inside that keep clear of pieces of lines (p, 2, 2), the border among them."""
    low, high = border.min(axis=0), border.max(axis=0)
    out, some, many = [np.zeros((0, 2))], [], 0
    rows = np.arange(low[1], high[1], spacing * CELL)
    for r, y in enumerate(rows):
        x = np.arange(low[0] + (r % 2) * spacing / 2, high[0], spacing)
        some.append(np.column_stack([x, np.full(len(x), y)]))
        many += len(x)
        if many > CHUNK or r == len(rows) - 1:
            points = np.concatenate(some)
            out.append(points[contains(border, points)])
            some, many = [], 0
    points = np.concatenate(out)
    return points[~near_line(pieces, points, CLEAR * spacing)]


def contains(border: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(j,) whether points (j, 2) are inside a closed line (k, 2): a ray to the right crosses it an odd number of times."""
    a, b = border, np.roll(border, -1, axis=0)
    order = np.argsort(points[:, 1], kind="stable")
    x, y = points[order].T
    first = np.searchsorted(y, np.minimum(a[:, 1], b[:, 1]))
    count = np.searchsorted(y, np.maximum(a[:, 1], b[:, 1])) - first
    times = np.zeros(len(points), dtype=np.int64)
    for piece, p in _ranges(first, count):
        rise = b[piece, 1] - a[piece, 1]
        right = x[p] < a[piece, 0] + (y[p] - a[piece, 1]) / rise * (b[piece, 0] - a[piece, 0])
        times += np.bincount(p[right], minlength=len(points))
    out = np.empty(len(points), dtype=bool)
    out[order] = times % 2 == 1
    return out


def _ranges(first: np.ndarray, count: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (i, j) with j in first[i], ..., first[i] + count[i] - 1, in parts of about `CHUNK`."""
    ends = np.cumsum(count)
    start = 0
    while start < len(count) and ends[-1] > 0:
        before = ends[start] - count[start]
        stop = max(start + 1, int(np.searchsorted(ends, before + CHUNK, "right")))
        n = count[start:stop]
        i = np.repeat(np.arange(start, stop), n)
        yield i, first[i] + np.arange(len(i)) - (ends[i] - count[i] - before)
        start = stop


def near_line(pieces: np.ndarray, points: np.ndarray, reach: float) -> np.ndarray:
    """(j,) whether points are as near to pieces of lines (p, 2, 2) [m]."""
    out = np.zeros(len(points), dtype=bool)
    start, way = pieces[:, 0], pieces[:, 1] - pieces[:, 0]
    for i, k in near(_flat(points[:, None] + np.array([[-reach, -reach], [reach, reach]])), _flat(pieces)):
        t = np.clip(((points[i] - start[k]) * way[k]).sum(axis=1) / np.maximum((way[k]**2).sum(axis=1), 1e-300), 0, 1)
        out[i[np.linalg.norm(points[i] - start[k] - t[:, None] * way[k], axis=1) <= reach]] = True
    return out


def pieces_of(border: np.ndarray) -> np.ndarray:
    """(k, 2, 2) the ends of each."""
    return np.stack([border, np.roll(border, -1, axis=0)], axis=1)


def _flat(points: np.ndarray) -> np.ndarray:
    """(..., 3) of (..., 2), at height 0."""
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def signed_area(border: np.ndarray) -> float:
    """[m^2] in a closed line (k, 2); positive where it goes round to the left."""
    p = border - border[0]
    q = np.roll(p, -1, axis=0)
    return float((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum() / 2)


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
    """Two pieces of a closed line (k, 2) that cross or touch, beside neighbours at their common point; or None.

    Piece i goes from point i to the next.
    """
    a, b = border, np.roll(border, -1, axis=0)
    n = len(a)

    def side(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> np.ndarray:
        return (q[:, 0] - p[:, 0]) * (r[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (r[:, 0] - p[:, 0])

    for i, j in _meeting(pieces_of(border)):
        i, j = np.minimum(i, j), np.maximum(i, j)
        apart = (j - i > 1) & (j - i < n - 1)
        i, j = i[apart], j[apart]
        hit = ((side(a[i], b[i], a[j]) * side(a[i], b[i], b[j]) <= 0)
               & (side(a[j], b[j], a[i]) * side(a[j], b[j], b[i]) <= 0))
        if hit.any():
            return min(zip(i[hit].tolist(), j[hit].tolist()))
    return None


def _meeting(pieces: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (i, j) of all pieces (k, 2, 2) whose boxes meet, in parts."""
    low, high = pieces.min(axis=1), pieces.max(axis=1)
    for axis in (0, 1):
        order = np.argsort(low[:, axis], kind="stable")
        first = np.arange(1, len(order) + 1)
        count = np.searchsorted(low[order, axis], high[order, axis], "right") - first
        if count.sum() <= SWEPT * len(order):
            for i, j in _ranges(first, count):
                i, j = order[i], order[j]
                meet = (low[i] <= high[j]).all(axis=1) & (low[j] <= high[i]).all(axis=1)
                yield i[meet], j[meet]
            return
    yield from near(_flat(pieces), _flat(pieces))
