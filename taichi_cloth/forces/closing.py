"""The pull that closes open seams: bounded springs between stitched particles.

A stitch between x_a and x_b, with u = x_b - x_a, d = |u|, w = v_b - v_a, pulls with

    f_a = T u/d + c w = -f_b,    T = min(k d, F),    E = k d^2/2, or F d - F^2/2k beyond F,

F is the stitch's share of the seam's pull a length. k = F/CATCH: the pull is whole until the stitch is so near that it becomes
a constraint (`system.stitches`). c = F/CLOSING: free cloth closes at that speed, held cloth is pulled with F. A step's first
solve takes T/d of where the step is led to, in all directions, a bound of the second derivative; further ones the
derivative itself.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..scene.scene import Scene
from ..system.seams import CLOSING
from ..system.state import Elements, ParticleState
from ..system.stitches import CATCH
from .conditions import sym_outer, sym_scaled_identity, sym_times
from .force import Force


@ti.data_oriented
class Closing(Force):
    """Stitches of seams that have a pull, while they are apart."""

    energies = ("seams",)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self._fields = model, fields
        a, b = (np.concatenate([model.particle[getattr(s, name) + s.cloth.start] for s in scene.seams]) for name in "ab")
        self.pulls = np.concatenate([s.pulls for s in scene.seams])  # (k,) F [N], 0 if none
        self.elements = Elements(fields, model.blocks, np.stack([a, b], axis=1))
        self.F = fields.real(self.elements.count, data=np.zeros(self.elements.count))

    def release(self, whole: np.ndarray, pulled: np.ndarray) -> None:
        """See `Force`."""
        write(self.F, self.elements.per_entry(self.pulls * pulled).astype(self.model.exchange))

    def rounding_energy(self, d: float) -> float:
        """See `Force`."""
        return float(self.pulls.sum()) * d

    def build_stiffness(self) -> None:
        """See `Force`."""
        self.A, self.stiff = self._fields.real(self.elements.count, 6), True
        self.own = self._fields.real(self.model.n, 6)  # of each particle

    @ti.func
    def ratio(self, F, u):
        """T/d"""
        return F / ti.max(u.norm(), ti.static(CATCH))

    @ti.func
    def scatter(self, e, value, q: ti.template(), lo, hi):
        """q_a += value, q_b -= value"""
        v = self.elements.vertices[e]
        self.model.blocks.add(q, v[0], value, lo, hi)
        self.model.blocks.add(q, v[1], -value, lo, hi)

    @ti.func
    def across(self, e, q: ti.template()):
        """q_b - q_a"""
        v = self.elements.vertices[e]
        return q[v[1]] - q[v[0]]

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += the pull."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            F, u = self.F[e], self.across(e, self.model.x)
            self.scatter(e, self.ratio(F, u) * u + F / ti.static(CLOSING) * self.across(e, self.model.v), f, lo, hi)

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energy [J] in column `base`, then dissipated power / 2 and the rate at which the energy grows [W]. With
        `linearizes`, the linear system too."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        energy, damped, rate = ti.cast(0, dtype), ti.cast(0, dtype), ti.cast(0, dtype)
        if ti.static(self.stiff):
            if linearizes == 1:
                for i in range(lo, hi):
                    self.own[i] = ti.Vector.zero(float, 6)
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            F, u, w = self.F[e], self.across(e, self.model.x), self.across(e, self.model.v)
            if self.elements.primary[e] == 1:
                T = self.ratio(F, u) * u.norm()
                energy += T * u.norm() if F <= 0 else T * (u.norm() - 0.5 * T * ti.static(CATCH) / F)
                damped += 0.5 * F / ti.static(CLOSING) * w.norm_sqr()
                rate += self.ratio(F, u) * u.dot(w)
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(e, moves, c, F, u, w, to, lo, hi)
        report[block, base] = energy
        report[block, base + 1] = damped
        report[block, base + 2] = rate

    @ti.func
    def linearize(self, e, moves, c, F, u, w, to: ti.template(), lo, hi):
        """b += c (f + K motion); stores the block of -c D - c^2 K."""
        led, v = u, self.elements.vertices[e]
        if moves == 1:
            led += self.across(e, to.rhs_displacement)
        ratio = self.ratio(F, led)
        self.scatter(e, c * (ratio * led + F / ti.static(CLOSING) * w), to.b, lo, hi)
        A = sym_scaled_identity(c * c * ratio + c * F / ti.static(CLOSING))
        if moves == 0 and u.norm() > ti.static(CATCH):
            A -= c * c * ratio * sym_outer(u.normalized())
        self.A[e] = A
        for k in ti.static(range(2)):
            self.model.blocks.add(to.P, v[k], A, lo, hi)
            self.model.blocks.add(self.own, v[k], A, lo, hi)

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            self.scatter(e, -sym_times(self.A[e], self.across(e, p)), q, lo, hi)

    def build_levels(self, levels) -> None:
        """Nothing: a node's block is summed up from its particles'."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D, with either side of a stitch as if the other were held: they are of different hats."""
        return levels.add_diagonal(n, D, self.own)
