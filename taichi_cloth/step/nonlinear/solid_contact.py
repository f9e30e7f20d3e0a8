"""The problem of a backward Euler step in contact with solids. [BW98 §5, §6]

The first Newton step is (18) by an active set: solves of the same linearization, from the saved state, go on until the
states of all contacts agree with the answer. Further Newton steps hold the same contacts, with friction and pairs taken
anew from where they begin; what they add to Phi counts. Where they end too deep, contacts are judged anew, and they go on.
"""

import math
from collections.abc import Callable

from ...backend.timing import Clock
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import APPROACH, CONTACT
from ..ledger import Ledger
from .euler import EulerPolicy, EulerStep
from .newton import Outcome, StepProblem, minimize
from .system import System

ANEW = 3  # times that contacts are judged anew after further Newton steps
FINEST = 8  # times smaller than the usual, a step that is not solved is no longer tried smaller. A sheet on a ball, .7 s: with
# 4, 8, 16 581, 641, 656 solves and .065, .0035, .0016 J unaccounted for; with 64 a rope of next to no weight takes minutes


def predict(system: System, c: float, pins, together: bool) -> None:
    """The model goes where the last step's change of velocity would lead it, and contacts are looked for on the way.

    Args:
        together: whether layers of cloth are part of the problem.
    """
    contacts, base = system.contacts, system.base
    x, v = system.model.read_saved()
    system.operator.set_motion(c)
    if base is not None:
        system.solver.dv.fill(0)
        system.add_guess(1.0)
    elif not contacts.warm:
        system.fall(c, *contacts.gravity)
    system.place(c, 1.0)
    system.settle(pins)
    contacts.begin(c, pins, x, v, together, base)


class SolidStep(EulerStep):
    """As `EulerStep`; `held` are the pins at first, then what the last solve held.

    Attributes:
        deep: whether the last Newton step ended the step, but for what it left too deep in solids.
        anew: times that contacts were judged anew for that.
    """

    touches, deep, anew = True, False, 0

    def first(self) -> Outcome | None:
        """(18) with the contacts that agree with it. Solves that others are likely to follow are preliminary ones."""
        contacts, foresight = self.system.contacts, self.system.contacts.foresight
        rough = foresight.more_steps and not self.exacting
        preliminary = rough or foresight.more_rounds
        with self.clock.part("C-S"):
            predict(self.system, self.c, self.held, together=False)
        while True:
            with self.clock.part("C-S"):
                self.held, closing = contacts.hold()
                contacts.set_points()
                self.system.start_over()
            if contacts.crowded:
                return self.refuse(CONTACT, f"more than {contacts.force.most} points of contact")
            if closing > contacts.solids.reach:
                return self.refuse(APPROACH, f"{closing:.3g} m in one step")
            self.solve_linear(preliminary)
            unsolved = self.unsolved()
            if unsolved is not None:
                return unsolved
            with self.clock.part("C-S"):
                verdict = contacts.judge(self.system.reaction_rows())
            goes_on = contacts.goes_on(verdict, contacts.solids.round)
            foresight.asked |= goes_on
            if goes_on or (preliminary and not rough):
                preliminary = rough
                continue
            if verdict.changes and verdict.bad and contacts.solids.may_shrink():
                return self.refuse(CONTACT, f"{verdict.deepest:.2g} thicknesses inside")
            with self.clock.part("C-S"):
                through = contacts.solids.went_through()
            return self.refuse(CONTACT, f"{contacts.crossings} crossings") if through else None

    def refuse(self, name: str, detail: str) -> Outcome:
        """The end of a step that contact does not allow."""
        return Outcome(name, detail, self.system.meter.measure())

    def further(self) -> Outcome | None:
        """See `EulerStep`. What the last Newton steps led too deep is brought out from here on."""
        contacts, self.to_go = self.system.contacts, None
        with self.clock.part("C-S"):
            if self.deep:
                self.held, closing = contacts.hold()
                if closing > contacts.solids.reach:
                    return self.refuse(APPROACH, f"{closing:.3g} m in one step")
                self.to_go = self.system.to_go(self.held, self.c)
            contacts.rebase()
        ended = super().further()
        if self.deep:
            self.level = math.inf  # what has to be brought out need not go downhill
        return ended

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `EulerStep`. No step ends with a preliminary solve, but where cloth runs into a limit and none after passes."""
        passes = super().acceptable(k, part, measures)
        if k == 0 and part == 1 and self.effort is None:
            self.system.contacts.foresight.gained = self.ended is None
            if self.solutions[-1].preliminary:
                self.ended = None
        return passes

    def potential(self, measures: Measures) -> float:
        """Phi [J] with what friction and pairs add to it."""
        return super().potential(measures) + self.system.contacts.lagged(self.c)

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `EulerStep`. A step that ends too deep goes on with that held, for a few times."""
        self.deep = False
        ended = super().judge(k, part, measures)
        if not (self.deep and self.settled) or self.anew == ANEW or self.system.base is not None:
            return ended
        with self.clock.part("C-S"):
            self.system.contacts.judge(self.system.reaction_rows())
        self.anew += 1
        return None

    def finish(self, measures: Measures, ledger: Ledger) -> Outcome:
        """Whether anything ended too deep after further Newton steps that held the same contacts."""
        with self.clock.part("C-S"):
            self.deep = self.system.contacts.went_in(self.system.reaction_rows())
        return Outcome(CONTACT, "after further solves", measures) if self.deep else Outcome(None, "", measures, ledger)


class SolidPolicy(EulerPolicy):
    """Steps in contact with solids.

    Attributes:
        solved: problem of a step that is solved, with `contact_tol`; None without.
    """

    step = SolidStep
    solved: Callable[..., StepProblem] | None = None

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`. A small step that is not solved is made as without `contact_tol`."""
        if self.solved is not None:
            problem = self.solved(self.system, self.energy, self.effort, h, pins, start, clock, solutions)
            made = minimize(problem, 1 + self.system.options.newton_max)
            if made.rejection is None or self.system.contacts.start.share > 1.5 / FINEST:
                return made
            self.system.tell("some steps in contact were not solved to contact_tol, however small: they were made without it")
            self.system.start_over()
        return super().attempt(h, pins, start, clock, solutions)
