"""The loops over triangles, written once for all laws of stretch and shear.

A law says, per area of the pattern, how a triangle's energy goes with (w_u, w_v), the columns of F (9): its first derivative
and its second one. Everything else is here: forces, energies, powers, the linear system, damping, measures for step control.

Damping is that of the conditions C = |w_u|, |w_v| and w_u . w_v: k_d/2 C_dot^2 of power per area for each.
"""

from abc import abstractmethod
from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from .conditions import sym_outer, sym_times, unit
from .triangle_force import TriangleForce


@ti.data_oriented
class TriangleLaw(TriangleForce):
    """Triangles with damping, by a law that subclasses have.

    Stored for an element and a step: the symmetric 6x6 block of A in the edges (x_1 - x_0, x_2 - x_0), 21 numbers.

    Attributes:
        area: (m,) of triangles in the pattern [m^2].
        damps: whether any triangle is damped, or may be.
        simd_width: elements whose forces a CPU thread takes together; above 1 there is add_forces(block, e, f) for so many.
        used: (e, w_u, w_v) gives the largest strain over its limit, 1 at a limit, where the law `stiffens_sharply`.
        mode: K of the conditions.
    """

    extremes = 2
    area: Any
    damps: bool
    simd_width: int = 1
    add_forces: Any
    used: Any
    mode: str

    def _begin(self, fields: Fields, unit_energy: float) -> None:
        """The part of making that all laws share.

        Args:
            unit_energy: of strains that are but a rounding of positions by 1 m [J].
        """
        self._fields, self._unit_energy = fields, unit_energy
        self.indefinite = self.mode == "projected"

    @abstractmethod
    def rest(self, e):
        """(b_u, b_v), the |w_u| and |w_v| at which nothing pulls."""

    @abstractmethod
    def viscosity(self, e):
        """k_d of warp, weft and shear [N s/m], a vector."""

    @abstractmethod
    def add_energy(self, e, area, w_u, w_v, v_u, v_v, sums):
        """sums += energies [J] of so much area, one a term, and behind dissipation the rate [W] at which they grow."""

    @abstractmethod
    def gradient(self, e, w_u, w_v, u, v, s_dot):
        """(g_u, g_v) per area, minus the force on (w_u, w_v), damping at these rates of the conditions included."""

    @abstractmethod
    def stiffness(self, e, w_u, w_v, u, v, s, over, whole):
        """Per area, blocks uu (6 numbers), uv (3x3), vv (6) of -K in (w_u, w_v). If `over` > 0 [s], with damping as an energy
        at the rates u, v, s. Positive semidefinite unless `whole` is 1 or K mode "paper" asks for the exact one."""

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    def build_stiffness(self) -> None:
        """Allocates the fields of implicit steps."""
        self.A, self.stiff = self._fields.real(self.elements.count, 21), True
        self.whole: Any = self._fields.real(1, data=np.ones(1))  # 1 if K is whole where damping is an energy

    def leave_out(self, part: bool) -> None:
        """Negative eigenvalues. They are in the matrix only where damping is an energy, so never in a step's first solve."""
        write(self.whole, np.array([not part], dtype=self.model.exchange))

    @ti.func
    def speeds(self, w_u, w_v, v_u, v_v):
        """C_dot of warp, weft and shear."""
        return unit(w_u).dot(v_u), unit(w_v).dot(v_v), v_u.dot(w_v) + v_v.dot(w_u)

    @ti.func
    def damping(self, k_d, w_u, w_v):
        """Per area, blocks uu, uv, vv of -D in (w_u, w_v): k_d dC dC^T (12)."""
        uu = k_d[0] * sym_outer(unit(w_u)) + k_d[2] * sym_outer(w_v)
        vv = k_d[1] * sym_outer(unit(w_v)) + k_d[2] * sym_outer(w_u)
        return uu, k_d[2] * w_v.outer_product(w_u), vv

    def change_beside(self, led: np.ndarray) -> float:
        """The largest change of triangles none of whose corners are among the particles `led` (n,)."""
        return float(self._change_beside(led.astype(np.int32)))

    @ti.kernel
    def _change_beside(self, led: ti.types.ndarray()) -> float:
        largest = 0.0
        for e in range(self.elements.first[self.model.blocks.count]):
            v = self.elements.vertices[e]
            if led[v[0]] + led[v[1]] + led[v[2]] == 0:
                w_u, w_v = self.spread(e, self.model.x)
                o_u, o_v = self.spread(e, self.model.x_saved)
                b_u, b_v = self.rest(e)
                ti.atomic_max(largest, ti.max(strayed(o_u.norm(), w_u.norm(), b_u), strayed(o_v.norm(), w_v.norm(), b_v)))
        return largest

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's elements; of those that it owns whole, a few at a time."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        first = self.elements.first[block]
        if ti.static(self.simd_width > 1):
            groups = (self.elements.shared[block] - first) // self.simd_width
            for group in range(groups):
                self.add_forces(block, first + group * self.simd_width, f)
            first += groups * self.simd_width
        for e in range(first, self.elements.first[block + 1]):
            w_u, w_v = self.spread(e, self.model.x)
            v_u, v_v = self.spread(e, self.model.v)
            r_u, r_v, r_s = self.speeds(w_u, w_v, v_u, v_v)
            g_u, g_v = self.gradient(e, w_u, w_v, r_u, r_v, r_s)
            self.scatter(e, -self.area[e] * g_u, -self.area[e] * g_v, f, lo, hi)

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energies by term [J], from column `base`; dissipated power / 2 [W]; the rate at which the energies grow [W]; largest
        |w| / b, by how much any went away from rest since the saved state, the used part of limits. With `linearizes`, the
        linear system too."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        n = ti.static(len(self.energies))
        sums, largest, change, used, over, whole = ti.Vector.zero(dtype, n + 2), 0.0, 0.0, 0.0, 0.0, 0.0
        if ti.static(self.stiff):
            over = self.model.over[0]
            if over > 0:
                whole = self.whole[0]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            w_u, w_v = self.spread(e, self.model.x)
            v_u, v_v = self.spread(e, self.model.v)
            o_u, o_v = self.spread(e, self.model.x_saved)
            b_u, b_v = self.rest(e)
            k_d = ti.Vector.zero(float, 3)
            if ti.static(self.damps):
                k_d = self.viscosity(e)
            u, v, u_0, v_0 = w_u.norm(), w_v.norm(), o_u.norm(), o_v.norm()
            u_dot, v_dot, s_dot = self.speeds(w_u, w_v, v_u, v_v)
            r_u, r_v, r_s = u_dot, v_dot, s_dot
            if ti.static(self.stiff and self.damps):
                if over > 0:
                    r_u, r_v, r_s = (u - u_0) / over, (v - v_0) / over, (w_u.dot(w_v) - o_u.dot(o_v)) / over
            largest = ti.max(largest, ti.max(u / b_u, v / b_v))
            change = ti.max(change, ti.max(strayed(u_0, u, b_u), strayed(v_0, v, b_v)))
            if ti.static(self.stiffens_sharply):
                used = ti.max(used, self.used(e, w_u, w_v))
            if self.elements.primary[e] == 1:
                area = self.area[e]
                self.add_energy(e, area, w_u, w_v, v_u, v_v, sums)
                if ti.static(self.damps):
                    sums[n] += 0.5 * area * (k_d[0] * r_u ** 2 + k_d[1] * r_v ** 2 + k_d[2] * r_s ** 2)
                    if over > 0:
                        sums[n + 1] += area * (k_d[0] * r_u * (u_dot - r_u) + k_d[1] * r_v * (v_dot - r_v)
                                               + k_d[2] * r_s * (s_dot - r_s))
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(e, moves, c, k_d, w_u, w_v, r_u, r_v, r_s, over, whole, to, lo, hi)
        for i in ti.static(range(n + 2)):
            report[block, base + i] = sums[i]
        report[block, base + n + 2] = largest
        report[block, base + n + 3] = change
        if ti.static(self.stiffens_sharply):
            report[block, base + n + 4] = used

    @ti.func
    def linearize(self, e, moves, c, k_d, w_u, w_v, u, v, s, over, whole, to: ti.template(), lo, hi):
        """b += c (f + K motion); stores the block of -c D - c^2 K and adds its diagonal to P."""
        g_u, g_v = self.gradient(e, w_u, w_v, u, v, s)
        uu, uv, vv = self.stiffness(e, w_u, w_v, u, v, s, over, whole)
        if moves == 1:
            m_u, m_v = self.spread(e, to.rhs_displacement)
            g_u += sym_times(uu, m_u) + uv @ m_v
            g_v += uv.transpose() @ m_u + sym_times(vv, m_v)
        scale = c * self.area[e]
        self.scatter(e, -scale * g_u, -scale * g_v, to.b, lo, hi)
        uu, uv, vv = c * scale * uu, c * scale * uv, c * scale * vv
        if ti.static(self.damps):
            if over == 0:
                d_uu, d_uv, d_vv = self.damping(k_d, w_u, w_v)
                uu += scale * d_uu
                uv += scale * d_uv
                vv += scale * d_vv
        self.store(e, uu, uv, vv, to.P, lo, hi)


@ti.func
def strayed(before, now, rest):
    """By how much a length |w| has gone away from rest, in parts of it: cloth that was let go and springs back does not
    count."""
    past, gone = before / rest - 1, ti.abs(now / rest - 1)
    return ti.select(past * (now / rest - 1) > 0, ti.max(gone - ti.abs(past), 0.0), gone)
