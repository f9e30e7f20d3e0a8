"""Laws of bending of a user's own, over hinges: psi, M = dpsi/dkappa and dM/dkappa, and no loop.

A hinge of condition C, see `hinge`, has the curvature kappa = C |e| / (A_1 + A_2) over its two triangles, and so

E = (A_1 + A_2) psi(kappa),    T = dE/dC = |e| M(kappa),    dT/dC = |e|^2 / (A_1 + A_2) dM(kappa).

With psi = D/2 kappa^2 that is `bend`'s law.
"""

from abc import abstractmethod

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.scene import Scene
from ..system.elements import hinges_of
from ..system.state import ParticleState
from .conditions import TINY
from .hinge_law import HingeLaw
from .hinge_rest import least_normal
from .own_law import OwnLaw, Rows, vectors


@ti.data_oriented
class BendLaw(OwnLaw, HingeLaw):
    """A law of bending, on the cloths that `on` names; their fabrics need none. Make subclasses `ti.data_oriented`.

    `psi`, `M` and `dM` are Taichi functions of the curvature kappa [1/m] of a hinge; `k` is the vector of its parameters, the
    mean of its two triangles'. At rest is the flat pattern, or the given shape where the mesh came without one. Seams have no
    such hinges.

    Attributes:
        parameters: names of the law's numbers, in the order in which `k` has them.
    """

    has_extra_torque = True
    damped = ("N m s", 1)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str, rows: Rows = (),
                 k_d: tuple[float, ...] = (0.0,)) -> None:
        self._check(scene, rows)
        self.model, self.exact = model, mode == "paper"
        self.notes = [f"{cloth.name}: bending of its fabric acts beside {type(self).__name__}"
                      for cloth, _ in rows if any(f.bend for f in cloth.fabrics)]
        parts = [hinges_of(cloth) for cloth, _ in rows]
        numbers = np.concatenate([row[h.faces].mean(axis=1) for h, (_, row) in zip(parts, rows)])
        angle = np.concatenate([h.angle * cloth.mesh.flattened for h, (cloth, _) in zip(parts, rows)])
        area, length2 = (np.concatenate(each) for each in zip(*((h.areas.sum(axis=1), h.length2) for h in parts)))
        weight, floor2 = length2 / area, np.concatenate([least_normal(h) for h in parts])
        rest = np.column_stack([0 * weight, k_d[0] * weight, angle, floor2])
        stiff = np.column_stack([self._stiffest(numbers) * weight, rest[:, 1:]])
        vertices = np.concatenate([model.particle[h.vertices + c.start] for h, (c, _) in zip(parts, rows)])
        self._begin(fields, parts, vertices, rest, stiff)
        per, count = self.elements.per_entry, self.elements.count
        self.k = fields.real(count, max(2, numbers.shape[1]), per(vectors(numbers)))
        self.size = fields.real(count, 2, per(np.column_stack([area, np.sqrt(length2)])))

    @abstractmethod
    def psi(self, k, kappa):
        """Energy per area [J/m^2], 0 at rest."""

    @abstractmethod
    def M(self, k, kappa):
        """dpsi/dkappa, the moment per width [N], 0 at rest."""

    @abstractmethod
    def dM(self, k, kappa):
        """dM/dkappa [N m]. If it is negative the matrix takes 0, or M/kappa."""

    @ti.func
    def extra_torque(self, e, C):
        """(torque, the matrix's stiffness but for K mode "paper", slope, energy) at the condition C."""
        area, length = self.size[e][0], self.size[e][1]
        kappa = C * length / area
        torque, slope = length * self.M(self.k[e], kappa), length * length / area * ti.max(self.dM(self.k[e], kappa), 0.0)
        bound = slope
        if ti.abs(C) > TINY:
            bound = ti.max(slope, torque / C)
        return torque, bound, slope, area * self.psi(self.k[e], kappa)
