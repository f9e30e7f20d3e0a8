"""The coarsest level of sewn cloth, solved exactly: panels that hang on each other move together at once.

    A_c = Q^T (A_0 + H) Q,   H_i = T_i + s (I - S_i),

with Q the hats of the coarsest level's nodes, averaged over particles that are sewn together. A_0 is the matrix without
contact; T_i are the diagonal blocks of contact. s is a stiffness that holds the directions constrained by the filter S: the
mean of the diagonal of A_0. Q^T A_0 Q is found by products with hats that have nothing in common: nodes of one color are so
far apart that no row meets two of them. Both parts are made anew when they have aged; in between they are an approximation,
as a preconditioner may be.
"""

from collections.abc import Callable

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import read, write
from ..forces.conditions import sym_scaled_identity
from ..system.checkpoint import Checkpointed
from ..system.operator import Operator
from .dense import inverted, inverted_in_part
from .galerkin import Hats, colored, coupled
from .lattice import Level
from .pointwise import Pointwise

FEW, MOST, SHARE = 128, 200, 30  # nodes of a level that is solved exactly: a part of the particles' number, within bounds
FIRST, SLACK = 8, 0.1  # solves whose mean others are held against, and part by which these may need more
PROBE = 3  # iterations that a product with hats costs: Q^T A_0 Q is found anew when age has cost as many as all of them
OLD = 100  # solves after which it is found anew in any case: `Drift` does not show a slow rise
LEAST = 1e-10  # of the mean of the diagonal of Q^T A_0 Q is added to it, in f32 a rounding


class Drift(Checkpointed):
    """How many iterations more solves need than they did at first, as a cumulative sum. [Page 1954]

    Contacts come and go, and solves need more or fewer iterations by them, with any preconditioner. Such changes around the
    same mean cancel in the sum; a lasting rise does not.

    Attributes:
        age: solves in all; solves, cost: so many, and the mean iterations of the first of them; excess: iterations beyond.
    """

    STATE = ("age", "solves", "cost", "excess")

    def __init__(self) -> None:
        self.age, self.solves, self.cost, self.excess = 0, 0, 0.0, 0.0

    def begin(self) -> None:
        """The next solves are the first from now on."""
        self.solves, self.cost = 0, 0.0

    def count_iterations(self, iterations: int) -> None:
        """Counts the iterations of a solve."""
        self.age += 1
        self.solves += 1
        if self.solves <= FIRST:
            self.cost += (iterations - self.cost) / self.solves
        else:
            self.excess = max(self.excess + iterations - (1 + SLACK) * self.cost, 0.0)


