"""Solids that cloth meets: shapes, and how they move. numpy only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, did_you_mean, shown
from . import border
from .intersections import count_self_crossings
from .mesh import face_edges, face_indices, facing
from .primitives import Box, Capsule, Core, Cylinder, Plane, Sphere

MESH = 5  # a shape's kind, after those of `primitives`
JUMP = 10.0  # times the median of how far a sequence moves from frame to frame, where it moves: more is said
STILL = 1e-6  # of a mesh's size: a mesh that moves less from frame to frame stands still


@dataclass(frozen=True, eq=False)
class SolidMesh:
    """A triangle mesh, rigid or deforming by a sequence of positions.

    Args:
        x: (n, 3) [m], or (frames, n, 3) of a sequence.
        faces: (m, 3); a closed mesh has an inside, and normals that point out; an open one is a sheet with two sides.
        fps: frames a second of a sequence; positions between frames are interpolated linearly, before the first
            and after the last they stay.
        groups: named groups of vertices, name -> indices, for `Scene.add_solid(parts=...)`.
        start: time of the first frame [s].

    Attributes:
        closed: whether every edge has two triangles.
        notes: findings about it, and repairs.

    Raises:
        SceneError: wrong shapes, numbers that are not finite, faces out of range or with a repeated vertex, an edge with
            more than two triangles, no fps.
    """

    x: np.ndarray
    faces: np.ndarray
    fps: float | None = None
    groups: dict[str, np.ndarray] = field(default_factory=dict)
    start: float = 0.0
    closed: bool = field(init=False)
    notes: tuple[str, ...] = field(init=False)
    kind = MESH

    def __post_init__(self) -> None:
        x = checks.array("solid mesh", self.x, ("n", 3), ("frames", "n", 3), row="vertex or frame")
        x = x[None] if x.ndim == 2 else x
        if not x.size:
            raise SceneError(f"solid mesh: has no {'vertices' if len(x) else 'frames'}")
        object.__setattr__(self, "fps", checks.maybe(self.fps, checks.number, "solid mesh fps", positive=True))
        object.__setattr__(self, "start", checks.number("solid mesh start", self.start, "s"))
        if len(x) > 1 and self.fps is None:
            raise SceneError(f"solid mesh: a sequence of {len(x)} frames needs fps")
        faces = face_indices(self.faces, x.shape[1], SceneError)
        groups = checks.instance("solid mesh: groups", self.groups, dict)
        object.__setattr__(self, "groups", {checks.name("group name", name): checks.indices(
            f"solid mesh: group {name!r}", index, x.shape[1]) for name, index in groups.items()})
        notes = _of_frames(x, self.start)
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
            said = border.said(x[0], edges[count[back] == 1])
            notes.append(f"the solid mesh is open ({said}): cloth stays on the side of it on which it starts")
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

    def __repr__(self) -> str:
        frames, n = self.x.shape[:2]
        moves = f", {frames:,} frames" if frames > 1 else ""
        return f"<SolidMesh of {n:,} vertices, {len(self.faces):,} triangles, {'closed' if self.closed else 'open'}{moves}>"

    @property
    def parameters(self) -> list[float]:
        """None: distances are taken from the triangles."""
        return []

    def shape_at(self, t: float) -> np.ndarray:
        """(n, 3) local positions [m] at time t [s]."""
        t = checks.number("t", t, "s")
        if len(self.x) == 1:
            return self.x[0]
        frame = min(max((t - self.start) * float(self.fps), 0.0), len(self.x) - 1.0)  # type: ignore[arg-type]
        k = min(int(frame), len(self.x) - 2)
        return self.x[k] + (frame - k) * (self.x[k + 1] - self.x[k])

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(vertices, triangles) of the first frame."""
        return self.x[0], self.faces

    def core(self) -> Core:
        """All of it."""
        return self.x[0], self.faces, 0.0


def _of_frames(x: np.ndarray, start: float) -> list[str]:
    """Sentences on a sequence (frames, n, 3) that waits, or that jumps."""
    notes = []
    if len(x) > 1 and start > 0:
        notes.append(f"the solid mesh stands still until its first frame, at {start:g} s")
    moves = np.array([np.linalg.norm(b - a, axis=1).max() for a, b in zip(x, x[1:])])
    some = moves[moves > STILL * np.ptp(x[0], axis=0).max()]
    usual = float(np.median(some)) if len(some) else np.inf
    return notes + [f"the solid mesh jumps from frame {k} to {k + 1} (counted from 0) by {moves[k]:.3g} m, "
                    f"{moves[k] / usual:.0f} times as far as it usually moves: are its frames whole, and in order?"
                    for k in np.flatnonzero(moves > JUMP * usual)]


Shape = Plane | Sphere | Capsule | Box | Cylinder | SolidMesh
Value = ArrayLike | Callable[[float], ArrayLike]


