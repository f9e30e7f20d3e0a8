"""Bending by curvatures: E = area D/2 |x_ab|^2 a triangle, x_ab the second derivatives of position in the material plane.

They come from the divergence theorem, x_ab = 1/area sum over edges of n_a l x_b, with one gradient x_b an edge, shared by its
two triangles. It is the mean of two gradients at the edge's middle: those of quadratics through each triangle and its three
neighbours. It is exact for quadratics on any triangulation, and the forces of a constant curvature cancel at inner vertices.
The rigidity is therefore D on irregular meshes too; a hinge's is D on equilateral ones only, 0.8 to 3 D on others. For
deformations that keep lengths |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2 is the sum of squares of the curvatures [Bergou et al. 2006];
patches of triangles without rotations as in [Onate, Zarate 2000]. Forces are linear in positions: a constant matrix, the same
in all three coordinates.

Friction between fibres and creases are in `curvature_hysteresis`.

Differs from [BW98 §4.2]: no angle; the rest shape is flat. Damping is that of the conditions C = |x_ab|, along x_ab: a
cloth that turns as a whole is not slowed down.
"""

from dataclasses import fields as fields_of
from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..errors import SceneError
from ..scene.fabric import remembers
from ..scene.scene import Scene
from ..system.elements import row_sums
from ..system.state import Elements, ParticleState
from .conditions import TINY, sym_outer, sym_scaled_identity, unit
from .curvature_fit import curvatures
from .curvature_law import CurvatureLaw, curvature_law, moduli_of, own_part
from .force import ElementForce


