"""Newton's method with line search: the problem of a step or stage that it minimizes, and how far it is worth going.

    Phi(v) = 1/2 (v - v_base)^T M (v - v_base) + E(x_base + c v) + c R(v) + terms of contact,

R half the dissipated power. In the second and later Newton steps of backward Euler without contact, damping in c R is an
energy k_d (C - C_0)^2 / (2 h), see `Force.evaluate`. The gradient of Phi is 0 where M (v - v_base) = c f(x_base + c v, v). A
Newton step dv solves (M - c D - c^2 K) dv = M (v_base - v) + c f. With a positive semidefinite K it goes downhill on Phi.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ...backend.timing import Clock
from ...options import CG_TOL
from ...solver.pcg import CONVERGED, Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import NOT_FINITE, SOLVER
from ..ledger import Ledger
from .linear_system import System

CALM = 1e-4  # m/s: a correction of velocities that is too small for another iteration
PART = 0.5  # part of the first correction that may be left to do
FIRST, OTHERS = 0.03, 0.1  # relative residuals of a stage's solves: they need not be more exact than the linearization
PRELIMINARY = 0.01  # of solves that others follow, and of BDF2's first. With .005 and .02 `table` takes 110, 117 for 109
FURTHER = 0.03  # of solves that mend energy. With .015 and .06 `table` takes 100 and 115 for 109, 1,595 and 1,347 iterations
LEAVES = 0.01  # part of the largest imbalance of forces that such a step's last solve may leave; or of `NewtonTolerance.moved`
SURE = 0.9  # times the square of the ratio of imbalances of forces: a solve need be no more exact [Eisenstat, Walker 1996]
HALVINGS = 9  # of a Newton step, which is then taken anyway: exactly folded cloth needs a tiny motion to find a side


@dataclass(frozen=True)
class Outcome:
    """How the solution of a problem ended.

    Attributes:
        rejection: None, or the name of its reason; detail: more about it, for people.
        measures: of the state that was reached.
        ledger: of the step's energy, where it was finished.
    """

    rejection: str | None
    detail: str
    measures: Measures
    ledger: Ledger | None = None


class StepProblem(ABC):
    """One step's or stage's problem on a model. `minimize` calls these in this order, for k = 0, 1, ...:
    `solve`, `advance`, then `measure` and `acceptable` (after `shift` where the step had to be shortened), `judge`.

    Attributes:
        c: step [s], or a stage's factor of forces [s].
        held: constraints at its end, of the last solve.
        before, level: measures of the state that a Newton step starts from, and Phi there [J].
        clock, solutions: wall time by part, and linear solves; all problems of a step share both.
    """

    def __init__(self, system: System, c: float, held: Held | None, start: Measures, clock: Clock,
                 solutions: list[Solution]) -> None:
        self.system, self.c, self.held, self.before = system, c, held, start
        self.clock, self.solutions, self.level = clock, solutions, np.inf

    @abstractmethod
    def solve(self, k: int) -> Outcome | None:
        """Linearizes the problem and solves for the Newton step dv; an outcome where something forbids to go on."""

    @abstractmethod
    def advance(self, k: int) -> float:
        """Moves the model by the full dv; returns the fraction of dv, at most 1, that is free of collisions."""

    @abstractmethod
    def shift(self, k: int, part: float, taken: float) -> None:
        """Moves the model from `taken` of dv to `part` of it."""

    @abstractmethod
    def measure(self, k: int) -> Measures:
        """Measures of the model's state."""

    @abstractmethod
    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """Whether a Newton step may be taken that far: sufficient decrease, or another condition of the problem."""

    @abstractmethod
    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """The outcome if this Newton step ends the solution, else None."""

    @abstractmethod
    def give_up(self, measures: Measures) -> Outcome:
        """After the last Newton step."""

    def decreases(self, measures: Measures, slack: float = 0.0) -> bool:
        """Whether Phi does not grow from `before` by more than rounding and a slack [J]."""
        return self.potential(measures) <= self.level + self.system.rounding(self.c, self.before, measures) + slack

    def potential(self, measures: Measures) -> float:
        """Phi [J] where the model is; NaN counts as infinite."""
        return phi(measures, self.c)

    def unsolved(self) -> Outcome | None:
        """The end where the last linear solve did not converge."""
        last = self.solutions[-1]
        return None if last.status == CONVERGED else Outcome(SOLVER, last.status, self.system.meter.measure())


def phi(measures: Measures, c: float) -> float:
    """Phi without contact [J]; NaN counts as infinite."""
    value = measures.change + measures.potential + c * measures.dissipation
    return value if np.isfinite(value) else np.inf


def minimize(problem: StepProblem, most: int) -> Outcome:
    """Solves a problem from where the model is; the model is left in the solution, or where the method stopped.

    Args:
        most: Newton steps.
    """
    for k in range(most):
        outcome = problem.solve(k)
        if outcome is not None:
            return outcome
        part, measures = line_search(problem, k)
        if not measures.finite:
            return Outcome(NOT_FINITE, f"Newton step {k + 1}", measures)
        outcome = problem.judge(k, part, measures)
        if outcome is not None:
            return outcome
        problem.before = measures
    return problem.give_up(problem.before)


def line_search(problem: StepProblem, k: int) -> tuple[float, Measures]:
    """Takes a Newton step as far as nothing collides and the problem accepts: (part of it, measures there)."""
    part, taken = problem.advance(k), 1.0
    for halving in range(HALVINGS + 1):
        if part < taken:
            problem.shift(k, part, taken)
            taken = part
        measures = problem.measure(k)
        if halving == HALVINGS or problem.acceptable(k, part, measures):
            break
        part /= 2
    return part, measures


@dataclass(frozen=True)
class NewtonTolerance:
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
    def of(cls, asked: float | None, effort: NewtonTolerance | None) -> "Forcing":
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
        """Whether the last solve was exact enough to be a step's last. It moved the cloth by this part of that tolerance."""
        return self.left <= LEAVES * self.most or moved <= LEAVES


@dataclass
class ConvergenceRate:
    """RMS changes of position [m]: the first, the last; of those to come, over the last."""

    first: float = np.inf
    last: float = np.inf
    rest: float = np.inf

    def add(self, moved: float) -> None:
        """One more."""
        self.rest = moved / (self.last - moved) if moved < self.last < np.inf else np.inf
        self.first, self.last = (moved if self.first == np.inf else self.first), moved

    def enough(self, effort: NewtonTolerance, part: float = 1.0) -> bool:
        """Whether the last change, taken to this part, leaves no more than the step is worth."""
        left = self.rest if part == 1 else self.rest + 1 - part
        return self.last <= effort.moved or self.last * left < effort.part * self.first
