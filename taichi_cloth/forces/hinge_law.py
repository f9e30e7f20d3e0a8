"""The loops over hinges, written once for all laws of bending over them.

A law gives the torque of a hinge at its condition C, see `hinge`: k C, plus the torque of a subclass (`extra_torque`).
Everything else is here: forces, energies and powers, the linear system, damping.
"""

from typing import Any

from ..backend.language import ti
from .hinge import hinge_condition, hinge_condition_change, turned_by
from .hinge_force import HingeForce


@ti.data_oriented
class HingeLaw(HingeForce):
    """Hinges with damping, by a law.

    Attributes:
        has_extra_torque: whether there is a torque beside k C, see `extra_torque`.
        has_crease_side: whether hinges have sides that they were creased to: `way` and `side`, functions of (e) and of (e, C).
    """

    has_extra_torque: bool = False
    has_crease_side: bool = False
    way: Any
    side: Any

    def build_stiffness(self) -> None:
        """Allocates the fields of implicit steps."""
        self.g, self.stiff = self._fields.real(self.elements.count, 9), True
        self.before = self._fields.real(self.elements.count)  # C where the step starts
        if self.exact:
            self.hessian = self._fields.real(self.elements.count, 81)

    @ti.func
    def turned(self, e):
        """C and dC as the hinge lies, whichever way it was creased."""
        e_x, a_x, b_x = self.arms(e, self.model.x)
        way = 1.0
        if ti.static(self.has_crease_side):
            way = self.way(e)
        return hinge_condition(e_x, a_x, b_x, self.rest[e][2], self.rest[e][3], way)

    @ti.func
    def strain(self, e):
        """C, dC and C_dot at the current state."""
        C, g_e, g_a, g_b = self.turned(e)
        if ti.static(self.has_crease_side):
            side = self.side(e, C)
            C, g_e, g_a, g_b = side * C, side * g_e, side * g_a, side * g_b
        C_dot = C * 0
        if ti.static(self.damps):
            C_dot = self.turning(e, g_e, g_a, g_b)
        return C, C_dot, g_e, g_a, g_b

    @ti.func
    def turning(self, e, g_e, g_a, g_b):
        """C_dot, from dC."""
        e_v, a_v, b_v = self.arms(e, self.model.v)
        return g_e.dot(e_v) + g_a.dot(a_v) + g_b.dot(b_v)

    @ti.func
    def extra_torque(self, e, C):
        """(torque, torque over displacement, slope, energy) of a hinge at the condition C, beside k C."""
        return 0.0, 0.0, 0.0, 0.0

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's hinges."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            C, C_dot, g_e, g_a, g_b = self.strain(e)
            s = -(self.rest[e][0] * C + self.rest[e][1] * C_dot)
            if ti.static(self.has_extra_torque):
                s -= self.extra_torque(e, C)[0]
            self.scatter(e, s * g_e, s * g_a, s * g_b, f, lo, hi)

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energy [J] in column `base`, then dissipated power / 2 and the rate at which the energy grows [W]. With
        `linearizes`, the linear system too."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        sums, over = ti.Vector.zero(dtype, 3), 0.0
        if ti.static(self.stiff):
            over = self.model.over[0]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            C, C_dot, g_e, g_a, g_b = self.strain(e)
            turning = self.turning(e, g_e, g_a, g_b)
            if ti.static(self.stiff and self.damps):
                if over > 0:
                    C_dot = turned_by(C, self.before[e]) / over
            if self.elements.primary[e] == 1:
                sums[0] += 0.5 * self.rest[e][0] * C * C
                sums[1] += 0.5 * self.rest[e][1] * C_dot * C_dot
                sums[2] += self.rest[e][0] * C * turning
                if over > 0:
                    sums[2] += self.rest[e][1] * C_dot * (turning - C_dot)
                if ti.static(self.has_extra_torque):
                    torque, secant, slope, energy = self.extra_torque(e, C)
                    sums[0] += energy
                    sums[2] += torque * turning
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(e, moves, c, over, C, C_dot, g_e, g_a, g_b, to, lo, hi)
        if ti.static(self.stiff):
            if linearizes == 1:
                # a loop of its own: Taichi does not see that a load at a fixed index depends on a store at a running one
                for e in range(self.elements.first[block], self.elements.first[block + 1]):
                    self.add_diagonal(e, to.P, lo, hi)
        report[block, base] = sums[0]
        report[block, base + 1] = sums[1]
        report[block, base + 2] = sums[2]

    @ti.func
    def linearize(self, e, moves, c, over, C, C_dot, g_e, g_a, g_b, to: ti.template(), lo, hi):
        """b += c (f + K motion); stores the block of -c D - c^2 K."""
        k, k_d = self.rest[e][0], self.rest[e][1]
        s, pull = k * C + k_d * C_dot, k * C
        m_e, m_a, m_b = self.arms(e, to.rhs_displacement)
        if moves == 1:
            s += k * (g_e.dot(m_e) + g_a.dot(m_a) + g_b.dot(m_b))
            self.before[e] = C  # where the step starts
        if ti.static(self.has_extra_torque):
            led = C
            if moves == 1:
                led += g_e.dot(m_e) + g_a.dot(m_a) + g_b.dot(m_b)
            torque, secant, slope, energy = self.extra_torque(e, led)
            s += torque
            k += secant if ti.static(not self.exact) else slope
            pull += self.extra_torque(e, C)[0]
        r_e, r_a, r_b = -c * s * g_e, -c * s * g_a, -c * s * g_b
        if ti.static(self.exact):
            e_x, a_x, b_x = self.arms(e, self.model.x)
            if over > 0:
                pull += k_d * C_dot
            if ti.static(self.has_crease_side):
                if self.turned(e)[0] * C < 0:
                    pull = -pull  # on the other side: ddC below is that of the angle as it is
            if moves == 1:
                d_e, d_a, d_b = hinge_condition_change(e_x, a_x, b_x, m_e, m_a, m_b, self.rest[e][2], self.rest[e][3])
                r_e, r_a, r_b = r_e - c * pull * d_e, r_a - c * pull * d_a, r_b - c * pull * d_b
        self.scatter(e, r_e, r_a, r_b, to.b, lo, hi)
        root = ti.sqrt(c * c * k + c * k_d)
        g_e, g_a, g_b = root * g_e, root * g_a, root * g_b
        for i in ti.static(range(3)):
            self.g[e][i] = g_e[i]
            self.g[e][3 + i] = g_a[i]
            self.g[e][6 + i] = g_b[i]
        if ti.static(self.exact):
            self.store_exact(e, c * c * pull)
