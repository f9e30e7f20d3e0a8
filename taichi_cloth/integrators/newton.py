"""A stage of an implicit method, M (v - v_base) = c f(x_base + c v, v), by Newton's method with line search.

The stage minimises Phi(v) = 1/2 (v - v_base)^T M (v - v_base) + E(x_base + c v) + c R(v), R half the dissipated power;
with a positive semidefinite K every Newton step goes downhill on it.
"""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from ..constraints import Held
from ..fields import Fields
from ..measure import Measures
from ..solver.pcg import CONVERGED, Solution
from ..timing import Clock
from . import NEWTON, NOT_FINITE, SOLVER
from .system import System, phi

HALVINGS = 12
FIRST, TIGHT, LOOSE = 0.03, 0.01, 0.1  # relative residuals of a stage's first solve, and between which the others' are
SHARE = 0.1  # of the last iteration's reduction of the residual that the next solve is asked for


@dataclass(frozen=True)
class Effort:
    """What a stage is worth.

    Attributes:
        moved: RMS of the last change of position [m] that is small enough.
        lowered: or part of what the first iteration lowered Phi by, by which another is the last one.
        cg_tol: relative residual of each linear solve; None lets it follow from how fast Newton's method converges
            [Eisenstat & Walker 1996]: a solve need not be more exact than the linearization.
        most: iterations.
    """

    moved: float
    lowered: float
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
        system, meter = self.system, self.system.meter
        with clock.part("EVAL"):
            measures = meter.measure()
        moved, residual, cg_tol = np.inf, 0.0, effort.cg_tol or FIRST
        lowered: list[float] = []
        for iteration in range(max(effort.most, 1)):
            with clock.part("EVAL"):
                system.linearize(c)
            with clock.part("CG"):
                solution = system.solve(cg_tol, held, lead=0.0 if iteration else c, fresh=fresh and iteration == 0)
            solutions.append(solution)
            if solution.status != CONVERGED:
                return Stage(SOLVER, solution.status, measures)
            with clock.part("EVAL"):
                led = iteration == 0 and held is not None and held.moving
                before = measures
                alpha, measures = self._advance(c, before, led)
                moved = c * system.rms_change()
            if not measures.finite:
                return Stage(NOT_FINITE, f"Newton iteration {iteration + 1}", measures)
            lowered.append(phi(before, c) - phi(measures, c))
            last = iteration > 0 and alpha == 1 and lowered[-1] <= effort.lowered * abs(lowered[0])
            if moved <= effort.moved or last:
                return Stage(None, "", measures)
            if alpha < 0.5**HALVINGS:
                return Stage(NEWTON, "no way down", measures)
            if effort.cg_tol is None:
                now = system.solver.reference
                cg_tol = min(max(SHARE * now / residual, TIGHT), LOOSE) if residual > 0 else LOOSE
                residual = now
        return Stage(NEWTON, f"{effort.most} iterations, the last by {moved:.2g} m", measures)

    def _advance(self, c: float, before: Measures, led: bool) -> tuple[float, Measures]:
        """Along dv as far as Phi does not grow: (part taken, measures there).

        R depends on x too, which the forces rightly know nothing of: by as much as it changes, Phi may grow.
        """
        limit = phi(before, c) + self.system.rounding(c, before)
        alpha, taken = 1.0, 0.0
        while True:
            self._shift(c, alpha - taken)
            taken = alpha
            measures = self.system.meter.measure()
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
        self.system.operator.motion[i] = ti.Vector.zero(float, 3)

    @ti.kernel
    def _shift(self, c: float, alpha: float):
        """v += alpha dv, x += alpha c dv"""
        for i in range(self.model.n):
            self.model.v[i] += alpha * self.system.solver.dv[i]
            self.model.x[i] += alpha * c * self.system.solver.dv[i]