class Placed:
    """A shape at a place in a scene; both may depend on time."""

    WHAT = ""  # it is, in messages
    name: str
    shape: Shape
    position: Value
    rotation: Value
    color: str | tuple[float, float, float] | None

    def _check_place(self) -> None:
        what = f"{self.WHAT} {checks.name(self.WHAT + ' name', self.name)!r}: "
        if not isinstance(self.shape, Shape):
            raise SceneError(f"{what}needs a Plane, Sphere, Capsule, Box, Cylinder or SolidMesh, not {shown(self.shape)}")
        object.__setattr__(self, "color", checks.maybe(self.color, checks.color, what + "color"))
        for name, shapes in (("position", [(3,)]), ("rotation", [(3,), (3, 3)])):
            value = getattr(self, name)
            if callable(value):
                checks.function(what + name, value, "time")
            else:
                object.__setattr__(self, name, checks.array(what + name, value, *shapes))
        self.pose(0.0)

    def __repr__(self) -> str:
        return f"<{self.WHAT.capitalize()} {self.name!r}: {self.shape!r}{', moves' if self.moves else ''}>"

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
        p = checks.vector(f"{self.WHAT} {self.name!r}: position at t = {t:g} s", p, "m")
        R = checks.array(f"{self.WHAT} {self.name!r}: rotation at t = {t:g} s", R, (3,), (3, 3))
        if R.shape == (3,):
            R = rotation_matrix(R)
        elif not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0):
            raise SceneError(f"{self.WHAT} {self.name!r}: the matrix at t = {t:g} s is not a rotation")
        return R, p

    def surface_at(self, t: float) -> np.ndarray:
        """(k, 3) vertices of the shape's surface in the world [m]."""
        R, p = self.pose(t)
        local = self.shape.shape_at(t) if isinstance(self.shape, SolidMesh) else self.shape.surface()[0]
        return local @ R.T + p


@dataclass(frozen=True, eq=False, repr=False)
class Prop(Placed):
    """A shape that pictures and exports show and cloth does not meet; made by `Scene.add_prop`.

    Attributes:
        position: of the local origin [m], (3,) or a function of time [s].
        rotation: rotation vector (3,) [rad] or matrix (3, 3), or a function of time [s] that returns one.
    """

    WHAT = "prop"
    name: str
    shape: Shape
    position: Value
    rotation: Value
    color: str | tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        self._check_place()


@dataclass(frozen=True, eq=False, repr=False)
class Solid(Placed):
    """A solid in a scene; made by `Scene.add_solid`.

    Attributes:
        friction: Coulomb's coefficient against cloth.
        thickness: distance [m] that cloth keeps from its surface.
        position: of the local origin [m], (3,) or a function of time [s].
        rotation: rotation vector (3,) [rad] or matrix (3, 3), or a function of time [s] that returns one.
        parts: friction of faces all of whose corners are in a group of the mesh, by the groups' names; None lets cloth pass.
    """

    WHAT = "solid"
    name: str
    shape: Shape
    friction: float
    thickness: float
    position: Value
    rotation: Value
    color: str | tuple[float, float, float] | None = None
    parts: dict[str, float | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_place()
        what = f"solid {self.name!r}: "
        for name, check in (("friction", {"least": 0.0}), ("thickness", {"unit": "m", "positive": True})):
            object.__setattr__(self, name, checks.number(what + name, getattr(self, name), **check))  # type: ignore[arg-type]
        parts = checks.instance(what + "parts", self.parts, dict)
        object.__setattr__(self, "parts", {name: checks.maybe(mu, checks.number, f"{what}friction of part {name!r}", least=0.0)
                                           for name, mu in parts.items()})
        self.face_friction()

    def face_friction(self) -> np.ndarray:
        """(m,) friction of a mesh's faces, NaN if cloth passes.

        Raises:
            SceneError: a part that is no group of the mesh, or has no face.
        """
        faces, groups = (self.shape.faces, self.shape.groups) if isinstance(self.shape, SolidMesh) else (np.zeros((0, 3)), {})
        out = np.full(len(faces), self.friction)
        for name, mu in self.parts.items():
            if name not in groups:
                raise SceneError(f"solid {self.name!r}: part {name!r} is not a group of its mesh; "
                                 f"{did_you_mean(name, list(groups))}")
            mine = np.isin(faces, groups[name]).all(axis=1)
            if not mine.any():
                raise SceneError(f"solid {self.name!r}: no face has all of its corners in the group {name!r}")
            out[mine] = np.nan if mu is None else mu
        return out


def rotation_matrix(vector: ArrayLike) -> np.ndarray:
    """(3, 3) rotation by |vector| [rad] about the vector (3,). [Rodrigues]"""
    w = np.asarray(vector, dtype=np.float64)
    angle = float(np.linalg.norm(w))
    if angle == 0:
        return np.eye(3)
    k = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) / angle
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * (k @ k)
