"""The problem of a backward Euler step in contact with solids, and when it is solved.

The first Newton step is (18) with the contacts that agree with it [BW98 §5, §6], see `solid_contact`. It ends the step where
the step's energy is accounted for, and forces and contacts are in balance at its end. Else Newton's method goes on with all
of it: the cloth's forces, and by one rule the forces, sticking and sliding of contacts (`contact.solid.balance`). Each solve
begins where the last one ended. A step that is not solved by then is tried smaller.

Balance is within `contact_tol` of all forces, by default within `BALANCED` of them. A linearized step of an impact, or round
an edge, is off by 5 to 500 times as much as all forces that act: stiff directions answer a turn of the cloth. All forces are
the least that act in any state of the step, since a state far off has forces of any size.

Tried and left out:
- a line search on the potential with friction and depths (as many solves, more evaluations);
- the prediction as the first linearization's place (as many);
- friction by secants to the end (three times as many steps: it converges by .9 a solve);
- states by the forces that balance needs instead of those of the last solve (they never settle).
"""

import math
from dataclasses import replace

from ...backend.timing import Clock
from ...contact.solid.balance import Found
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import CONTACT, NEWTON
from ..ledger import Ledger
from .energy import LIGHT, MOST
from .euler import EulerPolicy
from .newton import Outcome, minimize
from .solid_contact import SolidStep, forces_at_end

BALANCED = 0.3  # part of all that acts by which forces may be off balance at the end of a step, without `contact_tol`. With
# 1, this and .1 a towel slides .023, .062, .063 m (law .057), and a sheet on a ball (30 cells, 1 s) takes 449, 470, 651 solves
ACCOUNTED = 0.05  # part of a step's energy, or of what a step of free fall gains, that may be unaccounted for. With .02 and
# this 1 and 4 % of what moves are as a sheet lands on a table; the sheet on a ball takes 518, 470 solves, with .2 and no bound
# on balance 356
FINEST = 8  # times smaller than the usual, a step that is not solved is no longer tried smaller. Sheet on a ball, .7 s, to .01:
# with 4, 8, 16 581, 641, 656 solves, .065, .0035, .0016 J unaccounted for; with 64 a rope of next to no weight takes minutes
OTHERS = 1e-2  # relative residual of solves that go on from where the first one ended


