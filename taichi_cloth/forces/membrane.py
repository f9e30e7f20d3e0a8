"""Stretch and shear of woven cloth: the conditions of [BW98 §4.2] along warp and weft, per area of the pattern

psi = k_u/2 (|w_u| - b_u)^2 + k_v/2 (|w_v| - b_v)^2 + k_s/2 (w_u . w_v)^2, plus the terms of `stiffening`.

With n = w/|w|, the tensions T = k (|w| - b) and S = k_s w_u . w_v (both with their stiffening) and damping k_d C_dot in each:

dpsi/dw_u = T_u n_u + S w_v, and the same with u and v changed (7), (11);
d2psi/dw_u2 = T_u' n_u n_u^T + T_u/|w_u| (1 - n_u n_u^T) + S' w_v w_v^T,  d2psi/dw_u dw_v = S' w_v w_u^T + S 1.

Differs from [BW98 §4.2, §4.5]: energy is area k/2 C^2 (see fabric); damping is weighted by area like its
stiffness. In a first solve the matrix leaves out the derivative of damping by position and the term C_dot ddC. In further
solves damping is an energy, k_d/(2 c) (C - C_0)^2, and the matrix is that of this energy.
"""

from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.scene import Scene
from ..system.elements import triangles
from ..system.state import Elements, ParticleState
from .conditions import TINY, shear_stiffness, stretch_stiffness, unit
from .membrane_lanes import APART, SIMD_WIDTH, MembraneLanes
from .membrane_table import B_U, B_V, D_S, D_U, D_V, K_S, K_U, K_V, limits_of, materials_of, row_bounds, row_of
from .stiffening import SHEAR, WARP, WEFT, Stiffening, stiffens


