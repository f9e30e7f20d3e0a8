"""The problem of a backward Euler step in contact with solids, and of layers of cloth, solved to `contact_tol`.

Newton's method on all of it: the cloth's forces, and by one rule the forces, sticking and sliding of contacts
(`contact.solid.balance`). The first solve is (18) [BW98 §5, §6] with the contacts that the step before ended with, and those
that are predicted. Each further one begins where the last one ended. Forces are evaluated there, and states of contacts come
from the proximal gradient method on the new linearization (`solver.proximal`), or near the law from the law itself. The step
is solved if forces balance to `contact_tol` of all impulses, and impulses of contacts by Coulomb's law equal those of the last
linear solve to AGREED of that.

Layers of cloth are part of it where they meet. Pairs of layers are linearized where each solve begins, an update ends where
the first of them collide, and the last one has to go all of its way, with forces and friction of pairs as it took them.

A step whose energy grows is solved further. A step within BEARABLE times the tolerance is accepted; its `contact_error` shows
the residual. Any other is tried smaller.

Differs from `solid_contact` and `layer_contact`: the balance is that of the step's end, not of its linearization.

Tried and left out:
- Newton steps shortened until the potential falls, with terms of friction and without the work of constraints (`sphere_drape`
  556 solves for 552, `table` 425 for 485);
- the first linearization at the predicted positions (as many solves);
- friction linearized by secants in all solves (three times as many steps: the error falls by only 10 % a solve);
- contact states from the forces out of balance, instead of the last solve's reactions (they do not converge). As a second
  test, where contacts agree, they are taken: `sphere_drape` takes 589 solves for 569 without it, `bunny_drape` 1,966 to 2,711
  for 837 to 2,125 (four frictions).
"""

import math
from dataclasses import replace

from ...backend.timing import Clock
from ...contact.points import tangential
from ...contact.solid.balance import MET
from ...contact.solid.sliding import Sliding
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import APPROACH, CONTACT, ENERGY, NEWTON
from .energy import LIGHT, MOST, EnergyTest
from .linear_system import System
from .newton import CG_TOL, ConvergenceRate, NewtonTolerance, Outcome, StepProblem
from .solid_contact import forces_at_end

OTHERS = 5e-2  # relative residual of solves after the first one, whose is `cg_tol`. With 1e-2 for all of them `sphere_drape`
# takes 14,700 iterations for 19,700, but the speed of free fall beside a contact is .5 % off
LAST = 3e-3  # the same with layers, if the update before went all of its way. With 5e-2 a sheet that slides on a sheet gains
# 1.58 m/s^2 for 1.47 (1.48 by law), with 1e-2 the floor bears the weight of ten sheets to 1e-3 in 18 of 20 runs
AGREED = 0.01  # tolerance of Coulomb's law, over `contact_tol`. With .1, .03 and this `capstan_360_03` has 7.34, 6.69 and 6.70
# (6.68 on its polygon), and `sphere_drape` takes 551, 544 and 556 solves
STRICT = 3  # solves after which that tolerance doubles in each. If it never does 664 solves, after 2 of them 540
FAR = 0.3  # error of Coulomb's law, over `contact_tol`, above which states come from the proximal gradient method. With 1
# `table` takes 430 solves for 389. After MET solves they follow from the law alone: after 2, these 4 and never `table` takes
# 510, 449 and 485, without the method 658 (`bunny_drape` takes 800 to 2,300 with any of them, by chance)
BEARABLE = 5.0  # times the tolerances, within which a step that is not solved is accepted. With 3 597 solves for 562: smaller
# steps cost twice as much


