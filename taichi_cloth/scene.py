"""What there is and what is done to it: cloths, pins, prescribed motion, air, events. numpy only; runs nothing."""

import contextlib
import inspect
import itertools
import numbers
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from .errors import SceneError, check_choice, did_you_mean
from .fabric import ClothContact, Fabric
from .mesh import TriMesh
from .solids import Shape, Solid, Value
from .view import View

Path = Callable[[float], ArrayLike]


@dataclass(frozen=True, eq=False)
class Cloth:
    """A piece of cloth in a scene; made by `Scene.add_cloth` and handed to `pin`, `move` and the rest.

    Attributes:
        start: index of its first vertex in the simulation's arrays.
        positions, velocities: (n, 3) at time 0 [m], [m/s].
        contact: how it meets other cloth; None passes through.
    """

    name: str
    mesh: TriMesh
    fabric: Fabric
    positions: np.ndarray
    velocities: np.ndarray
    start: int
    color: tuple[float, float, float] | None = None
    contact: ClothContact | None = None


@dataclass(frozen=True, eq=False)
class Attachment:
    """Vertices held or led in 1 to 3 directions.

    Attributes:
        vertices: indices in the cloth.
        directions: (d, 3) orthonormal rows.
        path: None holds the vertices where they are when the attachment begins.
        relative: whether the path gives displacements from there, or positions.
        key: stays the same when some of the vertices are released.
        selected: the vertices that the path speaks of, released ones included.
    """

    cloth: Cloth
    vertices: np.ndarray
    directions: np.ndarray
    path: Path | None
    relative: bool
    key: int
    selected: np.ndarray

    def target(self, t: float, anchor: np.ndarray) -> np.ndarray:
        """(k, 3) positions [m] of `vertices` at time t [s]; `anchor` (n, 3) is the cloth when it began.

        Raises:
            SceneError: where the path returns a wrong shape or a number that is not finite.
        """
        here = anchor[self.vertices]
        if self.path is None:
            return here
        value = self.checked(t)
        if value.ndim == 2:
            value = value[np.searchsorted(self.selected, self.vertices)]
        return here + value if self.relative else np.broadcast_to(value, here.shape)

    def checked(self, t: float) -> np.ndarray:
        """The path's value at t, checked for shape and finiteness; rows sorted by vertex."""
        value = np.asarray(self.path(t), dtype=np.float64)  # type: ignore[misc]
        k = len(self.selected)
        shapes = [(k, 3)] + ([(3,)] if self.relative or k == 1 else [])
        what = f"the path that moves {k} vertices of {self.cloth.name!r}"
        if value.shape not in shapes:
            raise SceneError(f"{what} returned shape {value.shape} at t = {t:g} s: needs "
                             f"{' or '.join(map(str, shapes))}"
                             + ("" if self.relative else "; relative=True takes one displacement for all"))
        if not np.isfinite(value).all():
            raise SceneError(f"{what} returned a number that is not finite at t = {t:g} s")
        return value


@dataclass(frozen=True)
class Air:
    """Viscous air drag per area, f/A = -normal (n.u) n - tangential (u - (n.u) n), u = velocity - wind.

    Args:
        normal, tangential: coefficients [N s/m^3], at least 0 and not both 0.
        wind: velocity of the air [m/s], (3,) or a function of time [s] that returns it.
    """

    normal: float
    tangential: float = 0.0
    wind: ArrayLike | Callable[[float], ArrayLike] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("normal", "tangential"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise SceneError(f"air {name} = {value!r} N s/m^3: must be at least 0")
        if self.normal == self.tangential == 0:
            raise SceneError("air with both coefficients 0 does nothing: leave it out")
        self.wind_at(0.0)

    def wind_at(self, t: float) -> np.ndarray:
        """(3,) wind [m/s] at time t [s].

        Raises:
            SceneError: a wrong shape or a number that is not finite.
        """
        value = np.asarray(self.wind(t) if callable(self.wind) else self.wind, dtype=np.float64)
        if value.shape != (3,) or not np.isfinite(value).all():
            raise SceneError(f"the wind at t = {t:g} s is {value.tolist()}: needs three finite numbers [m/s]")
        return value


@dataclass(frozen=True)
class Event:
    """A function to be called when simulated time reaches `time` [s]."""

    time: float
    action: Callable


@dataclass
class Script:
    """The part of a scene that events may change while a simulation runs."""

    attachments: list[Attachment] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)

    def copy(self) -> "Script":
        """A copy whose lists are its own."""
        return Script(list(self.attachments), list(self.events))


