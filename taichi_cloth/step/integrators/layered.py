"""A backward Euler step in which cloth may meet cloth: several solves, none taken further than its way is free.

The first solve is (18), with the contacts that the last motion leads to; each further one is a Newton step on the
incremental potential, repulsion and friction of layers included, from where the last one could lead to. Contacts with
solids are judged after each. The step is made when a solve could be taken whole, its forces are what contacts then
have, and its energy has not grown beyond the work put in. Tangles that are pulled apart are given energy.
"""

import math
from dataclasses import replace

import numpy as np

from ...backend.timing import Clock
from ...contact.contacts import Verdict
from ...solver.pcg import CONVERGED, Solution
from ...system.assembler import Measures
from ...system.constraints import Held
from ..ledger import Ledger
from .attempt import APPROACH, CONTACT, NOT_FINITE, SOLVER, Attempt
from .brake import MOST
from .system import phi

BOLD = 4  # solves of a step before the potential has a say in how far they go
MEMORY = 3  # of the last potentials one must not be passed
TIMID = 0.2  # part of a solve's way below which it is not taken shorter for the potential's sake
SMOOTH = 1e-3  # part of the repulsion's energy that is not worth a shorter way
LETS = 10  # attempts at a small step, each without the pairs that kept the last from going all of its way
NEARLY = 1e-7  # m that a held direction may be off its target


