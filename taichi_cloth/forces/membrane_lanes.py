"""Explicit forces of woven cloth, a few triangles at a time: the same law as `membrane`, written for vector instructions."""

from typing import Any

from ..backend.language import ti
from .conditions import TINY
from .membrane_table import B_U, B_V, D_S, D_U, D_V, K_S, K_U, K_V
from .triangle_law import TriangleLaw

SIMD_WIDTH = 4  # elements whose forces a CPU thread takes together
APART = 8  # rows of `simd_scratch` between those of two threads


@ti.data_oriented
class MembraneLanes(TriangleLaw):
    """A law of woven cloth in which nothing stiffens.

    Attributes:
        table: rows of materials, see `membrane_table.row_of`; material: (m,) the row of each triangle.
        simd_scratch: where forces are written side by side; nobody reads them.
    """

    table: Any
    material: Any
    simd_scratch: Any

    @ti.func
    def add_forces(self, block, e, f: ti.template()):
        """f += forces of elements e, e + 1 ..., in `simd_width`, of which the compiler makes vector instructions.

        It does so where the forces are also written side by side, to `simd_scratch`, which nobody reads.
        """
        area = ti.Vector([self.area[e + j] for j in ti.static(range(self.simd_width))])
        k = [ti.Vector([self.table[self.material[e + j]][c] for j in ti.static(range(self.simd_width))])
             for c in ti.static(range(8))]
        vertex = [ti.Vector([self.elements.vertices[e + j][a] for j in ti.static(range(self.simd_width))])
                  for a in ti.static(range(3))]
        inverse = [ti.Vector([self.inverse[e + j][c] for j in ti.static(range(self.simd_width))]) for c in ti.static(range(4))]
        u, v = self.spread_lanes(vertex, inverse, self.model.x)
        size_u, size_v = ti.sqrt(dot(u, u)), ti.sqrt(dot(v, v))
        per_u, per_v = 1 / ti.max(size_u, TINY), 1 / ti.max(size_v, TINY)
        pull_u, pull_v, s = k[K_U] * (size_u - k[B_U]), k[K_V] * (size_v - k[B_V]), k[K_S] * dot(u, v)
        if ti.static(self.damps):
            du, dv = self.spread_lanes(vertex, inverse, self.model.v)
            pull_u += k[D_U] * dot(u, du) * per_u
            pull_v += k[D_V] * dot(v, dv) * per_v
            s += k[D_S] * (dot(du, v) + dot(dv, u))
        along_u, along_v, across = area * per_u * pull_u, area * per_v * pull_v, area * s
        q_1 = [(along_u * u[c] + across * v[c]) * inverse[0] + (along_v * v[c] + across * u[c]) * inverse[1]
               for c in ti.static(range(3))]
        q_2 = [(along_u * u[c] + across * v[c]) * inverse[2] + (along_v * v[c] + across * u[c]) * inverse[3]
               for c in ti.static(range(3))]
        for c in ti.static(range(3)):
            for j in ti.static(range(self.simd_width)):
                self.simd_scratch[APART * block][2 * c * self.simd_width + j] = q_1[c][j]
            for j in ti.static(range(self.simd_width)):
                self.simd_scratch[APART * block][(2 * c + 1) * self.simd_width + j] = q_2[c][j]
        for j in ti.static(range(self.simd_width)):
            f[vertex[0][j]] = f[vertex[0][j]] + ti.Vector([q_1[c][j] + q_2[c][j] for c in ti.static(range(3))])
            f[vertex[1][j]] = f[vertex[1][j]] - ti.Vector([q_1[c][j] for c in ti.static(range(3))])
            f[vertex[2][j]] = f[vertex[2][j]] - ti.Vector([q_2[c][j] for c in ti.static(range(3))])

    @ti.func
    def spread_lanes(self, vertex: ti.template(), inverse: ti.template(), q: ti.template()):
        """(w_u, w_v) of a per-vertex field on several elements, 3 vectors each of a number an element."""
        corner = [[ti.Vector([q[vertex[a][j]][c] for j in ti.static(range(self.simd_width))]) for c in ti.static(range(3))]
                  for a in ti.static(range(3))]
        u = [(corner[1][c] - corner[0][c]) * inverse[0] + (corner[2][c] - corner[0][c]) * inverse[2]
             for c in ti.static(range(3))]
        v = [(corner[1][c] - corner[0][c]) * inverse[1] + (corner[2][c] - corner[0][c]) * inverse[3]
             for c in ti.static(range(3))]
        return u, v


@ti.func
def dot(a: ti.template(), b: ti.template()):
    """a . b of 3 vectors each, whose numbers belong to different elements."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
