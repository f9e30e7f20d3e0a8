"""A stage of TR-BDF2: M (v - v_base) = c f(x_base + c v, v)."""

from dataclasses import dataclass

import numpy as np

from ...backend.timing import Clock
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import NEWTON
from .newton import HALVINGS, Outcome, StepProblem
from .system import System

FIRST, OTHERS = 0.03, 0.1  # relative residuals of a stage's solves: they need not be more exact than the linearization
OFF = 64  # roundings of positions by which held directions may be off their targets


@dataclass(frozen=True)
class Effort:
    """What a stage is worth.

    Attributes:
        moved: RMS of the last change of position [m] that is small enough.
        part: or part of the first change that may still be to come, estimated from how fast the changes shrink.
        cg_tol: relative residual of each linear solve; None is Newton's own choice.
        most: iterations.
    """

    moved: float
    part: float
    cg_tol: float | None
    most: int


class Stage(StepProblem):
    """From a guess in the model, with its v_base set, to the stage's v and x = x_base + c v.

    Args:
        held: at the end of the stage; those directions are led there in the first iteration.
        fresh: whether the preconditioner is made anew in the first of them.
    """

    def __init__(self, system: System, c: float, held: Held | None, effort: Effort, fresh: bool, clock: Clock,
                 solutions: list[Solution]) -> None:
        super().__init__(system, c, held, Measures({}, 0.0, 0.0, 0.0, 0.0, True), clock, solutions)
        self.effort, self.fresh = effort, fresh
        self.linearized = False  # where the model is
        self.first = self.moved = np.inf  # RMS of the first and of the last change [m]
        self.rest = np.inf  # of those to come, over the last
        self.led = self.leads()

    def leads(self) -> bool:
        """Whether the first iteration has to bring held directions to their targets: these move, or the guess left them, as
        where a pin holds what had a velocity."""
        to_go = self.system.to_go(self.held, self.c)
        if to_go is None or self.held is None:
            return False
        off = np.abs(np.einsum("kij,kj->ki", self.held.projector, to_go)).max(initial=0.0)
        return self.held.moving or self.c * off > OFF * self.system.resolution

    def solve(self, k: int) -> Outcome | None:
        """See `StepProblem`."""
        if not self.linearized:
            with self.clock.part("EVAL"):
                self.before = self.system.linearize(self.c)
        with self.clock.part("CG"):
            self.solutions.append(self.system.solve(self.effort.cg_tol or (OTHERS if k else FIRST), self.held,
                                                    lead=0.0 if k else self.c, fresh=self.fresh and k == 0))
        moved, before = self.c * self.system.rms_change(), self.moved
        self.first = self.first if k else moved
        self.moved, self.rest = moved, _rest(moved / before) if k else np.inf
        self.linearized = not self.enough(1.0)
        self.level = self.potential(self.before)
        return self.unsolved()

    def enough(self, part: float) -> bool:
        """Whether the last change, taken to this part, leaves no more than the stage is worth."""
        left = self.rest if part == 1 else self.rest + 1 - part
        return self.moved <= self.effort.moved or self.moved * left < self.effort.part * self.first

    def advance(self, k: int) -> float:
        """See `StepProblem`."""
        with self.clock.part("EVAL"):
            self.system.shift(self.c, 1.0)
        return 1.0

    def shift(self, k: int, part: float, taken: float) -> None:
        """See `StepProblem`."""
        with self.clock.part("EVAL"):
            self.system.shift(self.c, part - taken)

    def measure(self, k: int) -> Measures:
        """See `StepProblem`; the model is linearized there too where the iteration is expected to go on."""
        with self.clock.part("EVAL"):
            return self.system.linearize(self.c) if self.linearized else self.system.meter.measure()

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `StepProblem`. A shorter first step would leave constraints behind.

        R depends on x too, which the forces rightly know nothing of: by as much as it changes, Phi may grow.
        """
        lags = self.c * abs(measures.dissipation - self.before.dissipation)
        return (k == 0 and self.led) or self.decreases(measures, lags)

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `StepProblem`."""
        if self.enough(part):
            return Outcome(None, "", measures)
        return Outcome(NEWTON, "no way down", measures) if part <= 0.5**HALVINGS else None

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`."""
        return Outcome(NEWTON, f"{self.effort.most} iterations, the last by {self.moved:.2g} m", measures)


def _rest(rate: float) -> float:
    """Sum of the changes to come, in units of the last one, when each is `rate` times the one before."""
    return rate / (1 - rate) if rate < 1 else np.inf