class Scene:
    """A scene.

    Args:
        gravity: (3,) acceleration [m/s^2]; None or zeros model none. y is up.
        air: drag and wind, or None.
        view: how to draw it.
    """

    def __init__(self, gravity: ArrayLike | None = (0.0, -9.81, 0.0), air: Air | None = None,
                 view: View | None = None) -> None:
        self.gravity = _three(np.zeros(3) if gravity is None else gravity, "gravity [m/s^2]")
        if air is not None and not isinstance(air, Air):
            raise SceneError(f"air must be an Air or None, not {air!r}")
        self.air = air
        self.view = view or View()
        self.cloths: list[Cloth] = []
        self.solids: list[Solid] = []
        self.apart: list[tuple[Cloth, Cloth]] = []  # pairs that pass through each other
        self.masses: list[tuple[Cloth, np.ndarray, float]] = []
        self.script = Script()
        self._key = itertools.count()

    def add_cloth(self, mesh: TriMesh, fabric: Fabric, positions: ArrayLike | None = None,
                  velocities: ArrayLike | None = None, name: str | None = None,
                  color: tuple[float, float, float] | None = None, contact: ClothContact | None = None) -> Cloth:
        """Adds a piece of cloth.

        Args:
            positions: (n, 3) at time 0 [m]; the mesh's own where None.
            velocities: (n, 3) or (3,) at time 0 [m/s]; zero where None.
            color: (3,) linear RGB in 0..1 for pictures.
            contact: how it meets itself and other cloth that has a contact; None passes through, and costs nothing.
        """
        if not isinstance(mesh, TriMesh):
            raise SceneError(f"add_cloth needs a TriMesh, not {type(mesh).__name__}")
        if not isinstance(fabric, Fabric):
            raise SceneError(f"add_cloth needs a Fabric, not {type(fabric).__name__}")
        if contact is not None and not isinstance(contact, ClothContact):
            raise SceneError(f"add_cloth: contact needs a ClothContact or None, not {contact!r:.60}")
        name = name or f"cloth{len(self.cloths)}"
        if name in (c.name for c in self.cloths):
            raise SceneError(f"there is a cloth named {name!r} already")
        n = mesh.vertex_count
        x = mesh.x if positions is None else _rows(positions, n, f"positions of {name!r}")
        v = np.zeros((n, 3)) if velocities is None else _rows(
            np.broadcast_to(velocities, (n, 3)) if np.shape(velocities) == (3,) else velocities, n,
            f"velocities of {name!r}")
        cloth = Cloth(name, mesh, fabric, x, v, self.vertex_count, color, contact)
        self.cloths.append(cloth)
        return cloth

    def pass_through(self, a: Cloth, b: Cloth) -> None:
        """Lets two cloths that have a contact pass through each other."""
        for cloth in (a, b):
            self._own(cloth)
        if a is b:
            raise SceneError(f"pass_through: {a.name!r} twice; for a cloth and itself use ClothContact(itself=False)")
        self.apart.append((a, b))

    def passes(self, a: Cloth, b: Cloth) -> bool:
        """Whether two cloths pass through each other."""
        return (a, b) in self.apart or (b, a) in self.apart or a.contact is None or b.contact is None

    def add_solid(self, shape: Shape, friction: float, thickness: float, position: Value = (0.0, 0.0, 0.0),
                  rotation: Value = (0.0, 0.0, 0.0), name: str | None = None,
                  color: tuple[float, float, float] | None = None) -> Solid:
        """Adds a solid that cloth cannot enter.

        Args:
            shape: Plane, Sphere, Capsule, Box, Cylinder or SolidMesh.
            friction: Coulomb's coefficient, 0 is smooth.
            thickness: distance [m] that cloth keeps from the surface.
            position: of the shape's origin [m], (3,) or a function of time [s].
            rotation: rotation vector (3,) [rad] or matrix (3, 3), or a function of time [s].
            color: (3,) linear RGB in 0..1 for pictures.
        """
        if not isinstance(shape, Shape):
            raise SceneError(f"add_solid needs a Plane, Sphere, Capsule, Box, Cylinder or SolidMesh, not {shape!r:.60}")
        name = name or f"solid{len(self.solids)}"
        if name in (s.name for s in self.solids):
            raise SceneError(f"there is a solid named {name!r} already")
        if not (isinstance(friction, numbers.Real) and np.isfinite(friction) and friction >= 0):
            raise SceneError(f"solid {name!r}: friction = {friction!r} must be at least 0")
        if not (isinstance(thickness, numbers.Real) and np.isfinite(thickness) and thickness > 0):
            raise SceneError(f"solid {name!r}: thickness = {thickness!r} m must be positive")
        solid = Solid(name, shape, float(friction), float(thickness), position, rotation, color)
        solid.pose(0.0)
        self.solids.append(solid)
        return solid

    @property
    def touches(self) -> bool:
        """Whether cloth can meet anything: solids, other cloth or itself."""
        return bool(self.solids) or any(c.contact is not None for c in self.cloths)

    @property
    def vertex_count(self) -> int:
        """Number of vertices of all cloths."""
        return sum(c.mesh.vertex_count for c in self.cloths)

    def pin(self, cloth: Cloth, vertices: object, directions: object = None) -> None:
        """Holds vertices where they are, in all directions or in 1, 2 or 3 given ones.

        Args:
            vertices: index, list, mask or group name.
            directions: None (all), axis letters such as "y" or "xz", or (3,) or (1..3, 3) vectors.
        """
        self._attach(cloth, vertices, directions, None, False)

    def move(self, cloth: Cloth, vertices: object, path: Path, relative: bool = False,
             directions: object = None) -> None:
        """Leads vertices along a path.

        Args:
            path: function of time [s] that returns (k, 3) positions [m] of the k selected vertices in the order
                given ((3,) where k is 1); with `relative`, displacements from where they are when the motion
                begins, (k, 3) or one (3,) for all.
            directions: as in `pin`; the other directions stay free.
        """
        if not callable(path):
            raise SceneError(f"move needs a function of time, not {path!r}")
        self._attach(cloth, vertices, directions, path, relative)

    def unpin(self, cloth: Cloth, vertices: object = None) -> None:
        """Releases vertices (all of the cloth's where None) from every pin and motion.

        Raises:
            SceneError: where none of them is held.
        """
        self._own(cloth)
        free = np.arange(cloth.mesh.vertex_count) if vertices is None else cloth.mesh.select(vertices)
        kept, found = [], False
        for a in self.script.attachments:
            stay = a.vertices if a.cloth is not cloth else a.vertices[~np.isin(a.vertices, free)]
            found |= len(stay) < len(a.vertices)
            if len(stay):
                kept.append(replace(a, vertices=stay))
        if not found:
            raise SceneError(f"unpin: no such vertex of {cloth.name!r} is pinned or moved")
        self.script.attachments[:] = kept

    def at(self, t: float, f: Callable) -> None:
        """Calls f() or f(scene) when simulated time reaches t [s]; steps end exactly there.

        Pins and motions that f changes hold for the running simulation only; the scene stays as it was built.
        """
        if not (np.isfinite(t) and t >= 0):
            raise SceneError(f"at: t = {t!r} s must be a time of at least 0")
        if not callable(f):
            raise SceneError(f"at needs a function, not {f!r}")
        self.script.events.append(Event(float(t), f))

    def add_mass(self, cloth: Cloth, vertices: object, mass: float) -> None:
        """Adds a point mass [kg] to each of the vertices."""
        self._own(cloth)
        if not (np.isfinite(mass) and mass > 0):
            raise SceneError(f"point mass = {mass!r} kg: must be positive")
        self.masses.append((cloth, _used(cloth, vertices), float(mass)))

    @contextlib.contextmanager
    def running(self, script: Script) -> Iterator[None]:
        """Lets pins, motions and events act on `script` instead of the scene's own."""
        own, self.script = self.script, script
        try:
            yield
        finally:
            self.script = own

    def fire(self, event: Event) -> None:
        """Calls an event's function with as many arguments as it takes: none, or this scene."""
        takes = [p for p in inspect.signature(event.action).parameters.values()
                 if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
        event.action(*([self] if takes else []))

    def _own(self, cloth: Cloth) -> None:
        if cloth not in self.cloths:
            names = [c.name for c in self.cloths]
            raise SceneError(f"not a cloth of this scene: {cloth!r:.60}; {did_you_mean(cloth, names)}")

    def _attach(self, cloth: Cloth, vertices: object, directions: object, path: Path | None, relative: bool) -> None:
        self._own(cloth)
        index = _used(cloth, vertices)
        order = np.argsort(index, kind="stable")
        if path is not None and len(np.unique(index)) < len(index):
            raise SceneError("move: a vertex is named twice")
        if path is not None:
            path = _sorted_path(path, order)
        basis = orthonormal(directions)
        selected = np.unique(index)
        attachment = Attachment(cloth, selected, basis, path, relative, next(self._key), selected)
        if path is not None:
            attachment.checked(0.0)
        self._check_overlap(attachment)
        self.script.attachments.append(attachment)

    def _check_overlap(self, new: Attachment) -> None:
        for old in self.script.attachments:
            if old.cloth is not new.cloth or (old.path is None and new.path is None):
                continue
            shared = np.intersect1d(old.vertices, new.vertices)
            rank = np.linalg.matrix_rank(np.concatenate([old.directions, new.directions]), tol=1e-9)
            if len(shared) and rank < len(old.directions) + len(new.directions):
                raise SceneError(f"vertex {shared[0]} of {new.cloth.name!r} is already held or moved in that direction:"
                                 " unpin it first")


def orthonormal(directions: object) -> np.ndarray:
    """(d, 3) orthonormal rows that span the given directions: None, axis letters, or 1 to 3 vectors.

    Raises:
        SceneError: an unknown axis, a wrong shape, or directions that are not independent.
    """
    if directions is None:
        return np.eye(3)
    if isinstance(directions, str):
        for axis in directions or " ":
            check_choice("axis", axis, ("x", "y", "z"))
        return np.eye(3)[sorted({"xyz".index(a) for a in directions})]
    rows = np.atleast_2d(np.asarray(directions, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1:] != (3,) or not 1 <= len(rows) <= 3 or not np.isfinite(rows).all():
        raise SceneError(f"directions need 1 to 3 finite vectors of length 3, not shape {rows.shape}")
    length = np.linalg.norm(rows, axis=1)
    unit = rows / np.where(length > 0, length, 1)[:, None]
    if np.linalg.matrix_rank(unit, tol=1e-9) < len(rows):
        raise SceneError(f"directions {rows.tolist()} are not independent")
    if len(rows) == 3:
        return np.eye(3)
    # unit axes stay as they are, bit for bit
    if np.allclose(unit @ unit.T, np.eye(len(rows)), rtol=0, atol=1e-15):
        return unit
    q, _ = np.linalg.qr(unit.T)
    return q.T


def _sorted_path(path: Path, order: np.ndarray) -> Path:
    """The path with its rows in the order of rising vertex index."""
    def in_order(t: float) -> np.ndarray:
        value = np.asarray(path(t), dtype=np.float64)
        return value[order] if value.ndim == 2 and len(value) == len(order) else value
    return in_order


def _used(cloth: Cloth, vertices: object) -> np.ndarray:
    """The selected vertices, all of which belong to a face."""
    index = cloth.mesh.select(vertices)
    if not len(index):
        raise SceneError(f"the selection {vertices!r} of {cloth.name!r} is empty")
    loose = index[~np.isin(index, cloth.mesh.faces)]
    if len(loose):
        raise SceneError(f"vertex {loose[0]} of {cloth.name!r} belongs to no face and is not simulated")
    return index


def _three(value: ArrayLike, what: str) -> np.ndarray:
    value = np.array(value, dtype=np.float64)
    if value.shape != (3,) or not np.isfinite(value).all():
        raise SceneError(f"{what} needs three finite numbers, not {value.tolist()}")
    return value


def _rows(value: ArrayLike, n: int, what: str) -> np.ndarray:
    value = np.array(value, dtype=np.float64)
    if value.shape != (n, 3):
        raise SceneError(f"{what} need shape ({n}, 3), not {value.shape}")
    bad = np.flatnonzero(~np.isfinite(value).all(axis=1))
    if len(bad):
        raise SceneError(f"{what}: vertex {bad[0]} is not finite")
    return value
