"""Forces of hinges on (e, a, b), an edge and the two arms from its first vertex: where they act, and their blocks in A,
products and levels."""

from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..system.elements import Hinges, flat_turns, row_sums
from ..system.state import Elements, ParticleState
from .conditions import sym, sym_outer, sym_scaled_identity
from .force import Force
from .hinge import hinge_condition_change


@ti.data_oriented
class HingeForce(Force):
    """A force of one condition C a hinge, see `hinge`.

    Stored for a hinge and a step: dC scaled by the root of its factor in A, 9 numbers in (e, a, b); in K mode "paper" the
    symmetric 9x9 block itself.

    Attributes:
        elements: the hinges; rest: (m, 4) k [N m], k_d [N m s], theta_0, and the least squared normal [m^4].
        damps: whether any hinge is damped, or may be; exact: whether K is.
    """

    energies, multirate = ("bend",), True
    model: ParticleState
    damps: bool = False
    exact: bool
    g: Any
    hessian: Any

    def _begin(self, fields: Fields, parts: list[Hinges], vertices: np.ndarray, rest: np.ndarray, stiff: np.ndarray) -> None:
        """The part of making that all laws share.

        Args:
            vertices: (hinges, 4) particles.
            rest: (hinges, 4) rows of `rest`; stiff: the same with the largest stiffness that a hinge may have.
        """
        self.elements, self._fields = Elements(fields, self.model.blocks, vertices), fields
        self.host_stiff = stiff
        self.host_hinges, self.host_turns = vertices.astype(np.int32), np.concatenate([flat_turns(h) for h in parts])
        self.damps |= bool(rest[:, 1].any())
        self.rest = fields.real(self.elements.count, 4, self.elements.per_entry(rest))
        heights2 = np.concatenate([(2 * h.areas).min(axis=1) ** 2 / h.length2 for h in parts])
        self._unit_energy = float(np.sum(stiff[:, 0] / heights2) / 2)
        # bounds on the squared frequency [1/s^2] and the damping rate [1/s] of any mode of flat cloth
        sizes = np.abs(np.einsum("ei,ej->eij", self.host_turns, self.host_turns))
        self.rates = tuple(float(row_sums(vertices, k[:, None, None] * sizes, self.model.mass).max()) for k in stiff[:, :2].T)

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    @ti.func
    def arms(self, e, q: ti.template()):
        """(e, a, b) of a per-vertex field."""
        v = self.elements.vertices[e]
        return q[v[1]] - q[v[0]], q[v[2]] - q[v[0]], q[v[3]] - q[v[0]]

    @ti.func
    def scatter(self, e, r_e, r_a, r_b, q: ti.template(), lo, hi):
        """q += d(e, a, b)/dx^T r"""
        v = self.elements.vertices[e]
        self.model.blocks.add(q, v[0], -(r_e + r_a + r_b), lo, hi)
        self.model.blocks.add(q, v[1], r_e, lo, hi)
        self.model.blocks.add(q, v[2], r_a, lo, hi)
        self.model.blocks.add(q, v[3], r_b, lo, hi)

    @ti.func
    def store_exact(self, e, factor):
        """The 9x9 block g g^T + factor ddC, a column at a time."""
        e_x, a_x, b_x = self.arms(e, self.model.x)
        for column in range(9):
            d = ti.Matrix.zero(float, 3, 3)
            for i, j in ti.static(ti.ndrange(3, 3)):
                if column == 3 * i + j:
                    d[i, j] = 1
            rows = hinge_condition_change(e_x, a_x, b_x, ti.Vector([d[0, 0], d[0, 1], d[0, 2]]),
                                          ti.Vector([d[1, 0], d[1, 1], d[1, 2]]),
                                          ti.Vector([d[2, 0], d[2, 1], d[2, 2]]), self.rest[e][2],
                                          self.rest[e][3])
            for i, j in ti.static(ti.ndrange(3, 3)):
                self.hessian[e][9 * column + 3 * i + j] = (self.g[e][column] * self.g[e][3 * i + j]
                                                          + factor * rows[i][j])

    @ti.func
    def add_diagonal(self, e, P: ti.template(), lo, hi):
        """P += the diagonal 3x3 blocks of the stored block."""
        v = self.elements.vertices[e]
        if ti.static(self.exact):
            first = ti.Matrix.zero(float, 3, 3)
            for i in ti.static(range(3)):
                own = ti.Matrix.zero(float, 3, 3)
                for r, s in ti.static(ti.ndrange(3, 3)):
                    own[r, s] = self.hessian[e][9 * (3 * i + r) + 3 * i + s]
                    for j in ti.static(range(3)):
                        first[r, s] += self.hessian[e][9 * (3 * i + r) + 3 * j + s]
                self.model.blocks.add(P, v[i + 1], sym(own), lo, hi)
            self.model.blocks.add(P, v[0], sym(first), lo, hi)
        else:
            g_e, g_a, g_b = self.gradient(e)
            g_0 = g_e + g_a + g_b
            self.model.blocks.add(P, v[0], sym_outer(g_0), lo, hi)
            self.model.blocks.add(P, v[1], sym_outer(g_e), lo, hi)
            self.model.blocks.add(P, v[2], sym_outer(g_a), lo, hi)
            self.model.blocks.add(P, v[3], sym_outer(g_b), lo, hi)

    @ti.func
    def gradient(self, e):
        """The stored, scaled dC."""
        g = ti.static(self.g)
        return (ti.Vector([g[e][0], g[e][1], g[e][2]]), ti.Vector([g[e][3], g[e][4], g[e][5]]),
                ti.Vector([g[e][6], g[e][7], g[e][8]]))

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p with the blocks of the last `linearize`."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            p_e, p_a, p_b = self.arms(e, p)
            if ti.static(self.exact):
                r = ti.Matrix.zero(float, 3, 3)
                for column in range(9):
                    s = self.pick(column, p_e, p_a, p_b)
                    for i, j in ti.static(ti.ndrange(3, 3)):
                        r[i, j] += self.hessian[e][9 * column + 3 * i + j] * s
                self.scatter(e, ti.Vector([r[0, 0], r[0, 1], r[0, 2]]), ti.Vector([r[1, 0], r[1, 1], r[1, 2]]),
                             ti.Vector([r[2, 0], r[2, 1], r[2, 2]]), q, lo, hi)
            else:
                g_e, g_a, g_b = self.gradient(e)
                s = g_e.dot(p_e) + g_a.dot(p_a) + g_b.dot(p_b)
                self.scatter(e, s * g_e, s * g_a, s * g_b, q, lo, hi)

    @ti.func
    def pick(self, column, p_e, p_a, p_b):
        """Component `column` of the 9 numbers (p_e, p_a, p_b)."""
        s = 0.0
        for i in ti.static(range(3)):
            if column == i:
                s = p_e[i]
            if column == 3 + i:
                s = p_a[i]
            if column == 6 + i:
                s = p_b[i]
        return s

    def build_levels(self, levels) -> None:
        """Sums of k and of k_d over the hinges that each node's hat bends, on the flat pattern."""
        sums = levels.squares(self.host_hinges, self.host_turns, self.host_stiff[:, :2])
        self.bent = self._fields.real(levels.count, 2, sums)

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D + s^T (-c D - c^2 K) s of flat cloth, the same in all directions."""
        return D + sym_scaled_identity(c * (c * self.bent[n][0] + self.bent[n][1]))
