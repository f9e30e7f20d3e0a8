"""Constraints and attachments of vertices, and events: the part of a scene that changes as it runs. numpy only."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError
from .air import Air
from .cloth import Cloth
from .glue import Places, places
from .inflation import Inflation
from .load import Load
from .solids import Placed

Path = Callable[[float], ArrayLike]


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
        order: (k,) rows of the path's value in the order of rising vertex index.
        solid: the solid that the vertices ride on, from where they are when the attachment begins, at time `since` [s]; or
            None.
        stiffness: of a spring from each vertex to its place [N/m], one number or (k,) of `selected`, which pulls with `most`
            [N] at most; None holds exactly.
    """

    cloth: Cloth
    vertices: np.ndarray
    directions: np.ndarray
    path: Path | None
    relative: bool
    key: int
    selected: np.ndarray
    order: np.ndarray
    solid: Placed | None = None
    since: float = 0.0
    stiffness: float | np.ndarray | None = None
    most: float = np.inf
    found: dict[bytes, Places] = field(default_factory=dict, repr=False)  # the places that it last rode on

    @property
    def leads(self) -> bool:
        """Whether it moves its vertices."""
        return self.path is not None or self.solid is not None

    @property
    def alone(self) -> bool:
        """Whether nothing else may hold its vertices in its directions."""
        return self.leads or self.stiffness is not None

    @property
    def springs(self) -> np.ndarray:
        """(k,) stiffness [N/m] of those to `vertices`; 0 if it holds exactly."""
        every = np.broadcast_to(0.0 if self.stiffness is None else self.stiffness, len(self.selected))
        return every[np.searchsorted(self.selected, self.vertices)]

    def target(self, t: float, anchor: np.ndarray) -> np.ndarray:
        """(k, 3) positions [m] of `vertices` at time t [s]; `anchor` (n, 3) is the cloth when it began.

        Raises:
            SceneError: where the path returns a wrong shape or a number that is not finite.
        """
        here = anchor[self.vertices]
        if self.solid is not None:
            key = here.tobytes()
            if key not in self.found:
                self.found.clear()
                self.found[key] = places(self.solid, self.since, here)
            return self.found[key].at(self.solid, t)
        if self.path is None:
            return here
        value = self.checked(t)
        if value.ndim == 2:
            value = value[np.searchsorted(self.selected, self.vertices)]
        return here + value if self.relative else np.broadcast_to(value, here.shape)

    def checked(self, t: float) -> np.ndarray:
        """The path's value at t [s], (k, 3) or (3,) [m], checked for shape and finiteness; rows sorted by vertex."""
        k = len(self.selected)
        what = f"the path that moves {k} vertices of {self.cloth.name!r}, at t = {t:g} s"
        shapes = [(k, 3)] + ([(3,)] if self.relative or k == 1 else [])
        hint = "" if self.relative else "; relative=True takes one displacement for all"
        value = checks.array(what, self.path(t), *shapes, hint=hint)  # type: ignore[misc, arg-type]
        return value[self.order] if value.ndim == 2 else value


@dataclass(frozen=True)
class Event:
    """A function to be called when simulated time reaches `time` [s]."""

    time: float
    action: Callable


@dataclass
class Script:
    """The part of a scene that events may change while a simulation runs.

    Attributes:
        made: attachments and inflations that were ever made in it, those that were released included: keys go on from there.
        stitched: (seam, rows of its stitches, whether they hold) that are to be opened or closed, in order.
        inflations: gas in pieces of cloth, one a piece.
        loads: forces on vertices; bears: whether the scene had any when it was built.
        air: in place of the scene's, or None.
    """

    attachments: list[Attachment] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    made: int = 0
    stitched: list = field(default_factory=list)
    inflations: list[Inflation] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    bears: bool = False
    air: Air | None = None

    def copy(self) -> "Script":
        """A copy whose lists are its own."""
        lists: dict[str, Any] = {name: list(value) for name, value in vars(self).items() if isinstance(value, list)}
        return replace(self, **lists)

    def drives(self) -> tuple:
        """The prescribed drives of forces: inflations, loads and the air. Forces jump when one changes at once."""
        return (*self.inflations, *self.loads, self.air)


def orthonormal(directions: object) -> np.ndarray:
    """(d, 3) orthonormal rows that span the given directions: None, axis letters, or 1 to 3 vectors.

    Raises:
        SceneError: an unknown axis, a wrong shape, or directions that are not independent.
    """
    if directions is None:
        return np.eye(3)
    if isinstance(directions, str):
        for axis in directions or " ":
            checks.choice("axis", axis, ("x", "y", "z"))
        return np.eye(3)[sorted({"xyz".index(a) for a in directions})]
    rows = np.atleast_2d(checks.array("directions", directions, (3,), (1, 3), (2, 3), (3, 3), row="vector"))
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


def check_overlap(others: list[Attachment], new: Attachment) -> None:
    """Refuses an attachment of vertices that others hold or lead in a direction of its own already.

    Raises:
        SceneError: with the first such vertex.
    """
    for old in others:
        if old.cloth is not new.cloth or not (old.alone or new.alone):
            continue
        shared = np.intersect1d(old.vertices, new.vertices)
        rank = np.linalg.matrix_rank(np.concatenate([old.directions, new.directions]), tol=1e-9)
        if len(shared) and rank < len(old.directions) + len(new.directions):
            raise SceneError(f"vertex {shared[0]} of {new.cloth.name!r} is already held or moved in that direction:"
                             " unpin it first")
