"""The recurrences of preconditioned conjugate gradients, block by block: shared by solves of one launch and of many.

[Chronopoulos and Gear 1989]: with s = P^-1 r, one pass takes A s and s.A s, and one makes all updates. The numbers are
beta = r.s / (r.s before), c^T A c = s^T A s - beta r.s / (alpha before), alpha = r.s / c^T A c.
"""

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.runtime import Runtime
from ..backend.sums import GROUPS
from ..system.operator import Operator

GO_ON, DONE, BROKEN, BAD = range(4)
UNROLLED = 32


@ti.data_oriented
class Recurrences:
    """Vectors and sums of a solve of A dv = b with the filter in `preconditioner`.

    Attributes:
        dv, r, s, c, Ac, As: (n, 3) the answer, the filtered residual, P^-1 r, the direction, and products with A.
        partial: (blocks, 4) sums over blocks of rows: s.As, r.s, |dv|_P^2, |dv|^2; grouped: over groups of them, on a GPU.
        scalar: r.s now, r.s before, alpha before, |dv|_P^2, |dv|^2.
        history: r.s by iteration.
    """

    def __init__(self, fields: Fields, operator: Operator, preconditioner, runtime: Runtime, max_iterations: int) -> None:
        n = operator.model.n
        self.operator, self.preconditioner, self.blocks = operator, preconditioner, operator.blocks
        self.sum_type = ti.f32 if runtime.sums == "f32" else ti.f64
        self.dv, self.r, self.s = fields.real(n, 3), fields.real(n, 3), fields.real(n, 3)
        self.c, self.Ac, self.As = fields.real(n, 3), fields.real(n, 3), fields.real(n, 3)
        self.partial = fields.real(self.blocks.count, 4, dtype=self.sum_type)
        self.many = self.blocks.grain == 1
        self.grouped = fields.real(GROUPS if self.many else 1, 4, dtype=self.sum_type)
        self.scalar = fields.real(5, dtype=self.sum_type)
        self.history = fields.real(max_iterations + 1, dtype=self.sum_type)

    @ti.func
    def restart(self, block):
        """r = b - As, the particles' own part of s, and the block's parts of r.s and |dv|_P^2"""
        rs, size, square = ti.cast(0, self.sum_type), ti.cast(0, self.sum_type), ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            left = self.preconditioner.average(i, self.operator.b) - self.preconditioner.average(i, self.As)
            r = self.preconditioner.filter(i, left)
            s = self.preconditioner.apply(i, r)
            self.r[i], self.s[i] = r, s
            self.c[i], self.Ac[i] = ti.Vector.zero(float, 3), ti.Vector.zero(float, 3)
            rs += r.dot(s)
            size += self.preconditioner.norm_sqr(i, self.dv[i])
            square += self.dv[i].norm_sqr()
        self.partial[block] = ti.Vector([0 * rs, rs, size, square])

    @ti.func
    def begin(self):
        """Sums as the first iteration takes them."""
        self.scalar[0] = self.total(1)
        self.scalar[3] = self.total(2)
        self.scalar[4] = self.total(3)
        self.scalar[1] = 0
        self.scalar[2] = 1

    @ti.func
    def multiply(self, block):
        """The block's part of As = A s and of s.As."""
        self.operator.product(block, self.s, self.As)
        sAs = ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            sAs += self.s[i].dot(self.As[i])
        self.partial[block][0] = sAs

    @ti.func
    def update(self, block):
        """c, A c, dv, r, the particles' own part of s, and the block's part of r.s"""
        alpha, beta, cAc = self.coefficients()
        a, b = ti.cast(alpha, float), ti.cast(beta, float)
        rs = ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            c, Ac = self.s[i] + b * self.c[i], self.preconditioner.average(i, self.As) + b * self.Ac[i]
            self.c[i], self.Ac[i] = c, Ac
            self.dv[i] = self.dv[i] + a * c  # an += would be atomic
            r = self.preconditioner.filter(i, self.r[i] - a * Ac)
            s = self.preconditioner.apply(i, r)
            self.r[i], self.s[i] = r, s
            rs += r.dot(s)
        self.partial[block][1] = rs

    @ti.func
    def conclude(self, target, iteration):
        """Keeps the sums for the next iteration; how this one went."""
        alpha, beta, cAc = self.coefficients()
        rs = self.total(1)
        self.scalar[1] = self.scalar[0]
        self.scalar[2] = alpha
        self.scalar[0] = rs
        self.history[iteration] = rs
        state = GO_ON
        if rs <= target:
            state = DONE
        if cAc <= 0 or rs < 0:
            state = BROKEN
        if not (rs * 0 == 0 and cAc * 0 == 0):
            state = BAD
        return state

    @ti.func
    def precondition(self, column: ti.template(), going):
        """Adds to s the part that needs all of r; r.s into a column of the partial sums. Nothing if not `going`."""
        self.preconditioner.sweep(self.r, going)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0 and going == 1:
                self.correct(t // self.blocks.grain, column)

    @ti.func
    def correct(self, block, column: ti.template()):
        """The same on the rows of a block, after the preconditioner's sweep."""
        rs = ti.cast(0, self.sum_type)
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            s = self.s[i] + self.preconditioner.filter(i, self.preconditioner.correction(i))
            self.s[i] = s
            rs += self.r[i].dot(s)
        self.partial[block][column] = rs

    @ti.func
    def total(self, column: ti.template()):
        """Sum of a column of the blocks' partial sums, always in the same order.

        Unrolled where blocks are few: at the top of a kernel a loop would be a parallel task of its own.
        """
        out = ti.cast(0, self.sum_type)
        if ti.static(self.blocks.count <= UNROLLED):
            for block in ti.static(range(self.blocks.count)):
                out += self.partial[block][column]
        else:
            for _ in range(1):
                if ti.static(self.many):
                    for group in range(GROUPS):
                        out += self.grouped[group][column]
                else:
                    for block in range(self.blocks.count):
                        out += self.partial[block][column]
        return out

    @ti.func
    def group(self, going):
        """Sums over groups of blocks, on a GPU, before anything asks for a total."""
        if ti.static(self.many):
            for group in range(GROUPS):
                if going == 1:
                    total = ti.Vector.zero(self.sum_type, 4)
                    for block in range(self.blocks.count * group // GROUPS, self.blocks.count * (group + 1) // GROUPS):
                        total += self.partial[block]
                    self.grouped[group] = total

    @ti.func
    def coefficients(self):
        """alpha, beta and c^T A c of this iteration, from the sums of the blocks."""
        sAs = self.total(0)
        rs, before, alpha_before = self.scalar[0], self.scalar[1], self.scalar[2]
        beta = ti.cast(0, self.sum_type)
        if before > 0:
            beta = rs / before
        cAc = sAs - beta * rs / alpha_before
        alpha = ti.cast(0, self.sum_type)
        if cAc > 0:
            alpha = rs / cAc
        return alpha, beta, cAc