@ti.data_oriented
class CurvatureBend(ElementForce):
    """Bending by curvatures with damping.

    Stored for an element: weights of a dozen vertices, the three factors of its block in A, and the directions of its
    damping.
    """

    energies, slow = ("bend",), True

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self._fields = model, fields
        vertices, weights, factors, faces, laws = [], [], [], [], []
        for cloth in scene.cloths:
            bend = cloth.fabric.bend
            if bend is None or bend.model != "curvature":
                continue
            if bend.rest not in (None, "flat"):
                raise SceneError(f"{cloth.name}: bending by curvatures has a flat rest shape; another needs model='hinge'")
            if mode == "paper" and remembers(bend):
                raise SceneError(f"{cloth.name}: bending by curvatures that remembers has no exact K: leave K out, or use "
                                 "model='hinge'")
            v, B, area = curvatures(cloth.mesh)
            vertices.append(model.particle[v + cloth.start])
            weights.append(B)
            faces.append(cloth.mesh.faces + cloth.start)
            factors.append(area[:, None] * np.array([moduli_of(bend.D) + moduli_of(bend.k_d)]))
            laws.append((own_part(bend), curvature_law(bend, cloth.mesh)))
        self.width = max(v.shape[1] for v in vertices)
        corners = np.concatenate([_wider(v, self.width) for v in vertices])
        B = np.concatenate([np.pad(w, ((0, 0), (0, 0), (0, self.width - w.shape[2]))) for w in weights])
        factor = np.concatenate(factors)
        self.elements = Elements(fields, model.blocks, corners)
        self.host_faces, self.host_factor = np.concatenate(faces), factor[:, :3].copy()
        stiff = factor.copy()
        self.hysteresis: Any = None
        law = CurvatureLaw(*(np.concatenate([getattr(law, f.name) for _, law in laws]) for f in fields_of(CurvatureLaw)))
        if law.mean.any():
            from .curvature_hysteresis import CurvatureHysteresis

            self.hysteresis = CurvatureHysteresis(fields, model, self.elements, model.particle[self.host_faces], law)
            self.host_own = np.concatenate([np.full(len(part.mean), own) for own, part in laws])
            factor[:, :3] *= self.host_own[:, None]
            stiff[:, :3] = factor[:, :3] + law.k.sum(axis=1)  # before sliders give
        self.remembers = self.gusty = self.hysteresis is not None  # explicit steps must be as short as its changes
        self.yields = bool(self.remembers and self.hysteresis.creases_too)
        self.weight = fields.real(self.elements.count, 3 * self.width, self.elements.per_entry(
            B.reshape(-1, 3 * self.width)))
        self.factor = fields.real(self.elements.count, 6, self.elements.per_entry(factor))  # of k, then of k_d
        self.damps = bool(factor[:, 3:].any())
        sizes = (np.abs(np.einsum("kma,km,kmb->kab", B, stiff[:, first:first + 3], B)) for first in (0, 3))
        self.rates = tuple(float(row_sums(corners, s, model.mass).max()) for s in sizes)
        self.host_corners, self.host_weight = corners, B  # a triangle each
        self._unit_energy = float(np.sum(stiff[:, :3] * np.sum(B**2, axis=2)) / 2)

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    def build_stiffness(self) -> None:
        """Allocates the fields that only an implicit step needs."""
        self.A, self.stiff = self._fields.real(self.elements.count, 3), True
        self.over = self._fields.real(1, data=np.zeros(1))
        if self.damps:
            self.way, self.before = self._fields.real(self.elements.count, 9), self._fields.real(self.elements.count, 3)
        if self.remembers:
            self.hysteresis.build_stiffness(self._fields)

    def damp_over(self, c: float) -> None:
        """See `Force`."""
        write(self.over, np.array([c], dtype=self.model.exchange))

    def accept(self, h: float) -> bool:
        """Sliders follow the curvatures."""
        if self.remembers:
            self._return_map(h)
        return self.remembers

    @ti.kernel
    def _return_map(self, h: float):
        for e in range(self.elements.first[self.model.blocks.count]):
            if self.elements.primary[e] == 1:
                self.hysteresis.return_map(e, self.second(e, self.model.x), h)

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
        out = q
        for m, c in ti.static(ti.ndrange(3, 3)):
            out[m, c] = self.factor[e][m] * q[m, c]
        if ti.static(self.damps):
            u = self.along(e, q, self.second(e, self.model.v), over)
            for m, c in ti.static(ti.ndrange(3, 3)):
                out[m, c] += self.factor[e][3 + m] * u[m, c]
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
            over = self.over[0]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            q = self.second(e, self.model.x)
            if self.elements.primary[e] == 1:
                moved = self.second(e, self.model.v)
                for m, d in ti.static(ti.ndrange(3, 3)):
                    sums[0] += 0.5 * self.factor[e][m] * q[m, d] ** 2
                    sums[2] += self.factor[e][m] * q[m, d] * moved[m, d]
                if ti.static(self.remembers):
                    energy, rate = self.hysteresis.stored(e, q, moved)
                    sums[0] += energy
                    sums[2] += rate
                if ti.static(self.damps):
                    u = self.along(e, q, moved, over)
                    for m, d in ti.static(ti.ndrange(3, 3)):
                        sums[1] += 0.5 * self.factor[e][3 + m] * u[m, d] ** 2
                        if over > 0:
                            sums[2] += self.factor[e][3 + m] * u[m, d] * (moved[m, d] - u[m, d])
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
        r, moved = self.pull(e, q, over), q * 0
        if moves == 1:
            moved = self.second(e, to.motion)
            for m, d in ti.static(ti.ndrange(3, 3)):
                r[m, d] += self.factor[e][m] * moved[m, d]
        if ti.static(self.remembers):
            r += self.hysteresis.linearize(e, moves, c, q, moved, to, lo, hi)
        self.scatter(e, -c * r, to.b, lo, hi)
        for m in ti.static(range(3)):
            self.A[e][m] = c * c * self.factor[e][m]
        if ti.static(self.damps):
            for m in ti.static(range(3)):
                row, k_d = ti.Vector([q[m, 0], q[m, 1], q[m, 2]]), self.factor[e][3 + m]
                if moves == 1:
                    self.before[e][m] = row.norm()  # where the step starts
                if over > 0:
                    left = ti.min(self.before[e][m] / ti.max(row.norm(), TINY), 1.0)
                    self.A[e][m] += c * k_d * (1 - left)
                    k_d *= left
                way = ti.sqrt(c * k_d) * unit(row)
                for d in ti.static(range(3)):
                    self.way[e][3 * m + d] = way[d]

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

    def geometry(self) -> dict[str, np.ndarray]:
        """Patches of vertices round triangles, their weights and stiffness, and the triangles."""
        out = {"patches": self.model.user[self.host_corners], "patch_weight": self.host_weight,
               "patch_factor": self.host_factor, "patch_faces": self.host_faces}
        return out | ({"creases": np.array(True), "patch_own": self.host_own} if self.yields else {})

    def recorded(self) -> dict[str, np.ndarray]:
        """Curvatures [1/m] that triangles have been creased by."""
        return {"patch_crease": self.hysteresis.creases().astype(np.float32)} if self.yields else {}


def _wider(vertices: np.ndarray, width: int) -> np.ndarray:
    """Rows filled up with their first vertex."""
    return np.concatenate([vertices, np.repeat(vertices[:, :1], width - vertices.shape[1], axis=1)], axis=1)
