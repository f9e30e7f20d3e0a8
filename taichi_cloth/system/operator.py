"""The linear system of a step: A = M - c D - c^2 K and its right-hand side, matrix-free.

`c` is h for backward Euler (18); methods with stages use their own. `assembler.Assembler` linearizes.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import read, write
from .state import ParticleState


@ti.data_oriented
class Operator:
    """A, b and the block diagonal of A, from the forces of a model.

    Attributes:
        forces: those with a derivative.
        b: right-hand side [kg m/s].
        rhs_displacement: h v_0 + y [m], the displacement that K is applied to on the right-hand side.
        P: (n, 6) diagonal blocks xx xy xz yy yz zz [kg].
    """

    def __init__(self, fields: Fields, model: ParticleState, forces: list) -> None:
        self.model, self.blocks = model, model.blocks
        self.forces = [force for force in forces if not force.dead_load]
        self.low_rank = [force for force in forces if force.low_rank]
        self.has_low_rank = len(self.low_rank) > 0
        self._gathered = [] if self.blocks.serial else [force for force in self.low_rank if force.does("gather")]
        for force in forces:
            force.build_stiffness()
        self.b, self.rhs_displacement = fields.real(model.n, 3), fields.real(model.n, 3)
        self.P = fields.real(model.n, 6)

    @ti.kernel
    def set_rhs_displacement(self, c: float):
        """rhs_displacement = x_base + c v_base - x_saved"""
        ti.loop_config(serialize=self.blocks.serial)
        for i in range(self.model.rows()):
            self.rhs_displacement[i] = self.model.x_offset[i] + c * self.model.v_base[i]

    @ti.kernel
    def correct_rhs_displacement(self, index: ti.types.ndarray(), y: ti.types.ndarray()):
        """rhs_displacement += y (k, 3) [m] on particles index (k,)"""
        ti.loop_config(serialize=self.blocks.serial)
        for k in range(index.shape[0]):
            i = index[k]
            shift = ti.Vector([ti.cast(y[k, 0], float), ti.cast(y[k, 1], float), ti.cast(y[k, 2], float)])
            self.rhs_displacement[i] = self.rhs_displacement[i] + shift

    @ti.func
    def product(self, block, p: ti.template(), q: ti.template()):
        """q = A p on the rows of a block; `sum_up` has been called for all of them where forces couple."""
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            q[i] = self.model.m[i] * p[i]
        for k in ti.static(range(len(self.forces))):
            self.forces[k].add_product(block, p, q)
        for k in ti.static(range(len(self.low_rank))):
            self.low_rank[k].add_low_rank(block, q)

    @ti.func
    def gather(self):
        """These sums on a device, where they have thousands of parts; at the top of a kernel."""
        for k in ti.static(range(len(self._gathered))):
            self._gathered[k].gather()

    @ti.func
    def sum_up(self, block, p: ti.template()):
        """Sums over all of p that the product needs, a block's part."""
        for k in ti.static(range(len(self.low_rank))):
            self.low_rank[k].sum_up(block, p)


@ti.data_oriented
class ForceField:
    """f [N] at the current state, for explicit steps and for who asks."""

    def __init__(self, fields: Fields, model: ParticleState, forces: list) -> None:
        self.model, self.forces, self.blocks = model, forces, model.blocks
        self.f = fields.real(model.n, 3)

    def compute(self) -> None:
        """f = internal plus external forces."""
        for force in self.forces:
            force.prepare()
        self._compute()

    @ti.kernel
    def _compute(self):
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                block = t // self.blocks.grain
                for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
                    self.f[i] = ti.Vector.zero(float, 3)
                for k in ti.static(range(len(self.forces))):
                    self.forces[k].add_force(block, self.f)


@ti.data_oriented
class Probe:
    """q = A p for a p from outside."""

    def __init__(self, fields: Fields, model: ParticleState, forces: list, operator: Operator) -> None:
        self.operator, self.blocks = operator, model.blocks
        self.p, self.q = fields.real(model.n, 3), fields.real(model.n, 3)

    def product(self, p: np.ndarray) -> np.ndarray:
        """(n, 3) A p, in particle order."""
        write(self.p, p)
        self.apply(1)
        return read(self.q)

    @ti.kernel
    def apply(self, times: int):
        """q = A p; several times over in one launch where that is to be timed."""
        if ti.static(self.operator.has_low_rank):
            for t in range(self.blocks.count * self.blocks.grain):
                if t % self.blocks.grain == 0:
                    self.operator.sum_up(t // self.blocks.grain, self.p)
            self.operator.gather()
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                for _ in range(times):
                    self.operator.product(t // self.blocks.grain, self.p, self.q)
