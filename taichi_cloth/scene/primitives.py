"""Solids that distance functions describe, in a local frame. numpy only.

A shape knows its surface (for pictures and crossing counts) and its core: the edges and corners, with a radius
round them, that could poke through a triangle of cloth between its vertices.
"""

import math
import numbers
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown

PLANE, SPHERE, CAPSULE, BOX, CYLINDER = range(5)
ROUND = 48  # segments of a circle in surfaces and cores
NO_CORE = (np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), 0.0)

Core = tuple[np.ndarray, np.ndarray, float]  # vertices (k, 3), triangles (m, 3), perhaps degenerate, radius [m]


@dataclass(frozen=True)
class Plane:
    """The half space below a plane through the local origin.

    Args:
        normal: (3,) out of the solid; normalised.
        size: half the side of the square that pictures show [m].
    """

    normal: tuple[float, float, float] = (0.0, 1.0, 0.0)
    size: float = 1.0
    kind = PLANE

    def __post_init__(self) -> None:
        _positive(self, "plane", "size")
        n = checks.vector("plane normal", self.normal)
        if not np.linalg.norm(n) > checks.SMALLEST:
            raise SceneError(f"plane normal = {shown(self.normal)}: needs a direction, not all 0")
        object.__setattr__(self, "normal", tuple((n / np.linalg.norm(n)).tolist()))

    @property
    def parameters(self) -> list[float]:
        """Arguments of the distance function."""
        return [*self.normal]

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles) of the square that is shown."""
        n = np.array(self.normal)
        u = np.cross(n, [1.0, 0, 0] if abs(n[0]) < 0.9 else [0, 1.0, 0])
        u /= np.linalg.norm(u)
        w = np.cross(n, u)
        x = self.size * np.array([u + w, -u + w, -u - w, u - w])
        return x, np.array([[0, 1, 2], [0, 2, 3]])

    def core(self) -> Core:
        """Nothing pokes."""
        return NO_CORE


@dataclass(frozen=True)
class Sphere:
    """A ball round the local origin; radius [m]."""

    radius: float
    kind = SPHERE

    def __post_init__(self) -> None:
        _positive(self, "sphere", "radius")

    @property
    def parameters(self) -> list[float]:
        """Arguments of the distance function."""
        return [self.radius]

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles), inscribed."""
        return _revolve([(self.radius * math.sin(a), -self.radius * math.cos(a))
                         for a in np.linspace(0, math.pi, ROUND // 2 + 1)])

    def core(self) -> Core:
        """The centre."""
        return np.zeros((1, 3)), np.zeros((1, 3), dtype=np.int64), self.radius


@dataclass(frozen=True)
class Capsule:
    """All points nearer than `radius` [m] to the segment from `a` to `b` [m]."""

    a: tuple[float, float, float]
    b: tuple[float, float, float]
    radius: float = math.nan  # has to be given; the default makes its absence an error with advice
    kind = CAPSULE

    def __post_init__(self) -> None:
        if isinstance(self.a, numbers.Real) and isinstance(self.b, numbers.Real):
            raise SceneError(f"capsule: a = {shown(self.a)} and b = {shown(self.b)} must be the ends of its axis, not a "
                             "radius and a height: one that stands is Capsule((0, 0, 0), (0, height, 0), radius)")
        _positive(self, "capsule", "radius")
        for name in "ab":
            object.__setattr__(self, name, tuple(checks.vector(f"capsule {name}", getattr(self, name), "m").tolist()))
        if self.a == self.b:
            raise SceneError("capsule: a and b are the same point; use a Sphere")

    @property
    def parameters(self) -> list[float]:
        """Arguments of the distance function."""
        return [*self.a, *self.b, self.radius]

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles), inscribed."""
        a, b, r = np.array(self.a), np.array(self.b), self.radius
        length = float(np.linalg.norm(b - a))
        cap = np.linspace(0, math.pi / 2, ROUND // 4 + 1)
        low = [(r * math.sin(t), -r * math.cos(t)) for t in cap]
        x, faces = _revolve(low + [(p, length - q) for p, q in reversed(low)])
        axis = (b - a) / length
        side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
        side /= np.linalg.norm(side)
        return a + x @ np.stack([side, axis, np.cross(side, axis)]), faces

    def core(self) -> Core:
        """The segment."""
        return np.array([self.a, self.b]), np.array([[0, 1, 1]]), self.radius


@dataclass(frozen=True)
class Box:
    """A box round the local origin.

    Args:
        size: (3,) full sides [m].
        radius: of its rounded edges [m]; 0 is sharp.
    """

    size: tuple[float, float, float]
    radius: float = 0.0
    kind = BOX

    def __post_init__(self) -> None:
        size = checks.vector("box size", self.size, "m").tolist()
        object.__setattr__(self, "size", tuple(checks.number("box size", s, "m", positive=True) for s in size))
        object.__setattr__(self, "radius", checks.number("box radius", self.radius, "m", least=0.0, most=min(size) / 2))

    @property
    def parameters(self) -> list[float]:
        """Arguments of the distance function."""
        return [*(s / 2 for s in self.size), self.radius]

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles): the box with its edges bevelled round, inscribed."""
        steps = 1 if self.radius == 0 else 5
        angles = np.linspace(0, math.pi / 2, steps)
        unit: list[np.ndarray] = []
        faces: list[list[int]] = []
        for axis in range(3):  # six faces, each with its quarter rounds
            for sign in (1, -1):
                a, b = (axis + 1) % 3, (axis + 2) % 3
                grid = [(-1, t) for t in angles[::-1] if t] + [(-1, 0.0), (1, 0.0)] + [(1, t) for t in angles if t]
                grid = [(s, t) for s, t in grid if t <= math.pi / 4 + 1e-9]
                rows = []
                for s, t in grid:
                    row = []
                    for q, r in grid:
                        n = np.zeros(3)
                        n[axis], n[a], n[b] = sign, s * math.tan(t), q * math.tan(r)
                        side = np.zeros(3)
                        side[axis], side[a], side[b] = sign, s, q
                        row.append(side * (np.array(self.size) / 2 - self.radius)
                                   + self.radius * n / np.linalg.norm(n))
                    rows.append(row)
                start, k = len(unit), len(grid)
                unit += [p for row in rows for p in row]
                for i in range(k - 1):
                    for j in range(k - 1):
                        c = [start + i * k + j, start + (i + 1) * k + j, start + (i + 1) * k + j + 1, start + i * k + j + 1]
                        c = c if sign > 0 else c[::-1]
                        faces += [[c[0], c[1], c[2]], [c[0], c[2], c[3]]]
        return np.array(unit), np.array(faces)

    def core(self) -> Core:
        """The box that is left without the rounding."""
        half = np.array(self.size) / 2 - self.radius
        x = np.array([[sx, sy, sz] for sx in (-1, 1) for sy in (-1, 1) for sz in (-1, 1)]) * half
        quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        return x, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]), self.radius


