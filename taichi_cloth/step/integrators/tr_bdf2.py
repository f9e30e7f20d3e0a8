"""TR-BDF2 with implied stage force: second order, L-stable, two Newton solves a step.

With c = (1 - 1/sqrt 2) h and g = 2 - sqrt 2, the first stage goes to t + g h by the trapezoidal rule, the second to
t + h by BDF2:

    M (v_g - v_0) = c (F_0 + f(x_g, v_g)),  x_g = x_0 + c (v_0 + v_g)
    M (v_1 - v_p) = c f(x_1, v_1),          x_1 = x_p + c v_1,   (x_p, v_p) = a (x_g, v_g) - b (x_0, v_0)

F_0 is the force that the last stage of the step before implies, M (v_1 - v_p) / c, and not f(x_0, v_0). An evaluated force
would have an error at high frequencies: Newton's tolerance, times their stiffness. Both stages have the matrix
M - c D - c^2 K. The embedded error estimate is that of the third-order formula on the same stages, filtered by the
same matrix [Hosea & Shampine 1996].

A step that gains energy beyond the work put in (`ledger`) is rejected by name, but for a hundredth of the motion's: a
method of second order loses and gains in turn. Energy gained before and not lost again counts.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.sums import Sums
from ...backend.timing import Clock
from ...options import Options
from ...solver.pcg import CONVERGED, Solution
from ...system.assembler import Measures
from ...system.checkpoint import Checkpointed
from ...system.constraints import project
from ...system.held import Held
from ..attempt import ACCURACY, ENERGY, NEWTON, SOLVER, Attempt
from ..ledger import Work, gained, three_stages, with_attachments
from ..nonlinear.history import DEBT, FALL, GAIN, LAPSE
from ..nonlinear.linear_system import ROUNDING, System
from ..nonlinear.newton import (
    CALM,
    FIRST,
    HALVINGS,
    OTHERS,
    PART,
    ConvergenceRate,
    NewtonTolerance,
    Outcome,
    StepProblem,
    minimize,
)
from ..prescribed import ExplicitTimeWork

C = 1 - math.sqrt(0.5)
GAMMA = 2 - math.sqrt(2)
A = (math.sqrt(2) + 1) / 2
E_0, E_GAMMA, E_1 = (math.sqrt(2) - 1) / 3, -1 / 3, 2 * C / 3  # weights less those of the third-order formula
WEIGHT = math.sqrt(2) / 4  # of the beginning and of the first stage in a step; C is the end's
WORK = 0.05  # part of the constraints' work in a step by which the quadrature may be off
SHARE = 0.1  # of the error allowed in a step that Newton's method may leave
HORIZON = 0.5  # s: time in which a run may gather the error asked for
LEFT = 0.01  # part of the motion's energy that residuals of solves may put into a step, or take from it
CLOSER, FURTHER = 0.01, 0.1  # beyond that: factors of residuals of solves, and of the change that Newton's method may leave
FILTER = 0.01  # relative residual of the solve that filters the error estimate

NO_PINS: tuple[np.ndarray, ...] = np.zeros(0, dtype=np.int32), np.zeros((0, 3, 3)), np.zeros((0, 3))


class Stage(StepProblem):
    """A stage, M (v - v_base) = c f(x_base + c v, v): from a guess in the model, with its v_base set, to its v and x.

    Args:
        held: at the end of the stage; those directions are led there in the first iteration.
        fresh: whether the preconditioner is made anew in the first of them.
    """

    def __init__(self, system: System, c: float, held: Held | None, effort: NewtonTolerance, fresh: bool, clock: Clock,
                 solutions: list[Solution]) -> None:
        super().__init__(system, c, held, Measures({}, 0.0, 0.0, 0.0, 0.0, True), clock, solutions)
        self.effort, self.fresh = effort, fresh
        self.linearized = False  # where the model is
        self.changes = ConvergenceRate()
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


@ti.data_oriented
class TRBDF2(Checkpointed):
    """TR-BDF2 on a system."""

    stable_step = math.inf
    STATE = ("a_0", "v_p", "c", "power", "accumulated_gain", "motion", "known", "pins")

    def __init__(self, fields: Fields, system: System, options: Options, gravity: np.ndarray) -> None:
        self.system, self.options, self.model, self.time_work = system, options, system.model, ExplicitTimeWork(system.meter)
        n, self.blocks = self.model.n, self.model.blocks
        self.sums = Sums(fields, self.blocks.pieces, 1, not self.blocks.serial, dtype=system.solver.sum_type)
        self.a_0, self.v_g, self.a_g, self.v_p = (fields.real(n, 3) for _ in range(4))  # a_0 = F_0/M
        self.known = False  # whether a_0 is, or follows from the last step
        self.c = 0.0  # of the last step [s], while a_0 is still to be taken from it: (v_1 - v_p)/c
        self.tried = 0.0  # of the last attempt
        self.rate: float | None = None  # at which energies grow at the saved state [W], where a_0 is taken there
        self.pins = NO_PINS  # particles and projectors, and soft attachments
        self.power = 0.0  # of the constraints [W] at the end of the last step
        self.power_1 = 0.0
        self.accumulated_gain = self.accumulated_gain_1 = 0.0  # [J] gained by steps and not lost again; after the attempt
        self.motion = self.motion_1 = 0.0  # largest kinetic energy [J] of late; after the attempt
        self.stiffens_sharply = any(force.stiffens_sharply for force in system.meter.forces)
        self.weight = float(np.linalg.norm(gravity) * self.model.mass.sum())  # [N]

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package. If residuals of its solves put energy in or take it, the solves are done again, more
        exactly. If stiffness grows sharply only energy taken counts, and Newton's method goes no further."""
        effort = self._effort(h)
        made = self._attempt(h, held_at, start, effort)
        ledger, measures = made.ledger, made.measures
        if ledger is None or measures is None or made.rejection not in (None, ENERGY) or self.options.cg_tol is not None:
            return made
        spare = WORK * (abs(ledger.pins) + abs(ledger.wind)) + self.system.rounding(h, start, measures)
        gains = not self.stiffens_sharply and ledger.unaccounted > LEFT * self._energy_scale(h) + spare
        if not (gains or (made.rejection is None and -ledger.unaccounted > LEFT * self.motion_1 + spare)):
            return made
        self.model.restore()
        part = effort.part if self.stiffens_sharply else FURTHER * effort.part
        closer = replace(effort, first=CLOSER * effort.first, others=CLOSER * effort.others, part=part)
        return self._attempt(h, held_at, start, closer).instead_of(made, "")

    def _attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures, effort: NewtonTolerance) -> Attempt:
        """The same with solves of so much effort."""
        clock, c, system = Clock(), C * h, self.system
        solutions: list[Solution] = []
        with clock.part("EVAL"):
            pumped = self.time_work.around(held_at, h, start)
        pins = held_at(0.0)
        fresh = self._remember(pins, c, clock)
        if self.rate is not None:
            start = replace(start, rate=self.rate)  # attachments may have changed
        middle = held_at(GAMMA * h)
        with clock.part("EVAL"):
            self.model.moved()
            self._base(0, c, self.c, int(fresh))
            self.c, self.tried = 0.0, c
        first = minimize(Stage(system, c, middle, effort, True, clock, solutions), max(self.options.newton_max, 1))
        if first.rejection:
            return replace(self._failed(first, "first stage", solutions, clock), measures=None)  # not at the step's end
        power, extra = self._reaction_power(middle, c, pins, GAMMA * h)
        with clock.part("EVAL"):
            self.model.moved()
            self._base(1, c, 0.0, 0)
        held = held_at(h)
        stage = minimize(Stage(system, c, held, effort, False, clock, solutions), max(self.options.newton_max, 1))
        if stage.rejection:
            return self._failed(stage, "second stage", solutions, clock)
        with clock.part("EVAL"):
            power_1, extra_1 = self._reaction_power(held, c, pins, h)
            self.power_1 = power_1 + extra_1
            weights = (WEIGHT * h, WEIGHT * h, c)
            before = 0.0 if self.rate is not None else self.power  # as a_0 implies; with f(x_0, v_0)/M nothing holds
            start, led = self.system.meter.led(start, 0.5)
            work = Work(pins=sum(w * p for w, p in zip(weights, (before, power, power_1))),
                        gas=self.time_work.mean(held_at, h, stage.measures, pumped))
            lag = h * self._lag(c) - weights[1] * extra - weights[2] * extra_1
            ledger = three_stages(weights, (start, first.measures, stage.measures), work, lag)
            self.system.settle(held)
        measures = stage.measures
        ledger = with_attachments(ledger, led)
        over = gained(start, measures, work) - max(0.0, ledger.wind)
        self.accumulated_gain_1 = max(0.0, self.accumulated_gain + over)
        scale, rounding = self._scale(h, start, measures), self.system.rounding(h, start, measures)
        spare = WORK * (abs(work.pins) + abs(led) + abs(ledger.wind)) + rounding
        if over > GAIN * scale + spare or (over > rounding and self.accumulated_gain_1 > DEBT * scale + spare):
            return Attempt(ENERGY, f"{over:.2g} J gained", measures, tuple(solutions), clock.seconds, ledger=ledger)
        error = None
        if self.options.tolerance is not None:
            error = self._error(h, held, clock, solutions) * HORIZON / (h * self.options.tolerance)
            if solutions[-1].status != CONVERGED:
                return Attempt(SOLVER, f"error estimate: {solutions[-1].status}", measures, tuple(solutions), clock.seconds)
            if error > 1:
                return Attempt(ACCURACY, f"{error:.3g} times the error allowed", measures, tuple(solutions), clock.seconds,
                               error=error, order=2)
        return Attempt(None, "", measures, tuple(solutions), clock.seconds, error=error, order=2, ledger=ledger)

    def commit(self, taken: float = 0.0) -> None:
        """The last attempt was accepted; forces with memory took the energy `taken` [J] after it."""
        self.known, self.power, self.c, self.motion, self.rate = True, self.power_1, self.tried, self.motion_1, None
        self.accumulated_gain = max(0.0, self.accumulated_gain_1 - taken)

    def reset(self, accumulated_gain: float = 0.0) -> None:
        """The state was changed by hand, or by another method that gained energy [J]."""
        self.known, self.power, self.c, self.motion, self.rate = False, 0.0, 0.0, 0.0, None
        self.accumulated_gain = accumulated_gain

    def loosen(self) -> None:
        """Seams have opened in the model's state: forces of the last step are invalid."""
        self.known = False
        self.system.loosen()

    def _scale(self, h: float, start: Measures, end: Measures) -> float:
        """Energy [J] to which gains of an attempt are compared: kinetic energy, its largest of late, and gravity's work at
        the speed FALL."""
        self.motion_1 = max(start.energies["kinetic"], end.energies["kinetic"], self.motion * math.exp(-h / LAPSE))
        return self._energy_scale(h)

    def _energy_scale(self, h: float) -> float:
        """The same with the kinetic energy that `_scale` found last."""
        return self.motion_1 + self.weight * FALL * h

    def _effort(self, h: float) -> NewtonTolerance:
        """Tolerances of a stage: no digit beyond those that the step or the tolerance asked for needs."""
        options = self.options
        moved, part, cg_tol = options.newton_tol, 0.0, options.cg_tol
        if options.tolerance is not None:
            moved = min(moved or math.inf, SHARE * options.tolerance * h / HORIZON)
            cg_tol = cg_tol or FIRST
        elif moved is None:
            moved, part = CALM * C * h, PART
        return NewtonTolerance(moved, part, cg_tol or FIRST, cg_tol or OTHERS)

    def _remember(self, held: Held | None, c: float, clock: Clock) -> bool:
        """Whether a_0 is f(x_0, v_0)/M, now in b, where no step implies it: at the start, and when pins have come or gone."""
        pins = (*(NO_PINS[:2] if held is None else (held.index, held.projector)), self.system.meter.attached)
        same = all(np.array_equal(p, q) for p, q in zip(pins, self.pins))
        if self.known and same:
            return False
        self.pins = pins
        with clock.part("EVAL"):
            self.rate = self.system.linearize(c).rate
        self.known, self.c = True, 0.0
        return True

    def _failed(self, stage: Outcome, which: str, solutions: list[Solution], clock: Clock) -> Attempt:
        return Attempt(stage.rejection, f"{which}: {stage.detail}", stage.measures, tuple(solutions), clock.seconds)

    def _reaction_power(self, held: Held | None, c: float, before: Held | None, t: float) -> tuple[float, float]:
        """(power [W] of the constraints at the end of a stage, t [s] after the step's start; its excess by the stage's
        velocities). A moving particle that begins to be held is thrown back in the first stage. A constraint's own
        velocity is that of its targets, `before` at the start."""
        if held is None or not (held.moving or self.rate is not None):
            return 0.0, 0.0
        v, R = self.model.read_particles()[1][held.index], self.system.reaction_rows()
        power = float(np.sum(R * v)) / c
        if self.rate is None or before is None or not np.array_equal(before.index, held.index):
            return power, 0.0
        led = float(np.sum(R * (held.target - before.target))) / (c * t)
        return led, power - led

    def _error(self, h: float, held: Held | None, clock: Clock, solutions: list[Solution]) -> float:
        """RMS of the step's estimated error of positions [m]."""
        c, reaction = C * h, self.system.reaction_rows()
        tension = None if self.model.sewn is None else self.system.tension()
        with clock.part("EVAL"):
            self._estimate(h)
            if held is not None:
                self._know(held.index, held.projector)
            self.system.linearize(c, moves=True)
        with clock.part("CG"):
            z = None if held is None else np.zeros_like(held.target)
            solutions.append(self.system.solve(FILTER, held, z=z, fresh=False))
        self.system.keep_reaction(reaction, tension)
        return float(np.sqrt(self._error_square(c) / self.model.n))

    @ti.kernel
    def _base(self, stage: int, c: float, before: float, fresh: int):
        """Base and guess of a stage.

        The first one's guess is v_0. With `before`, c of the last step, a_0 is the one that it implies; a fresh one is
        b / (c m), linearized at the saved state. The second one's guess goes on as the first stage went.
        """
        for i in range(self.model.rows()):
            x_0, v_0, v_g = self.model.x_saved[i], self.model.v_saved[i], self.model.v[i]
            v_base, x_base, guess = v_0, x_0 + c * v_0, v_0
            if stage == 0:
                if before > 0:
                    self.a_0[i] = (v_0 - self.v_p[i]) / before
                if fresh == 1:
                    self.a_0[i] = self.system.operator.b[i] / (c * self.model.m[i])
                v_base += c * self.a_0[i]
            else:
                self.v_g[i] = v_g
                self.a_g[i] = (v_g - v_0) / c - self.a_0[i]
                v_base += ti.static(A) * (v_g - v_0)  # as differences, which lose no digits
                self.v_p[i] = v_base
                x_base, guess = x_0 + ti.static(A) * (self.model.x[i] - x_0), v_0 + (v_g - v_0) / ti.static(GAMMA)
            self.model.v_base[i] = v_base
            self.model.v[i] = guess
            self.model.x[i] = x_base + c * guess

    @ti.kernel
    def _lag(self, c: float) -> float:
        """sum_i w_i/h F_i . (v_i - u), u = (v_0 + v_1)/2: power [W] lost by the method's velocities, see `ledger`."""
        ti.loop_config(serialize=self.blocks.serial)
        for piece in range(self.blocks.pieces):
            total = ti.cast(0, self.sums.dtype)
            for i in range(self.blocks.first(piece), self.blocks.first(piece + 1)):
                v_0, v_1 = self.model.v_saved[i], self.model.v[i]
                u, a_1 = 0.5 * (v_0 + v_1), (v_1 - self.v_p[i]) / c
                total += self.model.m[i] * (ti.static(WEIGHT) * (self.a_0[i].dot(v_0 - u) + self.a_g[i].dot(self.v_g[i] - u))
                                            + ti.static(C) * a_1.dot(v_1 - u))
            self.sums.of_piece[piece] = total
        self.sums.finish(1)
        return self.sums.all[0]

    @ti.kernel
    def _estimate(self, h: float):
        """motion and v_base such that b is the right-hand side of the filtered error estimate."""
        for i in range(self.model.rows()):
            e_x = h * (ti.static(E_0) * self.model.v_saved[i] + ti.static(E_GAMMA) * self.v_g[i]
                       + ti.static(E_1) * self.model.v[i])
            a_1 = (self.model.v[i] - self.v_p[i]) / (ti.static(C) * h)
            e_v = h * (ti.static(E_0) * self.a_0[i] + ti.static(E_GAMMA) * self.a_g[i] + ti.static(E_1) * a_1)
            self.system.operator.rhs_displacement[i] = e_x
            self.model.v_base[i] = self.v_p[i] + e_v

    @ti.kernel
    def _know(self, index: ti.types.ndarray(), projector: ti.types.ndarray()):
        """Held directions have no error, also where they begin to move at a speed."""
        for k in range(index.shape[0]):
            i = index[k]
            self.system.operator.rhs_displacement[i] -= project(projector, k, self.system.operator.rhs_displacement[i])

    @ti.kernel
    def _error_square(self, c: float) -> float:
        """|e_x + c dv|^2"""
        ti.loop_config(serialize=self.blocks.serial)
        for piece in range(self.blocks.pieces):
            total = ti.cast(0, self.sums.dtype)
            for i in range(self.blocks.first(piece), self.blocks.first(piece + 1)):
                total += (self.system.operator.rhs_displacement[i] + c * self.system.solver.dv[i]).norm_sqr()
            self.sums.of_piece[piece] = total
        self.sums.finish(1)
        return self.sums.all[0]
