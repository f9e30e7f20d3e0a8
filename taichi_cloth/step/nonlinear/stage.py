"""A stage of TR-BDF2: M (v - v_base) = c f(x_base + c v, v)."""

import numpy as np

from ...backend.timing import Clock
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import NEWTON
from .effort import Changes, Effort
from .newton import HALVINGS, Outcome, StepProblem
from .system import ROUNDING, System


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
        self.changes = Changes()
        self.led = self.leads()

    def leads(self) -> bool:
        """Whether the first iteration has to bring held directions to their targets: these move, or the guess left them, as
        where a pin holds a particle that had a velocity."""
        to_go = self.system.to_go(self.held, self.c)
        if to_go is None or self.held is None:
            return False
        off = np.abs(np.einsum("kij,kj->ki", self.held.projector, to_go)).max(initial=0.0)
        return self.held.moving or self.c * off > ROUNDING * self.system.resolution

    def solve(self, k: int) -> Outcome | None:
        """See `StepProblem`."""
        if not self.linearized:
            with self.clock.part("EVAL"):
                self.before = self.system.linearize(self.c)
        with self.clock.part("CG"):
            self.solutions.append(self.system.solve(self.effort.others if k else self.effort.first, self.held,
                                                    lead=0.0 if k else self.c, fresh=self.fresh and k == 0))
        self.changes.add(self.c * self.system.rms_change())
        self.linearized = not self.changes.enough(self.effort)
        self.level = self.potential(self.before)
        return self.unsolved()

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
        if self.changes.enough(self.effort, part):
            return Outcome(None, "", measures)
        return Outcome(NEWTON, "no way down", measures) if part <= 0.5**HALVINGS else None

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`."""
        return Outcome(NEWTON, f"{len(self.solutions)} solves, the last by {self.changes.last:.2g} m", measures)
