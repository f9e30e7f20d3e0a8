"""The loops over patches, written once for all laws of bending by curvatures.

A law says how a patch's energy goes with its second derivatives x_uu, x_uv, x_vv: its first derivative and its second one.
Everything else is here: forces, energies, powers, the linear system, damping.

Damping is that of the conditions C = |x_ab|, along x_ab: a cloth that turns as a whole is not slowed down.
"""

from abc import abstractmethod

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from .conditions import TINY, unit
from .curvature_force import CurvatureForce


@ti.data_oriented
class CurvatureLaw(CurvatureForce):
    """Patches with damping, by a law that subclasses have."""

    def _begin(self, fields: Fields, patches: list[tuple[np.ndarray, np.ndarray]], stiff: np.ndarray,
               k_d: np.ndarray) -> None:
        """See `CurvatureForce`."""
        super()._begin(fields, patches, stiff, k_d)
        if self.damps:
            self.k_d = fields.real(self.elements.count, 3, self.elements.per_entry(k_d))

    @abstractmethod
    def add_energy(self, e, q, moved, sums):
        """sums[0] += energy [J] at second derivatives q [1/m], rows uu, uv, vv; sums[2] += the rate [W] of its growth,
        where q changes by `moved` [1/(m s)]."""

    @abstractmethod
    def moment(self, e, q):
        """dE/dq [N m^2], rows uu, uv, vv."""

    @abstractmethod
    def stiffness(self, e, q):
        """d2E/dq2 [N m^3] of uu, uv and vv, the same in all directions of space, a vector. None of them is negative."""

    def build_stiffness(self) -> None:
        """Allocates the fields that only an implicit step needs."""
        self.A, self.stiff = self._fields.real(self.elements.count, 3), True
        if self.damps:
            self.way, self.before = self._fields.real(self.elements.count, 9), self._fields.real(self.elements.count, 3)
        if self.remembers:
            self.hysteresis.build_stiffness(self._fields)

    @ti.func
    def along(self, e, q, u, over):
        """Parts of the rows of u along the rows of q; if `over` > 0, the growth of those rows over that time [s] instead."""
        out = u
        for m in ti.static(range(3)):
            row = ti.Vector([q[m, 0], q[m, 1], q[m, 2]])
            n = unit(row)
            part = n[0] * u[m, 0] + n[1] * u[m, 1] + n[2] * u[m, 2]
            if ti.static(self.stiff):
                if over > 0:
                    part = (row.norm() - self.before[e][m]) / over
            for c in ti.static(range(3)):
                out[m, c] = part * n[c]
        return out

    @ti.func
    def pull(self, e, q, over):
        """Minus the force on second derivatives that are q: of stretch and of damping."""
        out = self.moment(e, q)
        if ti.static(self.damps):
            u = self.along(e, q, self.second(e, self.model.v), over)
            for m, c in ti.static(ti.ndrange(3, 3)):
                out[m, c] += self.k_d[e][m] * u[m, c]
        return out

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's patches."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            q = self.second(e, self.model.x)
            r = self.pull(e, q, 0.0)
            if ti.static(self.remembers):
                r += self.hysteresis.add_force(e, q, f, lo, hi)
            self.scatter(e, -r, f, lo, hi)

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
            q = self.second(e, self.model.x)
            if self.elements.primary[e] == 1:
                moved = self.second(e, self.model.v)
                self.add_energy(e, q, moved, sums)
                if ti.static(self.remembers):
                    energy, rate = self.hysteresis.stored(e, q, moved)
                    sums[0] += energy
                    sums[2] += rate
                if ti.static(self.damps):
                    u = self.along(e, q, moved, over)
                    for m, d in ti.static(ti.ndrange(3, 3)):
                        sums[1] += 0.5 * self.k_d[e][m] * u[m, d] ** 2
                        if over > 0:
                            sums[2] += self.k_d[e][m] * u[m, d] * (moved[m, d] - u[m, d])
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(e, moves, c, over, q, to, lo, hi)
        if ti.static(self.stiff):
            if linearizes == 1:
                for e in range(self.elements.first[block], self.elements.first[block + 1]):
                    self.add_diagonal(e, to.P, lo, hi)
        report[block, base] = sums[0]
        report[block, base + 1] = sums[1]
        report[block, base + 2] = sums[2]

    @ti.func
    def linearize(self, e, moves, c, over, q, to: ti.template(), lo, hi):
        """b += c (f + K motion); keeps the factors of -c D - c^2 K. They have no negative part of damping as an energy."""
        r, moved, k = self.pull(e, q, over), q * 0, self.stiffness(e, q)
        if moves == 1:
            moved = self.second(e, to.rhs_displacement)
            for m, d in ti.static(ti.ndrange(3, 3)):
                r[m, d] += k[m] * moved[m, d]
        if ti.static(self.remembers):
            r += self.hysteresis.linearize(e, moves, c, q, moved, to, lo, hi)
        self.scatter(e, -c * r, to.b, lo, hi)
        for m in ti.static(range(3)):
            self.A[e][m] = c * c * k[m]
        if ti.static(self.damps):
            for m in ti.static(range(3)):
                row, k_d = ti.Vector([q[m, 0], q[m, 1], q[m, 2]]), self.k_d[e][m]
                if moves == 1:
                    self.before[e][m] = row.norm()  # where the step starts
                if over > 0:
                    left = ti.min(self.before[e][m] / ti.max(row.norm(), TINY), 1.0)
                    self.A[e][m] += c * k_d * (1 - left)
                    k_d *= left
                way = ti.sqrt(c * k_d) * unit(row)
                for d in ti.static(range(3)):
                    self.way[e][3 * m + d] = way[d]