@ti.data_oriented
class Membrane(MembraneLanes):
    """Stretch along warp and weft, and shear, with their damping.

    Args:
        mode: K of the conditions.
        substep: explicit step [s] that must be stable: triangles too stiff for it are softened as far as it takes, their
            damping with them. None leaves all as they are.

    Attributes:
        notes: how many triangles were softened, and how far.
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str, substep: float | None = None) -> None:
        self.model, self.mode = model, mode
        cloths = [c for c in scene.cloths if any(f.stretch or f.shear for f in c.fabrics)]
        table = np.array([row_of(f) for c in cloths for f in c.fabrics])
        parts = [triangles(c.mesh) for c in cloths]
        vertices = np.concatenate([model.particle[p.vertices + c.start] for p, c in zip(parts, cloths)])
        self.elements = Elements(fields, model.blocks, vertices)
        per_entry = self.elements.per_entry
        inverse = np.concatenate([p.inverse for p in parts]).reshape(-1, 4)
        area = np.concatenate([p.area for p in parts])
        material = materials_of(cloths)
        # squared frequency [1/s^2] and damping rate [1/s] that no mode at rest exceeds, as each particle has them
        fabrics = [f for c in cloths for f in c.fabrics]
        self.stiffening: Any = Stiffening(fields, fabrics) if any(map(stiffens, fabrics)) else None
        self.stiffer = self.stiffening is not None
        self.stiffens_sharply = self.stiffening is not None and self.stiffening.limits
        if self.stiffens_sharply:
            self.host_limit = np.array([limits_of(f) for c in scene.cloths for f in c.fabrics])[materials_of(scene.cloths)]
            self.extremes = 3
        stiffest = table.copy()
        if self.stiffening is not None:
            stiffest[:, :K_S + 1] += self.stiffening.tangent
        k = stiffest[material] * area[:, None]
        rates = [row_bounds(vertices, inverse, model.mass, k[:, column:column + 3]) for column in (K_U, D_U)]
        self.notes: list[str] = []
        if substep is not None:
            omega2, damping = rates
            over = (substep**2 * omega2 + 2 * substep * damping) / 4  # 1 if it is just stable
            left = 1 / np.maximum(1, over[vertices].max(axis=1))
            area, k = area * left, k * left[:, None]  # all that an element gives goes with its area
            if (left < 1).any():
                self.notes.append(f"for the substep asked for, {np.sum(left < 1)} of {len(left)} triangles keep but "
                                  f"{100 * left.min():.2g} % or more of their stretch and shear stiffness")
            rates = [row_bounds(vertices, inverse, model.mass, k[:, column:column + 3]) for column in (K_U, D_U)]
        self.rates = tuple(float(r.max()) for r in rates)
        self.inverse = fields.real(self.elements.count, 4, per_entry(inverse))
        self.area = fields.real(self.elements.count, data=per_entry(area))
        self.material = fields.integer(self.elements.count, data=per_entry(material))
        self.table = fields.real(len(table), 8, table)
        self.simd_width = SIMD_WIDTH if model.blocks.grain > 1 and not self.stiffer else 1
        self.simd_scratch = fields.scratch(APART * model.blocks.count, 6 * self.simd_width)
        self.stretches = bool(table[:, [K_U, K_V]].any())
        self.shears = bool(table[:, K_S].any())
        self.damps = scene.damped or bool(table[:, [D_U, D_V, D_S]].any())
        self.energies = (("stretch_u", "stretch_v") if self.stretches else ()) + (("shear",) if self.shears else ())
        self._begin(fields, float(np.sum(area * stiffest[material][:, :K_S + 1].max(axis=1) * np.sum(inverse**2, axis=1)) / 2))

    def geometry(self) -> dict[str, np.ndarray]:
        """Limits of triangles, in the order of their cloths, if there are any: b_u, b_v, L_u, L_v and L of shear."""
        return {"face_limit": self.host_limit} if self.stiffens_sharply else {}

    @ti.func
    def rest(self, e):
        """(b_u, b_v)"""
        k = self.table[self.material[e]]
        return k[B_U], k[B_V]

    @ti.func
    def viscosity(self, e):
        """k_d of warp, weft and shear [N s/m]."""
        k = self.table[self.material[e]]
        return ti.Vector([k[D_U], k[D_V], k[D_S]])

    @ti.func
    def add_energy(self, e, area, w_u, w_v, v_u, v_v, sums: ti.template()):
        """sums += energies [J] of warp, weft and shear, as far as there are; last the rate [W] at which they grow."""
        k = self.table[self.material[e]]
        shear, rate = ti.static(2 * self.stretches, len(self.energies) + 1)
        if ti.static(self.stretches):
            C_u, C_v = w_u.norm() - k[B_U], w_v.norm() - k[B_V]
            sums[0] += 0.5 * area * k[K_U] * C_u ** 2
            sums[1] += 0.5 * area * k[K_V] * C_v ** 2
            sums[rate] += area * (k[K_U] * C_u * unit(w_u).dot(v_u) + k[K_V] * C_v * unit(w_v).dot(v_v))
            if ti.static(self.stiffer):
                f_u, slope_u, e_u = self.beyond(e, WARP, w_u.norm())
                f_v, slope_v, e_v = self.beyond(e, WEFT, w_v.norm())
                sums[0] += area * e_u
                sums[1] += area * e_v
                sums[rate] += area * (f_u * unit(w_u).dot(v_u) + f_v * unit(w_v).dot(v_v))
        if ti.static(self.shears):
            C = w_u.dot(w_v)
            sums[shear] += 0.5 * area * k[K_S] * C * C
            sums[rate] += area * k[K_S] * C * (v_u.dot(w_v) + v_v.dot(w_u))
            if ti.static(self.stiffer):
                f_s, slope_s, e_s = self.beyond(e, SHEAR, C)
                sums[shear] += area * e_s
                sums[rate] += area * f_s * (v_u.dot(w_v) + v_v.dot(w_u))

    @ti.func
    def gradient(self, e, w_u, w_v, u, v, s_dot):
        """Per area, minus the force on (w_u, w_v): sum of (k C + k_d C_dot) dC (7), (11), at these rates of the conditions."""
        k = self.table[self.material[e]]
        g_u, g_v = w_u * 0, w_v * 0
        if ti.static(self.stretches):
            n_u, n_v = unit(w_u), unit(w_v)
            g_u += (k[K_U] * (w_u.norm() - k[B_U])) * n_u
            g_v += (k[K_V] * (w_v.norm() - k[B_V])) * n_v
            if ti.static(self.stiffer):
                g_u += self.beyond(e, WARP, w_u.norm())[0] * n_u
                g_v += self.beyond(e, WEFT, w_v.norm())[0] * n_v
            if ti.static(self.damps):
                g_u += k[D_U] * u * n_u
                g_v += k[D_V] * v * n_v
        if ti.static(self.shears):
            s = k[K_S] * w_u.dot(w_v)
            if ti.static(self.stiffer):
                s += self.beyond(e, SHEAR, w_u.dot(w_v))[0]
            if ti.static(self.damps):
                s += k[D_S] * s_dot
            g_u += s * w_v
            g_v += s * w_u
        return g_u, g_v

    @ti.func
    def beyond(self, e, axis: ti.template(), s):
        """(force, its slope, its energy) per area beyond k C at |w| = s or, in shear, C = s; 0 where nothing stiffens."""
        force, slope, energy = 0.0, 0.0, 0.0
        if ti.static(self.stiffer):
            force, slope, energy = self.stiffening.beyond(self.material[e], axis, ti.abs(s))
            if s < 0:
                force = -force
        return force, slope, energy

    @ti.func
    def used(self, e, w_u, w_v):
        """Largest strain over its limit, both from rest on: 1 at a limit."""
        m, k = self.material[e], self.table[self.material[e]]
        warp, weft = self.stiffening.used(m, WARP, w_u.norm(), k[B_U]), self.stiffening.used(m, WEFT, w_v.norm(), k[B_V])
        return ti.max(warp, weft, self.stiffening.used(m, SHEAR, ti.abs(w_u.dot(w_v)), 0.0))

    @ti.func
    def stiffness(self, e, w_u, w_v, u, v, s, over, whole):
        """Per area, blocks uu (6 numbers), uv (3x3), vv (6) of -K in (w_u, w_v). If `over` > 0 [s], with damping as an energy
        at the rates u, v, s."""
        k = self.table[self.material[e]]
        uu, uv, vv = ti.Vector.zero(float, 6), ti.Matrix.zero(float, 3, 3), ti.Vector.zero(float, 6)
        if ti.static(self.shears):
            k_s, C = k[K_S], w_u.dot(w_v)
            if ti.static(self.stiffer):
                force, slope, energy = self.beyond(e, SHEAR, C)
                C = (k_s * C + force) / ti.max(k_s + slope, TINY)
                k_s += slope
            if ti.static(self.damps):
                if over > 0:
                    C = (k_s * C + k[D_S] * s) / ti.max(k_s + k[D_S] / over, TINY)
                    k_s += k[D_S] / over
            uu, uv, vv = shear_stiffness(w_u, w_v, k_s, C, self.mode, whole)
        if ti.static(self.stretches):
            force_u, slope_u, energy_u = self.beyond(e, WARP, w_u.norm())
            force_v, slope_v, energy_v = self.beyond(e, WEFT, w_v.norm())
            if ti.static(self.damps):
                if over > 0:
                    force_u, slope_u = force_u + k[D_U] * u, slope_u + k[D_U] / over
                    force_v, slope_v = force_v + k[D_V] * v, slope_v + k[D_V] / over
            uu += stretch_stiffness(w_u, k[K_U], k[B_U], force_u, slope_u, self.mode, whole)
            vv += stretch_stiffness(w_v, k[K_V], k[B_V], force_v, slope_v, self.mode, whole)
        return uu, uv, vv
