"""Bending by curvatures: E = area D/2 |x_ab|^2 a triangle, x_ab the second derivatives of position in the material plane.

They come from the divergence theorem, x_ab = 1/area sum over edges of n_a l x_b, with one gradient x_b an edge, shared by its
two triangles. It is the mean of two gradients at the edge's middle: those of quadratics through each triangle and its three
neighbours. It is exact for quadratics on any triangulation, and the forces of a constant curvature cancel at inner vertices.
The rigidity is therefore D on irregular meshes too; a hinge's is D on equilateral ones only, 0.8 to 3 D on others. For
deformations that keep lengths |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2 is the sum of squares of the curvatures [Bergou et al. 2006];
patches of triangles without rotations as in [Onate, Zarate 2000]. Forces are linear in positions: a constant matrix, the same
in all three coordinates.

Friction between fibres and creases are in `curvature_hysteresis`.

Differs from [BW98 §4.2]: no angle; the rest shape is flat.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..errors import SceneError
from ..scene.fabric import Bend, remembers
from ..scene.scene import Scene
from ..system.state import ParticleState
from .curvature_fit import curvatures
from .curvature_law import CurvatureLaw
from .curvature_sliders import joined, moduli_of, own_part, sliders


@ti.data_oriented
class CurvatureBend(CurvatureLaw):
    """Bending of fabrics by curvatures, with damping, friction and creases."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self.damps = model, scene.damped
        patches, faces, factors, parts, own = [], [], [], [], []
        for cloth in scene.cloths:
            bend = cloth.fabric.bend
            if bend is None or bend.model != "curvature":
                continue
            _check(cloth.name, bend, mode)
            v, B, area = curvatures(cloth.mesh)
            patches.append((model.particle[v + cloth.start], B))
            faces.append(cloth.mesh.faces + cloth.start)
            factors.append(area[:, None] * np.array([moduli_of(bend.D) + moduli_of(bend.k_d)]))
            parts.append(sliders(bend, cloth.mesh))
            own.append(np.full(len(area), own_part(bend)))
        k, k_d = np.split(np.concatenate(factors), 2, axis=1)
        law = joined(parts)
        self.host_faces, self.host_factor, self.host_own = np.concatenate(faces), k, np.concatenate(own)
        self.remembers = self.time_dependent = bool(law.mean.any())  # explicit steps must be as short as its changes
        left = k * self.host_own[:, None]
        self._begin(fields, patches, left + law.k.sum(axis=1), k_d)  # before sliders give
        self.k = fields.real(self.elements.count, 3, self.elements.per_entry(left))
        if self.remembers:
            from .curvature_hysteresis import CurvatureHysteresis

            self.hysteresis = CurvatureHysteresis(fields, model, self.elements, model.particle[self.host_faces], law)
        self.yields = bool(self.remembers and self.hysteresis.creases_too)

    @ti.func
    def add_energy(self, e, q, moved, sums: ti.template()):
        """area D/2 |x_ab|^2, and its rate."""
        for m, d in ti.static(ti.ndrange(3, 3)):
            sums[0] += 0.5 * self.k[e][m] * q[m, d] ** 2
            sums[2] += self.k[e][m] * q[m, d] * moved[m, d]

    @ti.func
    def moment(self, e, q):
        """area D x_ab"""
        out = q
        for m, c in ti.static(ti.ndrange(3, 3)):
            out[m, c] = self.k[e][m] * q[m, c]
        return out

    @ti.func
    def stiffness(self, e, q):
        """area D of uu, uv and vv [N m^3]."""
        return ti.Vector([self.k[e][0], self.k[e][1], self.k[e][2]])

    @property
    def follows_steps(self) -> bool:
        """Only with sliders, or in a subclass with an `accept` of its own."""
        return self.remembers or type(self).accept is not CurvatureBend.accept

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

    def geometry(self) -> dict[str, np.ndarray]:
        """Patches of vertices round triangles, their weights and stiffness, and the triangles."""
        out = {"patches": self.model.user[self.host_corners], "patch_weight": self.host_weight,
               "patch_factor": self.host_factor, "patch_faces": self.host_faces}
        return out | ({"creases": np.array(True), "patch_own": self.host_own} if self.yields else {})

    def recorded(self) -> dict[str, np.ndarray]:
        """Curvatures [1/m] that triangles have been creased by."""
        return {"patch_crease": self.hysteresis.creases().astype(np.float32)} if self.yields else {}


def _check(name: str, bend: Bend, mode: str) -> None:
    """Refuses a rest shape and a K that there are none of."""
    if bend.rest not in (None, "flat"):
        raise SceneError(f"{name}: bending by curvatures has a flat rest shape; another needs model='hinge'")
    if mode == "paper" and remembers(bend):
        raise SceneError(f"{name}: bending by curvatures that remembers has no exact K: leave K out, or use model='hinge'")
