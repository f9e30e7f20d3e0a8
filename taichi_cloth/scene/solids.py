"""Solids that cloth meets: shapes in a local frame, and how they move. numpy only.

A shape knows its surface (for pictures and crossing counts) and its core: the edges and corners, with a radius
round them, that could poke through a triangle of cloth between its vertices.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, shown
from .intersections import count_self_crossings
from .mesh import face_edges, face_indices, facing

PLANE, SPHERE, CAPSULE, BOX, CYLINDER, MESH = range(6)
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
        """What the distance function takes."""
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
        """What the distance function takes."""
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
    radius: float
    kind = CAPSULE

    def __post_init__(self) -> None:
        _positive(self, "capsule", "radius")
        for name in "ab":
            object.__setattr__(self, name, tuple(checks.vector(f"capsule {name}", getattr(self, name), "m").tolist()))
        if self.a == self.b:
            raise SceneError("capsule: a and b are the same point; use a Sphere")

    @property
    def parameters(self) -> list[float]:
        """What the distance function takes."""
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
        """What the distance function takes."""
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
    """A cylinder along the local y axis, closed by flat ends; radius and length [m]."""

    radius: float
    length: float
    kind = CYLINDER

    def __post_init__(self) -> None:
        _positive(self, "cylinder", "radius")
        _positive(self, "cylinder", "length")

    @property
    def parameters(self) -> list[float]:
        """What the distance function takes."""
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


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A triangle mesh, rigid or deforming by a sequence of positions.

    Args:
        x: (n, 3) [m], or (frames, n, 3) of a sequence.
        faces: (m, 3); a closed mesh has an inside, and normals that point out; an open one is a sheet with two sides.
        fps: frames a second of a sequence; positions between frames are interpolated linearly, before the first
            and after the last they stay.

    Attributes:
        closed: whether every edge has two triangles.
        notes: what was found out about it, and done.

    Raises:
        SceneError: wrong shapes, numbers that are not finite, faces out of range or with a repeated vertex, an edge with
            more than two triangles, no fps.
    """

    x: np.ndarray
    faces: np.ndarray
    fps: float | None = None
    closed: bool = field(init=False)
    notes: tuple[str, ...] = field(init=False)
    kind = MESH

    def __post_init__(self) -> None:
        x = checks.array("solid mesh", self.x, ("n", 3), ("frames", "n", 3), row="vertex or frame")
        x = x[None] if x.ndim == 2 else x
        if not x.size:
            raise SceneError("solid mesh: has no vertices")
        object.__setattr__(self, "fps", checks.maybe(self.fps, checks.number, "solid mesh fps", positive=True))
        if len(x) > 1 and self.fps is None:
            raise SceneError(f"solid mesh: a sequence of {len(x)} frames needs fps")
        faces = face_indices(self.faces, x.shape[1], SceneError)
        notes = []
        edges = face_edges(faces)
        code, back, count = np.unique(np.sort(edges, axis=1) @ np.array([x.shape[1], 1]), return_inverse=True,
                                      return_counts=True)
        if count.max() > 2:
            a, b = edges[np.argmax(count[back] > 2)]
            raise SceneError(f"solid mesh: edge ({a}, {b}) has more than two triangles")
        turned = facing(faces)
        if turned is None:
            notes.append("the solid mesh has one side only, like a Moebius strip: which side cloth is on means nothing")
        elif turned.any():
            faces = np.where(turned[:, None], faces[:, [0, 2, 1]], faces)
            notes.append(f"{int(turned.sum())} triangles of the solid mesh were turned against their neighbours, and turned "
                         "round")
        closed = bool((count == 2).all())
        corner = x[0][faces]
        volume = float(np.einsum("ij,ij->i", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])).sum() / 6)
        if not closed:
            notes.append(f"the solid mesh is open ({int((count == 1).sum())} border edges): cloth stays on the side of it "
                         "on which it starts")
        elif volume < 0:
            faces = faces[:, [0, 2, 1]]
            notes.append("the solid mesh was inside out: its triangles were turned round")
        crossings = count_self_crossings(x[0], faces)
        if crossings:
            notes.append(f"the solid mesh passes through itself ({crossings} crossings): every one of its triangles counts, "
                         "and cloth between two of its layers is pushed off the nearest")
        object.__setattr__(self, "x", x)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "closed", closed)
        object.__setattr__(self, "notes", tuple(notes))

    @property
    def parameters(self) -> list[float]:
        """None: distances are taken from the triangles."""
        return []

    def shape_at(self, t: float) -> np.ndarray:
        """(n, 3) local positions [m] at time t [s]."""
        t = checks.number("t", t, "s")
        if len(self.x) == 1:
            return self.x[0]
        frame = min(max(t * float(self.fps), 0.0), len(self.x) - 1.0)  # type: ignore[arg-type]
        k = min(int(frame), len(self.x) - 2)
        return self.x[k] + (frame - k) * (self.x[k + 1] - self.x[k])

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles) of the first frame."""
        return self.x[0], self.faces

    def core(self) -> Core:
        """All of it."""
        return self.x[0], self.faces, 0.0


Shape = Plane | Sphere | Capsule | Box | Cylinder | SolidMesh
Value = ArrayLike | Callable[[float], ArrayLike]


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid in a scene; made by `Scene.add_solid`.

    Attributes:
        friction: Coulomb's coefficient against cloth.
        thickness: distance [m] that cloth keeps from its surface.
        position: of the local origin [m], (3,) or a function of time [s].
        rotation: rotation vector (3,) [rad] or matrix (3, 3), or a function of time [s] that returns one.
    """

    name: str
    shape: Shape
    friction: float
    thickness: float
    position: Value
    rotation: Value
    color: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        checks.name("solid name", self.name)
        if not isinstance(self.shape, Shape):
            raise SceneError(f"solid {self.name!r}: needs a Plane, Sphere, Capsule, Box, Cylinder or SolidMesh, not "
                             f"{shown(self.shape)}")
        what = f"solid {self.name!r}: "
        for name, check in (("friction", {"least": 0.0}), ("thickness", {"unit": "m", "positive": True})):
            object.__setattr__(self, name, checks.number(what + name, getattr(self, name), **check))  # type: ignore[arg-type]
        object.__setattr__(self, "color", checks.maybe(self.color, checks.color, what + "color"))
        for name, shapes in (("position", [(3,)]), ("rotation", [(3,), (3, 3)])):
            value = getattr(self, name)
            if callable(value):
                checks.function(what + name, value, "time")
            else:
                object.__setattr__(self, name, checks.array(what + name, value, *shapes))
        self.pose(0.0)

    @property
    def moves(self) -> bool:
        """Whether its position, rotation or shape depends on time."""
        return callable(self.position) or callable(self.rotation) or self.deforms

    @property
    def deforms(self) -> bool:
        """Whether its shape depends on time."""
        return isinstance(self.shape, SolidMesh) and len(self.shape.x) > 1

    def pose(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """(R (3, 3), p (3,) [m]) at time t [s]: world = R local + p.

        Raises:
            SceneError: a function that returns a wrong shape, a number that is not finite, or no rotation.
        """
        t = checks.number("t", t, "s")
        p, R = (value(t) if callable(value) else value for value in (self.position, self.rotation))
        p = checks.vector(f"solid {self.name!r}: position at t = {t:g} s", p, "m")
        R = checks.array(f"solid {self.name!r}: rotation at t = {t:g} s", R, (3,), (3, 3))
        if R.shape == (3,):
            R = rotation_matrix(R)
        elif not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0):
            raise SceneError(f"solid {self.name!r}: the matrix at t = {t:g} s is no rotation")
        return R, p

    def surface_at(self, t: float) -> np.ndarray:
        """(k, 3) vertices of the shape's surface in the world [m]."""
        R, p = self.pose(t)
        local = self.shape.shape_at(t) if isinstance(self.shape, SolidMesh) else self.shape.surface()[0]
        return local @ R.T + p


