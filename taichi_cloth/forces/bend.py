"""Bending over hinges: C = theta - theta_0 with stiffness k = D |e|^2 / (A_1 + A_2).

Differs from [BW98 §4.2]: k scales with the mesh so that D is a plate rigidity. C levels off where a fold closes on
itself, and fades with triangles that collapse: see `hinge`.
"""

from typing import Any

import numpy as np
import taichi as ti

from ..backend.fields import Fields
from ..backend.rows import write
from ..scene.fabric import remembers
from ..scene.scene import Scene
from ..system.elements import flat_turns, hinges_of, row_sums, seam_hinges
from ..system.state import Elements, ParticleState
from .conditions import sym, sym_outer, sym_scaled_identity
from .force import Force
from .hinge import hinge_condition, hinge_condition_change, turned_by
from .hinge_rest import creased, rest_of, seam_rest


@ti.data_oriented
class Bend(Force):
    """Hinges with damping.

    Stored for a hinge and a step: dC scaled by the root of its factor in A, 9 numbers in (e, a, b), the edge
    and the two arms from its first vertex; in K mode "paper" the symmetric 9x9 block itself.
    """

    energies, slow = ("bend",), True

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self.exact = model, mode == "paper"
        bent = [c for c in scene.cloths if any(f.bend and f.bend.model == "hinge" for f in c.fabrics)]
        names = {c.name for c in bent}
        seams = [(s, seam_hinges(s.cloth.mesh, s.a, s.b)) for s in scene.seams if s.cloth.name in names and s.stiffness > 0]
        parts = [(c, hinges_of(c)) for c in bent] + [(s.cloth, h) for s, h in seams]
        sewn: list[Any] = [*bent, *(s for s, _ in seams)]
        vertices = np.concatenate([model.particle[h.vertices + c.start] for c, h in parts])
        self.elements = Elements(fields, model.blocks, vertices)
        rest = np.concatenate([creased(scene, c, h, rest_of(c, h)) for c, h in parts[:len(bent)]]
                              + [seam_rest(s, h) for s, h in seams])
        self.hysteresis: Any = None
        self.host_rest = stiff = rest
        if any(remembers(f.bend) for c in bent for f in c.fabrics if f.bend):
            from .hysteresis import Hysteresis, joined, sliders

            first = np.cumsum([0] + [len(h.vertices) for _, h in parts])
            law = joined([sliders(c, h, rest[a:b], k >= len(bent)) for k, ((c, h), a, b) in enumerate(zip(
                parts, first[:-1], first[1:]))])
            self.hysteresis = Hysteresis(fields, model, self.elements, law)
            stiff = np.column_stack([law.own * rest[:, 0] + law.k.sum(axis=1), rest[:, 1:]])  # before sliders give
            rest = np.column_stack([law.own * rest[:, 0], rest[:, 1:]])
        self.remembers = self.gusty = self.hysteresis is not None  # explicit steps must be as short as its changes
        self.host_stiff = stiff
        self.yields, self.creased = bool(self.remembers and self.hysteresis.yields), bool(scene.creases)
        self.host_arc = np.concatenate([h.areas.sum(axis=1) / np.sqrt(h.length2) for _, h in parts])
        self.host_hinges, self.host_turns = vertices, np.concatenate([flat_turns(h) for _, h in parts])
        self.damps = bool(rest[:, 1].any())
        self.host_whole = np.ones(len(rest), dtype=bool)
        self._rest, self._sewn = rest, (scene, [(of, h) for of, (_, h) in zip(sewn, parts)])
        self.rest = fields.real(self.elements.count, 4, self.elements.per_entry(rest))  # k, k_d, theta_0, floor2
        heights2 = np.concatenate([(2 * h.areas).min(axis=1) ** 2 / h.length2 for _, h in parts])
        self._unit_energy = float(np.sum(stiff[:, 0] / heights2) / 2)
        # bounds on the squared frequency [1/s^2] and the damping rate [1/s] of any mode of flat cloth
        sizes = np.abs(np.einsum("ei,ej->eij", self.host_turns, self.host_turns))
        self.rates = tuple(float(row_sums(vertices, k[:, None, None] * sizes, model.mass).max()) for k in stiff[:, :2].T)
        self._fields = fields

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    def build_stiffness(self) -> None:
        """Allocates what only an implicit step needs."""
        self.g, self.stiff = self._fields.real(self.elements.count, 9), True
        self.over, self.before = self._fields.real(1, data=np.zeros(1)), self._fields.real(self.elements.count)
        if self.exact:
            self.hessian = self._fields.real(self.elements.count, 81)

    def damp_over(self, c: float) -> None:
        """See `Force`."""
        write(self.over, np.array([c], dtype=self.model.exchange))

    @ti.func
    def arms(self, e, q: ti.template()):
        """(e, a, b) of a per-vertex field."""
        v = self.elements.vertices[e]
        return q[v[1]] - q[v[0]], q[v[2]] - q[v[0]], q[v[3]] - q[v[0]]

    @ti.func
    def scatter(self, e, r_e, r_a, r_b, q: ti.template(), lo, hi):
        """q += d(e, a, b)/dx^T r"""
        v = self.elements.vertices[e]
        self.model.blocks.add(q, v[0], -(r_e + r_a + r_b), lo, hi)
        self.model.blocks.add(q, v[1], r_e, lo, hi)
        self.model.blocks.add(q, v[2], r_a, lo, hi)
        self.model.blocks.add(q, v[3], r_b, lo, hi)

    @ti.func
    def turned(self, e):
        """C and dC as the hinge lies, whichever way it was creased."""
        e_x, a_x, b_x = self.arms(e, self.model.x)
        way = 1.0
        if ti.static(self.remembers):
            way = self.hysteresis.way(e)
        return hinge_condition(e_x, a_x, b_x, self.rest[e][2], self.rest[e][3], way)

    @ti.func
    def strain(self, e):
        """C, dC and C_dot at the current state."""
        C, g_e, g_a, g_b = self.turned(e)
        if ti.static(self.remembers):
            side = self.hysteresis.side(e, C)
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
    def slid(self, e, C):
        """(torque, torque over displacement, slope, energy) of what the hinge remembers, at the condition C."""
        torque, secant, slope, energy = 0.0, 0.0, 0.0, 0.0
        if ti.static(self.remembers):
            torque, secant, slope, energy = self.hysteresis.respond(e, C)
        return torque, secant, slope, energy

    def accept(self, h: float) -> bool:
        """Sliders follow the hinges."""
        if self.remembers:
            self._settle(h)
        return self.remembers

    @ti.kernel
    def _settle(self, h: float):
        for e in range(self.elements.first[self.model.blocks.count]):
            if self.elements.primary[e] == 1:
                self.hysteresis.settle(e, self.turned(e)[0], h)

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's hinges."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            C, C_dot, g_e, g_a, g_b = self.strain(e)
            s = -(self.rest[e][0] * C + self.rest[e][1] * C_dot)
            if ti.static(self.remembers):
                s -= self.slid(e, C)[0]
            self.scatter(e, s * g_e, s * g_a, s * g_b, f, lo, hi)

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
                if ti.static(self.remembers):
                    torque, secant, slope, energy = self.slid(e, C)
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
        m_e, m_a, m_b = self.arms(e, to.motion)
        if moves == 1:
            s += k * (g_e.dot(m_e) + g_a.dot(m_a) + g_b.dot(m_b))
            self.before[e] = C  # where the step starts
        if ti.static(self.remembers):
            led = C
            if moves == 1:
                led += g_e.dot(m_e) + g_a.dot(m_a) + g_b.dot(m_b)
            torque, secant, slope, energy = self.slid(e, led)
            s += torque
            k += secant if ti.static(not self.exact) else slope
            pull += self.slid(e, C)[0]
        r_e, r_a, r_b = -c * s * g_e, -c * s * g_a, -c * s * g_b
        if ti.static(self.exact):
            e_x, a_x, b_x = self.arms(e, self.model.x)
            if over > 0:
                pull += k_d * C_dot
            if ti.static(self.remembers):
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

    @ti.func
    def store_exact(self, e, factor):
        """The 9x9 block g g^T + factor ddC, a column at a time."""
        e_x, a_x, b_x = self.arms(e, self.model.x)
        for column in range(9):
            d = ti.Matrix.zero(float, 3, 3)
            for i, j in ti.static(ti.ndrange(3, 3)):
                if column == 3 * i + j:
                    d[i, j] = 1
            rows = hinge_condition_change(e_x, a_x, b_x, ti.Vector([d[0, 0], d[0, 1], d[0, 2]]),
                                          ti.Vector([d[1, 0], d[1, 1], d[1, 2]]),
                                          ti.Vector([d[2, 0], d[2, 1], d[2, 2]]), self.rest[e][2],
                                          self.rest[e][3])
            for i, j in ti.static(ti.ndrange(3, 3)):
                self.hessian[e][9 * column + 3 * i + j] = (self.g[e][column] * self.g[e][3 * i + j]
                                                          + factor * rows[i][j])

    @ti.func
    def add_diagonal(self, e, P: ti.template(), lo, hi):
        """P += the diagonal 3x3 blocks of the stored block."""
        v = self.elements.vertices[e]
        if ti.static(self.exact):
            first = ti.Matrix.zero(float, 3, 3)
            for i in ti.static(range(3)):
                own = ti.Matrix.zero(float, 3, 3)
                for r, s in ti.static(ti.ndrange(3, 3)):
                    own[r, s] = self.hessian[e][9 * (3 * i + r) + 3 * i + s]
                    for j in ti.static(range(3)):
                        first[r, s] += self.hessian[e][9 * (3 * i + r) + 3 * j + s]
                self.model.blocks.add(P, v[i + 1], sym(own), lo, hi)
            self.model.blocks.add(P, v[0], sym(first), lo, hi)
        else:
            g_e, g_a, g_b = self.gradient(e)
            g_0 = g_e + g_a + g_b
            self.model.blocks.add(P, v[0], sym_outer(g_0), lo, hi)
            self.model.blocks.add(P, v[1], sym_outer(g_e), lo, hi)
            self.model.blocks.add(P, v[2], sym_outer(g_a), lo, hi)
            self.model.blocks.add(P, v[3], sym_outer(g_b), lo, hi)

    @ti.func
    def gradient(self, e):
        """The stored, scaled dC."""
        g = ti.static(self.g)
        return (ti.Vector([g[e][0], g[e][1], g[e][2]]), ti.Vector([g[e][3], g[e][4], g[e][5]]),
                ti.Vector([g[e][6], g[e][7], g[e][8]]))

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p with the blocks of the last `linearize`."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            p_e, p_a, p_b = self.arms(e, p)
            if ti.static(self.exact):
                r = ti.Matrix.zero(float, 3, 3)
                for column in range(9):
                    s = self.pick(column, p_e, p_a, p_b)
                    for i, j in ti.static(ti.ndrange(3, 3)):
                        r[i, j] += self.hessian[e][9 * column + 3 * i + j] * s
                self.scatter(e, ti.Vector([r[0, 0], r[0, 1], r[0, 2]]), ti.Vector([r[1, 0], r[1, 1], r[1, 2]]),
                             ti.Vector([r[2, 0], r[2, 1], r[2, 2]]), q, lo, hi)
            else:
                g_e, g_a, g_b = self.gradient(e)
                s = g_e.dot(p_e) + g_a.dot(p_a) + g_b.dot(p_b)
                self.scatter(e, s * g_e, s * g_a, s * g_b, q, lo, hi)

    @ti.func
    def pick(self, column, p_e, p_a, p_b):
        """Component `column` of the 9 numbers (p_e, p_a, p_b)."""
        s = 0.0
        for i in ti.static(range(3)):
            if column == i:
                s = p_e[i]
            if column == 3 + i:
                s = p_a[i]
            if column == 6 + i:
                s = p_b[i]
        return s

    def build_levels(self, levels) -> None:
        """Sums of k and of k_d over the hinges that each node's hat bends, on the flat pattern."""
        sums = levels.squares(self.host_hinges, self.host_turns, self.host_stiff[:, :2])
        self.bent = self._fields.real(levels.count, 2, sums)

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D + s^T (-c D - c^2 K) s of flat cloth, the same in all directions."""
        return D + sym_scaled_identity(c * (c * self.bent[n][0] + self.bent[n][1]))

    def release(self, whole: np.ndarray, pulled: np.ndarray) -> None:
        """Hinges over a seam go with either of the stitches at their ends."""
        from ..system.stitches import ends_of

        rest = self._rest.copy()
        held = np.append(whole, True)[ends_of(*self._sewn)]
        self.host_whole = held.all(axis=1)
        rest[:, :2] *= self.host_whole[:, None]
        write(self.rest, self.elements.per_entry(rest).astype(self.model.exchange))

    def geometry(self) -> dict[str, np.ndarray]:
        """Hinges with their stiffness [N m] and rest angle."""
        k, _, theta_0, _ = self.host_rest.T
        out = {"hinges": self.model.user[self.host_hinges], "hinge_k": k, "hinge_rest": theta_0}
        if self.yields or self.creased:
            own = self.hysteresis.own if self.yields else np.ones(len(k))
            out |= {"creases": np.array(True), "hinge_arc": self.host_arc, "hinge_own": own}
        return out

    def recorded(self) -> dict[str, np.ndarray]:
        """Angles [rad] that hinges have been creased by, and which of them are whole, where not all are."""
        out = {"hinge_crease": self.hysteresis.creases().astype(np.float32)} if self.yields else {}
        return out if self.host_whole.all() else out | {"hinge_whole": self.host_whole}
