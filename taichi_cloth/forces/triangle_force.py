"""Forces of triangles on (w_u, w_v): where they act, and their symmetric 6x6 blocks in A, products and levels.

With d_1, d_2 the edges from the first corner and R the inverse of the material edges, (w_u, w_v) = (d_1, d_2) R (9).
"""

from typing import Any

from ..backend.language import ti
from ..system.state import Elements, ParticleState
from .conditions import sym, sym_unpack
from .force import ElementForce


@ti.data_oriented
class TriangleForce(ElementForce):
    """A force with the condition that its energy is one of (w_u, w_v) alone.

    Attributes:
        model: the particles; elements: the triangles; inverse: (m, 4) R.
        A: (m, 21) blocks 11 (6 numbers), 12 (9) and 22 (6) of -c D - c^2 K in the two edges, for implicit steps.
    """

    model: ParticleState
    elements: Elements
    inverse: Any
    A: Any

    @ti.func
    def spread(self, e, q: ti.template()):
        """(w_u, w_v) of a per-vertex field (9)."""
        vertices, inverse = self.elements.vertices[e], self.inverse[e]
        d_1, d_2 = q[vertices[1]] - q[vertices[0]], q[vertices[2]] - q[vertices[0]]
        return d_1 * inverse[0] + d_2 * inverse[2], d_1 * inverse[1] + d_2 * inverse[3]

    @ti.func
    def scatter(self, e, r_u, r_v, q: ti.template(), lo, hi):
        """q += dw/dx^T (r_u, r_v)"""
        vertices, inverse = self.elements.vertices[e], self.inverse[e]
        q_1, q_2 = r_u * inverse[0] + r_v * inverse[1], r_u * inverse[2] + r_v * inverse[3]
        self.model.blocks.add(q, vertices[0], -(q_1 + q_2), lo, hi)
        self.model.blocks.add(q, vertices[1], q_1, lo, hi)
        self.model.blocks.add(q, vertices[2], q_2, lo, hi)

    @ti.func
    def store(self, e, uu, uv, vv, P: ti.template(), lo, hi):
        """The blocks in (w_u, w_v) as blocks in the two edges: 11, 12, 22."""
        i = self.inverse[e]
        both = sym(uv + uv.transpose())
        e_11 = i[0] * i[0] * uu + i[0] * i[1] * both + i[1] * i[1] * vv
        e_22 = i[2] * i[2] * uu + i[2] * i[3] * both + i[3] * i[3] * vv
        e_12 = i[0] * i[3] * uv + i[1] * i[2] * uv.transpose() + sym_unpack(i[0] * i[2] * uu + i[1] * i[3] * vv)
        for a in ti.static(range(6)):
            self.A[e][a] = e_11[a]
            self.A[e][15 + a] = e_22[a]
        for a, b in ti.static(ti.ndrange(3, 3)):
            self.A[e][6 + 3 * a + b] = e_12[a, b]
        vertices = self.elements.vertices[e]
        self.model.blocks.add(P, vertices[0], e_11 + e_22 + sym(e_12 + e_12.transpose()), lo, hi)
        self.model.blocks.add(P, vertices[1], e_11, lo, hi)
        self.model.blocks.add(P, vertices[2], e_22, lo, hi)

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p with the blocks of the last `linearize`."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            vertices = self.elements.vertices[e]
            x, y = p[vertices[1]] - p[vertices[0]], p[vertices[2]] - p[vertices[0]]
            A = ti.static(self.A)
            q_1 = ti.Vector([
                A[e][0] * x[0] + A[e][1] * x[1] + A[e][2] * x[2] + A[e][6] * y[0] + A[e][7] * y[1] + A[e][8] * y[2],
                A[e][1] * x[0] + A[e][3] * x[1] + A[e][4] * x[2] + A[e][9] * y[0] + A[e][10] * y[1] + A[e][11] * y[2],
                A[e][2] * x[0] + A[e][4] * x[1] + A[e][5] * x[2] + A[e][12] * y[0] + A[e][13] * y[1] + A[e][14] * y[2]])
            q_2 = ti.Vector([
                A[e][6] * x[0] + A[e][9] * x[1] + A[e][12] * x[2] + A[e][15] * y[0] + A[e][16] * y[1] + A[e][17] * y[2],
                A[e][7] * x[0] + A[e][10] * x[1] + A[e][13] * x[2] + A[e][16] * y[0] + A[e][18] * y[1] + A[e][19] * y[2],
                A[e][8] * x[0] + A[e][11] * x[1] + A[e][14] * x[2] + A[e][17] * y[0] + A[e][19] * y[1] + A[e][20] * y[2]])
            self.model.blocks.add(q, vertices[0], -(q_1 + q_2), lo, hi)
            self.model.blocks.add(q, vertices[1], q_1, lo, hi)
            self.model.blocks.add(q, vertices[2], q_2, lo, hi)

    @ti.func
    def level_block(self, e, n, levels: ti.template()):
        """A triangle's, 6 numbers."""
        v = self.elements.vertices[e]
        w = ti.Vector([levels.hat(n, v[0]), levels.hat(n, v[1]), levels.hat(n, v[2])])
        out = self.free_level_block(e, w, levels)
        if ti.static(levels.has_contact):
            if levels.partly(v[0]) or levels.partly(v[1]) or levels.partly(v[2]):
                A = self.A[e]
                S_0 = levels.shape(v[0], w[0])
                E, F = levels.shape(v[1], w[1]) - S_0, levels.shape(v[2], w[2]) - S_0
                mixed = ti.Matrix([[A[6], A[7], A[8]], [A[9], A[10], A[11]], [A[12], A[13], A[14]]])
                half = E @ mixed @ F
                first = sym_unpack(ti.Vector([A[0], A[1], A[2], A[3], A[4], A[5]]))
                second = sym_unpack(ti.Vector([A[15], A[16], A[17], A[18], A[19], A[20]]))
                out = sym(E @ first @ E + F @ second @ F + half + half.transpose())
        return out

    @ti.func
    def free_level_block(self, e, w, levels: ti.template()):
        """The same for a hat with values w at the corners, each held in all directions or in none."""
        A, v = self.A[e], self.elements.vertices[e]
        w_0 = w[0] * levels.free(v[0])
        x, y = w[1] * levels.free(v[1]) - w_0, w[2] * levels.free(v[2]) - w_0
        both = ti.Vector([2 * A[6], A[7] + A[9], A[8] + A[12], 2 * A[10], A[11] + A[13], 2 * A[14]])
        return (x * x * ti.Vector([A[0], A[1], A[2], A[3], A[4], A[5]]) + x * y * both
                + y * y * ti.Vector([A[15], A[16], A[17], A[18], A[19], A[20]]))