def rotation_matrix(vector: ArrayLike) -> np.ndarray:
    """(3, 3) rotation by |vector| [rad] about the vector (3,). [Rodrigues]"""
    w = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(w))
    if angle == 0:
        return np.eye(3)
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) / angle
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)


def _positive(shape: object, word: str, name: str) -> None:
    """A frozen shape's length [m], checked and made float."""
    object.__setattr__(shape, name, checks.number(f"{word} {name}", getattr(shape, name), "m", positive=True))


def _revolve(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """A profile of (radius, height), from below, turned about y; poles are rings of one point each."""
    angle = np.linspace(0, 2 * math.pi, ROUND, endpoint=False)
    x = np.array([[r * math.cos(a), y, -r * math.sin(a)] for r, y in profile for a in angle])
    faces = []
    for k, (low, high) in enumerate(zip(profile[:-1], profile[1:])):
        for i in range(ROUND):
            j = (i + 1) % ROUND
            a, b, c, d = k * ROUND + i, k * ROUND + j, (k + 1) * ROUND + j, (k + 1) * ROUND + i
            faces += ([[a, b, c]] if low[0] > 1e-12 else []) + ([[a, c, d]] if high[0] > 1e-12 else [])
    return x, np.array(faces)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Several (vertices, triangles) as one."""
    starts = np.cumsum([0] + [len(x) for x, _ in parts])
    return np.concatenate([x for x, _ in parts]), np.concatenate([f + s for (_, f), s in zip(parts, starts)])


def _merged(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same with equal vertices made one."""
    _, first, index = np.unique(np.round(x, 12), axis=0, return_index=True, return_inverse=True)
    return x[first], index.ravel()[faces]
