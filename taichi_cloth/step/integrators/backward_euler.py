"""Backward Euler: the paper's single linear solve (18), and more of them where the first does not hold.

The solve is one Newton step, from rest at x_0, on the incremental potential
    Phi(v) = 1/2 (v - v_0)^T M (v - v_0) + E(x_0 + h v + y) + h R(v),
R half the dissipated power. With a positive semidefinite K it goes downhill, and the step is accepted as it is
if its energy, kinetic and potential, has not grown but by the work put in (`ledger`): the paper's cheap case. Where it
has, the step is shortened and Newton goes on from there, until a full Newton step is taken and the energy is right. With
`converge` it always goes on, until a Newton step moves the cloth by less than `newton_tol`: nonlinear backward Euler.
Phi does not bound kinetic energy, and where E is not convex even the answer may gain some: what is over in the end, or
is so little that no further solve is worth it, is taken off the velocities (`brake`).

Differs from [BW98]: the test and what follows it; the paper accepts every solve.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np
import taichi as ti

from ...backend.timing import Clock
from ...options import CG_TOL, NEWTON_TOL, Options
from ...solver.pcg import CONVERGED, Solution
from ...system.assembler import Measures
from ...system.constraints import Held
from ..ledger import Ledger, Work, gained, one_stage
from .attempt import APPROACH, CONTACT, ENERGY, NEWTON, NOT_FINITE, SOLVER, Attempt
from .brake import MOST, Brake
from .system import System, phi

HALVINGS = 10
LIGHT = 0.01  # part of the velocity of deformation that is taken off rather than solved again
PINCHED = 0.1  # part of all works by which these may be off in steps too small to be tried smaller
PRESSED = 1e-3  # part of the energy of pressed layers by which that may be off there


@ti.data_oriented
class BackwardEuler:
    """[BW98 §3.1, §6] on a model."""

    stable_step = math.inf

    def __init__(self, system: System, options: Options, converge: bool = False) -> None:
        self.system, self.options, self.converge = system, options, converge
        self.model, self.meter, self.contacts = system.model, system.meter, system.contacts
        self.operator, self.solver = system.operator, system.solver
        self.cg_tol, self.brake = options.cg_tol or CG_TOL, Brake(self.model, system.scene)
        self.layered = None
        if self.contacts is not None and self.contacts.layers is not None:
            from .layered import Layered
            from .sprung import Sprung

            self.layered = (Sprung if self.contacts.sprung else Layered)(self)

    def reset(self) -> None:
        """The state was changed by hand: nothing is remembered."""

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        c = self.contacts
        held = held_at(h)
        made = self.solve_once(h, held, start) if self.layered is None else self.layered.attempt(h, held, start)
        return made if c is None else replace(made, contacts=c.count, unsettled=c.unsettled + made.unsettled,
                                              crossings=c.crossings, pinched=c.pinched + made.pinched)

    def solve_once(self, h: float, held: Held | None, start: Measures) -> Attempt:
        """A step without regard to cloth that meets cloth: one solve, more for contact with solids or for its energy."""
        clock = Clock()
        solutions: list[Solution] = []
        if self.contacts is None:
            self._linear(h, held, clock, solutions)
            rejection = None
        else:
            held, rejection = self._in_contact(h, held, clock, solutions)
        with clock.part("EVAL"):
            measures = self.meter.measure()
        if solutions and solutions[-1].status != CONVERGED:
            return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
        if not measures.finite:
            return Attempt(NOT_FINITE, "after the first solve", measures, tuple(solutions), clock.seconds)
        if rejection:
            return Attempt(*rejection, measures, tuple(solutions), clock.seconds)
        if not self.converge:
            with clock.part("EVAL"):
                ended = self.conclude(h, held, start, measures, LIGHT)
            if ended is not None:
                return Attempt(None, "", ended[0], tuple(solutions), clock.seconds, ledger=ended[1])
        return self._newton(h, held, start, measures, clock, solutions)

    def conclude(self, h: float, held: Held | None, start: Measures, measures: Measures, most: float,
                 stiffened: float | None = None) -> tuple[Measures, Ledger] | None:
        """(measures, ledger) of the step as it is, if its energy has not grown beyond work and rounding, or after what it has
        grown by was taken off velocities; None where that is too much.

        Args:
            most: part of the velocities that may be taken off.
            stiffened: energy [J] that layers of cloth may have been given; None: what they were.
        """
        work = self.work(h, held, start, measures)
        ledger = one_stage(h, start, measures, work)
        if stiffened is not None:
            work = replace(work, layers=min(work.layers, stiffened))
        over = gained(start, measures, work) - max(0.0, ledger.wind) - self.system.rounding(h, start, measures)
        if self.contacts is not None and self.contacts.small:  # nothing smaller does better where cloth is pinched: how it is
            # moved out need not be paid for, and works are off by as much as forces may be
            over += min(work.lifted, 0.0) - PINCHED * sum(abs(value) for value in asdict(work).values())
            over -= PRESSED * measures.energies.get("contact", 0.0)
        if not over > 0:
            return measures, ledger
        if not (math.isfinite(over) and self.brake.take(over, held, most)):
            return None
        slower = replace(self.meter.measure(), stretch_change=measures.stretch_change)
        energies = {**measures.energies, **slower.energies}
        lost = measures.energies["kinetic"] - slower.energies["kinetic"]
        return (replace(slower, energies=energies),
                replace(ledger, kinetic=ledger.kinetic - lost, method=ledger.method + lost, braked=lost))

    def work(self, h: float, held: Held | None, start: Measures, measures: Measures) -> Work:
        """What was put in by what holds, touches and alters positions, as the last solve took it."""
        by_pins = by_solids = lifted = lowered = friction = edges = layers = 0.0
        if held is not None and held.moving and len(held.index):
            reaction = self.system.reaction_rows()  # J
            v, dv, y = self.system.motion_rows(held, h)
            power = np.einsum("ki,ki->k", reaction, v)
            solids = up = np.zeros(len(power), dtype=bool)
            if self.contacts is not None:
                solids, up = self.contacts.rows_held(len(power))
            by_pins, by_solids = float(power[~solids].sum()), float(power[solids].sum())
            altered = np.einsum("ki,ki->k", reaction - self.model.mass[held.index][:, None] * dv, y) / h
            lifted, lowered = float(altered[up].sum()), float(altered[~up].sum())
        if self.contacts is not None:
            if self.contacts.small:  # what no smaller step can do better is let be
                lifted, lowered = lifted + lowered, 0.0
            friction, edges, layers = self.contacts.works()
            layers += measures.energies.get("contact", 0.0) - start.energies.get("contact", 0.0)
        return Work(by_pins, by_solids + edges, lifted, lowered, friction, layers)

    def commit(self) -> None:
        """The last attempt was accepted."""
        if self.contacts is not None:
            self.contacts.commit()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """The last change of velocity, from which contacts predict the next."""
        return {"dv": self.solver.dv.to_numpy()}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave."""
        self.solver.dv.from_numpy(state["dv"])

    def _linear(self, h: float, held: Held | None, clock: Clock, solutions: list[Solution], warm: bool = False) -> None:
        """One solve from the saved state; the model ends in what it says."""
        with clock.part("EVAL"):
            self.operator.set_motion(h)
            if self.contacts is not None and held is not None:
                self.operator.alter_motion(held.index, held.y)
            self.system.linearize(h, moves=True)
        with clock.part("CG"):
            solutions.append(self.system.solve(self.cg_tol, held, h, warm=warm, lasting=True))
        with clock.part("EVAL"):
            self.place(h, 1.0)
            self.system.settle(held)

    def _in_contact(self, h: float, pins: Held | None, clock: Clock,
                    solutions: list[Solution]) -> tuple[Held | None, tuple[str, str] | None]:
        """Solves until the states of all contacts agree with the answer: (what was held, what is wrong)."""
        contacts = self.contacts
        with clock.part("C-S"):
            self.predict(h, pins)
        while True:
            with clock.part("C-S"):
                held, closing = contacts.hold()
                self.model.restore()
            if contacts.crowded:
                return held, (CONTACT, f"more than {contacts.force.capacity} points of contact")
            if closing > contacts.reach:
                return held, (APPROACH, f"{closing:.3g} m in one step")
            self._linear(h, held, clock, solutions, warm=len(solutions) > 0)
            if solutions[-1].status != CONVERGED:
                return held, None
            with clock.part("C-S"):
                verdict = contacts.judge(self.system.reaction_rows())
            if verdict.changes and contacts.round < contacts.ROUNDS:
                continue
            if verdict.changes and verdict.bad and contacts.may_shrink():
                return held, (CONTACT, f"{verdict.deepest:.2g} thicknesses inside")
            with clock.part("C-S"):
                return held, (CONTACT, f"{contacts.crossings} crossings") if contacts.went_through() else None

    def predict(self, h: float, pins: Held | None) -> None:
        """The model goes where the last step's change of velocity would lead it, and contacts are looked for on the way."""
        x, v = self.model.read_particles()
        self.operator.set_motion(h)
        if not self.contacts.warm:
            self._fall(h, *self.contacts.gravity)
        self.place(h, 1.0)
        self.system.settle(pins)
        self.contacts.begin(h, pins, x, v)

    def _newton(self, h: float, held: Held | None, start: Measures, measures: Measures, clock: Clock,
                solutions: list[Solution]) -> Attempt:
        """Goes on from a first solve that gained energy."""
        with clock.part("EVAL"):
            alpha, limit = 1.0, start.total + self.system.rounding(h, start, measures)  # Phi of standing still
            if held is None or not held.moving:  # else a shorter first step would leave the constraints behind
                while phi(measures, h) > limit and alpha > 0.5**HALVINGS:
                    alpha /= 2
                    self.place(h, alpha)
                    measures = self.meter.measure()
        settled = False
        for _ in range(self.options.newton_max):
            with clock.part("EVAL"):
                if self.contacts is not None:
                    self.contacts.rebase()
                self.system.linearize(h)
            with clock.part("CG"):
                solutions.append(self.system.solve(self.cg_tol, held, lasting=True))
            if solutions[-1].status != CONVERGED:
                return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
            with clock.part("EVAL"):
                before, alpha, taken = phi(measures, h), 1.0, 0.0
                while alpha > 0.5**HALVINGS:
                    self.shift(h, alpha - taken)
                    taken = alpha
                    measures = self.meter.measure()
                    if phi(measures, h) <= before + self.system.rounding(h, measures):
                        break
                    alpha /= 2
            if alpha < 1 or not measures.finite:
                continue
            settled = True
            if self.converge:
                with clock.part("EVAL"):
                    settled = h * self.system.rms_change() <= (self.options.newton_tol or NEWTON_TOL)
            if settled or len(solutions) > self.options.newton_max:
                with clock.part("EVAL"):
                    self.system.settle(held)
                    last = self.converge or len(solutions) > self.options.newton_max
                    ended = self.conclude(h, held, start, measures, MOST if last else LIGHT) if settled else None
                if ended is not None:
                    if self.contacts is not None:
                        self.contacts.record_forces(self.system.reaction_rows())
                    if self.contacts is not None and self.contacts.went_in():
                        return Attempt(CONTACT, "after further solves", measures, tuple(solutions), clock.seconds)
                    return Attempt(None, "", ended[0], tuple(solutions), clock.seconds, ledger=ended[1])
        reason = NOT_FINITE if not measures.finite else NEWTON if self.converge and not settled else ENERGY
        return Attempt(reason, f"{len(solutions)} solves", measures, tuple(solutions), clock.seconds)

    @ti.kernel
    def place(self, h: float, alpha: float):
        """v = alpha (v_0 + dv), x = x_0 + alpha (h v_0 + y + h dv)"""
        for i in range(self.model.n):
            self.model.v[i] = alpha * (self.model.v_saved[i] + self.solver.dv[i])
            self.model.x[i] = self.model.x_saved[i] + alpha * (self.operator.motion[i] + h * self.solver.dv[i])

    @ti.kernel
    def _fall(self, h: float, x: float, y: float, z: float):
        """dv = h g"""
        for i in range(self.model.n):
            self.solver.dv[i] = h * ti.Vector([x, y, z])

    @ti.kernel
    def shift(self, h: float, alpha: float):
        """v += alpha dv, x += alpha h dv"""
        for i in range(self.model.n):
            self.model.v[i] += alpha * self.solver.dv[i]
            self.model.x[i] += alpha * h * self.solver.dv[i]
