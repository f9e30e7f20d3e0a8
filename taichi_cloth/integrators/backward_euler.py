"""Backward Euler: the paper's single linear solve (18), and more of them where the first does not hold.

The solve is one Newton step, from rest at x_0, on the incremental potential
    Phi(v) = 1/2 (v - v_0)^T M (v - v_0) + E(x_0 + h v + y) + h R(v),
R half the dissipated power. With a positive semidefinite K it goes downhill, and the step is accepted as it is
if Phi has not grown: the paper's cheap case. Where it has, the step is shortened and Newton goes on from there,
until a full Newton step is taken and Phi is below where it began.

Differs from [BW98]: the test and what follows it; the paper accepts every solve.
"""

import math
from dataclasses import replace

import numpy as np
import taichi as ti

from ..constraints import Filter, Held
from ..fields import Fields
from ..measure import Measures, Meter
from ..model import Model
from ..operator import Operator
from ..runtime import Runtime
from ..scene import Scene
from ..solver.pcg import CONVERGED, PCG, Solution
from ..solver.preconditioner import build_preconditioner
from ..timing import Clock
from . import APPROACH, CONTACT, ENERGY, NOT_FINITE, SOLVER, Attempt, Options

HALVINGS = 10
ROUNDING = 64  # Phi may grow by this many roundings of its terms


