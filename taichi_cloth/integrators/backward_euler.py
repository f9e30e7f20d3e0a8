"""Backward Euler: the paper's single linear solve (18), and more of them where the first does not hold.

The solve is one Newton step, from rest at x_0, on the incremental potential
    Phi(v) = 1/2 (v - v_0)^T M (v - v_0) + E(x_0 + h v + y) + h R(v),
R half the dissipated power. With a positive semidefinite K it goes downhill, and the step is accepted as it is
if Phi has not grown: the paper's cheap case. Where it has, the step is shortened and Newton goes on from there,
until a full Newton step is taken and Phi is below where it began. With `converge` it always goes on, until a
Newton step moves the cloth by less than `newton_tol`: nonlinear backward Euler, which never gains energy.

Differs from [BW98]: the test and what follows it; the paper accepts every solve.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import taichi as ti

from ..constraints import Held
from ..measure import Measures
from ..solver.pcg import CONVERGED, Solution
from ..timing import Clock
from . import APPROACH, CG_TOL, CONTACT, ENERGY, NEWTON, NOT_FINITE, SOLVER, Attempt, Options
from .system import System, phi

HALVINGS = 10
SLACK = 0.01  # of kinetic energy by which a step in which layers meet may be off
SMOOTH = 1e-3  # part of the repulsion's energy that is not worth a shorter way
MEMORY = 3  # of the last potentials one must not be passed
NEARLY = 1e-7  # m that a held direction may be off its target
TIMID = 0.2  # part of a solve's way below which it is not taken shorter for their sake
BOLD = 4  # solves of a step with layers before the potential has a say in how far they go


@ti.data_oriented
class BackwardEuler:
    """[BW98 §3.1, §6] on a model."""

    stable_step = math.inf

    def __init__(self, system: System, options: Options, converge: bool = False) -> None:
        self.system, self.options, self.converge = system, options, converge
        self.model, self.meter, self.contacts = system.model, system.meter, system.contacts
        self.layers = self.contacts.layers if self.contacts is not None else None
        self.operator, self.solver = system.operator, system.solver
        self.cg_tol = options.cg_tol or CG_TOL

    def reset(self) -> None:
        """The state was changed by hand: nothing is remembered."""

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        c, layers = self.contacts, self.layers
        if layers is None:
            made = self._attempt(h, held_at(h), start)
        else:
            before = layers.seconds
            made = self._layered(h, held_at(h), start)
            spent = layers.seconds - before
            made = replace(made, layers=layers.count, least=layers.least, tangled=layers.tangles.count,
                           pinched=layers.tangles.pinched, seconds={
                **made.seconds, "C-C": spent, "C-S": max(made.seconds.get("C-S", 0.0) - spent, 0.0)})
        return made if c is None else replace(made, contacts=c.count, unsettled=c.unsettled, crossings=c.crossings)

    def _attempt(self, h: float, held: Held | None, start: Measures) -> Attempt:
        clock = Clock()
        solutions: list[Solution] = []
        if self.contacts is None:
            self._linear(h, held, clock, solutions)
            rejection = None
        else:
            held, rejection = self._in_contact(h, held, clock, solutions)
        with clock.part("EVAL"):
            measures = self.meter.measure()
            # work of the constraints that move, which the energy may grow by
            work = self._reaction_power(h) if held is not None and held.moving else 0.0
            work += self.contacts.work() if self.contacts is not None and solutions else 0.0
        if solutions and solutions[-1].status != CONVERGED:
            return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
        if not measures.finite:
            return Attempt(NOT_FINITE, "after the first solve", measures, tuple(solutions), clock.seconds)
        if rejection:
            return Attempt(*rejection, measures, tuple(solutions), clock.seconds)
        limit = start.energies["kinetic"] + start.potential + work + self.system.rounding(h, start, measures)
        if phi(measures, h) <= limit and not self.converge:
            return Attempt(None, "", measures, tuple(solutions), clock.seconds)
        return self._newton(h, held, limit, measures, clock, solutions)

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
            self.system.linearize(h)
        with clock.part("CG"):
            solutions.append(self.system.solve(self.cg_tol, held, h, warm=warm))
        with clock.part("EVAL"):
            self._place(h, 1.0)
            self.system.settle(held)

    def _in_contact(self, h: float, pins: Held | None, clock: Clock,
                    solutions: list[Solution]) -> tuple[Held | None, tuple[str, str] | None]:
        """Solves until the states of all contacts agree with the answer: (what was held, what is wrong)."""
        contacts = self.contacts
        with clock.part("C-S"):
            self._predict(h, pins)
        while True:
            with clock.part("C-S"):
                held, closing = contacts.hold()
                self.model.restore()
            if contacts.crowded:
                return held, (CONTACT, f"more than {contacts.touch.capacity} points of contact")
            if closing > contacts.reach:
                return held, (APPROACH, f"{closing:.3g} m in one step")
            self._linear(h, held, clock, solutions, warm=len(solutions) > 0)
            if solutions[-1].status != CONVERGED:
                return held, None
            with clock.part("C-S"):
                verdict = contacts.judge(self.system.reaction_rows())
            if verdict.changes and contacts.round < contacts.ROUNDS:
                continue
            if verdict.changes and verdict.bad and contacts.may_shrink:
                return held, (CONTACT, f"{verdict.deepest:.2g} thicknesses inside")
            with clock.part("C-S"):
                return held, (CONTACT, f"{contacts.crossings} crossings") if contacts.went_through() else None

    def _predict(self, h: float, pins: Held | None) -> None:
        """The model goes where the last step's change of velocity would lead it, and contacts are looked for on the way."""
        x, v = self.model.read_particles()
        self.operator.set_motion(h)
        if not self.contacts.warm:
            self._fall(h, *self.contacts.gravity)
        self._place(h, 1.0)
        self.system.settle(pins)
        self.contacts.begin(h, pins, x, v)

    def _layered(self, h: float, pins: Held | None, start: Measures) -> Attempt:
        """A step in which cloth may meet cloth: solves from where the last one could lead to, until contacts agree.

        The first is (18); each goes as far as nothing passes through anything. After a few, they go only so far that the
        incremental potential falls, that of repulsion and friction included.
        """
        clock, contacts, layers = Clock(), self.contacts, self.layers
        solutions: list[Solution] = []
        with clock.part("C-S"):
            self._predict(h, pins)
            self.model.restore()
        part, limit, seen = 1.0, math.inf, []
        begins = start.energies["kinetic"] + start.potential - start.energies.get("contact", 0.0) + layers.energy
        measures = start
        for k in range(layers.ROUNDS):
            with clock.part("C-S"):
                held, closing = contacts.hold()
                layers.detector.arrive()
                if k:
                    contacts.rebase()
                else:
                    contacts.set_touch()
            if contacts.crowded:
                return Attempt(CONTACT, f"more than {contacts.touch.capacity} points of contact", measures, tuple(solutions),
                               clock.seconds)
            if closing > contacts.reach:
                return Attempt(APPROACH, f"{closing:.3g} m in one step", measures, tuple(solutions), clock.seconds)
            with clock.part("EVAL"):
                self.operator.set_motion(0.0 if k else h)
                if not k and held is not None:
                    self.operator.alter_motion(held.index, held.y)
                self.system.linearize(h)
            with clock.part("CG"):
                z = self.system.to_go(held, h) if k else None
                leads = k == 0 or self._leads(held, z, h)
                solutions.append(self.system.solve(self.cg_tol, held, h, z=z))
            if solutions[-1].status != CONVERGED:
                return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
            seen.append(phi(measures, h) + contacts.lagged(h) if k else math.inf)
            with clock.part("EVAL"):
                self._shift(h, 1.0) if k else self._place(h, 1.0)
                self.system.settle(held)
            with clock.part("C-S"):
                verdict = contacts.judge(self.system.reaction_rows())
                part = layers.advance()
            taken = 1.0
            while True:
                with clock.part("EVAL"):
                    if part < taken:
                        self._shift(h, part - taken) if k else self._place(h, part)
                        taken = part
                    measures = self._measure()
                    after = phi(measures, h) + contacts.lagged(h)
                if k < BOLD or leads or after <= max(seen[-MEMORY:]) + SMOOTH * layers.energy + (
                        self.system.rounding(h, measures)) or part < TIMID:
                    break
                part /= 2
            if not measures.finite:
                return Attempt(NOT_FINITE, f"after {k + 1} solves", measures, tuple(solutions), clock.seconds)
            with clock.part("C-S"):
                agreed = part == 1 and layers.settled() and not (verdict.changes and k < contacts.ROUNDS)
            if agreed:
                work = self._reaction_power(h) if held is not None and held.moving else 0.0
                work += contacts.work()
                slack = layers.agreed * max(start.energies.get("contact", 0.0), layers.energy) + SLACK * start.energies["kinetic"]
                limit = begins + work + slack + self.system.rounding(h, start, measures)
                if phi(measures, h) <= limit:
                    break
        else:
            if part < 1 or contacts.may_shrink:
                if not contacts.may_shrink:
                    layers.let_go()
                return Attempt(CONTACT, f"layers after {len(solutions)} solves: {part:.2g} of the way free, {layers.off} pairs "
                               f"off, energy {phi(measures, h) - limit:.2g} J too high", measures, tuple(solutions), clock.seconds)
        with clock.part("C-S"):
            if verdict.changes and verdict.bad and contacts.may_shrink:
                return Attempt(CONTACT, f"{verdict.deepest:.2g} thicknesses inside", measures, tuple(solutions), clock.seconds)
            if contacts.went_through():
                return Attempt(CONTACT, f"{contacts.crossings} crossings", measures, tuple(solutions), clock.seconds)
        return Attempt(None, "", measures, tuple(solutions), clock.seconds)

    def _newton(self, h: float, held: Held | None, limit: float, measures: Measures, clock: Clock,
                solutions: list[Solution]) -> Attempt:
        """Goes on from a first solve that Phi does not accept."""
        with clock.part("EVAL"):
            alpha = 1.0
            if held is None or not held.moving:  # else a shorter first step would leave the constraints behind
                while phi(measures, h) > limit and alpha > 0.5**HALVINGS:
                    alpha /= 2
                    self._place(h, alpha)
                    measures = self.meter.measure()
        for _ in range(self.options.newton_max):
            with clock.part("EVAL"):
                self.operator.set_motion(0.0)
                if self.contacts is not None:
                    self.contacts.rebase()
                self.system.linearize(h)
            with clock.part("CG"):
                solutions.append(self.system.solve(self.cg_tol, held))
            if solutions[-1].status != CONVERGED:
                return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
            with clock.part("EVAL"):
                before, alpha, taken = phi(measures, h), 1.0, 0.0
                while alpha > 0.5**HALVINGS:
                    self._shift(h, alpha - taken)
                    taken = alpha
                    measures = self.meter.measure()
                    if phi(measures, h) <= before + self.system.rounding(h, measures):
                        break
                    alpha /= 2
            settled = phi(measures, h) <= limit or (held is not None and held.moving)
            if self.converge:
                with clock.part("EVAL"):
                    moved = h * self.system.rms_change()
                settled = settled and moved <= self.options.newton_tol
            if alpha == 1.0 and settled and measures.finite:
                self.system.settle(held)
                if self.contacts is not None and self.contacts.went_in():
                    return Attempt(CONTACT, "after further solves", measures, tuple(solutions), clock.seconds)
                return Attempt(None, "", measures, tuple(solutions), clock.seconds)
        reason = NOT_FINITE if not measures.finite else NEWTON if self.converge and phi(measures, h) <= limit else ENERGY
        return Attempt(reason, f"{len(solutions)} solves", measures, tuple(solutions), clock.seconds)

    def _leads(self, held: Held | None, z: np.ndarray | None, h: float) -> bool:
        """Whether held directions are still on their way to their targets: the potential may then have to grow."""
        if held is None or z is None or not len(z):
            return False
        return bool(np.abs(np.einsum("kij,kj->ki", held.projector, z)).max() * h > NEARLY)

    def _measure(self) -> Measures:
        """Of the state as it now is, with the repulsion of layers."""
        self.layers.look()
        measures = self.meter.measure()
        return replace(measures, energies={**measures.energies, "contact": self.layers.energy})

    @ti.kernel
    def _place(self, h: float, alpha: float):
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
    def _shift(self, h: float, alpha: float):
        """v += alpha dv, x += alpha h dv"""
        for i in range(self.model.n):
            self.model.v[i] += alpha * self.solver.dv[i]
            self.model.x[i] += alpha * h * self.solver.dv[i]

    @ti.kernel
    def _reaction_power(self, h: float) -> float:
        """J . (x - x_0)/h - M (v - v_0) . y/h [J], J = A dv - b: work of the constraints, y moved against forces."""
        total = ti.cast(0, self.solver.sum_type)
        for _ in range(1):
            for i in range(self.model.n):
                J = self.solver.As[i] - self.operator.b[i]
                way = self.model.x[i] - self.model.x_saved[i]
                y = way - h * self.model.v[i]
                total += (J.dot(way) - self.model.m[i] * (self.model.v[i] - self.model.v_saved[i]).dot(y)) / h
        return total
