"""The coarsest level of sewn cloth, solved exactly: panels that hang on each other move together at once.

    A_c = Q^T S A S Q,   Q the hats of the coarsest level's nodes,

is found by products with hats that have nothing in common: nodes of one color are so far apart that no row of A_c meets two of
them. It is made anew where it has aged; in between it is an approximation, as a preconditioner may be. Contact is left out of
it.
"""

import numpy as np
import taichi as ti

from ..backend.fields import Fields
from ..backend.rows import write
from ..system.checkpoint import Checkpointed
from ..system.operator import Operator
from .lattice import Level
from .pointwise import Pointwise

MOST = 128  # nodes of a level that is solved exactly
RINGS = 2  # of neighbours that a force may couple a vertex with
WORTH = 150  # iterations that finding A_c costs: it is found anew when age has cost as many
LEAST = 1e-10  # part of the largest eigenvalue below which nothing of A_c is solved for


@ti.data_oriented
class Coarse(Checkpointed):
    """A_c and its inverse.

    Args:
        faces: (m, 3) of the cloths.
        particles: of every node, the particles that its hat meets; first: number of the first node.
    """

    STATE = ("inverse", "span", "cost", "excess")

    def __init__(self, fields: Fields, operator: Operator, jacobi: Pointwise, level: Level, first: int,
                 faces: np.ndarray) -> None:
        self.operator, self.jacobi, self.blocks = operator, jacobi, operator.blocks
        self.forces = [force for force in operator.forces if not force.of_contact]
        self.count, self.width = level.count, level.node.shape[1]
        self.size = fields.integer(2, data=np.array([first, level.count]))  # as kernels read them
        n = operator.model.n
        self.node, self.weight = fields.integer(n, self.width, level.node), fields.real(n, self.width, level.weight)
        self.p, self.q = fields.real(n, 3), fields.real(n, 3)
        self.inverse = fields.real(self.count**2, 9)
        self.couples = coupled(level, faces, jacobi.sewn.knot)
        self.colors = colored(self.couples)
        self._picked: np.ndarray = np.zeros(self.count, dtype=np.int32)
        self._out: np.ndarray = np.zeros((n, 3), dtype=operator.model.exchange)
        used = level.weight > 0
        self._hat = np.repeat(np.arange(n), used.sum(axis=1)), level.node[used], level.weight[used]
        self.span, self.cost, self.excess = 0.0, 0, 0

    def make(self, span: float) -> None:
        """For a system as linearized with c = span [s], if what there is will not do."""
        if abs(span - self.span) > 1e-3 * span or self.excess > WORTH:
            A = self._matrix()
            values, vectors = np.linalg.eigh(A)
            good = values > LEAST * values[-1]
            inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
            k = self.count
            write(self.inverse, inverse.reshape(k, 3, k, 3).transpose(0, 2, 1, 3).reshape(k * k, 9)
                  .astype(self.operator.model.exchange))
            self.span, self.cost, self.excess = span, 0, 0

    def count_iterations(self, iterations: int) -> None:
        """Iterations of a solve: how well it still does."""
        self.cost = min(self.cost or iterations, iterations)
        self.excess += max(iterations - self.cost, 0)

    def _matrix(self) -> np.ndarray:
        """(3 count, 3 count) A_c"""
        k = self.count
        blocks = np.zeros((k, 3, k, 3))
        particle, node, weight = self._hat
        for color in range(self.colors.max() + 1):
            self._picked[:] = self.colors == color
            mine = np.flatnonzero(self._picked)
            for d in range(3):
                self._probe(self._picked, d, self._out)
                rows = np.stack([np.bincount(node, weight * self._out[particle, c], k) for c in range(3)], axis=1)
                for m in mine:
                    near = self.couples[:, m]
                    blocks[near, :, m, d] = rows[near]
        A = blocks.reshape(3 * k, 3 * k)
        return (A + A.T) / 2

    @ti.kernel
    def _probe(self, picked: ti.types.ndarray(), d: int, out: ti.types.ndarray()):
        """S A S times the sum of some nodes' hats along axis d."""
        for i in range(self.operator.model.rows()):
            w = 0.0
            for k in ti.static(range(self.width)):
                if picked[self.node[i][k]] == 1:
                    w += self.weight[i][k]
            self.q[i] = w * ti.Vector([float(d == 0), float(d == 1), float(d == 2)])
        for i in range(self.operator.model.rows()):
            self.p[i] = self.jacobi.filter(i, self.jacobi.average(i, self.q))
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.multiply(t // self.blocks.grain)
        for i in range(self.operator.model.rows()):
            r = self.jacobi.filter(i, self.jacobi.average(i, self.q))
            for c in ti.static(range(3)):
                out[i, c] = r[c]

    @ti.func
    def multiply(self, block):
        """q = A p without contact."""
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            self.q[i] = self.operator.model.m[i] * self.p[i]
        for k in ti.static(range(len(self.forces))):
            self.forces[k].add_product(block, self.p, self.q)

    @ti.func
    def solve(self, n, r: ti.template()):
        """Node n's value of A_c^-1 r."""
        z = ti.Vector.zero(float, 3)
        first, count = self.size[0], self.size[1]
        for m in range(count):
            B, v = self.inverse[(n - first) * count + m], r[first + m]
            z += ti.Vector([B[0] * v[0] + B[1] * v[1] + B[2] * v[2], B[3] * v[0] + B[4] * v[1] + B[5] * v[2],
                            B[6] * v[0] + B[7] * v[1] + B[8] * v[2]])
        return z


def coupled(level: Level, faces: np.ndarray, knot: np.ndarray) -> np.ndarray:
    """(count, count) whether A_c may have a block between two nodes: whether what one's hat meets is within RINGS of what the
    other's does, over seams too.

    Args:
        knot: (n,) one particle for all that are sewn together.
    """
    here = np.zeros((len(level.node), level.count), dtype=bool)
    for node, weight in zip(level.node.T, level.weight.T):
        here[knot[weight > 0], node[weight > 0]] = True
    wide, corner = here.copy(), knot[faces]
    for _ in range(RINGS):
        touched = wide[corner].any(axis=1)
        for k in range(3):
            np.logical_or.at(wide, corner[:, k], touched)
    return (wide.T.astype(np.float32) @ here.astype(np.float32)) > 0


def colored(couples: np.ndarray) -> np.ndarray:
    """(count,) a color for each node, so that no node is coupled with two of the same color."""
    clash = (couples.astype(np.float32) @ couples.T.astype(np.float32)) > 0
    out = np.full(len(couples), -1)
    for n in np.argsort(-clash.sum(axis=1), kind="stable"):
        taken = set(out[clash[n]].tolist())
        out[n] = next(c for c in range(len(couples)) if c not in taken)
    return out