class SolvedStep(SolidStep):
    """`held` are the pins at first, then the constraints of the last solve.

    Attributes:
        whole: whether further Newton steps take contacts anew: not where nothing is touched, or solids leave no room.
        found: assessment of the state; residual: as last judged, out of balance by no more than `enough` where the step is
            solved.
        lacks: (n, 3) impulses [N s] that the state lacks; taken: contact forces of the last solve.
        acting: least [N s] that acts in any state of the step.
        pairs: of edges that want another solve.
    """

    bearable = ACCOUNTED

    def __init__(self, *problem) -> None:
        super().__init__(*problem)
        self.contacts = self.system.contacts
        self.enough = self.system.options.contact_tol or BALANCED
        self.whole, self.pairs, self.acting = False, 0, math.inf
        self.found: Found | None = None

    def first(self) -> Outcome | None:
        """See `SolidStep`."""
        refused = super().first()
        self.whole = refused is None and not self.excused
        if self.whole:
            self.noted()
        return refused

    def noted(self) -> None:
        """Notes the reactions of a solve, before the model is linearized elsewhere."""
        system, solids = self.system, self.contacts.solids
        self.found, self.reaction = None, system.reaction_rows()
        system.keep_reaction(self.reaction, None if system.model.sewn is None else system.tension())
        self.taken = solids.active.holding.forces(solids.active.contacts, self.reaction)
        self.borne, self.began = (solids.linearized, solids.pressing), self.contacts.base[0]

    def further(self) -> Outcome | None:
        """See `EulerStep`: a Newton step of cloth and contacts."""
        if not self.whole:
            return super().further()
        balance, contacts, system = self.contacts.balance, self.contacts, self.system
        with self.clock.part("C-S"):
            balance.hold()
            contacts.base, self.held = system.model.read_particles(), balance.held
            crowded = not contacts.take(balance.rubs(contacts.base[1]), False)
        if crowded:
            return self.refuse(CONTACT, f"more than {contacts.force.most} points of contact")
        with self.clock.part("EVAL"):
            system.linearize(self.c, over=self.over)
        with self.clock.part("CG"):
            tolerance, z = system.options.cg_tol or OTHERS, system.to_go(self.held, self.c)
            self.solutions.append(system.solve(tolerance, self.held, self.c, z, again=True, lasting=True))
        return self.unsolved()

    def advance(self, k: int) -> float:
        """See `StepProblem`."""
        if not (k and self.whole):
            return super().advance(k)
        with self.clock.part("C-S"):
            self.noted()
        with self.clock.part("EVAL"):
            self.system.shift(self.c, 1.0)
            self.system.settle(self.held)
        return 1.0

    def measure(self, k: int) -> Measures:
        """See `StepProblem`; from the second one on the model is linearized there too."""
        if not (k and self.whole):
            return super().measure(k)
        with self.clock.part("C-S"):
            self.contacts.solids.look()
        return self.assess()

    def assess(self) -> Measures:
        """Finds how far the state is from balance."""
        contacts, system = self.contacts, self.system
        with self.clock.part("EVAL"):
            measures, self.lacks, needed = forces_at_end(system, self.c, self.held, self.over)
        with self.clock.part("C-S"):
            active, contacts.balance.inertia = contacts.solids.active, system.inertia()
            needed = active.holding.forces(active.contacts, needed)
            self.found = contacts.balance.assess(self.lacks, contacts.base[1], self.taken, needed, self.enough)
        self.residual = r = self.found.residual
        self.acting = min(self.acting, r.acting)
        return measures

    @property
    def off(self) -> float:
        """How far the state is from balance, as part of the least that acts in any state of the step."""
        return self.residual.off * self.residual.acting / self.acting

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `StepProblem`. No other length of a further step was found to do better."""
        return True if k and self.whole else super().acceptable(k, part, measures)

    def fits(self, measures: Measures, ledger: Ledger) -> bool:
        """See `EulerStep`; and whether forces are in balance."""
        if not super().fits(measures, ledger):
            return False
        if self.whole and self.found is None:
            self.assess()
        return not self.whole or self.off <= self.enough

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `StepProblem`."""
        if self.ended is not None or not self.whole:
            return super().judge(k, part, measures)
        if k == 0:
            self.over = self.c if self.system.base is None else 0.0
            self.assess()
        self.changes.add(self.c * self.system.rms_change())
        with self.clock.part("C-S"):
            contacts = self.contacts
            self.pairs = contacts.solids.bear(self.reaction, contacts.base[0] - self.began, self.borne)
            contacts.balance.take(self.found)
        enough = k > 0 and self.off <= self.enough and (self.effort is None or self.changes.enough(self.effort))
        return self.end(measures) if enough and not self.pairs else None

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`. A step is taken even if pairs of edges could be further apart."""
        if not self.whole:
            return super().give_up(measures)
        ended, r = self.end(measures) if self.pairs and self.off <= self.enough else None, self.residual
        off = f"{100 * self.off:.2g} % of all forces out of balance, most at particle {r.worst}"
        return ended or Outcome(NEWTON, f"{len(self.solutions)} solves, {off}, {r.changed} contacts change", measures)

    def end(self, measures: Measures) -> Outcome | None:
        """The step's end, if its energy is accounted for, and nothing is too deep inside solids, or through."""
        contacts, system, solids, found = self.contacts, self.system, self.contacts.solids, self.found
        with self.clock.part("C-S"):
            contacts.balance.finish()
            self.held = contacts.balance.held
            solids.unsettled = self.residual.changed
        with self.clock.part("EVAL"):
            system.hold(self.held, -self.lacks)
            if self.effort is None:
                ended = self.accounted(self.energy.conclude(self.c, self.held, self.start, measures, LIGHT, fits=self.fits))
            else:
                ended = self.energy.conclude(self.c, self.held, self.start, measures, MOST)
        with self.clock.part("C-S"):
            if ended is None or solids.ends_deep() or solids.went_through():
                return None
        assert found is not None
        if system.options.contact_tol is None:  # contacts bear what the law says: it is the cloth that is off balance
            found = replace(found, residual=replace(found.residual, off=0.0))
        contacts.found = found
        now = system.meter.measure()
        return Outcome(None, "", replace(ended[0], dissipation=now.dissipation, damped=now.damped, rate=now.rate), ended[1])


class SolidPolicy(EulerPolicy):
    """Steps in contact with solids."""

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`. A small step that is not solved is made as a `SolidStep`."""
        problem = SolvedStep(self.system, self.energy, self.effort, h, pins, start, clock, solutions)
        made = minimize(problem, 1 + self.system.options.newton_max)
        if made.rejection != NEWTON or not problem.whole or self.system.contacts.start.share > 1.5 / FINEST:
            return made
        if self.system.options.contact_tol is not None:
            self.system.tell("some steps in contact were not solved to contact_tol, however small: they were made without it")
        self.system.start_over()
        return minimize(SolidStep(self.system, self.energy, self.effort, h, pins, start, clock, solutions),
                        1 + self.system.options.newton_max)