class SolvedStep(StepProblem):
    """`held` are the pins at first, then the constraints of the last solve.

    Attributes:
        balance: of forces and contacts; found: its assessment of the state; residual: as last judged, out of balance by no
            more than `enough` where the step is solved.
        lacks: (n, 3) impulses out of balance [N s]; solve_impulses: contact forces of the last solve.
        acting: the smallest sum of all impulses [N s] in any state of the step; `enough` is relative to it. Relative to its
            own sum a state that went astray, with huge forces, would pass.
        over: span [s] over which damping is an energy; 0 where the step starts from a base.
        pairs: number of pairs of edges that need another solve.
        layers: of cloth that meets cloth, or None; part: of the last update that is free of collisions; apart: whether that is
            all of it, and pairs of layers agree with their solve.
        took: contact as the last solve took it; reaction, tension: impulses [N s] of what it held, and of seams.
        relaxed: whether states of contacts came from the proximal gradient method before the last solve.
    """

    def __init__(self, system: System, energy: EnergyTest, effort: NewtonTolerance | None, h: float, held: Held | None,
                 start: Measures, clock: Clock, solutions: list[Solution], together: bool = False) -> None:
        super().__init__(system, h, held, start, clock, solutions)
        self.layers, self.part, self.apart = system.contacts.layers if together else None, 1.0, True
        self.energy, self.effort, self.start, self.contacts = energy, effort, start, system.contacts
        self.enough = system.options.contact_tol or 0.0
        self.changes, self.pairs, self.over = ConvergenceRate(), 0, h if system.base is None else 0.0
        self.acting, self.relaxed = math.inf, False
        system.definite, system.stays_definite = False, True
        with clock.part("C-S"):
            system.predict(h, held, together)
            system.start_over()
            self.balance = self.contacts.balance

    def solve(self, k: int) -> Outcome | None:
        """See `StepProblem`."""
        balance, contacts, system = self.balance, self.contacts, self.system
        if k:
            self.relax()
        with self.clock.part("C-S"):
            if self.layers is not None:
                self.layers.detector.paths.arrive()
            if k:
                balance.take(self.found)
                balance.go_on(self.residual.relative <= self.enough)
                balance.constrain()
                contacts.base = system.model.read_particles()
            else:
                balance.begin()
                contacts.base = contacts.start.initial_iterate
                if balance.held is not None:
                    contacts.base[0][balance.held.index] += balance.held.y
            self.held = balance.held
            crowded = not contacts.take(balance.rubs(contacts.base[1]), k == 0, k > 0)
        if crowded:
            return self.refuse(CONTACT, f"more than {contacts.force.most} points of contact")
        if k == 0 and balance.closing > contacts.solids.reach:
            return self.refuse(APPROACH, f"{balance.closing:.3g} m in one step")
        self.linear(k)
        return self.unsolved()

    def linear(self, k: int) -> None:
        """Linearization and solve, from where the model is."""
        system, h, held = self.system, self.c, self.held
        with self.clock.part("EVAL"):
            if k:
                system.linearize(h, over=self.over)
            else:
                system.linearize_first(h, held)
        with self.clock.part("CG"):
            tolerance = CG_TOL
            if k:
                tolerance = LAST if self.layers is not None and self.part == 1 else OTHERS
            tolerance = system.options.cg_tol or tolerance
            z = system.rest(held, h) if k else None
            warm = k == 0 and system.base is not None and len(self.solutions) > 0
            if warm:
                system.add_guess(-1.0)
            self.solutions.append(system.solve(tolerance, held, h, z, warm, moved=k > 0, reuse_levels=True))
            if k == 0 and system.base is not None:
                system.add_guess(1.0)

    def advance(self, k: int) -> float:
        """See `StepProblem`."""
        contacts, system = self.contacts, self.system
        solids = contacts.solids
        with self.clock.part("C-S"):
            self.reaction = system.reaction_rows()
            if system.model.sewn is not None:
                self.tension = system.tension()
            self.solve_impulses = solids.active.holding.forces(solids.active.contacts, self.reaction)
            self.took = contacts.linearization
        with self.clock.part("EVAL"):
            self.changes.add(self.c * system.rms_change())
            if k:
                system.shift(self.c, 1.0)
            else:
                system.place(self.c, 1.0)
            system.settle(self.held)
        if self.layers is None:
            return 1.0
        with self.clock.part("C-S"):
            self.layers.record_forces()
            self.part = self.layers.advance()
            return self.part

    def shift(self, k: int, part: float, taken: float) -> None:
        """See `StepProblem`."""
        with self.clock.part("EVAL"):
            if k:
                self.system.shift(self.c, part - taken)
            else:
                self.system.place(self.c, part)

    def measure(self, k: int) -> Measures:
        """See `StepProblem`; the model is linearized there too, without friction of sliding contacts."""
        contacts, system = self.contacts, self.system
        solids = contacts.solids
        with self.clock.part("C-S"):
            solids.look()
            if self.layers is not None:
                self.layers.look()
                if self.part < 1:
                    self.layers.stop_short()
                self.apart = self.part == 1 and self.layers.settled()
        with self.clock.part("EVAL"):
            measures, self.lacks, balance_reaction = forces_at_end(system, self.c, self.held, self.over)
            solids.sliding = Sliding()  # as it is linearized
        with self.clock.part("C-S"):
            self.balance.inertia, holding = system.inertia(self.balance.near), solids.active.holding
            self.found = self.balance.assess(self.lacks, contacts.base[1], self.solve_impulses, holding.forces(
                solids.active.contacts, balance_reaction), self.enough, self.agreed, fixed=self.balance.k >= MET)
        if self.layers is None:
            return measures
        return replace(measures, energies={**measures.energies, "contact": self.layers.energy})

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `StepProblem`; no other length of it was found to do better."""
        return True

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `StepProblem`."""
        smoothed, r = self.balance.smoothed, self.found.residual
        self.acting = min(self.acting, r.acting)
        more = r.acting / self.acting
        self.residual = r = replace(r, relative=r.relative * more, law=r.law * more)
        with self.clock.part("C-S"):
            moved = self.contacts.base[0] - self.took.base[0]
            self.pairs = self.contacts.solids.update_pairs(self.reaction, moved, (self.took.near, self.took.repulsion))
        solved = self.within(1.0) and not smoothed and not self.pairs and self.apart
        if self.effort is not None:
            solved &= self.changes.enough(self.effort)
        return self.finish(measures, last=self.system.base is not None) if solved else None

    @property
    def agreed(self) -> float:
        """Part of all that acts by which contacts may now be off the law."""
        return min(AGREED * 2.0 ** max(0, len(self.solutions) - STRICT), 1.0) * self.enough

    def within(self, times: float) -> bool:
        """Whether the state is within so many times the tolerances."""
        r, most = self.residual, times * self.enough
        return r.relative <= most and r.law <= (self.agreed if times == 1 else self.enough)

    def relax(self) -> None:
        """States of contacts for the next solve, by the proximal gradient method where they are far from the law."""
        system, again = self.system, self.relaxed
        self.relaxed = len(self.solutions) <= MET and self.residual.law > FAR * self.enough
        self.relaxed &= not system.operator.has_low_rank
        with self.clock.part("C-S"):
            cones = self.balance.cones(self.found) if self.relaxed else None
        if cones is None:
            self.relaxed = False
            return
        with self.clock.part("CG"):
            slips, pressed = system.relax_next(cones, again)
        with self.clock.part("C-S"):
            self.found = self.balance.relaxed(self.found, tangential(slips, cones.normal), pressed)

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`. A step that is nearly solved is taken, also where pairs of edges could be further apart."""
        if self.within(BEARABLE) and not self.balance.smoothed and self.apart:
            made = self.finish(measures)
            assert made is not None
            return made
        r = self.residual
        return Outcome(NEWTON, f"{len(self.solutions)} solves, {100 * r.relative:.2g} % of all forces out of balance, most at "
                       f"particle {r.worst}, {r.changed} contacts change", measures)

    def finish(self, measures: Measures, last: bool = True) -> Outcome | None:
        """Whether the step passes: nothing too deep or through solids, and no energy from nowhere. If there is some, but it is
        not the last solve, None: forces balance better after another."""
        contacts, system, solids = self.contacts, self.system, self.contacts.solids
        with self.clock.part("C-S"):
            since, contacts.linearization = contacts.linearization, self.took
            system.keep_reaction(self.reaction, None if system.model.sewn is None else self.tension)
            solids.trial = self.balance.next_states(self.found)
            solids.record_forces(self.reaction, self.took.base[0])
            r, solved = self.residual, self.within(1.0) and not self.pairs
            contacts.found = replace(self.found, residual=replace(r, relative=r.law if solved else max(r.relative, r.law)))
            solids.unsettled = 0 if solved else max(r.changed, 1)
            deep = solids.ends_deep()
            through = not deep and solids.went_through()
        if deep:
            return Outcome(CONTACT, "too deep inside", measures)
        if through:
            return Outcome(CONTACT, f"{contacts.crossings} crossings", measures)
        with self.clock.part("EVAL"):
            slack = self.enough if last and contacts.meeting else 0.0
            ended = self.energy.conclude(self.c, self.held, self.start, measures, MOST if last else LIGHT, slack=slack)
        if ended is None and not last:
            contacts.linearization = since
            return None
        if ended is None:
            return Outcome(ENERGY, f"{len(self.solutions)} solves", measures)
        now = system.meter.measure()
        return Outcome(None, "", replace(ended[0], dissipation=now.dissipation, damped=now.damped, rate=now.rate), ended[1])

    def refuse(self, name: str, detail: str) -> Outcome:
        """The end of a step that contact does not allow."""
        return Outcome(name, detail, self.system.meter.measure())
