"""How far Newton's method is worth going, and whether it has gone so far; how exact each of its solves needs to be."""

from dataclasses import dataclass

import numpy as np

from ...options import CG_TOL

CALM = 1e-4  # m/s: a correction of velocities that is too small for another iteration
PART = 0.5  # part of the first correction that may be left to do
FIRST, OTHERS = 0.03, 0.1  # relative residuals of a stage's solves: they need not be more exact than the linearization
PRELIMINARY = 0.01  # of solves that others follow, and of BDF2's first. With .005 and .02 `table` takes 110, 117 for 109
FURTHER = 0.03  # of solves that mend energy. With .015 and .06 `table` takes 100 and 115 for 109, 1,595 and 1,347 iterations
LEAVES = 0.01  # part of the largest imbalance of forces that such a step's last solve may leave; or of `Effort.moved`
SURE = 0.9  # times the square of the ratio of imbalances of forces: a solve need be no more exact [Eisenstat, Walker 1996]


@dataclass(frozen=True)
class Effort:
    """Tolerances of a step.

    Attributes:
        moved: RMS of the last change of position [m] that is small enough.
        part: or part of the first change that may still be to come, estimated from how fast the changes shrink.
        first, others: relative residuals of the first and of further linear solves.
        last: to which others come down as forces come to balance; None: they do not.
    """

    moved: float
    part: float
    first: float
    others: float
    last: float | None = None


@dataclass
class Forcing:
    """Relative residuals that the linear solves of a backward Euler step get.

    Attributes:
        first: of (18); preliminary: of one that others are to follow.
        further, last: of those that follow, at most and at least.
        mending: of those that only mend energy, where contact or a limit made it grow.
        imbalance, most: of forces before the last solve, and the largest so far; left: bound of it after that solve.
    """

    first: float
    preliminary: float
    further: float
    last: float
    mending: float
    imbalance: float = 0.0
    most: float = 0.0
    left: float = 0.0

    @classmethod
    def of(cls, asked: float | None, effort: Effort | None) -> "Forcing":
        """Those of a step: `cg_tol` where that was asked for, else by its effort; None is a step of single solves."""
        if effort is not None:
            first, further = asked or effort.first, asked or effort.others
            return cls(first, max(first, PRELIMINARY), further, asked or effort.last or further, further)
        first = asked or CG_TOL
        return cls(first, max(first, PRELIMINARY), first, first, max(first, FURTHER) if first >= CG_TOL else first)

    @property
    def follows(self) -> bool:
        """Whether further ones follow how forces come to balance."""
        return self.last < self.further

    def next(self, imbalance: float) -> float:
        """Relative residual of the solve that follows, at such an imbalance of forces."""
        tolerance = self.first
        if self.imbalance > 0:
            tolerance = min(self.further, max(self.last, SURE * (imbalance / self.imbalance) ** 2))
        self.imbalance, self.most, self.left = imbalance, max(self.most, imbalance), tolerance * imbalance
        return tolerance

    def enough(self, moved: float) -> bool:
        """Whether the last solve was exact enough to be a step's last. It moved the cloth by this part of `Effort.moved`."""
        return self.left <= LEAVES * self.most or moved <= LEAVES


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