class Layered:
    """Steps of a `BackwardEuler` whose cloth meets cloth."""

    def __init__(self, euler) -> None:
        self.euler, self.system, self.model = euler, euler.system, euler.model
        self.contacts, self.layers = euler.contacts, euler.contacts.layers
        self.stiffened = 0.0  # energy [J] that repulsion has where the step begins beyond what it had where the last ended
        self.ledger: Ledger | None = None
        self.unsettled = 0  # pairs whose forces did not agree, in a step too small to be tried smaller

    @property
    def meets(self) -> bool:
        """Whether layers met at the end of the last step, or cross: then they are reckoned with from the first solve on."""
        return self.layers.count > 0 or self.layers.tangles.active

    def attempt(self, h: float, pins: Held | None, start: Measures) -> Attempt:
        """One step; see the package. After one in which layers did not meet it is made as if they could not, and again if
        they do."""
        if self.meets:
            return self._together(h, pins, start)
        made = self.euler.solve_once(h, pins, start)
        if made.rejection is not None:
            return made
        before = self.layers.seconds
        met = self.layers.meet()
        seconds = {**made.seconds, "C-C": self.layers.seconds - before}
        if not met:
            self.layers.pass_without()
            return replace(made, seconds=seconds)
        self.model.restore()
        again = self._together(h, pins, start)
        both = {k: seconds.get(k, 0.0) + again.seconds.get(k, 0.0) for k in seconds | again.seconds}
        return replace(again, seconds=both, solutions=made.solutions + again.solutions)

    def _together(self, h: float, pins: Held | None, start: Measures) -> Attempt:
        clock, layers, before = Clock(), self.layers, self.layers.seconds
        solutions: list[Solution] = []
        for _ in range(LETS):
            self.let_go = False
            rejection, measures = self._attempt(h, pins, start, clock, solutions)
            if not self.let_go:
                break
            self.model.restore()
        self.contacts.layered = False
        if layers.tangles.active:
            layers.count_tangled()
        spent = layers.seconds - before
        seconds = {**clock.seconds, "C-C": spent, "C-S": max(clock.seconds.get("C-S", 0.0) - spent, 0.0)}
        name, detail = rejection or (None, "")
        return Attempt(name, detail, measures, tuple(solutions), seconds, unsettled=self.unsettled, layers=layers.count,
                       least=layers.least, tangled=layers.tangles.count, pinched=layers.tangles.pinched, ledger=self.ledger)

    def _attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock,
                 solutions: list[Solution]) -> tuple[tuple[str, str] | None, Measures]:
        """(what is wrong with the step or None, measures of the state that it ends in)."""
        contacts, layers = self.contacts, self.layers
        contacts.layered, self.unsettled = True, 0
        with clock.part("C-S"):
            known = contacts.warm
            self.euler.predict(h, pins)
            self.model.restore()
            energy = layers.energy if known else layers.energy_here()
        self.stiffened, self.ledger = energy - start.energies.get("contact", 0.0), None
        measures, seen = start, []
        for k in range(layers.ROUNDS):
            with clock.part("C-S"):
                held, closing = contacts.hold()
                layers.detector.arrive()
                if k:
                    contacts.rebase()
                else:
                    contacts.set_touch()
            if contacts.crowded:
                return (CONTACT, f"more than {contacts.force.capacity} points of contact"), measures
            if closing > contacts.reach:
                return (APPROACH, f"{closing:.3g} m in one step"), measures
            leads = self._solve(h, held, k == 0, clock, solutions)
            if solutions[-1].status != CONVERGED:
                return (SOLVER, solutions[-1].status), measures
            seen.append(math.inf if k == 0 else self._potential(measures, h))
            free = k < BOLD or leads
            part, verdict, measures = self._go(h, held, k == 0, math.inf if free else max(seen[-MEMORY:]), clock)
            if not measures.finite:
                return (NOT_FINITE, f"after {k + 1} solves"), measures
            with clock.part("C-S"):
                agreed = part == 1 and layers.settled() and not (verdict.changes and k < contacts.ROUNDS)
            if agreed and (ended := self._conclude(h, held, start, measures)):
                measures, self.ledger = ended
                break
        else:
            ended = self._conclude(h, held, start, measures) if part == 1 and contacts.small else None
            if ended is None:
                if part < 1 and (contacts.smallest or (contacts.small and held is not None and held.moving)):
                    self.let_go = layers.let_go(contacts.smallest)  # else nothing presses that does not give way
                why = "its energy grew" if agreed else (f"{layers.off} pairs unsettled, smallest gap {layers.least:.2g} of "
                                                        "what it should be")
                return (CONTACT, f"between layers of cloth, after {len(solutions)} solves: {part:.2g} of the way free, "
                        f"{why}"), measures
            measures, self.ledger = ended
            self.unsettled = layers.off
        with clock.part("C-S"):
            if verdict.changes and verdict.bad and contacts.may_shrink():
                return (CONTACT, f"{verdict.deepest:.2g} thicknesses inside a solid"), measures
            if contacts.went_through():
                return (CONTACT, f"{contacts.crossings} crossings with solids"), measures
        return None, measures

    def _conclude(self, h: float, held: Held | None, start: Measures, measures: Measures) -> tuple[Measures, Ledger] | None:
        """(measures, ledger) of the step as it is, or None where its energy grew too much to be taken off velocities."""
        given = math.inf if self.layers.tangles.active else self.stiffened
        return self.euler.conclude(h, held, start, measures, MOST, given)

    def _solve(self, h: float, held: Held | None, first: bool, clock: Clock, solutions: list[Solution]) -> bool:
        """One solve from where the model is; whether held directions are still on their way to their targets."""
        system = self.system
        with clock.part("EVAL"):
            if first:
                system.operator.set_motion(h)
                if held is not None:
                    system.operator.alter_motion(held.index, held.y)
            system.linearize(h, moves=first)
        with clock.part("CG"):
            z = None if first else system.to_go(held, h)
            solutions.append(system.solve(self.euler.cg_tol, held, h, z=z))
        if z is None or held is None or not len(z):
            return first
        return bool(np.abs(np.einsum("kij,kj->ki", held.projector, z)).max() * h > NEARLY)

    def _go(self, h: float, held: Held | None, first: bool, limit: float,
            clock: Clock) -> tuple[float, Verdict, Measures]:
        """Goes along a solve as far as the way is free and the potential within the limit: (part, verdict, measures)."""
        move, layers = self.euler.place if first else self.euler.shift, self.layers
        with clock.part("EVAL"):
            move(h, 1.0)
            self.system.settle(held)
        with clock.part("C-S"):
            verdict = self.contacts.judge(self.system.reaction_rows())
            layers.record_forces()
            part = layers.advance()
        taken = 1.0
        while True:
            with clock.part("EVAL"):
                if part < taken:
                    move(h, part if first else part - taken)
                    taken = part
                measures = self._measure()
                allowed = limit + SMOOTH * layers.energy + self.system.rounding(h, measures)
                if part < TIMID or limit == math.inf or self._potential(measures, h) <= allowed:
                    break
            part /= 2
        if part < 1:
            with clock.part("C-S"):
                self.contacts.stop_short()
        return part, verdict, measures

    def _measure(self) -> Measures:
        """Of the state as it now is, with the repulsion of layers."""
        self.layers.look()
        measures = self.euler.meter.measure()
        return replace(measures, energies={**measures.energies, "contact": self.layers.energy})

    def _potential(self, measures: Measures, h: float) -> float:
        """The incremental potential [J] with what contacts add to it."""
        return phi(measures, h) + self.contacts.lagged(h)
