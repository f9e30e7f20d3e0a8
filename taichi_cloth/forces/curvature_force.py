"""Forces of patches on (x_uu, x_uv, x_vv), second derivatives of position: where they act, and their blocks in A, products
and levels.

A patch is a triangle with its neighbours, see `curvature_fit`: x_ab is a sum over a dozen vertices with constant weights.
"""

from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..system.elements import row_sums
from ..system.state import Elements, ParticleState
from .conditions import sym_outer, sym_scaled_identity
from .force import ElementForce


@ti.data_oriented
class CurvatureForce(ElementForce):
    """A force with the condition that its energy is one of x_ab alone, alike in all directions of space.

    Stored for an element and a step: the three factors of its block in A, and the directions of its damping.

    Attributes:
        model: the particles; elements: the patches; weight: (m, 3 width) weights of x_uu, x_uv and x_vv.
        damps: whether any patch is damped, or may be.
        remembers: whether `hysteresis` adds a part that turns with the triangle's frame, see `curvature_hysteresis`.
        A: (m, 3) factors of -c D - c^2 K; way: (m, 9) directions of damping, times the roots of their factors.
    """

    energies, multirate = ("bend",), True
    model: ParticleState
    damps: bool = False
    remembers: bool = False
    hysteresis: Any = None
    A: Any
    way: Any

    def _begin(self, fields: Fields, patches: list[tuple[np.ndarray, np.ndarray]], stiff: np.ndarray,
               k_d: np.ndarray) -> None:
        """The part of making that all laws share.

        Args:
            patches: of each cloth, (faces, width) particles and (faces, 3, width) weights.
            stiff: (m, 3) the largest stiffness that a patch may have [N m^3]; k_d: (m, 3) damping [N m^3 s].
        """
        self._fields, self.width = fields, max(v.shape[1] for v, _ in patches)
        corners = np.concatenate([_wider(v, self.width) for v, _ in patches])
        B = np.concatenate([np.pad(w, ((0, 0), (0, 0), (0, self.width - w.shape[2]))) for _, w in patches])
        self.elements = Elements(fields, self.model.blocks, corners)
        self.weight = fields.real(self.elements.count, 3 * self.width, self.elements.per_entry(
            B.reshape(-1, 3 * self.width)))
        self.damps |= bool(k_d.any())
        sizes = (np.abs(np.einsum("kma,km,kmb->kab", B, each, B)) for each in (stiff, k_d))
        self.rates = tuple(float(row_sums(corners, s, self.model.mass).max()) for s in sizes)
        self.host_corners, self.host_weight = corners, B  # a triangle each
        self._unit_energy = float(np.sum(stiff * np.sum(B**2, axis=2)) / 2)

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    @ti.func
    def second(self, e, q: ti.template()):
        """Second derivatives uu, uv, vv of a per-vertex field, as rows."""
        out = ti.Matrix.zero(float, 3, 3)
        for a in range(self.width):
            value = q[self.elements.vertices[e][a]]
            for m, c in ti.static(ti.ndrange(3, 3)):
                out[m, c] += self.weight[e][self.width * m + a] * value[c]
        return out

    @ti.func
    def scatter(self, e, r, q: ti.template(), lo, hi):
        """q += the transpose of `second`, of rows r"""
        for a in range(self.width):
            value = ti.Vector.zero(float, 3)
            for m, c in ti.static(ti.ndrange(3, 3)):
                value[c] += self.weight[e][self.width * m + a] * r[m, c]
            self.model.blocks.add(q, self.elements.vertices[e][a], value, lo, hi)

    @ti.func
    def add_diagonal(self, e, P: ti.template(), lo, hi):
        """P += the diagonal 3x3 blocks."""
        for a in range(self.width):
            own = ti.Vector.zero(float, 6)
            for m in ti.static(range(3)):
                square = self.weight[e][self.width * m + a] ** 2
                own += sym_scaled_identity(self.A[e][m] * square)
                if ti.static(self.damps):
                    own += square * sym_outer(self.direction(e, m))
            if ti.static(self.remembers):
                stiff = self.hysteresis.stiffness(e)
                for m in ti.static(range(3)):
                    own += sym_scaled_identity(stiff[m] * self.weight[e][self.width * m + a] ** 2)
            self.model.blocks.add(P, self.elements.vertices[e][a], own, lo, hi)
        if ti.static(self.remembers):
            for a in range(3):
                B = ti.Vector([self.weight[e][self.width * m + self.hysteresis.slot[e][a]] for m in ti.static(range(3))])
                own = self.hysteresis.frame_block(e, B, float(a == 1) - float(a == 0), float(a == 2) - float(a == 0))
                self.model.blocks.add(P, self.hysteresis.corner[e][a], own, lo, hi)

    @ti.func
    def direction(self, e, m: ti.template()):
        """Direction of the damping of term m, times the root of its factor."""
        return ti.Vector([self.way[e][3 * m], self.way[e][3 * m + 1], self.way[e][3 * m + 2]])

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p with the factors of the last `linearize`."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            r = self.second(e, p)
            more = r * 0
            if ti.static(self.remembers):
                more = self.hysteresis.add_product(e, r, p, q, lo, hi)
            for m in ti.static(range(3)):
                row = ti.Vector([r[m, 0], r[m, 1], r[m, 2]])
                out = self.A[e][m] * row
                if ti.static(self.damps):
                    way = self.direction(e, m)
                    out += way.dot(row) * way
                for c in ti.static(range(3)):
                    r[m, c] = out[c] + more[m, c]
            self.scatter(e, r, q, lo, hi)

    @ti.func
    def level_block(self, e, n, levels: ti.template()):
        """A patch's block, 6 numbers: isotropic, but for the part of its frame."""
        out, B, stiff = 0.0, ti.Vector.zero(float, 3), ti.Vector.zero(float, 3)
        if ti.static(self.remembers):
            stiff = self.hysteresis.stiffness(e)
        for m in ti.static(range(3)):
            for a in range(self.width):
                i = self.elements.vertices[e][a]
                B[m] += self.weight[e][self.width * m + a] * levels.hat(n, i) * levels.free(i)
            out += (self.A[e][m] + stiff[m]) * B[m] * B[m]
        block = sym_scaled_identity(out)
        if ti.static(self.remembers):
            s = ti.Vector.zero(float, 3)
            for a in ti.static(range(3)):
                i = self.hysteresis.corner[e][a]
                s[a] = levels.hat(n, i) * levels.free(i)
            block += self.hysteresis.frame_block(e, B, s[1] - s[0], s[2] - s[0])
        return block


def _wider(vertices: np.ndarray, width: int) -> np.ndarray:
    """Rows filled up with their first vertex."""
    return np.concatenate([vertices, np.repeat(vertices[:, :1], width - vertices.shape[1], axis=1)], axis=1)
