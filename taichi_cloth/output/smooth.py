"""Cloth in finer triangles, for pictures only: subdivision by Loop's rules, which rounds outlines and folds.

[C. Loop: Smooth Subdivision Surfaces Based on Triangles, 1987; weights of J. Warren: 3/(8 k) for k neighbours]
Differs from it: border vertices of one or two triangles, the corners of a sheet, stay where they are. Loop's rules round a
surface off on its inner side, and would press cloth that lies on a solid into it. There a point is no nearer to the solid
than the simulated triangles. Nor is it nearer than a smooth surface whose vertices were first moved out by as much as the
rules move them in. Where another layer of cloth is near, both stay as they were simulated.
"""

import numpy as np

ROUNDS = 6  # of moving vertices out: folds wider than a few triangles come back whole, finer ones are rounded a little
RINGS = 2  # of vertices round those that a solid pushes: they are near it, and do not always touch
MOST = 3  # each halves edges once more
CHILDREN = ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5))  # of a triangle 0 1 2 with the points 3, 4, 5 on 01, 12, 20
LOCAL = np.array([(1, 0, 0), (0, 1, 0), (0, 0, 1), (.5, .5, 0), (0, .5, .5), (.5, 0, .5)])[np.array(CHILDREN)]


class Halving:
    """One level: a point on every edge, and the vertices moved.

    Args:
        faces: (m, 3) of n vertices.

    Attributes:
        faces: (4 m, 3), those of a face one after the other; the points on edges follow the n vertices.
    """

    def __init__(self, faces: np.ndarray, n: int) -> None:
        pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1).astype(np.int64)
        code, inverse, count = np.unique(pairs[:, 0] * n + pairs[:, 1], return_inverse=True, return_counts=True)
        self.a, self.b = code // n, code % n
        self.edge, self.opposite = inverse.reshape(-1), faces[:, [2, 0, 1]].ravel()
        self.inner = (count == 2)[:, None]
        of = np.concatenate([faces, n + inverse.reshape(-1, 3)], axis=1)
        self.faces = of[:, CHILDREN].reshape(-1, 3).astype(np.int32)
        border, ends = count == 1, np.concatenate([self.a, self.b])
        on_border = np.bincount(ends, np.tile(border, 2), n)
        valence = np.bincount(ends, minlength=n)
        # weight of a neighbour over an edge, and of the vertex itself
        self.weight = np.where(on_border > 0, 0.0, np.where(valence == 3, 3 / 16, 3 / (8 * np.maximum(valence, 1))))
        self.border = border[:, None]
        self.along = np.where((on_border == 2) & (np.bincount(faces.ravel(), minlength=n) > 2), 1 / 8, 0.0)
        self.own = 1 - self.weight * valence - 2 * self.along
        # a level later, the neighbours are nearer to a vertex by this factor, and so is its next move shorter
        self.shorter = np.where(on_border > 0, 1 / 4, 5 / 8 - self.weight * valence)

    def points(self, x: np.ndarray) -> np.ndarray:
        """Positions (n, 3), after Loop."""
        p, q = x[self.a], x[self.b]
        across = _sums(self.edge, x[self.opposite], len(self.a))
        between = np.where(self.inner, 0.375 * (p + q) + 0.125 * across, 0.5 * (p + q))
        return np.concatenate([self._moved(x), between])

    def outward(self, x: np.ndarray, levels: int) -> np.ndarray:
        """Positions (n, 3) that so many levels move to x."""
        moves = ((1 - self.shorter**levels) / (1 - self.shorter))[:, None]  # of all levels, in those of the first
        out = x
        for _ in range(ROUNDS):
            out = x - moves * (self._moved(out) - out)
        return out

    def _moved(self, x: np.ndarray) -> np.ndarray:
        p, q = x[self.a], x[self.b]
        around = _sums(self.a, q, len(x)) + _sums(self.b, p, len(x))
        beside = _sums(self.a, q * self.border, len(x)) + _sums(self.b, p * self.border, len(x))
        return self.own[:, None] * x + self.weight[:, None] * around + self.along[:, None] * beside

    def linear(self, values: np.ndarray) -> np.ndarray:
        """Values (n, d) at the vertices, as they are, and their means on edges."""
        return np.concatenate([values, (values[self.a] + values[self.b]) / 2])


class Smooth:
    """A finer mesh over a given one.

    Args:
        faces: (m, 3) of n vertices; level: how often edges are halved.
        sewn: (n,) the vertex that stands for the cluster of each, or None.

    Attributes:
        faces: (m 4^level, 3) of finer vertices, those of a face one after the other.
        each: how many there are in a face; count: of finer vertices.
    """

    def __init__(self, faces: np.ndarray, n: int, level: int, sewn: np.ndarray | None = None) -> None:
        self.faces, self.count, self.each = faces if sewn is None else sewn[faces], n, 4**level
        self.levels: list[Halving] = []
        for _ in range(level):
            self.levels.append(Halving(self.faces, self.count))
            self.faces = self.levels[-1].faces
            self.count += len(self.levels[-1].a)

    def points(self, x: np.ndarray, push: np.ndarray | None = None, layered: np.ndarray | None = None) -> np.ndarray:
        """(count, 3) finer vertices of positions x (n, 3) [m].

        Args:
            push: (n, 3) forces of solids, or ways out of them, along which vertices keep away.
            layered: (n,) vertices at which cloth stays as simulated, since another layer is near.
        """
        fine = self._rounded(x) if push is None or not push.any() else self._kept_away(x, push)
        if layered is None or not layered.any():
            return fine
        part = self.linear(layered[:, None].astype(float))
        return fine + part * (self.linear(x) - fine)

    def _kept_away(self, x: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Rounded, but no nearer to solids."""
        fine = self._rounded(x)
        away = _units(self.linear(self._spread(_units(push))))
        others = self.linear(x), self._rounded(self.levels[0].outward(x, len(self.levels)))
        lacks = np.max([np.einsum("ij,ij->i", other - fine, away) for other in others], axis=0)
        return fine + np.maximum(lacks, 0.0)[:, None] * away

    def _rounded(self, x: np.ndarray) -> np.ndarray:
        for level in self.levels:
            x = level.points(x)
        return x

    def _spread(self, away: np.ndarray) -> np.ndarray:
        """Directions (n, 3), those of vertices without one from their neighbours."""
        a, b = self.levels[0].a, self.levels[0].b
        for _ in range(RINGS):
            near = _units(_sums(a, away[b], len(away)) + _sums(b, away[a], len(away)))
            away = np.where(away.any(axis=1, keepdims=True), away, near)
        return away

    def linear(self, values: np.ndarray) -> np.ndarray:
        """Values (n, d) at the vertices, at the finer ones."""
        for level in self.levels:
            values = level.linear(values)
        return values

    def corners(self, values: np.ndarray) -> np.ndarray:
        """Values (m, 3, d) at corners of faces, at those of the finer ones."""
        for _ in self.levels:
            values = np.einsum("cij,fjd->fcid", LOCAL, values).reshape(-1, 3, values.shape[2])
        return values


def _sums(index: np.ndarray, rows: np.ndarray, n: int) -> np.ndarray:
    """(n, 3) sums of rows by index."""
    return np.stack([np.bincount(index, rows[:, d], n) for d in range(rows.shape[1])], axis=1)


def _units(rows: np.ndarray) -> np.ndarray:
    """Rows (n, 3) of length 1, or 0."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    return np.divide(rows, length, out=np.zeros(rows.shape), where=length > 0)
