"""The problem of a backward Euler step in which cloth may meet cloth, and when a step is one.

The first Newton step is (18), with the contacts that the last motion leads to; each further one takes contacts, of layers
and of solids, as they are where it begins. None goes further than its collision-free step size. The step is made when a
Newton step could be taken whole, contacts have the forces of its solve, and its energy has not grown beyond the work put
in. Intersections that are pulled apart are given energy.

If a Newton step was cut short, or changed many contacts with solids, in two steps running, the next step's first one is not
likely to be its last. Its solve, and the second if the first was cut short, only has to find the pairs, and is rough. All
others of that step may leave LOOSER times `cg_tol`. None of this is done if cloth is pinched or passes through itself.
"""

from dataclasses import replace

from ...backend.timing import Clock
from ...contact.cloth.layers import LATER
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import APPROACH, CONTACT
from ..ledger import Ledger
from .energy import MOST, EnergyTest
from .euler import EulerStep
from .linear_system import System
from .newton import NewtonTolerance, Outcome, minimize
from .solid_contact import SolidPolicy

ROUGH = 0.03  # relative residual of preliminary solves; with solids, whose states they decide, it is less
LOOSER = 5.0  # tolerance of the other solves of such a step, in `cg_tol` and relative to the first one's residual. With 1
# `layers` takes 174 solves for 129, and 5,507 iterations for 2,377
MANY = 0.1  # of the contacts with solids: a Newton step that changes more predicts further ones in the next step. Without it
# `layers` takes 138 solves for 129, and 3,253 iterations for 2,377


