"""Polygons cut into triangles: along the shortest diagonals that lie inside them, and so that no edge gets too many."""

import heapq
from collections.abc import Sequence

import numpy as np

TIE = 0.01  # of a length: diagonals that differ by less, as of a file's digits, count for the same, and a grid's go one way


def cut(x: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Triangles of polygons of any number of corners, concave ones too, in their order.

    Args:
        x: (n, 3) positions.
        corners: (k,) vertices of all polygons, one after the other.
        counts: (f,) corners of each.

    Returns:
        (m, 3) places in `corners` and (m,) the polygon of each triangle. A polygon with a vertex twice in a row is cut
        without the second, where three are left.

    Raises:
        ValueError: a polygon with fewer than three corners, by its number.
    """
    few = np.flatnonzero(counts < 3)
    if len(few):
        raise ValueError(f"face {few[0]}: a face needs at least 3 corners, not {counts[few[0]]}")
    here, counts = _without_repeats(corners, counts)
    first = np.cumsum(counts) - counts
    threes = np.flatnonzero(counts == 3)
    out = [(here[first[threes, None] + np.arange(3)], threes)]
    quads, many = np.flatnonzero(counts == 4), np.flatnonzero(counts > 4)
    if len(quads) or len(many):
        following = np.arange(1, len(here) + 1)
        following[first + counts - 1] = first
        edges = _codes(corners[here], corners[here[following]], len(x))
        taken = set(edges.tolist()) if len(many) else set()
        for k in many:
            mine = here[first[k]: first[k] + counts[k]]
            made = _ears(x[corners[mine]], corners[mine].tolist(), taken, len(x))
            out.append((mine[np.array(made)], np.full(len(made), k)))
        places = here[first[quads, None] + np.arange(4)]
        edges = np.array([*taken], dtype=np.int64) if len(many) else edges
        out.append((_halves(x, corners, places, edges), np.repeat(quads, 2)))
    triangles, face = (np.concatenate(part) for part in zip(*out))
    order = np.argsort(face, kind="stable")
    return triangles[order], face[order]


def triangles_of(x: np.ndarray, polygons: Sequence | np.ndarray) -> np.ndarray:
    """(m, 3) triangles of polygons: lists of rows of x (n, 3), or an array of them.

    Raises:
        ValueError: a face that cannot be cut, or that names a vertex out of range, by its number.
    """
    counts = np.array([len(p) for p in polygons], dtype=np.int64)
    flat = [np.ravel(polygons)] if isinstance(polygons, np.ndarray) else [np.asarray(p) for p in polygons]
    with np.errstate(invalid="ignore"):  # NaN is out of range
        corners = np.concatenate([*flat, np.zeros(0, dtype=np.int64)]).astype(np.int64)
    bad = np.flatnonzero((corners < 0) | (corners >= len(x)))
    if len(bad):
        face = int(np.searchsorted(np.cumsum(counts), bad[0], side="right"))
        raise ValueError(f"face {face} names vertex {corners[bad[0]]} out of range: there are {len(x)}")
    return corners[cut(x, corners, counts)[0]]


def _without_repeats(corners: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of the corners that are not the same vertex as the one before, and how many of these each polygon has."""
    first = np.cumsum(counts) - counts
    before = np.arange(-1, len(corners) - 1)
    before[first] = first + counts - 1
    new = corners != corners[before]
    left = np.add.reduceat(new, first) if len(counts) else counts
    new |= np.repeat(left < 3, counts)  # nothing would be left of it
    return np.flatnonzero(new), np.where(left < 3, counts, left)


def _codes(a: np.ndarray, b: np.ndarray, n: int) -> np.ndarray:
    """A number of each edge between vertices a and b of n, whichever comes first."""
    return np.minimum(a, b) * n + np.maximum(a, b)


def _halves(x: np.ndarray, corners: np.ndarray, places: np.ndarray, taken: np.ndarray) -> np.ndarray:
    """(2 q, 3) places of the triangles of quads whose corners are at `places` (q, 4)."""
    p = x[corners[places]]
    normal = np.cross(p[:, 2] - p[:, 0], p[:, 3] - p[:, 1])
    side = p - np.roll(p, 1, axis=1)
    ear = np.einsum("qkd,qd->qk", np.cross(side, np.roll(side, -1, axis=1)), normal) > 0
    inside = np.stack([ear[:, 1] & ear[:, 3], ear[:, 0] & ear[:, 2]])  # of the diagonals 0-2 and 1-3
    length = np.linalg.norm(p[:, [2, 3]] - p[:, [0, 1]], axis=2).T
    shorter = np.where(inside[0] == inside[1], length[0] < (1 - TIE) * length[1], inside[0])
    v = corners[places]
    codes = np.stack([_codes(v[:, 0], v[:, 2], len(x)), _codes(v[:, 1], v[:, 3], len(x))])
    _settle(codes, inside, shorter, taken)
    one, other = places[:, [0, 1, 2, 0, 2, 3]], places[:, [3, 0, 1, 1, 2, 3]]
    return np.where(shorter[:, None], one, other).reshape(-1, 3)


def _settle(codes: np.ndarray, inside: np.ndarray, first: np.ndarray, taken: np.ndarray) -> None:
    """Turns diagonals that are edges already, `taken` or of another quad, where the other one is free and inside.

    Args:
        codes: (2, q) of the diagonals; inside: (2, q) whether they are.
        first: (q,) whether the first diagonal is the one to be cut along; written to.
    """
    chosen = np.where(first, codes[0], codes[1])
    kinds, back, count = np.unique(chosen, return_inverse=True, return_counts=True)
    doubtful = np.flatnonzero(((count > 1) | np.isin(kinds, taken))[back])
    if not len(doubtful):
        return
    used, edges = dict(zip(kinds.tolist(), count.tolist())), set(taken.tolist())
    for q in doubtful:
        mine, way = int(chosen[q]), int(first[q])  # the other diagonal is in the row `way`
        other = int(codes[way, q])
        if (mine in edges or used[mine] > 1) and inside[way, q] and other not in edges and not used.get(other):
            used[mine], used[other], first[q] = used[mine] - 1, 1, not first[q]


def _ears(p: np.ndarray, names: list[int], taken: set[int], n: int) -> list[tuple[int, int, int]]:
    """Triangles, as places in p (k, 3), of a polygon: ears are cut off, the one with the shortest diagonal first.

    Args:
        names: (k,) its vertices of n.
        taken: codes of edges that have triangles enough, which come last; those of the diagonals are added.
    """
    flat = _Flat(p)
    last = [0] * len(p)  # the newest entry of each corner in the queue
    queue: list[tuple[bool, bool, float, int, int]] = []
    out: list[tuple[int, int, int]] = []
    waiting: dict[int, list[int]] = {}  # corners that are no ears for the corner in their way

    def enter(k: int) -> None:
        i, j, obstacle = flat.before[k], flat.after[k], flat.obstacle(k)
        if obstacle is not None:
            waiting.setdefault(obstacle, []).append(k)
        low, high = sorted((names[i], names[j]))
        last[k] += 1
        heapq.heappush(queue, (obstacle is not None, low * n + high in taken, flat.distance(i, j), k, last[k]))

    for k in range(len(p)):
        enter(k)
    while len(out) < len(p) - 3:
        *_, k, entry = heapq.heappop(queue)
        if entry != last[k]:
            continue
        i, j = flat.before[k], flat.after[k]
        out.append((i, k, j))
        last[k] = -1
        low, high = sorted((names[i], names[j]))
        taken.add(low * n + high)
        freed = [w for c in flat.cut_off(k) for w in waiting.pop(c, [])]
        for w in {i, j, *freed}:
            if last[w] >= 0:
                enter(w)
    k = next(k for k in range(len(p)) if last[k] >= 0)
    return [*out, (flat.before[k], k, flat.after[k])]


class _Flat:
    """A polygon p (k, 3) in the plane of its mean normal, and the rest of it: the corners before and after each."""

    def __init__(self, p: np.ndarray) -> None:
        normal = np.cross(np.roll(p, 1, axis=0), p).sum(axis=0)
        e = np.linalg.svd(normal[None])[2]  # orthonormal, the first along the normal
        turn = np.sign(e[0] @ normal) * np.sign(np.linalg.det(e))
        self.points = p @ e[1:].T * [1, turn or 1]
        self.p: list[list[float]] = p.tolist()
        self.x: list[float] = self.points[:, 0].tolist()
        self.y: list[float] = self.points[:, 1].tolist()
        self.before, self.after = [len(p) - 1, *range(len(p) - 1)], [*range(1, len(p)), 0]
        self.hollow = np.array([self._turn(self.before[k], k, self.after[k]) <= 0 for k in range(len(p))])
        self.hollows = int(self.hollow.sum())

    def obstacle(self, k: int) -> int | None:
        """A corner that lies in the triangle of a corner and its neighbours, or k where it points in; None of an ear."""
        i, j = self.before[k], self.after[k]
        if self._turn(i, k, j) <= 0:
            return k
        if not self.hollows:
            return None
        rows = np.flatnonzero(self.hollow)  # a corner that points out is in it only together with one that does not
        rows = rows[(rows != i) & (rows != j)]
        to = self.points[rows]
        inside = np.ones(len(rows), dtype=bool)
        for a, b in ((i, k), (k, j), (j, i)):
            start, side = self.points[a], self.points[b] - self.points[a]
            inside &= side[0] * (to[:, 1] - start[1]) - side[1] * (to[:, 0] - start[0]) >= 0
        return int(rows[np.argmax(inside)]) if inside.any() else None

    def cut_off(self, k: int) -> list[int]:
        """Removes a corner; those that are in nobody's way any more."""
        i, j = self.before[k], self.after[k]
        self.after[i], self.before[j] = j, i
        before = self.hollow[[k, i, j]]
        self.hollow[[k, i, j]] = False, *(self._turn(self.before[c], c, self.after[c]) <= 0 for c in (i, j))
        now = self.hollow[[k, i, j]]
        self.hollows += int(now.sum()) - int(before.sum())
        return [c for c, was, still in zip((k, i, j), before, now) if was and not still]

    def distance(self, i: int, j: int) -> float:
        """Square of the distance between two corners, in space."""
        return sum((a - b) ** 2 for a, b in zip(self.p[i], self.p[j]))

    def _turn(self, i: int, k: int, j: int) -> float:
        """Twice the area of three corners, positive where they go round with the polygon."""
        x, y = self.x, self.y
        return (x[k] - x[i]) * (y[j] - y[k]) - (y[k] - y[i]) * (x[j] - x[k])
