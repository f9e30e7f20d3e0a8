"""Held particles of a step: I - S, the projector on their held directions, and their targets, by a script's attachments.
[BW98 §5.1] numpy only."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ..errors import SceneError
from ..scene.attachment import Attachment

CONFLICT = 1e-9  # two attachments of one particle that ask for positions further apart than this [m] disagree


@dataclass(frozen=True)
class Held:
    """The held particles of a step.

    Attributes:
        index: (k,) particles.
        projector: (k, 3, 3) I - S.
        target: (k, 3) positions [m] that the held directions must have at the end of the step.
        moving: whether any of them is led along a path, or by a solid.
        y: (k, 3) part of the way there [m] that is an alteration of position, not motion; 0 for pins.
        copies: of index, projector, target and y on a device.
    """

    index: np.ndarray
    projector: np.ndarray
    target: np.ndarray
    moving: bool
    y: np.ndarray
    copies: list = field(init=False, default_factory=list, repr=False, compare=False)

    @property
    def arrays(self) -> tuple:
        """(index, projector, target, y) as kernels take them: on a device copies, where `Filter.bring` made these."""
        return tuple(self.copies) or (self.index, self.projector, self.target, self.y)

    def same(self, other: "Held") -> bool:
        """Whether others are these particles, held as they are."""
        names = "index", "projector", "target", "y"
        return all(np.array_equal(getattr(self, name), getattr(other, name)) for name in names)

    @classmethod
    def of(cls, index: ArrayLike, projector: ArrayLike, target: ArrayLike, moving: bool, y: ArrayLike, dtype: type) -> "Held":
        """From arrays of any type; `dtype` is that of the compiled kernels."""
        P, goal, shift = (kernel_array(rows, dtype) for rows in (projector, target, y))
        return cls(kernel_array(index, np.int32), P, goal, moving, shift)


def kernel_array(values: ArrayLike, dtype: type) -> np.ndarray:
    """An array of any shape as kernels take it: contiguous, of the type they were compiled for."""
    return np.ascontiguousarray(values, dtype=dtype)


def pinned_particles(pins: Held | None, n: int) -> np.ndarray:
    """(n,) whether pins hold all directions of a particle."""
    out = np.zeros(n, dtype=bool)
    if pins is not None:
        out[pins.index] = np.trace(pins.projector, axis1=1, axis2=2) > 2.5
    return out


class Attachments:
    """Turns a script's attachments into held particles, step by step.

    Args:
        particle: (user's n,) the particle of each vertex; origin: (3,) [m] taken off all positions.
        exchange: type of the arrays that kernels take.

    Attributes:
        anchors: by an attachment's key, its cloth (n, 3) when it began [m].
    """

    def __init__(self, particle: np.ndarray, origin: np.ndarray, exchange: type) -> None:
        self.particle, self.origin, self.exchange = particle, origin, exchange
        self.anchors: dict[int, np.ndarray] = {}

    def update(self, attachments: list[Attachment], positions) -> None:
        """Begins attachments that are new; `positions()` gives the user's (n, 3) when one is."""
        new = [a for a in attachments if a.key not in self.anchors]
        if not new:
            return
        x = positions()
        for a in new:
            self.anchors[a.key] = x[a.cloth.start: a.cloth.start + a.cloth.mesh.vertex_count].copy()

    def soft(self, attachments: list[Attachment], t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """(particles (k,), places (k, 3) [m], (k, 2) stiffness [N/m] and largest force [N]) of soft attachments at
        t [s], or None."""
        some = [a for a in attachments if a.stiffness is not None]
        if not some:
            return None
        index = np.concatenate([self.particle[a.vertices + a.cloth.start] for a in some])
        place = np.concatenate([a.target(t, self.anchors[a.key]) for a in some]) - self.origin
        law = np.concatenate([a.cloth.shares(a.vertices)[:, None] * np.stack(np.broadcast_arrays(a.springs, a.most), axis=1)
                              for a in some])
        return index, place, law

    def at(self, attachments: list[Attachment], t: float) -> Held | None:
        """The constraints at time t [s], or None.

        Raises:
            SceneError: a path's wrong value, or attachments that contradict each other.
        """
        attachments = [a for a in attachments if a.stiffness is None]
        if not attachments:
            return None
        index = np.concatenate([self.particle[a.vertices + a.cloth.start] for a in attachments])
        basis = np.concatenate([np.broadcast_to(_padded(a.directions), (len(a.vertices), 3, 3)) for a in attachments])
        goal = np.concatenate([a.target(t, self.anchors[a.key]) for a in attachments]) - self.origin
        moving = any(a.leads for a in attachments)
        projector = np.einsum("kdi,kdj->kij", basis, basis)
        if len(np.unique(index)) < len(index):
            index, projector, goal = _combine(index, basis, goal)
        return Held.of(index, projector, goal, moving, np.zeros(goal.shape), self.exchange)


def _padded(directions: np.ndarray) -> np.ndarray:
    return np.concatenate([directions, np.zeros((3 - len(directions), 3))])


def _combine(index: np.ndarray, basis: np.ndarray, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attachments of the same particle as one: the span of their directions, the position that suits them all."""
    particles, first, count = np.unique(index, return_index=True, return_counts=True)
    projector = np.einsum("kdi,kdj->kij", basis[first], basis[first])
    target = np.einsum("kij,kj->ki", projector, goal[first])
    for k in np.flatnonzero(count > 1):
        p = particles[k]
        rows, goals = basis[index == p].reshape(-1, 3), goal[index == p]
        values = np.einsum("adi,ai->ad", basis[index == p], goals).reshape(-1)
        inverse = np.linalg.pinv(rows, rcond=1e-9)
        projector[k], target[k] = inverse @ rows, inverse @ values
        if np.abs(rows @ target[k] - values).max() > CONFLICT * max(1.0, np.abs(values).max()):
            raise SceneError(f"particle {p} is held at two places at once: unpin it before pinning it elsewhere")
        if np.linalg.matrix_rank(rows, tol=1e-9) == 3:
            projector[k] = np.eye(3)
    return particles, projector, target
