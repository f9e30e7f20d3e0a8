"""Preconditioners that work a particle at a time, on the directions that are free: 3x3 block Jacobi, Jacobi, none."""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..forces.conditions import sym, sym_scaled_identity, sym_times, sym_unpack
from ..system.checkpoint import Checkpointed
from ..system.held import Held
from ..system.operator import Operator

FULLY = 2.5  # trace of I - S from which on a particle is held in all directions: 1, 2 or 3 but for rounding


@ti.data_oriented
class Pointwise(Checkpointed):
    """(S P S)^-1 on the free directions of each particle, 0 on the constrained ones: symmetric, 6 numbers.

    Args:
        kind: the matrix P: "block_jacobi", the diagonal 3x3 block of A; "jacobi", its diagonal; "none", the particle's mass.
    """

    pointwise = True  # s_i depends on r_i alone

    def __init__(self, fields: Fields, operator: Operator, kind: str = "block_jacobi") -> None:
        self.operator, self.kind, self.sewn = operator, kind, operator.model.sewn
        self.sews = self.sewn is not None
        n = operator.model.n
        self.inverse = fields.real(n, 6)
        self.is_held, self.S = fields.integer(n), fields.real(n, 6)

    @ti.func
    def block(self, i):
        """P_i, 6 numbers; the mean over particles sewn together."""
        P = self.average(i, self.operator.P)
        if ti.static(self.kind == "jacobi"):
            P = ti.Vector([P[0], 0.0, 0.0, P[3], 0.0, P[5]])
        if ti.static(self.kind == "none"):
            P = sym_scaled_identity(self.operator.model.m[i])
        return P

    def make(self, c: float, held: Held | None, reuse_levels: bool = False) -> None:
        """Prepares for the system A = M - c D - c^2 K as it is linearized, c the effective step [s]. Nothing here lasts."""
        if held is None:
            self.build(np.zeros(0, dtype=np.int32))
            return
        full = np.trace(held.projector, axis1=1, axis2=2) > FULLY
        if full.all():
            self.build(held.arrays[0])
        else:  # compiled only for scenes with 1 or 2 held directions
            self.build_partly(*held.arrays[:2])

    def forget(self) -> None:
        """Nothing here outlasts a solve."""

    @ti.kernel
    def build(self, fully: ti.types.ndarray()):
        """Inverts every diagonal block as if its particle were free; particles `fully` (k,), held in all directions, get
        S = 0."""
        for i in range(self.operator.model.rows()):
            self.let_go(i)
        ti.loop_config(serialize=self.operator.blocks.serial)
        for k in range(fully.shape[0]):
            self.hold_fully(fully[k])

    def count_iterations(self, iterations: int) -> None:
        """Iterations of the first solve after `make`."""

    @ti.kernel
    def build_partly(self, index: ti.types.ndarray(), held: ti.types.ndarray()):
        """The same for particles index (k,) that are held in the directions of projectors (k, 3, 3)."""
        for i in range(self.operator.model.rows()):
            self.let_go(i)
        ti.loop_config(serialize=self.operator.blocks.serial)
        for k in range(index.shape[0]):
            C = ti.Matrix.zero(float, 3, 3)
            for a, b in ti.static(ti.ndrange(3, 3)):
                C[a, b] = held[k, a, b]
            if C.trace() > FULLY:
                self.hold_fully(index[k])
            else:
                self.hold_partly(index[k], C)

    @ti.func
    def let_go(self, i):
        """Particle i is free."""
        self.is_held[i] = 0
        self.inverse[i] = sym(sym_unpack(self.block(i)).inverse())

    @ti.func
    def hold_fully(self, i):
        """Particle i is held in all directions."""
        self.is_held[i] = 1
        self.S[i] = ti.Vector.zero(float, 6)
        self.inverse[i] = ti.Vector.zero(float, 6)

    @ti.func
    def hold_partly(self, i, C):
        """(S P S + I - S)^-1 - (I - S), the two parts of the sum alike in size; C is I - S."""
        S = ti.Matrix.identity(float, 3) - C
        P = sym_unpack(self.block(i))
        free = (S @ P @ S + P.trace() * C).inverse() - C / P.trace()
        self.is_held[i] = 1
        self.S[i] = sym(S)
        self.inverse[i] = sym(0.5 * (free + free.transpose()))

    @ti.func
    def average(self, i, q: ti.template()):
        """q_i, or its mean over the particles sewn to i: the seams' part of S."""
        out = q[i]
        if ti.static(self.sews):
            out = self.sewn.mean(i, q)
        return out

    @ti.func
    def filter(self, i, r):
        """S_i r_i [BW98 §5.3]"""
        if self.is_held[i] == 1:
            r = sym_times(self.S[i], r)
        return r

    @ti.func
    def apply(self, i, r):
        """s_i = S_i P_i^-1 r_i for an r that is filtered already."""
        return self.filter(i, sym_times(self.inverse[i], r))

    @ti.func
    def norm_sqr(self, i, x):
        """x_i . P_i x_i"""
        return x.dot(sym_times(self.block(i), x))