@ti.data_oriented
class BackwardEuler:
    """[BW98 §3.1, §6] on a model."""

    stable_step = math.inf

    def __init__(self, fields: Fields, model: Model, forces: list, meter: Meter, options: Options,
                 runtime: Runtime, scene: Scene, contacts=None) -> None:
        self.model, self.meter, self.options, self.contacts = model, meter, options, contacts
        self.operator = Operator(fields, model, forces + ([contacts.touch] if contacts else []))
        self.preconditioner = build_preconditioner(options.preconditioner, fields, self.operator, scene)
        self.solver = PCG(fields, self.operator, self.preconditioner, runtime, options.cg_max_iterations)
        self.filter = Filter(fields, model, self.solver.dv)
        self.slack = ROUNDING * runtime.epsilon
        extent = float(np.abs(model.start_positions[model.user] - model.origin).max())
        self.resolution = runtime.epsilon * extent  # [m]
        self.floor = sum(force.rounding_energy(self.resolution) for force in forces)
        self.held: Held | None = None

    def attempt(self, h: float, held: Held | None, start: Measures) -> Attempt:
        """One step; see the package."""
        made, c = self._attempt(h, held, start), self.contacts
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
        limit = start.energies["kinetic"] + start.potential + work + self.rounding(h, start, measures)
        if phi(measures, h) <= limit:
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
            self.operator.linearize(h)
        with clock.part("CG"):
            solutions.append(self.solve(held, h, warm=warm))
        with clock.part("EVAL"):
            self._place(h, 1.0)
            self._settle(held)

    def _in_contact(self, h: float, pins: Held | None, clock: Clock,
                    solutions: list[Solution]) -> tuple[Held | None, tuple[str, str] | None]:
        """Solves until the states of all contacts agree with the answer: (what was held, what is wrong)."""
        contacts = self.contacts
        with clock.part("C-S"):
            x, v = self.model.read_particles()
            self.operator.set_motion(h)
            if not contacts.warm:
                self._fall(h, *contacts.gravity)
            self._place(h, 1.0)  # where the last step's change of velocity would lead
            self._settle(pins)
            contacts.begin(h, pins, x, v)
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
                verdict = contacts.judge(self._reaction_rows())
            if verdict.changes and contacts.round < contacts.ROUNDS:
                continue
            if verdict.changes and verdict.bad and contacts.may_shrink:
                return held, (CONTACT, f"{verdict.deepest:.2g} thicknesses inside")
            with clock.part("C-S"):
                return held, (CONTACT, f"{contacts.crossings} crossings") if contacts.went_through() else None

    def solve(self, held: Held | None, h: float = 0.0, z: np.ndarray | None = None, warm: bool = False) -> Solution:
        """Solves the system as linearized.

        Args:
            held: the held directions.
            h: step [s] in which they must reach their targets; with 0 they are there and dv = 0 in them.
            z: (k, 3) dv in them [m/s], instead.
            warm: starts from the last solve's dv.
        """
        self.held = held
        if not warm:
            self.filter.clear()
        self.preconditioner.build()
        if held is not None:
            if z is not None:
                self.filter.impose(held.index, held.projector, z)
            elif h > 0:
                self.filter.prescribe(held.index, held.projector, held.target, held.y, h)
            self.preconditioner.hold(held.index, held.projector)
        self.preconditioner.finish()
        return self.solver.solve(self.options.cg_tol, free=held is None and not warm, warm=warm)

    def reaction(self) -> np.ndarray:
        """(n, 3) impulse [N s] in particle order that the last solve needed to keep the held directions."""
        impulse = np.zeros((self.model.n, 3))
        if self.held is not None:
            impulse[self.held.index] = self._reaction_rows()
        return impulse

    def _reaction_rows(self) -> np.ndarray:
        """(k, 3) impulse [N s] on the held particles, in their order."""
        held = self.held
        if held is None:
            return np.zeros((0, 3))
        rows = np.empty((len(held.index), 3), dtype=held.target.dtype)
        self._gather_reaction(held.index, rows)
        return np.einsum("kij,kj->ki", held.projector.astype(np.float64), rows.astype(np.float64))

    @ti.kernel
    def _gather_reaction(self, index: ti.types.ndarray(), rows: ti.types.ndarray()):
        """A dv - b on particles index[k]"""
        for k in range(index.shape[0]):
            i = index[k]
            for c in ti.static(range(3)):
                rows[k, c] = self.solver.As[i][c] - self.operator.b[i][c]

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
                self.operator.linearize(h)
            with clock.part("CG"):
                solutions.append(self.solve(held))
            if solutions[-1].status != CONVERGED:
                return Attempt(SOLVER, solutions[-1].status, measures, tuple(solutions), clock.seconds)
            with clock.part("EVAL"):
                before, alpha, taken = phi(measures, h), 1.0, 0.0
                while alpha > 0.5**HALVINGS:
                    self._shift(h, alpha - taken)
                    taken = alpha
                    measures = self.meter.measure()
                    if phi(measures, h) <= before + self.rounding(h, measures):
                        break
                    alpha /= 2
            settled = phi(measures, h) <= limit or (held is not None and held.moving)
            if alpha == 1.0 and settled and measures.finite:
                self._settle(held)
                if self.contacts is not None and self.contacts.went_in():
                    return Attempt(CONTACT, "after further solves", measures, tuple(solutions), clock.seconds)
                return Attempt(None, "", measures, tuple(solutions), clock.seconds)
        reason = ENERGY if measures.finite else NOT_FINITE
        return Attempt(reason, f"{len(solutions)} solves", measures, tuple(solutions), clock.seconds)

    def rounding(self, h: float, *measures: Measures) -> float:
        """How much of Phi [J] is rounding: of its terms, and of positions as they are stored."""
        kinetic = 0.5 * self.model.mass.sum() * (self.resolution / h) ** 2
        return self.slack * sum(m.size for m in measures) + 2 * (self.floor + kinetic)

    def _settle(self, held: Held | None) -> None:
        if held is not None:
            self.filter.settle(held.index, held.projector, held.target)

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
        """J . v + (J - M dv) . y/h [J], J = A dv - b: work of the constraints in the step, y moved against forces."""
        total = ti.cast(0, self.solver.sum_type)
        for _ in range(1):
            for i in range(self.model.n):
                J = self.solver.As[i] - self.operator.b[i]
                y = self.operator.motion[i] - h * self.model.v_saved[i]
                total += J.dot(self.model.v[i]) + (J - self.model.m[i] * self.solver.dv[i]).dot(y) / h
        return total


def phi(measures: Measures, h: float) -> float:
    """The incremental potential [J]; NaN counts as infinite."""
    value = measures.change + measures.potential + h * measures.dissipation
    return value if np.isfinite(value) else np.inf
