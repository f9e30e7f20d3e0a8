"""3x3 block Jacobi on the directions that are free."""

import taichi as ti

from ..fields import Fields
from ..forces.external import sym_times
from ..forces.membrane import sym
from ..operator import Operator


@ti.data_oriented
class BlockJacobi:
    """(S P S)^-1 on the free directions of each particle, 0 on the constrained ones: symmetric, 6 numbers."""

    def __init__(self, fields: Fields, operator: Operator) -> None:
        self.operator = operator
        self.inverse = fields.real(operator.model.n, 6)

    @ti.kernel
    def build(self):
        """Inverts every diagonal block as if its particle were free."""
        for i in range(self.operator.model.n):
            self.inverse[i] = sym(unpack(self.operator.P[i]).inverse())

    @ti.kernel
    def restrict(self, index: ti.types.ndarray(), held: ti.types.ndarray()):
        """For particles index[k], with I - S = held[k]: (S P S + I - S)^-1 - (I - S)."""
        for k in range(index.shape[0]):
            C = ti.Matrix.zero(float, 3, 3)
            for a, b in ti.static(ti.ndrange(3, 3)):
                C[a, b] = held[k, a, b]
            S = ti.Matrix.identity(float, 3) - C
            if C.trace() > 2.5:
                self.inverse[index[k]] = ti.Vector.zero(float, 6)
            else:
                # S times P's scale keeps the two parts of the sum alike in size
                scale = unpack(self.operator.P[index[k]]).trace()
                block = S @ unpack(self.operator.P[index[k]]) @ S + scale * C
                free = S @ block.inverse() @ S
                self.inverse[index[k]] = sym(0.5 * (free + free.transpose()))

    @ti.func
    def apply(self, i, r):
        """s_i = P_i^-1 r_i"""
        return sym_times(self.inverse[i], r)

    @ti.func
    def norm_sqr(self, i, x):
        """x_i . P_i x_i"""
        return x.dot(sym_times(self.operator.P[i], x))


@ti.func
def unpack(s):
    """The symmetric 3x3 matrix of 6 numbers."""
    return ti.Matrix([[s[0], s[1], s[2]], [s[1], s[3], s[4]], [s[2], s[4], s[5]]])
