"""Stretch and shear of a triangle: conditions of (w_u, w_v), so three 3x3 blocks an element are all there is.

Differs from [BW98 §4.2, §4.5]: energy is area k/2 C^2 (see fabric); damping is weighted by area like its
stiffness. Of a first solve its derivative by position and the term C_dot ddC are left out of the matrix; in further ones
damping is an energy, k_d/(2 c) (C - C_0)^2, and its matrix is all of this energy's.
"""

from typing import Any

import numpy as np
import taichi as ti

from ..backend.fields import Fields
from ..backend.rows import write
from ..scene.scene import Scene
from ..system.elements import triangles
from ..system.state import Elements, ParticleState
from .conditions import TINY, shear_stiffness, stretch_stiffness, sym_outer, sym_times, unit
from .membrane_table import limits_of, materials_of, row_bounds, row_of
from .stiffening import SHEAR, WARP, WEFT, Stiffening, stiffens
from .triangle_force import TriangleForce

# columns of the table of materials
K_U, K_V, K_S, D_U, D_V, D_S, B_U, B_V = range(8)
LANES = 4  # elements whose forces a CPU thread takes together
APART = 8  # rows of `aside` between those of two threads


@ti.data_oriented
class Membrane(TriangleForce):
    """Stretch along warp and weft, and shear, with their damping.

    Stored for an element and a step: the symmetric 6x6 block of A in the edges (x_1 - x_0, x_2 - x_0), 21 numbers.

    Args:
        mode: K of the conditions.
        substep: explicit step [s] that must be stable: triangles too stiff for it are softened as far as it takes, their
            damping with them. None leaves all as they are.

    Attributes:
        notes: what was softened.
    """

    extremes = 2

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
        self.abrupt = self.stiffening is not None and self.stiffening.limits
        if self.abrupt:
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
            over = (substep**2 * omega2 + 2 * substep * damping) / 4  # 1 where it is just stable
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
        self.lanes = LANES if model.blocks.grain > 1 and not self.stiffer else 1
        self.aside = fields.aside(APART * model.blocks.count, 6 * self.lanes)
        self.stretches = bool(table[:, [K_U, K_V]].any())
        self.shears = bool(table[:, K_S].any())
        self.damps = bool(table[:, [D_U, D_V, D_S]].any())
        self.energies = (("stretch_u", "stretch_v") if self.stretches else ()) + (("shear",) if self.shears else ())
        # energy of strains that are but a rounding of positions by 1 m, see `rounding_energy`
        self._unit_energy = float(np.sum(area * stiffest[material][:, :K_S + 1].max(axis=1) * np.sum(inverse**2, axis=1)) / 2)
        self._fields = fields
        self.indefinite = mode == "projected"
        self._over, self._whole = 0.0, True

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    def build_stiffness(self) -> None:
        """Allocates what only an implicit step needs."""
        self.A, self.stiff = self._fields.real(self.elements.count, 21), True
        self.way: Any = self._fields.real(2, data=np.zeros(2))  # span that damping is taken over [s]; 1 where K is whole

    def damp_over(self, c: float) -> None:
        """See `Force`; from here on negative eigenvalues are in the matrix too."""
        self._over = c
        self._set_way()

    def leave_out(self, part: bool) -> None:
        """Negative eigenvalues. They are in the matrix only where damping is an energy, so never in a step's first solve."""
        self._whole = not part
        self._set_way()

    def _set_way(self) -> None:
        whole = self._whole and self._over > 0
        write(self.way, np.array([self._over, whole], dtype=self.model.exchange))

    def geometry(self) -> dict[str, np.ndarray]:
        """Limits of triangles, in the order of their cloths, where there are any: b_u, b_v, L_u, L_v and L of shear."""
        return {"face_limit": self.host_limit} if self.abrupt else {}

    @ti.func
    def speeds(self, w_u, w_v, v_u, v_v):
        """C_dot of warp, weft and shear."""
        return unit(w_u).dot(v_u), unit(w_v).dot(v_v), v_u.dot(w_v) + v_v.dot(w_u)

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
        """Largest part of the ways from rest to a limit."""
        m, k = self.material[e], self.table[self.material[e]]
        warp, weft = self.stiffening.used(m, WARP, w_u.norm(), k[B_U]), self.stiffening.used(m, WEFT, w_v.norm(), k[B_V])
        return ti.max(warp, weft, self.stiffening.used(m, SHEAR, ti.abs(w_u.dot(w_v)), 0.0))

    @ti.func
    def stiffness(self, e, w_u, w_v, u, v, s, over, whole):
        """Per area, blocks uu (6 numbers), uv (3x3), vv (6) of -K in (w_u, w_v); with damping as an energy, at these rates,
        where it is `over` a span."""
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

    @ti.func
    def damping(self, e, w_u, w_v):
        """Per area, blocks uu, uv, vv of -D in (w_u, w_v): k_d dC dC^T (12)."""
        k = self.table[self.material[e]]
        uu = k[D_U] * sym_outer(unit(w_u)) + k[D_S] * sym_outer(w_v)
        vv = k[D_V] * sym_outer(unit(w_v)) + k[D_S] * sym_outer(w_u)
        return uu, k[D_S] * w_v.outer_product(w_u), vv

    @ti.func
    def change(self, e, u_0, v_0, u, v):
        """By how much |w_u| = u or |w_v| = v went away from rest since they were u_0 and v_0."""
        k = self.table[self.material[e]]
        return ti.max(strayed(u_0 / k[B_U], u / k[B_U]), strayed(v_0 / k[B_V], v / k[B_V]))

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
                ti.atomic_max(largest, self.change(e, o_u.norm(), o_v.norm(), w_u.norm(), w_v.norm()))
        return largest

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's elements; of those that it owns whole, a few at a time."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        first = self.elements.first[block]
        if ti.static(self.lanes > 1):
            groups = (self.elements.shared[block] - first) // self.lanes
            for group in range(groups):
                self.add_forces(block, first + group * self.lanes, f)
            first += groups * self.lanes
        for e in range(first, self.elements.first[block + 1]):
            w_u, w_v = self.spread(e, self.model.x)
            v_u, v_v = self.spread(e, self.model.v)
            r_u, r_v, r_s = self.speeds(w_u, w_v, v_u, v_v)
            g_u, g_v = self.gradient(e, w_u, w_v, r_u, r_v, r_s)
            self.scatter(e, -self.area[e] * g_u, -self.area[e] * g_v, f, lo, hi)

    @ti.func
    def add_forces(self, block, e, f: ti.template()):
        """f += forces of elements e, e + 1 ..., in `lanes`, of which the compiler makes vector instructions.

        It does so where what they give is also written side by side, to `aside`, which nobody reads.
        """
        area = ti.Vector([self.area[e + j] for j in ti.static(range(self.lanes))])
        k = [ti.Vector([self.table[self.material[e + j]][c] for j in ti.static(range(self.lanes))])
             for c in ti.static(range(8))]
        vertex = [ti.Vector([self.elements.vertices[e + j][a] for j in ti.static(range(self.lanes))])
                  for a in ti.static(range(3))]
        inverse = [ti.Vector([self.inverse[e + j][c] for j in ti.static(range(self.lanes))]) for c in ti.static(range(4))]
        u, v = self.spread_lanes(vertex, inverse, self.model.x)
        size_u, size_v = ti.sqrt(dot(u, u)), ti.sqrt(dot(v, v))
        per_u, per_v = 1 / ti.max(size_u, TINY), 1 / ti.max(size_v, TINY)
        pull_u, pull_v, s = k[K_U] * (size_u - k[B_U]), k[K_V] * (size_v - k[B_V]), k[K_S] * dot(u, v)
        if ti.static(self.damps):
            du, dv = self.spread_lanes(vertex, inverse, self.model.v)
            pull_u += k[D_U] * dot(u, du) * per_u
            pull_v += k[D_V] * dot(v, dv) * per_v
            s += k[D_S] * (dot(du, v) + dot(dv, u))
        along_u, along_v, across = area * per_u * pull_u, area * per_v * pull_v, area * s
        q_1 = [(along_u * u[c] + across * v[c]) * inverse[0] + (along_v * v[c] + across * u[c]) * inverse[1]
               for c in ti.static(range(3))]
        q_2 = [(along_u * u[c] + across * v[c]) * inverse[2] + (along_v * v[c] + across * u[c]) * inverse[3]
               for c in ti.static(range(3))]
        for c in ti.static(range(3)):
            for j in ti.static(range(self.lanes)):
                self.aside[APART * block][2 * c * self.lanes + j] = q_1[c][j]
            for j in ti.static(range(self.lanes)):
                self.aside[APART * block][(2 * c + 1) * self.lanes + j] = q_2[c][j]
        for j in ti.static(range(self.lanes)):
            f[vertex[0][j]] = f[vertex[0][j]] + ti.Vector([q_1[c][j] + q_2[c][j] for c in ti.static(range(3))])
            f[vertex[1][j]] = f[vertex[1][j]] - ti.Vector([q_1[c][j] for c in ti.static(range(3))])
            f[vertex[2][j]] = f[vertex[2][j]] - ti.Vector([q_2[c][j] for c in ti.static(range(3))])

    @ti.func
    def spread_lanes(self, vertex: ti.template(), inverse: ti.template(), q: ti.template()):
        """(w_u, w_v) of a per-vertex field on several elements, 3 vectors each of a number an element."""
        corner = [[ti.Vector([q[vertex[a][j]][c] for j in ti.static(range(self.lanes))]) for c in ti.static(range(3))]
                  for a in ti.static(range(3))]
        u = [(corner[1][c] - corner[0][c]) * inverse[0] + (corner[2][c] - corner[0][c]) * inverse[2]
             for c in ti.static(range(3))]
        v = [(corner[1][c] - corner[0][c]) * inverse[1] + (corner[2][c] - corner[0][c]) * inverse[3]
             for c in ti.static(range(3))]
        return u, v

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energies by term [J], from column `base`; dissipated power / 2 [W]; the rate at which the energies grow [W]; largest
        |w| / b, by how much any went away from rest since the saved state, what is used of limits. With `linearizes`, the
        linear system too."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        sums, largest, change, used, over, whole = ti.Vector.zero(dtype, 5), 0.0, 0.0, 0.0, 0.0, 0.0
        if ti.static(self.stiff):
            over, whole = self.way[0], self.way[1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            k = self.table[self.material[e]]
            w_u, w_v = self.spread(e, self.model.x)
            v_u, v_v = self.spread(e, self.model.v)
            o_u, o_v = self.spread(e, self.model.x_saved)
            u, v, u_0, v_0 = w_u.norm(), w_v.norm(), o_u.norm(), o_v.norm()
            u_dot, v_dot, s_dot = self.speeds(w_u, w_v, v_u, v_v)
            r_u, r_v, r_s = u_dot, v_dot, s_dot
            if ti.static(self.stiff and self.damps):
                if over > 0:
                    r_u, r_v, r_s = (u - u_0) / over, (v - v_0) / over, (w_u.dot(w_v) - o_u.dot(o_v)) / over
            largest = ti.max(largest, ti.max(u / k[B_U], v / k[B_V]))
            change = ti.max(change, self.change(e, u_0, v_0, u, v))
            if ti.static(self.abrupt):
                used = ti.max(used, self.used(e, w_u, w_v))
            if self.elements.primary[e] == 1:
                half = 0.5 * self.area[e]
                if ti.static(self.stretches):
                    sums[0] += half * k[K_U] * (u - k[B_U]) ** 2
                    sums[1] += half * k[K_V] * (v - k[B_V]) ** 2
                    sums[4] += 2 * half * (k[K_U] * (u - k[B_U]) * unit(w_u).dot(v_u)
                                           + k[K_V] * (v - k[B_V]) * unit(w_v).dot(v_v))
                    if ti.static(self.stiffer):
                        f_u, slope_u, e_u = self.beyond(e, WARP, u)
                        f_v, slope_v, e_v = self.beyond(e, WEFT, v)
                        sums[0] += 2 * half * e_u
                        sums[1] += 2 * half * e_v
                        sums[4] += 2 * half * (f_u * unit(w_u).dot(v_u) + f_v * unit(w_v).dot(v_v))
                if ti.static(self.shears):
                    C = w_u.dot(w_v)
                    sums[2] += half * k[K_S] * C * C
                    sums[4] += 2 * half * k[K_S] * C * (v_u.dot(w_v) + v_v.dot(w_u))
                    if ti.static(self.stiffer):
                        f_s, slope_s, e_s = self.beyond(e, SHEAR, C)
                        sums[2] += 2 * half * e_s
                        sums[4] += 2 * half * f_s * (v_u.dot(w_v) + v_v.dot(w_u))
                if ti.static(self.damps):
                    sums[3] += half * (k[D_U] * r_u ** 2 + k[D_V] * r_v ** 2 + k[D_S] * r_s ** 2)
                    if over > 0:
                        sums[4] += 2 * half * (k[D_U] * r_u * (u_dot - r_u) + k[D_V] * r_v * (v_dot - r_v)
                                               + k[D_S] * r_s * (s_dot - r_s))
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(e, moves, c, w_u, w_v, r_u, r_v, r_s, over, whole, to, lo, hi)
        if ti.static(self.stretches):
            report[block, base] = sums[0]
            report[block, base + 1] = sums[1]
        if ti.static(self.shears):
            report[block, base + 2 * self.stretches] = sums[2]
        report[block, base + 2 * self.stretches + self.shears] = sums[3]
        report[block, base + 2 * self.stretches + self.shears + 1] = sums[4]
        report[block, base + 2 * self.stretches + self.shears + 2] = largest
        report[block, base + 2 * self.stretches + self.shears + 3] = change
        if ti.static(self.abrupt):
            report[block, base + 2 * self.stretches + self.shears + 4] = used

    @ti.func
    def linearize(self, e, moves, c, w_u, w_v, u, v, s, over, whole, to: ti.template(), lo, hi):
        """b += c (f + K motion); stores the block of -c D - c^2 K and adds its diagonal to P."""
        g_u, g_v = self.gradient(e, w_u, w_v, u, v, s)
        uu, uv, vv = self.stiffness(e, w_u, w_v, u, v, s, over, whole)
        if moves == 1:
            m_u, m_v = self.spread(e, to.motion)
            g_u += sym_times(uu, m_u) + uv @ m_v
            g_v += uv.transpose() @ m_u + sym_times(vv, m_v)
        scale = c * self.area[e]
        self.scatter(e, -scale * g_u, -scale * g_v, to.b, lo, hi)
        uu, uv, vv = c * scale * uu, c * scale * uv, c * scale * vv
        if ti.static(self.damps):
            if over == 0:
                d_uu, d_uv, d_vv = self.damping(e, w_u, w_v)
                uu += scale * d_uu
                uv += scale * d_uv
                vv += scale * d_vv
        self.store(e, uu, uv, vv, to.P, lo, hi)


@ti.func
def dot(a: ti.template(), b: ti.template()):
    """a . b of 3 vectors each, whose numbers belong to different elements."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@ti.func
def strayed(before, now):
    """By how much a stretch |w| / b has gone away from 1: cloth that was let go and springs back does not count."""
    past, gone = before - 1, ti.abs(now - 1)
    return ti.select(past * (now - 1) > 0, ti.max(gone - ti.abs(past), 0.0), gone)
