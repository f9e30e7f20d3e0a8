"""Bending by second derivatives: a quadratic through each triangle and its three neighbours, E = area D/2 |x_ab|^2.

The fit is exact for any quadratic, so that the rigidity is D on every triangulation (a hinge's is D on equilateral
meshes only, 0.8 to 3 D on others). For deformations that keep lengths |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2 is the sum of
squares of the curvatures [Bergou et al. 2006]; patches of four triangles as in rotation-free shells [Onate, Zarate
2000]. Linear in positions: a constant matrix, the same in all three coordinates.

Differs from [BW98 §4.2]: no angle; the rest shape is flat. Damping is that of the conditions C = |x_ab|, along x_ab: a
cloth that turns as a whole is not slowed down.
"""

import math

import numpy as np
import taichi as ti

from ..elements import face_edges
from ..errors import SceneError
from ..fabric import pair
from ..fields import Fields
from ..mesh import TriMesh
from ..model import Elements, Model
from ..scene import Scene
from .conditions import sym_outer, sym_scaled_identity, unit

CONIC = 1e-2  # singular values of a fit below this part of the largest are left out: six points near a conic


@ti.data_oriented
class QuadraticBend:
    """Quadratic bending with damping; see `forces` for the contract.

    Stored for an element: 18 weights, the three factors of its block in A, and the directions of its damping.
    """

    energies = ("bend",)

    def __init__(self, fields: Fields, model: Model, scene: Scene, mode: str) -> None:
        self.model, self._fields = model, fields
        vertices, weights, factors = [], [], []
        for cloth in scene.cloths:
            bend = cloth.fabric.bend
            if bend is None or bend.model != "quadratic":
                continue
            if bend.rest == "given":
                raise SceneError(f"{cloth.name}: quadratic bending has a flat rest shape; rest='given' needs model='hinge'")
            v, B, area = patches(cloth.mesh)
            vertices.append(model.particle[v + cloth.start])
            weights.append(B)
            factors.append(area[:, None] * np.array([_moduli(bend.D) + _moduli(bend.k_d)]))
        corners, B, factor = (np.concatenate(parts) for parts in (vertices, weights, factors))
        self.elements = Elements(fields, model.blocks, corners)
        self.weight = fields.real(self.elements.count, 18, self.elements.per_entry(B.reshape(-1, 18)))
        self.factor = fields.real(self.elements.count, 6, self.elements.per_entry(factor))  # of k, then of k_d
        self.damps = bool(factor[:, 3:].any())
        self.rates = tuple(_largest(corners, B, factor[:, first:first + 3], model.mass) for first in (0, 3))
        self._unit_energy = float(np.sum(factor[:, :3] * np.sum(B**2, axis=2)) / 2)

    def rounding_energy(self, d: float) -> float:
        """Energy [J] that positions off by d [m] put into the rest shape."""
        return self._unit_energy * d * d

    def build_stiffness(self) -> None:
        """Allocates what only an implicit step needs."""
        self.A = self._fields.real(self.elements.count, 3)
        if self.damps:
            self.way = self._fields.real(self.elements.count, 9)

    @ti.func
    def second(self, e, q: ti.template()):
        """Second derivatives uu, uv, vv of a per-vertex field, as rows."""
        out = ti.Matrix.zero(float, 3, 3)
        for a in ti.static(range(6)):
            value = q[self.elements.vertices[e][a]]
            for m, c in ti.static(ti.ndrange(3, 3)):
                out[m, c] += self.weight[e][6 * m + a] * value[c]
        return out

    @ti.func
    def scatter(self, e, r, q: ti.template(), lo, hi):
        """q += the transpose of `second`, of rows r"""
        for a in ti.static(range(6)):
            value = ti.Vector.zero(float, 3)
            for m, c in ti.static(ti.ndrange(3, 3)):
                value[c] += self.weight[e][6 * m + a] * r[m, c]
            self.model.blocks.add(q, self.elements.vertices[e][a], value, lo, hi)

    @ti.func
    def along(self, q, u):
        """Rows of u, their parts along the rows of q."""
        out = u
        for m in ti.static(range(3)):
            n = unit(ti.Vector([q[m, 0], q[m, 1], q[m, 2]]))
            part = n[0] * u[m, 0] + n[1] * u[m, 1] + n[2] * u[m, 2]
            for c in ti.static(range(3)):
                out[m, c] = part * n[c]
        return out

    @ti.func
    def pull(self, e, q):
        """Minus the force on second derivatives that are q: of stretch and of damping."""
        out = q
        for m, c in ti.static(ti.ndrange(3, 3)):
            out[m, c] = self.factor[e][m] * q[m, c]
        if ti.static(self.damps):
            u = self.along(q, self.second(e, self.model.v))
            for m, c in ti.static(ti.ndrange(3, 3)):
                out[m, c] += self.factor[e][3 + m] * u[m, c]
        return out

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += internal forces of the block's patches."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            self.scatter(e, -self.pull(e, self.second(e, self.model.x)), f, lo, hi)

    @ti.func
    def linearize(self, block, c, motion: ti.template(), b: ti.template(), P: ti.template()):
        """b += c (f + K motion); keeps the factors of -c D - c^2 K and adds its diagonal to P."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            q, moved = self.second(e, self.model.x), self.second(e, motion)
            r = self.pull(e, q)
            for m, d in ti.static(ti.ndrange(3, 3)):
                r[m, d] += self.factor[e][m] * moved[m, d]
            self.scatter(e, -c * r, b, lo, hi)
            for m in ti.static(range(3)):
                self.A[e][m] = c * c * self.factor[e][m]
            if ti.static(self.damps):
                for m in ti.static(range(3)):
                    way = ti.sqrt(c * self.factor[e][3 + m]) * unit(ti.Vector([q[m, 0], q[m, 1], q[m, 2]]))
                    for d in ti.static(range(3)):
                        self.way[e][3 * m + d] = way[d]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            for a in ti.static(range(6)):
                own = ti.Vector.zero(float, 6)
                for m in ti.static(range(3)):
                    square = self.weight[e][6 * m + a] ** 2
                    own += sym_scaled_identity(self.A[e][m] * square)
                    if ti.static(self.damps):
                        own += square * sym_outer(self.direction(e, m))
                self.model.blocks.add(P, self.elements.vertices[e][a], own, lo, hi)

    @ti.func
    def direction(self, e, m: ti.template()):
        """Of damping of term m, scaled by the root of its factor."""
        return ti.Vector([self.way[e][3 * m], self.way[e][3 * m + 1], self.way[e][3 * m + 2]])

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += (-c D - c^2 K) p with the factors of the last `linearize`."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            r = self.second(e, p)
            for m in ti.static(range(3)):
                row = ti.Vector([r[m, 0], r[m, 1], r[m, 2]])
                out = self.A[e][m] * row
                if ti.static(self.damps):
                    way = self.direction(e, m)
                    out += way.dot(row) * way
                for c in ti.static(range(3)):
                    r[m, c] = out[c]
            self.scatter(e, r, q, lo, hi)

    @ti.func
    def measure(self, block, base: ti.template(), report: ti.template(), dtype: ti.template()):
        """Energy [J] in column `base`; then dissipated power / 2 [W]."""
        sums = ti.Vector.zero(dtype, 2)
        for e in range(self.elements.first[block], self.elements.first[block + 1]):
            if self.elements.primary[e] == 1:
                q = self.second(e, self.model.x)
                u = self.along(q, self.second(e, self.model.v))
                for m, c in ti.static(ti.ndrange(3, 3)):
                    sums[0] += 0.5 * self.factor[e][m] * q[m, c] ** 2
                    sums[1] += 0.5 * self.factor[e][3 + m] * u[m, c] ** 2
        report[block, base] = sums[0]
        report[block, base + 1] = sums[1]


def patches(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles with the vertices across their edges, unfolded into their material plane.

    Returns:
        (k, 6) vertices, (k, 3, 6) weights of the second derivatives uu, uv, vv [1/m^2], (k,) areas [m^2]. Across an
        edge without a neighbour stands the triangle's own first vertex, with weight 0; there the fit is that of
        least energy. Triangles without any neighbour are left out.
    """
    faces, m, corner = mesh.faces, mesh.face_count, mesh.corner_uv
    edges = face_edges(faces)  # row r is edge r // m of triangle r % m: corners (0, 1), (1, 2), (2, 0)
    order = np.lexsort((edges.max(axis=1), edges.min(axis=1)))
    s = np.sort(edges, axis=1)[order]
    twin = np.full(3 * m, -1)
    same = np.flatnonzero((s[1:] == s[:-1]).all(axis=1))
    twin[order[same]], twin[order[same + 1]] = order[same + 1], order[same]
    vertices = np.concatenate([faces, np.repeat(faces[:, :1], 3, axis=1)], axis=1)
    R, W = np.zeros((m, 3, 3)), np.zeros((m, 3, 6))
    for k in range(3):
        row = np.arange(m) + k * m
        there = twin[row] >= 0
        other, side = twin[row[there]] % m, twin[row[there]] // m
        vertices[there, 3 + k] = faces[other, (side + 2) % 3]
        a, b = corner[there, k], corner[there, (k + 1) % 3]
        flips = edges[row[there], 0] == edges[twin[row[there]], 0]
        c, d, tip = corner[other, side], corner[other, (side + 1) % 3], corner[other, (side + 2) % 3]
        c, d = np.where(flips[:, None], c, d), np.where(flips[:, None], d, c)  # where a and b are in the other's plane
        along, unit = d - c, b - a
        length = np.linalg.norm(along, axis=1)
        unit = unit / np.linalg.norm(unit, axis=1)[:, None]
        t = np.einsum("ki,ki->k", tip - c, along) / length
        height = np.abs(along[:, 0] * (tip - c)[:, 1] - along[:, 1] * (tip - c)[:, 0]) / length
        normal = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        third = corner[there, (k + 2) % 3]
        outward = -np.sign(np.einsum("ki,ki->k", normal, third - a))
        place = a + t[:, None] * unit + (outward * height)[:, None] * normal
        corners = corner[there]
        inverse = np.linalg.inv(np.concatenate([corners, np.ones((len(corners), 3, 1))], axis=2))
        share = np.einsum("kj,kji->ki", np.column_stack([place, np.ones(len(place))]), inverse)  # of the plane through them

        def quadratics(p: np.ndarray) -> np.ndarray:
            return np.stack([p[..., 0] ** 2 / 2, p[..., 0] * p[..., 1], p[..., 1] ** 2 / 2], axis=-1)

        origin = corners[:, :1]
        R[there, k] = quadratics(place - origin[:, 0]) - np.einsum("ki,kim->km", share, quadratics(corners - origin))
        W[there, k, :3] = -share
        W[there, k, 3 + k] = 1.0
    scale = np.array([1.0, math.sqrt(2.0), 1.0])  # the norm whose square the energy is
    inverse = np.linalg.pinv(R / scale, rcond=CONIC) / scale[:, None]
    keep = np.abs(W).sum(axis=(1, 2)) > 0
    return vertices[keep], (inverse @ W)[keep], mesh.material_areas[keep]


def _moduli(value) -> list[float]:
    """Of the terms |x_uu|^2, |x_uv|^2, |x_vv|^2, from (warp, weft)."""
    u, v = pair(value)
    return [u, 2 * math.sqrt(u * v), v]


def _largest(vertices: np.ndarray, B: np.ndarray, factor: np.ndarray, mass: np.ndarray) -> float:
    """A bound on the eigenvalues of M^-1 K [1/s^2] (or of M^-1 D): the largest row sum of absolute values."""
    K = np.abs(np.einsum("kma,km,kmb->kab", B, factor, B)).sum(axis=2)
    rows = np.bincount(vertices.ravel(), K.ravel(), minlength=len(mass))
    return float(np.max(rows / mass))
