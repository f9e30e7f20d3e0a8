"""The start of an attempt at a step, as contact sees it, and its expected course by the steps before. numpy only."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..options import USUAL
from ..system.base import Base
from ..system.checkpoint import Checkpointed
from ..system.held import Held

SMALLER = 64  # times smaller than the usual, a step is taken though cloth ends inside or across, where there is no room
SMALLEST = 2048  # times smaller than the usual, layers that allow no collision-free step are pinched, however fast: with 64 a
# sheet at 500 m/s goes through another, with 117 crossings
OFTEN = 2  # consecutive steps that took more solves, after which the next one is expected to. Without it `layers` takes 183
# solves for 129, and 7,000 iterations for 2,377


@dataclass(frozen=True)
class StepContext:
    """An attempt at a step.

    Attributes:
        h: its size; h_usual: the largest one's [s].
        x, v: (n, 3) saved positions [m] and velocities [m/s].
        pins: particles that a script holds.
        together: whether layers of cloth are part of its problem from the first solve on.
        base: the state from which the method starts, where that is not the saved state.
    """

    h: float
    h_usual: float
    x: np.ndarray
    v: np.ndarray
    pins: Held | None = None
    together: bool = False
    base: Base | None = None

    @property
    def c(self) -> float:
        """The factor by which the method multiplies forces [s]."""
        return self.h if self.base is None else self.base.c

    @property
    def base_v(self) -> np.ndarray:
        """(n, 3) velocities [m/s] that the method starts from."""
        return self.v if self.base is None else self.base.v

    @cached_property
    def coasting(self) -> np.ndarray:
        """(n, 3) where particles are at the end if nothing acts on them [m]: x_base + c v_base."""
        coasts = self.x + self.c * self.base_v
        return coasts if self.base is None else coasts + self.base.x_offset

    @property
    def initial_iterate(self) -> tuple[np.ndarray, np.ndarray]:
        """(positions [m], velocities [m/s]), each (n, 3), of the end that the first solve begins with."""
        if self.base is None:
            return self.coasting.copy(), self.v
        return self.coasting + self.c * (self.base.guess - self.base.v), self.base.guess

    def mean(self, v: np.ndarray) -> np.ndarray:
        """(n, 3) mean velocities [m/s] of steps that end with v, alterations apart: (x_base + c v - x)/h."""
        return v if self.base is None else (self.base.x_offset + self.c * v) / self.h

    def altered(self, held: Held | None, sticking: np.ndarray | None = None) -> Held | None:
        """Held particles, such that they end with their mean velocity of the step, alterations apart. In directions in which
        they stick, with projectors (k, 3, 3), they have the method's."""
        if held is None or self.base is None:
            return held
        i = held.index
        v = (held.target - held.y - self.x[i]) / self.h
        stops = held.projector if sticking is None else held.projector - sticking
        y = np.einsum("kij,kj->ki", stops, held.target - self.x[i] - self.base.x_offset[i] - self.c * v)
        return replace(held, y=y.astype(held.y.dtype))

    @cached_property
    def share(self) -> float:
        """The step over a usual one, 1 at most."""
        return min(1.0, self.h / self.h_usual)

    @cached_property
    def small(self) -> bool:
        """Whether the step is so small that smaller ones do not help where there is no room."""
        return self.h <= min(self.h_usual, USUAL) / SMALLER

    @cached_property
    def smallest(self) -> bool:
        """Whether there is hardly a smaller step to try."""
        return self.h <= min(self.h_usual, USUAL) / SMALLEST


class ForcingTerms(Checkpointed):
    """Whether the first solve of a step with layers of cloth is likely to be its last, by the steps before: one that others
    follow may be rough.

    Attributes:
        rounds: accepted steps, one after the other, in which a Newton step was cut short, or changed many contacts.
        asked: whether that is so in this attempt.
    """

    STATE = ("rounds",)

    def __init__(self) -> None:
        self.rounds = 0
        self.asked = False

    def begin(self) -> None:
        """A new attempt."""
        self.asked = False

    def commit(self) -> None:
        """The attempt was accepted."""
        self.rounds = self.rounds + 1 if self.asked else 0

    def clear(self) -> None:
        """Nothing is known of the steps before."""
        self.rounds = 0

    @property
    def more_rounds(self) -> bool:
        """Whether a first solve will hardly be the last."""
        return self.rounds >= OFTEN
