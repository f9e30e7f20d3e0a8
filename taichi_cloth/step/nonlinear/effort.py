"""How far Newton's method is worth going, and whether it has gone so far."""

from dataclasses import dataclass

import numpy as np

CALM = 1e-4  # m/s: a correction of velocities that is too small for another iteration
PART = 0.5  # part of the first correction that may be left to do
FIRST, OTHERS = 0.03, 0.1  # relative residuals of solves: they need not be more exact than the linearization


@dataclass(frozen=True)
class Effort:
    """What a step is worth.

    Attributes:
        moved: RMS of the last change of position [m] that is small enough.
        part: or part of the first change that may still be to come, estimated from how fast the changes shrink.
        first, others: relative residuals of the first and of further linear solves.
    """

    moved: float
    part: float
    first: float
    others: float


@dataclass
class Changes:
    """RMS changes of position [m]: the first, the last; of those to come, over the last."""

    first: float = np.inf
    last: float = np.inf
    rest: float = np.inf

    def add(self, moved: float) -> None:
        """One more."""
        self.rest = moved / (self.last - moved) if moved < self.last < np.inf else np.inf
        self.first, self.last = (moved if self.first == np.inf else self.first), moved

    def enough(self, effort: Effort, part: float = 1.0) -> bool:
        """Whether the last change, taken to this part, leaves no more than the step is worth."""
        left = self.rest if part == 1 else self.rest + 1 - part
        return self.last <= effort.moved or self.last * left < effort.part * self.first
