"""Hysteresis of bending by curvatures: friction and creases as in `hysteresis`, with a slider of each kind a triangle.

A slider is where the triangle's second derivatives x_ab have slid to: pi_ab, three vectors in the triangle's own frame F
(first edge, across it, normal), so that it turns with the cloth. In a step it stays. With

    P = fade F pi,    z = x_ab - P,    phi^2 = (k_uu |z_uu|^2 + k_uv |z_uv|^2 + k_vv |z_vv|^2) / K,
    E = K phi^2/2 where phi <= d, else K d (phi - d/2):

convex in z, with a continuous force; one slider for all three, so that cloth gives way alike in all directions (by component,
friction on the bias would be twice that along warp and weft). After an accepted step z is brought back to phi <= d.

- friction: k_ab from HB^2, d = SLIP; bent along warp or weft the moment is +- HB of that direction, on the bias their mean;
- creases: k_ab from (1 - H) D, d = yield curvature: of the mean of D, where D differs between warp and weft.

x_ab are vectors, not angles, so sharp folds count too: there x_ab lies in the triangles' planes. When the frame turns,
dz = dx_ab - w x P - g P with the rotation w and the fading g by its corners. P fades as a triangle collapses and has no
frame: r^2 (3 - 2 r) of its area over a tenth of that at rest. The matrix takes dE / dz over z, as hinges do, and leaves out
how w changes.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import read
from ..system.state import Elements, ParticleState
from .conditions import TINY, unit
from .curvature_sliders import CurvatureSliders

SYM = ((0, 0, 0), (1, 0, 1), (2, 0, 2), (3, 1, 1), (4, 1, 2), (5, 2, 2))  # numbers of a symmetric matrix: place, row, column


@ti.data_oriented
class CurvatureHysteresis:
    """Positions of the sliders of triangles, and their response. Kinds that no triangle has are left out.

    Args:
        faces: (m, 3) particles at the triangles' corners.
    """

    def __init__(self, made: Fields, model: ParticleState, elements: Elements, faces: np.ndarray,
                 law: CurvatureSliders) -> None:
        self.model, self.elements, per = model, elements, elements.per_entry
        there = np.flatnonzero(law.mean.any(axis=0))
        count, self.kinds = len(faces), len(there)
        self.creases_too = 1 in there
        self.row = made.integer(elements.count, data=per(np.arange(count) * self.kinds))
        self.corner = made.integer(elements.count, 3, per(faces))
        self.slot = made.integer(elements.count, 3, np.argmax(
            elements.host_vertices[:, None] == per(faces)[:, :, None], axis=2))
        self.k = made.real(count * self.kinds, 3, law.k[:, there])
        self.law = made.real(count * self.kinds, 2, np.stack([law.mean[:, there], law.reach[:, there]], axis=2))
        self.floor = made.real(elements.count, data=per(law.floor))
        self.recovers = bool(law.recovery[:, 0].any())
        self.recovery = made.real(elements.count, 2, per(law.recovery))
        self.stiff = False
        self.state = model.remember("curvature_sliders", count * self.kinds, 9)

    def build_stiffness(self, made: Fields) -> None:
        """Allocates the fields of implicit steps: edges of the last `linearize`, and dE / dz over k z of each kind."""
        self.edge, self.stiff = made.real(self.elements.count, 6), True
        self.secant, self.led = (made.real(self.elements.count * self.kinds) for _ in range(2))

    @ti.func
    def edges(self, e, q: ti.template()):
        """Differences of a per-vertex field from the triangle's first corner."""
        c = self.corner[e]
        return q[c[1]] - q[c[0]], q[c[2]] - q[c[0]]

    @ti.func
    def kept_edges(self, e):
        """Those of the last `linearize`."""
        k = self.edge[e]
        return ti.Vector([k[0], k[1], k[2]]), ti.Vector([k[3], k[4], k[5]])

    @ti.func
    def frame(self, e, e_1, e_2):
        """(rows t_1, t_2, n; fade, its slope over it [1/m^2], 1 over the doubled area and the first edge) of a triangle."""
        n_0 = e_1.cross(e_2)
        n, t_1 = unit(n_0), unit(e_1)
        r = ti.max(n_0.norm() / self.floor[e], 1e-9)
        value, slope = 1.0, 0.0
        if r < 1:
            value, slope = r * r * (3 - 2 * r), 6 * (1 - r) / (r * (3 - 2 * r) * self.floor[e])
        sizes = ti.Vector([value, slope, 1 / ti.max(n_0.norm(), TINY), 1 / ti.max(e_1.norm(), TINY)])
        return ti.Matrix.rows([t_1, n.cross(t_1), n]), sizes

    @ti.func
    def slid(self, row, F, sizes):
        """P, its rows uu, uv, vv."""
        pi = self.state.now[row]
        return sizes[0] * (ti.Matrix([[pi[0], pi[1], pi[2]], [pi[3], pi[4], pi[5]], [pi[6], pi[7], pi[8]]]) @ F)

    @ti.func
    def turn(self, e_1, e_2, F, sizes, d_1, d_2):
        """(w, g): how the frame turns and fades where the edges change by d_1, d_2."""
        t_2, n = row_of(F, 1), row_of(F, 2)
        dn = d_1.cross(e_2) + e_1.cross(d_2)
        return sizes[2] * n.cross(dn) + sizes[3] * t_2.dot(d_1) * n, sizes[1] * n.dot(dn)

    @ti.func
    def press(self, e, e_1, e_2, F, sizes, T, S, q: ti.template(), lo, hi):
        """q += the transpose: forces on the corners that do T . w + S g of work."""
        t_2, n = row_of(F, 1), row_of(F, 2)
        w = sizes[2] * T.cross(n) + sizes[1] * S * n
        f_1, f_2 = e_2.cross(w) + sizes[3] * n.dot(T) * t_2, w.cross(e_1)
        c = self.corner[e]
        self.model.blocks.add(q, c[0], -(f_1 + f_2), lo, hi)
        self.model.blocks.add(q, c[1], f_1, lo, hi)
        self.model.blocks.add(q, c[2], f_2, lo, hi)

    @ti.func
    def size(self, row, z):
        """phi of z, rows uu, uv, vv."""
        total = 0.0
        for m, c in ti.static(ti.ndrange(3, 3)):
            total += self.k[row][m] * z[m, c] ** 2
        return ti.sqrt(total / ti.max(self.law[row][0], TINY))

    @ti.func
    def share(self, row, phi):
        """(dE/dz over k z, E) at phi."""
        K, d = self.law[row][0], self.law[row][1]
        secant, energy = 1.0, 0.5 * K * phi * phi
        if phi > d:
            secant, energy = d / phi, K * d * (phi - 0.5 * d)
        return secant, energy

    @ti.func
    def weighed(self, row, secant, z):
        """dE/dz, rows uu, uv, vv."""
        out = z
        for m, c in ti.static(ti.ndrange(3, 3)):
            out[m, c] = secant * self.k[row][m] * z[m, c]
        return out

    @ti.func
    def respond(self, e, z_0, w, g, F, sizes):
        """(dE/dx_ab as rows, torque T and pull S on the frame, energy) where x_ab is z_0, led by w and g from this frame."""
        pull, T, S, energy = z_0 * 0, ti.Vector.zero(float, 3), 0.0, 0.0
        for j in range(self.kinds):
            row = self.row[e] + j
            P = self.slid(row, F, sizes)
            z = z_0 - P - changed(P, w, g)
            secant, own = self.share(row, self.size(row, z))
            mu = self.weighed(row, secant, z)
            pull += mu
            T, S = T + moment(P, mu), S + product(P, mu)
            energy += own
            if ti.static(self.stiff):
                self.led[self.kinds * e + j] = secant
        return pull, T, S, energy

    @ti.func
    def add_force(self, e, q, f: ti.template(), lo, hi):
        """f += the frame's part of the forces at second derivatives q; their part, as rows."""
        e_1, e_2 = self.edges(e, self.model.x)
        F, sizes = self.frame(e, e_1, e_2)
        pull, T, S, energy = self.respond(e, q, ti.Vector.zero(float, 3), 0.0, F, sizes)
        self.press(e, e_1, e_2, F, sizes, T, S, f, lo, hi)
        return pull

    @ti.func
    def stored(self, e, q, moved):
        """(energy [J], its rate [W]) at second derivatives q that change by `moved` [1/(m s)]."""
        e_1, e_2 = self.edges(e, self.model.x)
        F, sizes = self.frame(e, e_1, e_2)
        d_1, d_2 = self.edges(e, self.model.v)
        pull, T, S, energy = self.respond(e, q, ti.Vector.zero(float, 3), 0.0, F, sizes)
        w, g = self.turn(e_1, e_2, F, sizes, d_1, d_2)
        return energy, product(pull, moved) - T.dot(w) - S * g

    @ti.func
    def linearize(self, e, moves, c, q, moved, to: ti.template(), lo, hi):
        """b += the frame's part, at the predicted positions with `moves`; returns the part of x_ab, as rows. Keeps the edges
        and secants that products need."""
        e_1, e_2 = self.edges(e, self.model.x)
        F, sizes = self.frame(e, e_1, e_2)
        d_1, d_2 = self.edges(e, to.rhs_displacement)
        w, g = self.turn(e_1, e_2, F, sizes, moves * d_1, moves * d_2)
        pull, T, S, energy = self.respond(e, q + moved, w, g, F, sizes)
        self.press(e, e_1, e_2, F, sizes, c * T, c * S, to.b, lo, hi)
        for i in ti.static(range(3)):
            self.edge[e][i] = e_1[i]
            self.edge[e][3 + i] = e_2[i]
        for j in range(self.kinds):
            self.secant[self.kinds * e + j] = c * c * self.led[self.kinds * e + j]
        return pull

    @ti.func
    def add_product(self, e, second, p: ti.template(), q: ti.template(), lo, hi):
        """q += the frame's part of the product with p, of second derivatives `second`; their part, as rows."""
        e_1, e_2 = self.kept_edges(e)
        F, sizes = self.frame(e, e_1, e_2)
        d_1, d_2 = self.edges(e, p)
        w, g = self.turn(e_1, e_2, F, sizes, d_1, d_2)
        pull, T, S = second * 0, ti.Vector.zero(float, 3), 0.0
        for j in range(self.kinds):
            P = self.slid(self.row[e] + j, F, sizes)
            mu = self.weighed(self.row[e] + j, self.secant[self.kinds * e + j], second - changed(P, w, g))
            pull += mu
            T, S = T + moment(P, mu), S + product(P, mu)
        self.press(e, e_1, e_2, F, sizes, -T, -S, q, lo, hi)
        return pull

    @ti.func
    def stiffness(self, e):
        """Stiffness of x_uu, x_uv, x_vv in the matrix, summed over all kinds."""
        out = ti.Vector.zero(float, 3)
        for j in range(self.kinds):
            out += self.secant[self.kinds * e + j] * self.k[self.row[e] + j]
        return out

    @ti.func
    def frame_block(self, e, B, s_1, s_2):
        """The frame's part of s^T A s, 6 numbers, for a shape s that changes x_ab by B and the edges by s_1 and s_2 times one
        direction or another."""
        e_1, e_2 = self.kept_edges(e)
        F, sizes = self.frame(e, e_1, e_2)
        out = ti.Vector.zero(float, 6)
        for j in range(self.kinds):
            P, A = self.slid(self.row[e] + j, F, sizes), self.secant[self.kinds * e + j] * self.k[self.row[e] + j]
            G = [self.led_by(P, e_1, e_2, F, sizes, s_1, s_2, c) for c in ti.static(range(3))]
            for m in ti.static(range(3)):
                for k, c, d in ti.static(SYM):
                    both = G[c][m, 0] * G[d][m, 0] + G[c][m, 1] * G[d][m, 1] + G[c][m, 2] * G[d][m, 2]
                    out[k] += A[m] * (both - B[m] * (G[c][m, d] + G[d][m, c]))
        return out

    @ti.func
    def led_by(self, P, e_1, e_2, F, sizes, s_1, s_2, c: ti.template()):
        """Change of P where the edges change by s_1 and s_2 in direction c."""
        d = ti.Vector([ti.static(float(c == i)) for i in ti.static(range(3))])
        w, g = self.turn(e_1, e_2, F, sizes, s_1 * d, s_2 * d)
        return changed(P, w, g)

    @ti.func
    def return_map(self, e, q, h):
        """Sliders follow second derivatives that came to q in a step of h; those of triangles that are collapsed rest."""
        e_1, e_2 = self.edges(e, self.model.x)
        F, sizes = self.frame(e, e_1, e_2)
        for j in range(self.kinds):
            row = self.row[e] + j
            z = (q - self.slid(row, F, sizes)) @ F.transpose() / ti.max(sizes[0], TINY)
            phi, d = sizes[0] * self.size(row, z), self.law[row][1]
            if sizes[0] > 0.5:
                if phi > d:
                    self.move(row, (1 - d / phi) * z)
                    z *= d / phi
                if ti.static(self.recovers):
                    if j == self.kinds - 1:
                        self.recover(e, row, z, h)

    @ti.func
    def move(self, row, change):
        """pi += change, rows uu, uv, vv."""
        for m, c in ti.static(ti.ndrange(3, 3)):
            self.state.now[row][3 * m + c] += change[m, c]

    @ti.func
    def recover(self, e, row, z, h):
        """Lets a crease that is pulled back recover at its rate, down to the part that stays; z is in the frame."""
        rate, stays = self.recovery[e][0], self.recovery[e][1]
        pi = self.state.now[row]
        at = ti.Matrix([[pi[0], pi[1], pi[2]], [pi[3], pi[4], pi[5]], [pi[6], pi[7], pi[8]]])
        size = self.size(row, at)
        if product(self.weighed(row, 1.0, z), at) < 0 and size > stays:
            back = at + (1 - ti.exp(-rate * h)) * z
            if product(self.weighed(row, 1.0, back), at) <= 0:
                back = at * 0
            left = self.size(row, back)
            if left < stays:
                back = at * (stays / size)
            self.move(row, back - at)

    def creases(self) -> np.ndarray:
        """(triangles,) curvature [1/m] that stays where nothing pulls, but for hardening."""
        rows = read(self.state.now).reshape(-1, self.kinds, 3, 3)[:, -1]
        plastic = np.sum(read(self.k).reshape(-1, self.kinds, 3)[:, -1] * np.sum(rows**2, axis=2), axis=1)
        mean = read(self.law).reshape(-1, self.kinds, 2)[:, -1, 0]
        return np.sqrt(plastic / np.where(mean > 0, mean, 1.0)) * self.creases_too


@ti.func
def row_of(F, m: ti.template()):
    """Row m of a matrix."""
    return ti.Vector([F[m, 0], F[m, 1], F[m, 2]])


@ti.func
def changed(P, w, g):
    """w x P + g P, row by row."""
    out = P
    for m in ti.static(range(3)):
        row = w.cross(row_of(P, m)) + g * row_of(P, m)
        for c in ti.static(range(3)):
            out[m, c] = row[c]
    return out


@ti.func
def moment(P, mu):
    """sum of P x mu over their rows."""
    out = ti.Vector.zero(float, 3)
    for m in ti.static(range(3)):
        out += row_of(P, m).cross(row_of(mu, m))
    return out


@ti.func
def product(a, b):
    """sum of a b over all numbers."""
    total = 0.0
    for m, c in ti.static(ti.ndrange(3, 3)):
        total += a[m, c] * b[m, c]
    return total