@ti.data_oriented
class Coarse(Checkpointed):
    """A_c and its inverse.

    Args:
        faces: (m, 3) of the cloths.
        first: number of the level's first node.
        tell: takes a sentence about directions that cannot be solved for.
    """

    STATE = ("matrix", "inverse", "span", "pressed", "drift")

    def __init__(self, fields: Fields, operator: Operator, jacobi: Pointwise, level: Level, first: int,
                 faces: np.ndarray, tell: Callable[[str], None]) -> None:
        self._tell, self._told = tell, False
        self.operator, self.jacobi, self.blocks = operator, jacobi, operator.blocks
        self.forces = [force for force in operator.forces if not force.of_contact]
        self.count, self.width = level.count, level.node.shape[1]
        self.size = fields.integer(2, data=np.array([first, level.count]))  # as kernels read them
        n = operator.model.n
        self.node, self.weight = fields.integer(n, self.width, level.node), fields.real(n, self.width, level.weight)
        self.p, self.q = fields.real(n, 3), fields.real(n, 3)
        self.inverse = fields.real(self.count**2, 9)
        self.couples = coupled(level, faces, jacobi.sewn.representative)
        self.colors = colored(self.couples)
        self.hats = Hats(level, jacobi.sewn)
        self._picked: np.ndarray = np.zeros(self.count, dtype=np.int32)
        self._out: np.ndarray = np.zeros((n, 3), dtype=operator.model.exchange)
        self._held: np.ndarray = np.zeros((n, 6), dtype=operator.model.exchange)
        self.matrix: np.ndarray = np.zeros((0, 0))
        self._least = max(LEAST, float(np.finfo(operator.model.exchange).eps))
        self.pressed: np.ndarray = np.zeros((n, 6))  # H
        self.span, self.drift = 0.0, Drift()
        self.worth = PROBE * 3 * (int(self.colors.max()) + 1)  # iterations
        self._weighed: tuple[np.ndarray, np.ndarray] | None = None  # Q^T M Q, and the seams' labels that it is of

    def make(self, c: float, contact) -> None:
        """Prepares for the system A = M - c D - c^2 K as it is linearized; reuses the old parts while they serve.

        Args:
            c: effective step [s].
            contact: field (n, 6) of diagonal blocks of contact, or None.
        """
        aged = self.span == 0 or self.drift.excess > self.worth or self.drift.age >= OLD
        changed = abs(c - self.span) > 1e-3 * c
        if aged:
            self.matrix, self.span, self.drift = self._matrix(), c, Drift()
        elif changed:  # all but the masses are nearly in proportion to c^2
            M = self._masses()
            self.matrix, self.span = M + (c / self.span) ** 2 * (self.matrix - M), c
            self.drift.begin()
        self._hold(contact, aged or changed)

    def _hold(self, contact, anew: bool) -> None:
        """Finds H, and inverts A_c if `anew` or if H is another than it was."""
        pressed = self._find_pressed(contact)
        if anew or not np.array_equal(pressed, self.pressed):
            self.pressed = pressed
            self._invert()

    def _invert(self) -> None:
        """A_c^-1, on the host."""
        k = self.count
        blocks = self._inverted().reshape(k, 3, k, 3).transpose(0, 2, 1, 3).reshape(k * k, 9)
        write(self.inverse, blocks.astype(self.operator.model.exchange))

    def count_iterations(self, iterations: int) -> None:
        """Iterations of a solve: how well it still does."""
        self.drift.count_iterations(iterations)

    def _matrix(self) -> np.ndarray:
        """(3 count, 3 count) Q^T A_0 Q"""
        k = self.count
        blocks = np.zeros((k, 3, k, 3))
        for color in range(self.colors.max() + 1):
            self._picked[:] = self.colors == color
            entries = self.hats.entries_of(np.any(self.couples[:, self.colors == color], axis=1))
            for d in range(3):
                self._probe(self._picked, d, self._out)
                rows = self.hats.transposed(self._out, entries)
                for m in np.flatnonzero(self._picked):
                    near = self.couples[:, m]
                    blocks[near, :, m, d] = rows[near]
        A = blocks.reshape(3 * k, 3 * k)
        return (A + A.T) / 2

    def _inverted(self) -> np.ndarray:
        """(3 count, 3 count) inverse of A_c.

        Hats depend on each other where they meet nothing but one seam, or lie across a flat panel: Q^T A_0 Q may be singular,
        and gets a little on its diagonal. If it is not positive definite even so, eigenvectors with smaller eigenvalues are
        left to the other levels.
        """
        A, index = self.matrix, np.flatnonzero(self.pressed[:, [0, 3, 5]].any(axis=1))
        least, loads = self.least, self.hats.summed(index, self.pressed[index]).reshape(A.shape)
        try:
            return inverted(A + least * np.eye(len(A)) + loads)
        except np.linalg.LinAlgError:
            pass
        try:
            out, left = inverted_in_part(A + loads, least)
        except np.linalg.LinAlgError:  # not finite, as the whole system: its solve says so
            self.span = 0.0
            return np.zeros(A.shape)
        if not self._told:
            self._tell(f"solver: its coarsest level leaves {left} of {len(A)} directions to the finer ones, as under layers "
                       "that press hard: solves may take longer, and are no less exact")
        self._told = True
        return out

    @property
    def least(self) -> float:
        """Added to the diagonal."""
        return self._least * float(np.trace(self.matrix)) / len(self.matrix)

    @property
    def stiffness(self) -> float:
        """s"""
        return float(np.trace(self.matrix)) / len(self.matrix)

    def _masses(self) -> np.ndarray:
        """(3 count, 3 count) Q^T M Q"""
        if self._weighed is None or self._weighed[1] is not self.hats.sewn.label:
            mass = read(self.operator.model.m).astype(np.float64)
            blocks = mass[:, None] * np.array([1.0, 0, 0, 1, 0, 1])
            M = self.hats.summed(np.arange(len(mass)), blocks).reshape(3 * self.count, 3 * self.count)
            self._weighed = M, self.hats.sewn.label
        return self._weighed[0]

    def _find_pressed(self, contact) -> np.ndarray:
        """(n, 6) H"""
        self._find_held(self.stiffness, self._held)
        return self._held.copy() if contact is None else self._held + read(contact)

    @ti.kernel
    def _find_held(self, stiffness: float, out: ti.types.ndarray()):
        """s (I - S_i)"""
        for i in range(self.operator.model.rows()):
            H = ti.Vector.zero(float, 6)
            if self.jacobi.is_held[i] == 1:
                H = stiffness * (sym_scaled_identity(1.0) - self.jacobi.S[i])
            for c in ti.static(range(6)):
                out[i, c] = H[c]

    @ti.kernel
    def _probe(self, picked: ti.types.ndarray(), d: int, out: ti.types.ndarray()):
        """A_0 times the sum of some nodes' hats along axis d, with the seams' means."""
        for i in range(self.operator.model.rows()):
            w = 0.0
            for k in ti.static(range(self.width)):
                if picked[self.node[i][k]] == 1:
                    w += self.weight[i][k]
            self.q[i] = w * ti.Vector([float(d == 0), float(d == 1), float(d == 2)])
        for i in range(self.operator.model.rows()):
            self.p[i] = self.jacobi.average(i, self.q)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.multiply(t // self.blocks.grain)
        for i in range(self.operator.model.rows()):
            r = self.jacobi.average(i, self.q)
            for c in ti.static(range(3)):
                out[i, c] = r[c]

    @ti.func
    def multiply(self, block):
        """q = A_0 p"""
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


def most_nodes(n: int) -> int:
    """Largest number of nodes of a level that is solved exactly, for n particles: it may cost as much as a few iterations."""
    return min(max(FEW, n // SHARE), MOST)
