"""The problem of a backward Euler step without contact: the paper's linear solve (18), and more Newton steps where it does
not hold.

The first Newton step, from rest at x_0, is (18); its line search accepts it as it is if energy has not grown beyond the
work put in: the paper's cheap case. Else it is shortened until Phi is no more than that of standing still, and Newton goes
on from there, until a full Newton step is taken and the energy is right. With `converge` it always goes on, until a
Newton step moves the cloth by less than `newton_tol`: nonlinear backward Euler.

Further steps take damping as an energy of the step, and with all of its second derivative and of the membrane's where the
matrix is positive definite. Forces and Phi then agree, and Newton's method converges from far away.

Differs from [BW98]: the test and the further solves; the paper accepts every solve.
"""

from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from ...backend.timing import Clock
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import ENERGY, NEWTON
from ..ledger import STILL, Ledger
from .energy import LIGHT, MOST, EnergyTest
from .linear_system import System
from .newton import ConvergenceRate, Forcing, NewtonTolerance, Outcome, StepProblem, minimize, phi

PATIENCE = 5  # of them without one that goes all of its way
BEARABLE = 0.2  # part unaccounted for with which a step is better than a smaller one
LOOSE = 0.1  # part of a step's exchanged energy that may be unaccounted for where something may rip, or gas works,
ACCOUNTED = 0.02  # and where cloth is beyond a limit, or in which something does


