"""Preconditioned conjugate gradients with the filter of [BW98 §5.3]; on the CPU one launch a solve.

Differs from [BW98 §5.2]:

- The preconditioner is the inverse of S P S on the free directions. r and s are filtered where they are made, so that a
  constrained component never leaves z by more than rounding.
- The recurrences are those of Chronopoulos and Gear: one pass for the product and one for all updates.
- It stops when the filtered residual is below the tolerance times that of dv = z.
- Breakdown is detected instead of divided by: c^T A c <= 0, with the search direction c, or r^T P^-1 r < 0.
- The residual of the answer is computed afresh, with restarts while it differs from that of the recurrence.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.phases import END, TASK, PhaseScheduler
from ..backend.runtime import Runtime
from ..backend.sums import Sums
from ..system.operator import Operator
from .recurrences import BAD, BROKEN, DONE, GO_ON, Recurrences

CONVERGED, MAX_ITERATIONS, BREAKDOWN, NOT_FINITE = "CONVERGED", "MAX_ITERATIONS", "BREAKDOWN", "NOT_FINITE"
BEGIN, ITERATE, CHECK = range(3)  # stages of a phase scheduler's solve
COPY, MULTIPLY, RESTART, UPDATE, RESTRICT, SOLVE, PROLONG, CORRECT, SUM_UP = range(1, 10)  # kinds of its phases
STAGE, STATE, DID, ROUND, NEXT = range(5)  # its counters
FIRST, LAST = range(2)  # residual norms that it keeps
RESTARTS = 5
FUTILE = 0.75  # another restart follows only if the last one reduced the residual to less than this part
ROUNDING = 8.0  # least residual, in roundings of A dv
LOOK, LONGEST = 8, 32  # iterations on a device that are launched between two reads of their state: as many as the last solve
# took, within these bounds. One in vain costs about as much as a read
SLACK = 2.0  # a fresh residual within this factor of the tolerance counts as converged


@dataclass(frozen=True)
class Solution:
    """How a solve ended.

    Attributes:
        status: CONVERGED, MAX_ITERATIONS, BREAKDOWN or NOT_FINITE.
        iterations: over all restarts.
        residual: of the answer, computed afresh, relative to that of Delta v = z; filtered, in the norm of P^-1.
        tolerance: bound on `residual`; above `cg_tol` only where rounding allows no less.
        preliminary: whether it was a low-accuracy solve, used only to estimate contact forces.
    """

    status: str
    iterations: int
    residual: float
    tolerance: float
    preliminary: bool = False


@ti.data_oriented
class PCG(Recurrences):
    """Solves A dv = b with dv = z in the constrained directions.

    Args:
        preconditioner: Pointwise or Multilevel.
        max_iterations: of one solve.
        balanced: whether A has no force from outside: no solids, air or attachments. Cloth that nothing holds then gets
            exactly the right momentum in all.
    """

    def __init__(self, fields: Fields, operator: Operator, preconditioner, runtime: Runtime,
                 max_iterations: int, balanced: bool) -> None:
        super().__init__(fields, operator, preconditioner, runtime, max_iterations)
        self.max_iterations, self.epsilon = max_iterations, runtime.epsilon
        self.together = not runtime.device  # a phase scheduler, or a launch for each iteration
        self.phases = PhaseScheduler(fields, self.blocks.count if self.together else 1, self.blocks.largest)
        self.sums = Sums(fields, self.blocks.pieces, 4, runtime.device, dtype=self.sum_type)  # of momentum, and of mass
        self.count, self.norm = fields.integer(5), fields.real(2, dtype=self.sum_type)
        self.last, self.balanced = 0, balanced
        self.reference = 0.0  # residual norm that the last solve's tolerance was relative to
        self.rms = 0.0  # of the last solve's dv over the particles [m/s]

    def solve(self, tolerance: float, free: bool = False, warm: bool = False, zero: bool = False,
              least_reference: float = 0.0, loose: bool = False) -> Solution:
        """From dv = z (already in place) to dv; A dv is left in As.

        Args:
            tolerance: on the filtered residual, relative to that of dv = z.
            free: nothing is held or being sewn: start from the translation with the momentum of b, which is the answer where
                cloth falls freely.
            warm: dv is the answer of nearly the same system instead of z, and the reference is that of its solve.
            zero: starts from dv = 0, whatever is in place.
            least_reference: residual norm that the tolerance is relative to where its own is less.
            loose: nothing is held, though seams may be closing: the total momentum is made exact, where `balanced`.
        """
        solve = self._together if self.together else self._apart
        ended = solve(tolerance, self.reference if warm else 0.0, least_reference, int(zero),
                      0 if free else self.max_iterations)
        if free and float(ended[3]) > 0:
            self._translate()
            ended = solve(tolerance, float(ended[3]), least_reference, 0, self.max_iterations)
        if loose and self.balanced:
            self._balance()
        state, done = int(ended[0]), int(ended[1])
        norm, first, size, square = (float(ended[k]) for k in range(2, 6))
        self.last, self.reference = done, first
        self.rms = math.sqrt(square / self.operator.model.n) if square >= 0 else math.nan
        if not math.isfinite(norm):
            return Solution(NOT_FINITE, done, float("nan"), tolerance)
        if norm < 0 or first < 0:
            return Solution(BREAKDOWN, done, abs(norm / first), tolerance)
        if first == 0:
            return Solution(CONVERGED, done, 0.0, tolerance)
        allowed = max(tolerance, ROUNDING * self.epsilon * math.sqrt(max(size, 0.0)) / first)
        if norm <= SLACK * allowed * first:
            name = CONVERGED
        else:  # where the recurrence reports convergence, the true residual does not
            name = {BROKEN: BREAKDOWN, BAD: NOT_FINITE}.get(state, MAX_ITERATIONS)
        return Solution(name, done, norm / first, allowed)

    def left(self) -> float:
        """Norm [N s] of the answer's residual on the free directions. NumPy's would leave threads of BLAS that spin for 30 ms:
        a third of the CPU time of steps in contact."""
        return math.sqrt(self._left())

    @ti.kernel
    def _left(self) -> float:
        ti.loop_config(serialize=self.blocks.serial)
        for piece in range(self.blocks.pieces):
            total = ti.cast(0, self.sum_type)
            for i in range(self.blocks.first(piece), self.blocks.first(piece + 1)):
                total += self.r[i].norm_sqr()
            self.sums.of_piece[piece] = ti.Vector([total, 0, 0, 0])
        self.sums.finish(1)
        return ti.cast(self.sums.all[0][0], float)

    def residual_history(self) -> np.ndarray:
        """(iterations,) filtered residual norms of the last solve, as the recurrence has them."""
        return np.sqrt(np.maximum(self.history.to_numpy()[: self.last], 0))

    def _apart(self, tolerance: float, reference: float, least_reference: float, zero: int, most: int) -> tuple:
        """`_together` by a launch an iteration. The host waits once for a group of these: where the last solve needed no more
        iterations, the residual of the answer follows in the same group."""
        asked = tolerance, reference, least_reference, most
        went = self._went_f32 if self.sum_type == ti.f32 else self._went_f64
        self._start(zero, *asked)
        done, following = 0, MULTIPLY
        while True:
            group = min(max(min(self.last - done, LONGEST), LOOK), most - done) if following == MULTIPLY else 0
            for _ in range(group):
                self._step(*asked)
            if following == COPY or done + group >= min(self.last, most):
                self._check(*asked)
            ended = went()
            following, done = int(ended[0]), int(ended[2])
            if following == END:
                return tuple(ended[k] for k in range(1, 7))

    @ti.kernel
    def _translate(self):
        """dv = sum of b / sum of m"""
        self.momentum(self.operator.b)
        ti.loop_config(serialize=self.blocks.serial)
        for i in range(self.operator.model.rows()):
            self.dv[i] = self.translation()

    @ti.func
    def momentum(self, q: ti.template()):
        """Sums of q and of masses, at the top of a kernel."""
        ti.loop_config(serialize=self.blocks.serial)
        for piece in range(self.blocks.pieces):
            total = ti.Vector.zero(self.sum_type, 4)
            for i in range(self.blocks.first(piece), self.blocks.first(piece + 1)):
                total += ti.Vector([q[i][0], q[i][1], q[i][2], self.operator.model.m[i]])
            self.sums.of_piece[piece] = total
        self.sums.finish(1)

    @ti.func
    def translation(self):
        """Velocity that has this momentum."""
        all_ = self.sums.all[0]
        return ti.cast(ti.Vector([all_[0], all_[1], all_[2]]) / all_[3], float)

    @ti.kernel
    def _start(self, zero: int, tolerance: float, reference: float, least_reference: float, most: int):
        """A solve from dv, or from zero: its first residual, and the kind of phase that follows."""
        self.count[STAGE], self.count[STATE], self.count[DID], self.count[ROUND] = BEGIN, DONE, 0, 0
        for i in range(self.operator.model.rows()):
            if zero == 1:
                self.dv[i] = ti.Vector.zero(float, 3)
        self.residual(tolerance, reference, least_reference, most, 1)

    @ti.kernel
    def _check(self, tolerance: float, reference: float, least_reference: float, most: int):
        """The residual of the answer, computed afresh, where iterations have ended; nothing where they go on."""
        self.residual(tolerance, reference, least_reference, most, ti.cast(self.count[NEXT] == COPY, ti.i32))

    @ti.func
    def residual(self, tolerance, reference, least_reference, most, going):
        """r = b - A dv, s = P^-1 r, r.s; A dv is left in As; then the next phase. Nothing if not `going`."""
        for i in range(self.operator.model.rows()):
            if going == 1:
                self.s[i] = self.dv[i]
        if ti.static(self.operator.has_low_rank):
            for t in range(self.blocks.count * self.blocks.grain):
                if t % self.blocks.grain == 0 and going == 1:
                    self.operator.sum_up(t // self.blocks.grain, self.s)
            self.operator.gather()
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0 and going == 1:
                self.multiply(t // self.blocks.grain)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0 and going == 1:
                self.restart(t // self.blocks.grain)
        if ti.static(not self.preconditioner.pointwise):
            self.precondition(1, going)
        self.group(going)
        for _ in range(1):
            if going == 1:
                self.count[NEXT] = self.decide(tolerance, reference, least_reference, most)

    @ti.kernel
    def _balance(self):
        """Adds the translation whose momentum the answer lacks: free cloth falls exactly, however rough the solve."""
        self.momentum(self.r)
        ti.loop_config(serialize=self.blocks.serial)
        for i in range(self.operator.model.rows()):
            self.dv[i] = self.dv[i] + self.translation()
            self.As[i] = self.As[i] + self.operator.model.m[i] * self.translation()

    @ti.kernel
    def _step(self, tolerance: float, reference: float, least_reference: float, most: int):
        """One iteration, on all threads; nothing where iterations have ended."""
        going = ti.cast(self.count[NEXT] == MULTIPLY, ti.i32)
        if ti.static(self.operator.has_low_rank):
            for t in range(self.blocks.count * self.blocks.grain):
                if t % self.blocks.grain == 0 and going == 1:
                    self.operator.sum_up(t // self.blocks.grain, self.s)
            self.operator.gather()
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0 and going == 1:
                self.multiply(t // self.blocks.grain)
        self.group(going)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0 and going == 1:
                self.update(t // self.blocks.grain)
        if ti.static(not self.preconditioner.pointwise):
            self.precondition(1, going)
        self.group(going)
        for _ in range(1):
            if going == 1:
                self.count[NEXT] = self.decide(tolerance, reference, least_reference, most)

    @ti.kernel
    def _went_f64(self) -> ti.types.vector(7, ti.f64):
        """The numbers that the host waits for, see `ended`."""
        return ti.cast(self.ended(), ti.f64)

    @ti.kernel
    def _went_f32(self) -> ti.types.vector(7, ti.f32):
        """The same where sums are in f32."""
        return ti.cast(self.ended(), ti.f32)

    @ti.func
    def ended(self):
        """(next phase, state, iterations, residual norm of the answer, that it is relative to, |dv|_P^2, |dv|^2)"""
        following, state, did = self.count[NEXT], self.count[STATE], self.count[DID]
        return ti.Vector([ti.cast(following, self.sum_type), ti.cast(state, self.sum_type), ti.cast(did, self.sum_type),
                          self.norm[LAST], self.norm[FIRST], self.scalar[3], self.scalar[4]])

    @ti.kernel
    def _together(self, tolerance: ti.f64, reference: ti.f64, least_reference: ti.f64, zero: int,
                  most: int) -> ti.types.vector(6, ti.f64):
        """`_apart` in one launch, by a phase scheduler."""
        self.phases.start(COPY)
        self.count[STAGE], self.count[STATE], self.count[DID], self.count[ROUND] = BEGIN, DONE, 0, 0
        for t in range(self.phases.tasks):
            if t % TASK == 0:
                phase, kind, block, waited = 0, COPY, 0, 0
                while kind != END:
                    phase, kind = self.phases.phase(), self.phases.kind(waited)
                    if kind != END:
                        block, waited = self.phases.claim(t // TASK, phase, waited)
                        if block >= 0:
                            self.work(kind, block, zero)
                            if self.phases.last(phase):
                                self.phases.turn(self.after(kind, tolerance, reference, least_reference, most))
        return ti.Vector([ti.cast(self.count[STATE], ti.f64), ti.cast(self.count[DID], ti.f64), self.norm[LAST],
                          self.norm[FIRST], self.scalar[3], self.scalar[4]])

    @ti.func
    def work(self, kind, block, zero):
        """A block's part of a phase."""
        if kind == COPY:
            for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
                if zero == 1 and self.count[STAGE] == BEGIN:
                    self.dv[i] = ti.Vector.zero(float, 3)
                self.s[i] = self.dv[i]
        elif kind == MULTIPLY:
            self.multiply(block)
        elif kind == RESTART:
            self.restart(block)
        elif kind == UPDATE:
            self.update(block)
        if ti.static(self.operator.has_low_rank):
            if kind == SUM_UP:
                self.operator.sum_up(block, self.s)
        if ti.static(not self.preconditioner.pointwise):
            if kind == RESTRICT:
                self.preconditioner.restrict_block(block, self.r)
            elif kind == PROLONG:
                self.preconditioner.prolong_block(block)
            elif kind == CORRECT:
                self.correct(block, 1)
            if ti.static(self.preconditioner.exact):
                if kind == SOLVE:
                    self.preconditioner.solve_block(block)

    @ti.func
    def after(self, kind, tolerance, reference, least_reference, most):
        """The kind of phase that follows."""
        following = MULTIPLY
        if kind == MULTIPLY:
            following = UPDATE
            if self.count[STAGE] != ITERATE:
                following = RESTART
        elif ti.static(not self.preconditioner.pointwise) and (kind == RESTART or kind == UPDATE):
            following = RESTRICT
        elif kind == RESTRICT:
            following = PROLONG
            if ti.static(not self.preconditioner.pointwise):
                self.preconditioner.restrict_rest()
                if ti.static(self.preconditioner.exact):
                    following = SOLVE
                else:
                    self.preconditioner.prolong_rest()
        elif kind == SOLVE:
            if ti.static(not self.preconditioner.pointwise):
                self.preconditioner.prolong_rest()
            following = PROLONG
        elif kind == PROLONG:
            following = CORRECT
        elif kind != COPY and kind != SUM_UP:
            following = self.decide(tolerance, reference, least_reference, most)
        if ti.static(self.operator.has_low_rank):
            if following == MULTIPLY and kind != SUM_UP:
                following = SUM_UP
        return following

    @ti.func
    def decide(self, tolerance, reference, least_reference, most):
        """The next phase of a phase scheduler after a residual or an iteration."""
        following = MULTIPLY
        if self.count[STAGE] == ITERATE:
            state = self.conclude((tolerance * self.norm[FIRST]) ** 2, self.count[DID])
            self.count[STATE] = state
            self.count[DID] += 1
            if state != GO_ON or self.count[DID] >= most:
                self.count[STAGE] = CHECK
                following = COPY
        else:
            self.begin()
            rs = self.scalar[0]
            norm, stage = ti.sqrt(ti.abs(rs)), self.count[STAGE]
            if rs < 0:
                norm = -norm
            first = self.norm[FIRST]
            if stage == BEGIN:
                first = norm
                if reference > 0:
                    first = reference
                if least_reference > 0:
                    first = ti.max(first, least_reference)
            going = self.count[ROUND] < RESTARTS and norm > SLACK * tolerance * first and self.count[DID] < most
            if stage == CHECK and (self.count[STATE] != DONE or norm > FUTILE * self.norm[LAST]):
                going = False
            if going:
                self.count[STAGE], self.count[STATE] = ITERATE, GO_ON
                self.count[ROUND] += 1
            else:
                following = END
            self.norm[FIRST], self.norm[LAST] = first, norm
        return following