class LayerStep(EulerStep):
    """A step with layers of cloth in its problem.

    Attributes:
        more_expected: whether the first Newton step is unlikely to be the last; preliminary: whether the next one is, and its
            solve may be rough.
        reference: residual norm at the start of the step: tolerances of further solves are relative to no less.
        released: whether pairs that leave no room were released, so that the step is worth another attempt.
    """

    touches = True

    def __init__(self, system: System, energy: EnergyTest, h: float, pins: Held | None, start: Measures, clock: Clock,
                 solutions: list[Solution]) -> None:
        super().__init__(system, energy, None, h, pins, start, clock, solutions)
        self.contacts, self.layers = system.contacts, system.contacts.layers
        with clock.part("C-S"):
            system.predict(h, pins, together=True)
            system.start_over()
        self.agrees = False  # whether contacts with solids do
        self.more_expected = self.preliminary = self.contacts.forcing_terms.more_rounds and not self.contacts.hindered
        self.agreed = self.released = False
        self.part = self.reference = 0.0

    def solve(self, k: int) -> Outcome | None:
        """See `StepProblem`."""
        contacts = self.contacts
        with self.clock.part("C-S"):
            self.held, closing = contacts.constrain()
            self.layers.detector.paths.arrive()
            if k:
                contacts.rebase()
            else:
                contacts.set_points()
        if contacts.crowded:
            return Outcome(CONTACT, f"more than {contacts.force.most} points of contact", self.before)
        if closing > contacts.solids.reach:
            return Outcome(APPROACH, f"{closing:.3g} m in one step", self.before)
        self.linear(k)
        unsolved = self.unsolved()
        return unsolved and replace(unsolved, measures=self.before)

    def linear(self, k: int) -> None:
        """Linearization and solve, from where the model is."""
        system, h, held = self.system, self.c, self.held
        with self.clock.part("EVAL"):
            if k == 0:
                system.linearize_first(h, held)
            else:
                self.over = h if system.base is None else 0.0
                here = system.linearize(h, over=self.over)
                self.before = replace(here, energies={**here.energies, "contact": self.layers.energy})
        with self.clock.part("CG"):
            z = system.rest(held, h) if k else None
            tolerance, least_reference = self.cg_tol * (LOOSER if self.more_expected and k else 1.0), self.reference
            if self.agreed:  # all but the energy is right: residuals of solves have made it grow
                tolerance, least_reference = self.cg_tol, 0.0
            if self.preliminary and tolerance < ROUGH:
                tolerance, least_reference = ROUGH, least_reference * tolerance / ROUGH
            solution = system.solve(tolerance, held, h, z=z, moved=k > 0, reuse_levels=True, least_reference=least_reference,
                                    track_iterations=not self.preliminary)
            self.solutions.append(replace(solution, preliminary=self.preliminary))
            self.reference = self.reference or system.solver.reference
            if system.base is not None and k == 0:
                system.add_guess(1.0)

    def advance(self, k: int) -> float:
        """See `StepProblem`. States of contacts with solids are judged at the end of the whole Newton step."""
        with self.clock.part("EVAL"):
            if k:
                self.system.shift(self.c, 1.0)
            else:
                self.system.place(self.c, 1.0)
            self.system.settle(self.held)
        with self.clock.part("C-S"):
            left = 0.0 if self.preliminary else self.system.left_undone()
            self.agrees = self.contacts.judge(self.system.reaction_rows(), self.system.inertia, left)
            self.layers.record_forces()
            return self.layers.advance()

    def measure(self, k: int) -> Measures:
        """See `StepProblem`; with the repulsion of layers."""
        with self.clock.part("C-S"):
            self.layers.look()
        with self.clock.part("EVAL"):
            measures = self.system.meter.measure(self.over)
        return replace(measures, energies={**measures.energies, "contact": self.layers.energy})

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `StepProblem`. A Newton step goes as far as nothing collides."""
        return True

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `StepProblem`."""
        self.part, contacts = part, self.contacts
        with self.clock.part("C-S"):
            if part < 1:
                contacts.stop_short()
                self.layers.stop_short()
            later = k >= LATER and not contacts.solids.ends_deep()
            settled = part == 1 and self.layers.settled() and (self.agrees or later)
            contacts.forcing_terms.asked |= part < 1 or contacts.solids.unsettled > MANY * contacts.count
            self.agreed, self.preliminary = settled and not self.preliminary, self.preliminary and k == 0 and part < 1
            self.released = not self.agreed and k > LATER and self.layers.release_beside(contacts.solids.holds())
        if self.released:
            return self.refuse(measures)
        if not self.agreed:
            return None
        strict = k < self.layers.ROUNDS // 2
        ended = self.conclude(measures, strict)
        if strict:
            ended = self.accounted(ended)
        return None if ended is None else self.finish(*ended)

    def conclude(self, measures: Measures, strict: bool = False) -> tuple[Measures, Ledger] | None:
        """Calls `EnergyTest.conclude`. In the first half of the solves a step has to account for its energy before
        it is slowed down."""
        return self.energy.conclude(self.c, self.held, self.start, measures, MOST, self.fits if strict else None)

    def finish(self, measures: Measures, ledger: Ledger) -> Outcome:
        """Whether solids let the step pass."""
        contacts = self.contacts
        with self.clock.part("C-S"):
            if contacts.solids.ends_deep():
                return Outcome(CONTACT, "too deep inside a solid", measures)
            if contacts.solids.went_through():
                return Outcome(CONTACT, f"{contacts.crossings} crossings with solids", measures)
        return Outcome(None, "", self.at_end(measures), ledger)

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`. Small steps are taken as they are. In the smallest, pairs that allow no collision-free
        step are released."""
        layers, start = self.layers, self.contacts.start
        ended = self.conclude(measures) if self.part == 1 and start.small else None
        if ended is not None:
            return self.finish(*ended)
        if self.part < 1 and start.smallest:
            self.released = layers.release()
        return self.refuse(measures)

    def refuse(self, measures: Measures) -> Outcome:
        """The end of an attempt that was not made."""
        layers = self.layers
        why = "its energy grew" if self.agreed else (f"{layers.unsettled} pairs unsettled, smallest gap {layers.least:.2g} of "
                                                     "what it should be")
        free = "" if self.part == 1 else f"only {self.part:.2g} of the last one's motion is free of collisions, "
        return Outcome(CONTACT, f"between layers of cloth, after {len(self.solutions)} solves: {free}{why}", measures)


class LayerPolicy(SolidPolicy):
    """When layers of cloth are part of a step's problem: if they met, or crossed, at the end of the last step, else in a
    second attempt, if the first one shows that they meet."""

    def __init__(self, system: System, energy: EnergyTest, effort: NewtonTolerance | None) -> None:
        super().__init__(system, energy, effort)
        self.layers = system.contacts.layers

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`."""
        if not (self.layers.count > 0 or self.layers.intersections.active):
            made = super().attempt(h, pins, start, clock, solutions)
            if made.rejection is not None:
                return made
            if not self.layers.meet():
                self.layers.pass_without()
                return made
            self.system.start_over()
        solved = self.solve(h, pins, start, clock, solutions, together=True)
        if solved is not None:
            return solved
        while True:
            problem = LayerStep(self.system, self.energy, h, pins, start, clock, solutions)
            made = minimize(problem, self.layers.ROUNDS)
            if not problem.released:  # else again, each time without more of the pairs that kept it from going all of its way
                break
            self.system.start_over()
        if self.layers.intersections.active or self.layers.freed:
            with clock.part("C-S"):
                self.layers.count_tangled(False)
        return made


class SpringPolicy(SolidPolicy):
    """Steps with the springs of `contact.cloth.springs` among their forces: one solve, no further than nothing collides."""

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`."""
        contacts, made = self.system.contacts, super().attempt(h, pins, start, clock, solutions)
        layers = contacts.layers
        if made.rejection is None:
            layers.record_forces()
            part = layers.advance()
            if part < 1:
                if contacts.start.smallest:
                    layers.release()
                detail = f"cloth would pass through cloth, a collision-free step is {part:.2g} of it"
                made = replace(made, rejection=CONTACT, detail=detail)
            layers.look()
        if layers.intersections.active:
            layers.count_tangled()
        return made
