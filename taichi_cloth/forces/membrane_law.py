"""Laws of stretch and shear of a user's own: psi, P = dpsi/dF and d2psi/dF2, and no loop."""

from abc import abstractmethod

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.scene import Scene
from ..system.elements import row_sums, triangles
from ..system.state import Elements, ParticleState
from .conditions import shear_stiffness, stretch_stiffness, sym, unit
from .own_law import OwnLaw, Rows, vectors
from .triangle_law import TriangleLaw


@ti.data_oriented
class MembraneLaw(OwnLaw, TriangleLaw):
    """A law of stretch and shear, on the cloths that `on` names; their fabrics need neither. Make subclasses
    `ti.data_oriented`.

    A law is of F = (w_u, w_v), the vectors [m/m] that a unit of warp and a unit of weft of the pattern have become. `psi`, `P`
    and `dP` are Taichi functions, per area of the pattern; `k` is the vector of the triangle's parameters. With K =
    "gauss_newton" `exact` is always 0.

    Attributes:
        parameters: names of the law's numbers, in the order in which `k` has them.
        energies: name of its energy in `Simulation.energy`, a tuple of one.
    """

    energies = ("membrane",)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str, rows: Rows = (),
                 k_d: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
        self._check(scene, rows)
        what = type(self).__name__
        self.notes = [f"{cloth.name}: stretch and shear of its fabric act beside {what}"
                      for cloth, _ in rows if any(f.stretch or f.shear for f in cloth.fabrics)]
        self.model, self.mode, self.damps = model, mode, any(k_d)
        parts, numbers = [triangles(cloth.mesh) for cloth, _ in rows], np.concatenate([row for _, row in rows])
        vertices = np.concatenate([model.particle[p.vertices + c.start] for p, (c, _) in zip(parts, rows)])
        inverse = np.concatenate([p.inverse for p in parts]).reshape(-1, 4)
        area = np.concatenate([p.area for p in parts])
        self.elements = Elements(fields, model.blocks, vertices)
        per, count = self.elements.per_entry, self.elements.count
        self.inverse, self.area = fields.real(count, 4, per(inverse)), fields.real(count, data=per(area))
        self.k = fields.real(count, max(2, numbers.shape[1]), per(vectors(numbers)))
        self.k_d = fields.real(1, 3, np.array([k_d]))
        stiff = self._stiffest(numbers) * area
        self.rates = tuple(_bound(vertices, inverse, model.mass, size) for size in (stiff, 2 * max(k_d) * area))
        self._begin(fields, float(np.sum(stiff * np.sum(inverse**2, axis=1)) / 2))

    @abstractmethod
    def psi(self, k, w_u, w_v):
        """Energy per area [J/m^2], 0 at rest."""

    @abstractmethod
    def P(self, k, w_u, w_v):
        """dpsi/dF as (dpsi/dw_u, dpsi/dw_v) [N/m]: the pull at a unit of width of the pattern, across warp and weft."""

    @abstractmethod
    def dP(self, k, w_u, w_v, exact):
        """d2psi/dF2 [N/m] as 3x3 blocks uu, uv, vv: that of P_u by w_u, of P_u by w_v and of P_v by w_v.

        If `exact` is 0 all of it is to be positive semidefinite, else CG breaks down: see `positive`.
        """

    @ti.func
    def positive(self, s_u, s_v, s):
        """The symmetric 2x2 matrix of (uu, vv, uv) without its negative eigenvalues, in the same order."""
        mean, half = 0.5 * (s_u + s_v), 0.5 * (s_u - s_v)
        radius = ti.sqrt(half * half + s * s)
        high, low = ti.max(mean + radius, 0.0), ti.max(mean - radius, 0.0)
        part = 0.0
        if radius > 0:
            part = 0.5 * (high - low) / radius
        return 0.5 * (high + low) + part * half, 0.5 * (high + low) - part * half, part * s

    @ti.func
    def rest(self, e):
        """The pattern's own size."""
        return 1.0, 1.0

    @ti.func
    def viscosity(self, e):
        """k_d of warp, weft and shear [N s/m]."""
        return self.k_d[0]

    @ti.func
    def add_energy(self, e, area, w_u, w_v, v_u, v_v, sums: ti.template()):
        """sums += energy [J]; last the rate [W] at which it grows."""
        P_u, P_v = self.P(self.k[e], w_u, w_v)
        sums[0] += area * self.psi(self.k[e], w_u, w_v)
        sums[2] += area * (P_u.dot(v_u) + P_v.dot(v_v))

    @ti.func
    def gradient(self, e, w_u, w_v, u, v, s_dot):
        """P and the pull of damping, at these rates of the conditions."""
        g_u, g_v = self.P(self.k[e], w_u, w_v)
        if ti.static(self.damps):
            k_d = self.viscosity(e)
            g_u += k_d[0] * u * unit(w_u) + k_d[2] * s_dot * w_v
            g_v += k_d[1] * v * unit(w_v) + k_d[2] * s_dot * w_u
        return g_u, g_v

    @ti.func
    def stiffness(self, e, w_u, w_v, u, v, s, over, whole):
        """dP as blocks; damping as an energy adds its own, where it is `over` a span."""
        exact = whole if ti.static(self.mode == "projected") else float(ti.static(self.mode == "paper"))
        P_uu, uv, P_vv = self.dP(self.k[e], w_u, w_v, exact)
        uu, vv = sym(P_uu), sym(P_vv)
        if ti.static(self.damps):
            if over > 0:
                k_d = self.viscosity(e)
                uu += stretch_stiffness(w_u, 0.0, 1.0, k_d[0] * u, k_d[0] / over, self.mode, whole)
                vv += stretch_stiffness(w_v, 0.0, 1.0, k_d[1] * v, k_d[1] / over, self.mode, whole)
                s_uu, s_uv, s_vv = shear_stiffness(w_u, w_v, k_d[2] / over, over * s, self.mode, whole)
                uu, uv, vv = uu + s_uu, uv + s_uv, vv + s_vv
        return uu, uv, vv


def _bound(vertices: np.ndarray, inverse: np.ndarray, mass: np.ndarray, size: np.ndarray) -> float:
    """A bound on the eigenvalues of M^-1 K, for an energy of no more than size (m,) / 2 |F|^2 a triangle."""
    u, v = (np.column_stack([-inverse[:, a] - inverse[:, a + 2], inverse[:, a], inverse[:, a + 2]]) for a in (0, 1))
    blocks = np.abs(np.einsum("ei,ej->eij", u, u) + np.einsum("ei,ej->eij", v, v))
    return float(row_sums(vertices, size[:, None, None] * blocks, mass).max())