class EulerStep(StepProblem):
    """A step of size c from the model's saved state, which its current state equals.

    Args:
        start: measures there.
        effort: how far Newton's method goes on; None: no further than the first solve's energy asks for.

    Attributes:
        touches: whether contact is part of it; least_gravity: [m/s^2] in the fall that its lost energy is compared with.
    """

    touches = False
    least_gravity = 0.0
    over = 0.0

    def __init__(self, system: System, energy: EnergyTest, effort: NewtonTolerance | None, h: float, held: Held | None,
                 start: Measures, clock: Clock, solutions: list[Solution]) -> None:
        super().__init__(system, h, held, start, clock, solutions)
        self.energy, self.effort, self.start = energy, effort, start
        self.forcing = Forcing.of(system.options.cg_tol, effort)
        self.cg_tol = self.forcing.first
        self.changes = ConvergenceRate()
        self.settled = False  # whether the last Newton step was a full one, and small enough
        self.ended: tuple[Measures, Ledger] | None = None  # the first one's, with its energy right
        self.fallback: Callable[[], Outcome] | None = None  # goes back to it, where too much of that is unaccounted for

    def solve(self, k: int) -> Outcome | None:
        """See `StepProblem`. The first Newton step places the model at its end."""
        return self.further() if k else self.first()

    def first(self) -> Outcome | None:
        """(18) from the saved state."""
        self.solve_linear()
        return self.unsolved()

    def solve_linear(self, tolerance: float | None = None) -> None:
        """(18) with the constraints; the model ends in its solution. A solve of a `tolerance` of its own is preliminary."""
        system, h, held = self.system, self.c, self.held
        with self.clock.part("EVAL"):
            self.before = system.linearize_first(h, held)
            if self.forcing.follows:
                self.forcing.next(system.imbalance(held))
        self.solve_linearized(tolerance)

    def solve_linearized(self, tolerance: float | None = None, fresh: bool = True) -> None:
        """Solves the system as it is linearized, as `solve_linear` does. Not `fresh`, its last solve goes on."""
        system, h, held = self.system, self.c, self.held
        with self.clock.part("CG"):
            warm = not fresh or len(self.solutions) > 0
            if system.base is not None and warm:
                system.add_guess(-1.0)
            solution = system.solve(tolerance or self.forcing.first, held, h, warm=warm, fresh=fresh, reuse_levels=True,
                                    track_iterations=tolerance is None)
            self.solutions.append(replace(solution, preliminary=tolerance is not None))
            if system.base is not None:
                system.add_guess(1.0)
        with self.clock.part("EVAL"):
            system.place(h, 1.0)
            system.settle(held)

    def further(self) -> Outcome | None:
        """A Newton step from the model's state; constrained particles are at their targets."""
        self.over = self.c if self.system.base is None and not self.touches else 0.0
        with self.clock.part("EVAL"):
            here = self.system.linearize(self.c, over=self.over)
        if self.over > 0:
            self.before = here
        with self.clock.part("CG"):
            tolerance = self.forcing.mending if self.touches or self.before.used > 1 else self.forcing.further
            if self.forcing.follows:
                tolerance = self.forcing.next(self.system.imbalance(self.held))
            fresh = self.system.base is None  # else close by: the first solve's preconditioner will do
            self.solutions.append(self.system.solve(tolerance, self.held, fresh=fresh, reuse_levels=True, moved=True))
        self.level = self.potential(self.before)
        return self.unsolved()

    def advance(self, k: int) -> float:
        """See `StepProblem`."""
        if k:
            self.shift(k, 1.0, 0.0)
        return 1.0

    def shift(self, k: int, part: float, taken: float) -> None:
        """See `StepProblem`."""
        with self.clock.part("EVAL"):
            if k:
                self.system.shift(self.c, part - taken)
            else:
                self.system.place(self.c, part)

    def measure(self, k: int) -> Measures:
        """See `StepProblem`."""
        with self.clock.part("EVAL"):
            return self.system.meter.measure(self.over)

    def acceptable(self, k: int, part: float, measures: Measures) -> bool:
        """See `StepProblem`. The first step needs the right energy, or less Phi than standing still."""
        if k:
            small = self.system.base is not None and self.c * self.system.rms_change() < self.changes.first / 2
            return small or self.decreases(measures, self.lags(measures))
        if not measures.finite:
            return True  # nothing to shorten: the step ends there, by name
        if part == 1:
            if self.effort is None:
                with self.clock.part("EVAL"):
                    ended = self.energy.conclude(self.c, self.held, self.start, measures, LIGHT, fits=self.fits)
                    self.ended = self.accounted(ended)
                    if ended is not None and self.ended is None and self.doubt(*ended) < BEARABLE:
                        self.fallback = self.fallback_to(ended)
            self.level = self.start.total + self.system.rounding(self.c, self.start, measures)
        # a shorter first step would leave led particles behind, and a guess that is better than standing still
        whole = self.ended is not None or self.system.leads or self.system.base is not None
        return whole or phi(measures, self.c) <= self.level

    def lags(self, measures: Measures) -> float:
        """Growth [J] allowed to Phi as the air's R changes with x; its force rightly ignores that change."""
        return self.c * abs(measures.air - self.before.air) if self.over > 0 else 0.0

    def judge(self, k: int, part: float, measures: Measures) -> Outcome | None:
        """See `StepProblem`."""
        if self.ended is not None:
            return Outcome(None, "", *self.ended)
        if self.effort is not None:
            self.changes.add(self.c * self.system.rms_change() * part)
        small = self.effort is None or (self.changes.enough(self.effort)
                                        and self.forcing.enough(self.changes.last / self.effort.moved))
        self.settled = k > 0 and part == 1 and small
        if not self.settled:
            return self.fallback() if self.fallback is not None and k == PATIENCE else None
        last = self.effort is not None or len(self.solutions) > self.system.options.newton_max
        with self.clock.part("EVAL"):
            self.system.settle(self.held)
            if last:
                ended = self.energy.conclude(self.c, self.held, self.start, measures, MOST)
            else:
                ended = self.accounted(self.energy.conclude(self.c, self.held, self.start, measures, LIGHT, fits=self.fits))
        if ended is None:
            return None if self.system.base is None else Outcome(ENERGY, f"{len(self.solutions)} solves", measures)
        return self.finish(*ended)

    def accounted(self, ended: tuple[Measures, Ledger] | None) -> tuple[Measures, Ledger] | None:
        """The end of a step, or None if it does not fit; a step that was slowed down passed that test before."""
        return ended if ended is None or ended[1].kinetic_correction or self.fits(*ended) else None

    def fits(self, measures: Measures, ledger: Ledger) -> bool:
        """False if a solve left too much of the step's energy unaccounted for, and cloth runs into a limit or tears, or gas
        works on it, or it touches something. In contact, a part of the gain of a step of free fall may be left in any case."""
        doubt = self.doubt(measures, ledger)
        if self.exacting or measures.used > 1:
            most = ACCOUNTED if self.system.stitches_failed or not self.system.fragile else LOOSE
            return doubt <= most
        if not self.touches or doubt <= BEARABLE or self.excused:
            return True
        g = max(float(np.linalg.norm(self.system.contacts.gravity)), self.least_gravity)
        fall = 0.5 * self.system.model.mass.sum() * (g * self.c) ** 2
        return abs(ledger.unaccounted) <= BEARABLE * fall

    @property
    def excused(self) -> bool:
        """Whether the step touches nothing after all, or solids leave cloth no room: no solve accounts for its motion then."""
        return False

    @property
    def exacting(self) -> bool:
        """Whether cloth is beyond a limit, may tear, or gas works on it: then the residuals of solves count."""
        return self.start.used > 1 or self.system.fragile

    @staticmethod
    def doubt(measures: Measures, ledger: Ledger) -> float:
        """Part of all that a step's energy went through that is unaccounted for."""
        through = sum(abs(value) for value in asdict(ledger).values()) + STILL * measures.size
        return abs(ledger.unaccounted) / max(through, 1e-300)

    def fallback_to(self, ended: tuple[Measures, Ledger]) -> Callable[[], Outcome]:
        """Saves the present state and its reactions; the function returned restores them and accepts the step there."""
        system = self.system
        particles, rows = system.model.read_particles(), system.reaction_rows()
        tension = None if system.model.sewn is None else system.tension()

        def back() -> Outcome:
            system.model.write_particles(*particles)
            system.keep_reaction(rows, tension)
            return self.finish(*ended)

        return back

    def finish(self, measures: Measures, ledger: Ledger) -> Outcome:
        """Outcome of a step that took more than (18). The next step asks for powers at its end."""
        return Outcome(None, "", self.at_end(measures), ledger)

    def at_end(self, measures: Measures) -> Measures:
        """Measures of the step with powers by velocities at its end."""
        if self.over == 0:
            return measures
        now = self.system.meter.measure()
        return replace(measures, dissipation=now.dissipation, damped=now.damped, rate=now.rate)

    def give_up(self, measures: Measures) -> Outcome:
        """See `StepProblem`."""
        if self.fallback is not None:
            return self.fallback()
        name = NEWTON if self.effort is not None and not self.settled else ENERGY
        return Outcome(name, f"{len(self.solutions)} solves", measures)


class EulerPolicy:
    """The problems of a step: here one `EulerStep`, by the single solve (18) and up to `newton_max` more."""

    step = EulerStep

    def __init__(self, system: System, energy: EnergyTest, effort: NewtonTolerance | None) -> None:
        self.system, self.energy, self.effort = system, energy, effort

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """A step from the saved state; its solves are added to `solutions`."""
        problem = self.step(self.system, self.energy, self.effort, h, pins, start, clock, solutions)
        return minimize(problem, 1 + self.system.options.newton_max)
