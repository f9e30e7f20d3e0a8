"""The problem of a backward Euler step in contact with solids. [BW98 §5, §6]

The first Newton step linearizes at the saved state, (18), and repeats the linear solve until contact states satisfy Coulomb's
law (`contact.solid.balance`). Further Newton steps hold the same contacts, with friction and pairs linearized anew. The
potentials of friction and pairs are part of Phi.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...backend.rows import read
from ...backend.timing import Clock
from ...contact.solid.solid_contacts import EARTH
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import APPROACH, CONTACT, TOUCH
from ..ledger import Ledger
from .euler import EulerPolicy, EulerStep
from .linear_system import System
from .newton import Outcome, StepProblem, minimize

ROUNDS = 13  # solves of (18), after which a step goes on with the last states of contacts
MORE = 2  # solves besides `newton_max` further ones that a step may take with `contact_tol`; with 0 and 4 `sphere_drape` takes
# 562 and 596 for 512 in 1 s
FINDING = 9  # solves besides those for layers of cloth, whose first ones find their pairs. With 3, 9 and 13 `layers` takes
# 321, 343 and 347 solves in .4 s, and has 8, 6 and 4 steps that are not solved, .026, .016 and .016 J unaccounted for
FINEST = 4  # times smaller than a full step, one that is not solved is made without `contact_tol`. With 1, 2, 4, 8
# `bunny_drape` takes 534, 811, 687, 731 solves, .085, .020, .014, .006 J unaccounted for; `sphere_drape` 532, 651, 584, 584,
# .16 to .007 J


def forces_at_end(system: System, c: float, held: Held | None, over: float) -> tuple[Measures, np.ndarray, np.ndarray]:
    """Linearizes at the model's state, the step's end, without friction of contacts that slide on solids.

    Returns (measures, impulses (n, 3) [N s] that the step lacks, those (k, 3) that balance them on held particles).

    Args:
        over: span [s] over which damping is an energy, or 0.
    """
    contacts = system.contacts
    contacts.base = system.model.read_particles()
    contacts.take(None, False)
    measures = system.linearize(c, over=over)
    lacks = read(system.operator.b).astype(float)
    balance_reaction = np.zeros((0, 3)) if held is None else system.on_held(held, -lacks[held.index])
    return measures, lacks, balance_reaction


class SolidStep(EulerStep):
    """An `EulerStep` in which `held` are the pins at first, then the constraints of the last solve.

    Attributes:
        relaxed: whether states of contacts came from the proximal gradient method in this step.
    """

    touches = True
    least_gravity = EARTH
    relaxed = False

    def first(self) -> Outcome | None:
        """(18) with contacts that agree with it. The tolerance of CG is halved in each solve."""
        contacts, tolerance = self.system.contacts, self.forcing.preliminary
        with self.clock.part("C-S"):
            self.system.predict(self.c, self.held, together=False)
        while True:
            refused = self.solve_held(tolerance if tolerance > self.forcing.first else None)
            if refused is not None:
                return refused
            tolerance /= 2
            if self.agrees() or contacts.rounds == ROUNDS:
                break
            if contacts.rounds == 1 and self.balances():
                return self.went_wrong()
            self.relax()
        return self.finish_solve() or self.went_wrong()

    def went_wrong(self) -> Outcome | None:
        """The end of a step that leaves cloth too deep inside solids, or through."""
        contacts = self.system.contacts
        with self.clock.part("C-S"):
            deep = contacts.solids.ends_deep()
            through = not deep and contacts.solids.went_through()
        if deep:
            return self.refuse(CONTACT, "too deep inside a solid")
        return self.refuse(CONTACT, f"{contacts.crossings} crossings") if through else None

    def agrees(self) -> bool:
        """Whether contacts agree with the last solve."""
        with self.clock.part("C-S"):
            return self.system.contacts.judge(self.system.reaction_rows(), self.system.inertia)

    def finish_solve(self) -> Outcome | None:
        """Goes on from the last rough solve to `cg_tol`; both count as one solve."""
        if not self.solutions[-1].preliminary:
            return None
        rough = self.solutions.pop()
        self.system.start_over()
        self.solve_linearized(fresh=False)
        self.solutions[-1] = replace(self.solutions[-1], iterations=self.solutions[-1].iterations + rough.iterations)
        with self.clock.part("C-S"):
            self.system.contacts.record(self.system.reaction_rows())
        return self.unsolved()

    def balances(self) -> bool:
        """Whether contact states satisfy Coulomb's law with the true forces at the end state. If so, contact forces are those
        that balance them."""
        system, contacts = self.system, self.system.contacts
        solids = contacts.solids
        if solids.wanting():
            return False
        keep = solids.linearized, solids.repulsion, contacts.base
        _, lacks, balance_reaction = forces_at_end(system, self.c, self.held, self.c if system.base is None else 0.0)
        contacts.base = keep[2]
        with self.clock.part("C-S"):
            agrees = contacts.accept(lacks, balance_reaction)
        if agrees:
            system.replace_constraints(self.held, -lacks)
        else:  # back to the system of the solve
            system.start_over()
            contacts.set_points()
            system.linearize_first(self.c, self.held)
        solids.linearized, solids.repulsion = keep[:2]
        return agrees

    def relax(self) -> None:
        """States of contacts for the next solve, by the proximal gradient method."""
        contacts = self.system.contacts
        with self.clock.part("C-S"):
            cones = None if self.system.operator.has_low_rank else contacts.cones()
        if cones is None:
            return
        with self.clock.part("CG"):
            slips, pressed = self.system.relax(cones, self.relaxed)
        self.relaxed = True
        with self.clock.part("C-S"):
            contacts.found = contacts.balance.relaxed(contacts.found, slips, pressed)

    def solve_held(self, tolerance: float | None) -> Outcome | None:
        """(18) with the constraints that contacts now set."""
        system, contacts = self.system, self.system.contacts
        with self.clock.part("C-S"):
            self.held, closing = contacts.constrain(smooth=False)
            contacts.set_points()
            system.start_over()
        if contacts.crowded:
            return self.refuse(CONTACT, f"more than {contacts.force.most} points of contact")
        if closing > contacts.solids.reach:
            return self.refuse(APPROACH, f"{closing:.3g} m in one step")
        self.solve_linear(tolerance)
        return self.unsolved()

    @property
    def excused(self) -> bool:
        """See `EulerStep`."""
        contacts = self.system.contacts
        return contacts.hindered or not (contacts.count or contacts.solids.near.any_pairs)

    def refuse(self, name: str, detail: str) -> Outcome:
        """The end of a step that contact does not allow."""
        return Outcome(name, detail, self.system.meter.measure())

    def further(self) -> Outcome | None:
        """See `EulerStep`; the constraints of contacts stay."""
        with self.clock.part("C-S"):
            self.system.contacts.rebase()
        return super().further()

    def potential(self, measures: Measures) -> float:
        """Phi [J] with the terms of friction and pairs."""
        return super().potential(measures) + self.system.contacts.lagged(self.c)

    def finish(self, measures: Measures, ledger: Ledger) -> Outcome:
        """Rejects the step if further Newton steps, which held the same contacts, pushed anything too deep."""
        with self.clock.part("C-S"):
            wrong = self.system.contacts.went_in(self.system.reaction_rows())
        return Outcome(CONTACT, "after further solves", measures) if wrong else Outcome(None, "", measures, ledger)


class SolidPolicy(EulerPolicy):
    """Steps in contact with solids, or with `solve` with layers of cloth too.

    Attributes:
        solved: problem of a step that is solved, with `contact_tol`; None without.
    """

    step = SolidStep
    solved: Callable[..., StepProblem] | None = None

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`."""
        made = self.solve(h, pins, start, clock, solutions)
        return super().attempt(h, pins, start, clock, solutions) if made is None else made

    def solve(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution],
              together: bool = False) -> Outcome | None:
        """A step that is solved, with `together` with layers of cloth. None where it is to be made as without `contact_tol`:
        small ones that are not solved, those in which nothing is met, and those in which solids leave cloth no room, as no
        state is in balance there."""
        contacts, most = self.system.contacts, 1 + self.system.options.newton_max + MORE
        if self.solved is None or contacts.hindered:
            return None
        problem = self.solved(self.system, self.energy, self.effort, h, pins, start, clock, solutions, together)
        if self.system.base is not None and contacts.solids.hit():
            return Outcome(TOUCH, "an impact", start)
        if not contacts.solids.pinches.where.any():
            made = minimize(problem, most + (FINDING if together else 0))
            self.system.stays_definite = self.system.definite = False
            if made.rejection is None or (contacts.meeting and contacts.start.share > 1.5 / FINEST):
                return made
            if contacts.meeting:
                self.system.tell("some small steps in contact were solved less exactly, as is usual where cloth hits "
                                 "something; a run's last lines say how inexact forces are")
        self.system.start_over()
        return None