@dataclass(frozen=True)
class Cylinder:
    """A cylinder along the local y axis, around the origin, closed by flat ends; radius and length [m]."""

    radius: float
    length: float
    kind = CYLINDER

    def __post_init__(self) -> None:
        _positive(self, "cylinder", "radius")
        _positive(self, "cylinder", "length")

    @property
    def parameters(self) -> list[float]:
        """Arguments of the distance function."""
        return [self.radius, self.length / 2]

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles), inscribed; rims are double, so that they look sharp."""
        r, y = self.radius, self.length / 2
        parts = [_revolve([(0.0, -y), (r, -y)]), _revolve([(r, -y), (r, y)]), _revolve([(r, y), (0.0, y)])]
        return _joined(parts)

    def core(self) -> Core:
        """Its rims, as polygons."""
        r, y = self.radius, self.length / 2
        return *_merged(*_revolve([(0.0, -y), (r, -y), (r, y), (0.0, y)])), 0.0


def _positive(shape: object, word: str, name: str) -> None:
    """A frozen shape's length [m], checked and made float."""
    object.__setattr__(shape, name, checks.number(f"{word} {name}", getattr(shape, name), "m", positive=True))


def _revolve(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """A profile of (radius, height), from below, turned about y; poles are rings of one point each."""
    circle = np.array([(math.cos(a), 1.0, -math.sin(a)) for a in np.linspace(0, 2 * math.pi, ROUND, endpoint=False)])
    x = (np.array([(r, y, r) for r, y in profile])[:, None] * circle).reshape(-1, 3)
    i = np.arange(ROUND)
    j = (i + 1) % ROUND
    faces = np.array([np.stack([k + i, k + j, k + j + ROUND, k + i, k + j + ROUND, k + i + ROUND], axis=1).reshape(ROUND, 2, 3)
                      for k in ROUND * np.arange(len(profile) - 1)])
    ends = np.array([(low[0] > 1e-12, high[0] > 1e-12) for low, high in zip(profile[:-1], profile[1:])])
    return x, faces[np.broadcast_to(ends[:, None], faces.shape[:3])]


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Several (vertices, triangles) as one."""
    starts = np.cumsum([0] + [len(x) for x, _ in parts])
    return np.concatenate([x for x, _ in parts]), np.concatenate([f + s for (_, f), s in zip(parts, starts)])


def _merged(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same with equal vertices made one."""
    _, first, index = np.unique(np.round(x, 12), axis=0, return_index=True, return_inverse=True)
    return x[first], index.ravel()[faces]
