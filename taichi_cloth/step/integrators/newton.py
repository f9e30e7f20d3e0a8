"""A stage of an implicit method, M (v - v_base) = c f(x_base + c v, v), by Newton's method with line search.

The stage minimises Phi(v) = 1/2 (v - v_base)^T M (v - v_base) + E(x_base + c v) + c R(v), R half the dissipated power;
with a positive semidefinite K every Newton step goes downhill on it.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from ...backend.fields import Fields
from ...backend.timing import Clock
from ...solver.pcg import CONVERGED, Solution
from ...system.assembler import Measures
from ...system.constraints import Held
from .attempt import NEWTON, NOT_FINITE, SOLVER
from .system import System, phi

HALVINGS = 12
FIRST, OTHERS = 0.03, 0.1  # relative residuals of a stage's solves: they need not be more exact than the linearization


@dataclass(frozen=True)
class Effort:
    """What a stage is worth.

    Attributes:
        moved: RMS of the last change of position [m] that is small enough.
        part: or part of the first change that may still be to come, estimated from how fast the changes shrink.
        cg_tol: relative residual of each linear solve; None is Newton's own choice.
        most: iterations.
    """

    moved: float
    part: float
    cg_tol: float | None
    most: int


@dataclass
class Stage:
    """How a stage ended: what is wrong with it or None, details for people, and measures of the state it left."""

    rejection: str | None
    detail: str
    measures: Measures


@ti.data_oriented
class Newton:
    """Solves stages on a system.

    Attributes:
        x_base: of the stage [m]; its v_base is the model's.
    """

    def __init__(self, fields: Fields, system: System) -> None:
        self.system, self.model = system, system.model
        self.x_base = fields.real(self.model.n, 3)

    def solve(self, c: float, held: Held | None, effort: Effort, clock: Clock, solutions: list[Solution],
              fresh: bool) -> Stage:
        """From a guess that was `put` for all particles, with the model's v_base set, to the stage's v and x = x_base + c v.

        Args:
            held: at the end of the stage; those directions are led there in the first iteration.
            fresh: whether the preconditioner is made anew in the first of them.
        """
        system, ready = self.system, False
        first = moved = np.inf
        for iteration in range(max(effort.most, 1)):
            if not ready:
                with clock.part("EVAL"):
                    measures = system.linearize(c)
            with clock.part("CG"):
                cg_tol = effort.cg_tol or (OTHERS if iteration else FIRST)
                solution = system.solve(cg_tol, held, lead=0.0 if iteration else c, fresh=fresh and iteration == 0)
            solutions.append(solution)
            if solution.status != CONVERGED:
                return Stage(SOLVER, solution.status, measures)
            moved, before = c * system.rms_change(), moved
            first = moved if iteration == 0 else first
            rest = _rest(moved / before) if iteration else np.inf
            ready = not (moved <= effort.moved or moved * rest < effort.part * first)
            with clock.part("EVAL"):
                led = iteration == 0 and held is not None and held.moving
                alpha, measures = self._advance(c, measures, led, ready)
            if not measures.finite:
                return Stage(NOT_FINITE, f"Newton iteration {iteration + 1}", measures)
            if moved <= effort.moved or moved * (rest + 1 - alpha) < effort.part * first:
                return Stage(None, "", measures)
            if alpha < 0.5**HALVINGS:
                return Stage(NEWTON, "no way down", measures)
        return Stage(NEWTON, f"{effort.most} iterations, the last by {moved:.2g} m", measures)

    def _advance(self, c: float, before: Measures, led: bool, goes_on: bool) -> tuple[float, Measures]:
        """Along dv as far as Phi does not grow: (part taken, measures there); linearized there too where it goes on.

        R depends on x too, which the forces rightly know nothing of: by as much as it changes, Phi may grow.
        """
        limit = phi(before, c) + self.system.rounding(c, before)
        alpha, taken = 1.0, 0.0
        while True:
            self._shift(c, alpha - taken)
            taken = alpha
            measures = self.system.linearize(c) if goes_on else self.system.meter.measure()
            slack = self.system.rounding(c, measures) + c * abs(measures.dissipation - before.dissipation)
            if led or phi(measures, c) <= limit + slack or alpha < 0.5**HALVINGS:
                return alpha, measures
            alpha /= 2

    @ti.func
    def put(self, i, c, x_base, v):
        """Base and guess of a stage for particle i."""
        self.x_base[i] = x_base
        self.model.v[i] = v
        self.model.x[i] = x_base + c * v

    @ti.kernel
    def _shift(self, c: float, alpha: float):
        """v += alpha dv, x += alpha c dv"""
        for i in range(self.model.n):
            self.model.v[i] += alpha * self.system.solver.dv[i]
            self.model.x[i] += alpha * c * self.system.solver.dv[i]


def _rest(rate: float) -> float:
    """Sum of the changes to come, in units of the last one, when each is `rate` times the one before."""
    return rate / (1 - rate) if rate < 1 else np.inf
