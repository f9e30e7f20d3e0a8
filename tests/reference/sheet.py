"""Energies, forces, K, D and masses of a scene's cloth, assembled dense."""

from collections import defaultdict

import numpy as np

from .conditions import bend, membrane
from .rest import area, hinges, pair


class Sheet:
    """Sums over all elements at a state x, v (n, 3).

    Attributes:
        energy: J by term. force: (n, 3) [N]. mass: (n,) [kg]. rayleigh: R [W], minus whose
            gradient by v is the damping force and drag: half the power that damping dissipates.
        K, D: (3n, 3n) df/dx and df/dv, K as `mode` says.
    """

    def __init__(self, scene, x, v, mode):
        self.x, self.v, self.mode, n = np.asarray(x, float), np.asarray(v, float), mode, len(x)
        self.energy, self.rayleigh = defaultdict(float), 0.0
        self.force, self.mass = np.zeros((n, 3)), np.zeros(n)
        self.K, self.D = np.zeros((3 * n, 3 * n)), np.zeros((3 * n, 3 * n))
        for cloth in scene.cloths:
            self.add_membrane(cloth)
            if cloth.fabric.bend is not None:
                (self.add_hinges if cloth.fabric.bend.model == "hinge" else self.add_curvatures)(cloth)
            for face, uv in zip(cloth.mesh.faces + cloth.start, cloth.mesh.corner_uv):
                self.mass[face] += cloth.fabric.density * area(uv) / 3
        for cloth, vertices, extra in scene.masses:
            self.mass[vertices + cloth.start] += extra
        if scene.gravity.any():
            self.energy["gravity"] = -float(np.sum(self.mass[:, None] * scene.gravity * self.x))
            self.force += self.mass[:, None] * scene.gravity
        if scene.air is not None:
            self.add_drag(scene)

    def add(self, vertices, f, K, D):
        """An element's force (3k,), K and D (3k, 3k)."""
        rows = (3 * np.asarray(vertices)[:, None] + np.arange(3)).ravel()
        self.force[vertices] += f.reshape(-1, 3)
        self.K[np.ix_(rows, rows)] += K
        self.D[np.ix_(rows, rows)] += D

    def add_membrane(self, cloth):
        """Stretch along u and v, and shear: E = area k/2 C^2; damping -area k_d C_dot dC (11)."""
        stretch, shear = cloth.fabric.stretch, cloth.fabric.shear
        k, k_d, b = (pair(stretch.k), pair(stretch.k_d), pair(stretch.b)) if stretch else ((0, 0), (0, 0), (1, 1))
        k, k_d = (*k, shear.k if shear else 0.0), (*k_d, shear.k_d if shear else 0.0)
        names = ("stretch_u", "stretch_v", "shear")
        for face, uv in zip(cloth.mesh.faces + cloth.start, cloth.mesh.corner_uv):
            *conditions, slope = membrane(self.x[face], uv, b)
            size, v = area(uv), self.v[face].ravel()
            for name, C, k_c, k_dc in zip(names, conditions, k, k_d):
                H = self.block(C, k_c, clamped=True)
                g = slope.T @ C.gradient
                self.energy[name] += size * k_c / 2 * C.value**2
                self.rayleigh += size * k_dc / 2 * (g @ v) ** 2
                self.add(face, -size * (k_c * C.value + k_dc * (g @ v)) * g, -size * slope.T @ H @ slope,
                         -size * k_dc * np.outer(g, g))

    def block(self, C, k, clamped):
        """d2/dw2 of k/2 C^2 by what C is a function of, as the mode has it."""
        gauss_newton = k * np.outer(C.gradient, C.gradient)
        exact = gauss_newton + k * C.value * C.hessian
        if self.mode == "paper":
            return exact
        if self.mode == "gauss_newton" or not clamped:
            return gauss_newton
        values, vectors = np.linalg.eigh(exact)
        return (vectors * np.maximum(values, 0)) @ vectors.T

    def add_hinges(self, cloth):
        """E = k/2 C^2, k = D |e|^2 / (A_1 + A_2) with D of the direction across the edge; projected K is Gauss-Newton's."""
        fabric = cloth.fabric.bend
        given = fabric.rest == "given" or (fabric.rest is None and cloth.mesh.flattened)
        for hinge in hinges(cloth.mesh):
            vertices = np.array(hinge["vertices"]) + cloth.start
            k, k_d = (hinge["weight"] * float(hinge["across"] @ pair(value)) for value in (fabric.D, fabric.k_d))
            C = bend(self.x[vertices], hinge["angle"] if given else 0.0, hinge["least"])
            g, C_dot = C.gradient, C.gradient @ self.v[vertices].ravel()
            self.energy["bend"] += k / 2 * C.value**2
            self.rayleigh += k_d / 2 * C_dot**2
            self.add(vertices, -(k * C.value + k_d * C_dot) * g, -self.block(C, k, clamped=False), -k_d * np.outer(g, g))

    def add_curvatures(self, cloth):
        """E = area/2 (D_u |x_uu|^2 + 2 sqrt(D_u D_v) |x_uv|^2 + D_v |x_vv|^2), with the weights of x_ab that
        `curvature_fit` gives (test_curvature_bend holds those); damping of the conditions |x_ab|."""
        from taichi_cloth.forces.curvature_fit import curvatures

        for vertices, weights, size in zip(*curvatures(cloth.mesh)):
            vertices = vertices + cloth.start
            for term in range(3):
                k, k_d = (size * (u, 2 * np.sqrt(u * v), v)[term]
                          for u, v in map(pair, (cloth.fabric.bend.D, cloth.fabric.bend.k_d)))
                slope = np.kron(weights[term], np.eye(3))  # dq/dx (3, 3k); a vertex that fills a row up has weight 0
                q = slope @ self.x[vertices].ravel()
                way = q / max(np.linalg.norm(q), 1e-300)
                speed = way @ slope @ self.v[vertices].ravel()
                f = -slope.T @ (k * q + k_d * speed * way)
                self.energy["bend"] += k / 2 * q @ q
                self.rayleigh += k_d / 2 * speed**2
                self.add_repeated(vertices, f, -k * slope.T @ slope, -k_d * np.outer(slope.T @ way, slope.T @ way))

    def add_repeated(self, vertices, f, K, D):
        """As `add`, where a vertex may be named more than once."""
        rows = (3 * vertices[:, None] + np.arange(3)).ravel()
        np.add.at(self.force, vertices, f.reshape(-1, 3))
        np.add.at(self.K, np.ix_(rows, rows), K)
        np.add.at(self.D, np.ix_(rows, rows), D)

    def add_drag(self, scene):
        """f = -area (c_n n n^T + c_t (I - n n^T)) (v - wind), a third on each corner; no K."""
        air, wind = scene.air, scene.air.wind_at(0.0)
        for cloth in scene.cloths:
            for face in cloth.mesh.faces + cloth.start:
                twice = np.cross(self.x[face[1]] - self.x[face[0]], self.x[face[2]] - self.x[face[0]])
                size = np.linalg.norm(twice)
                n = twice / max(size, 1e-300)
                B = size / 2 * (air.normal * np.outer(n, n) + air.tangential * (np.eye(3) - np.outer(n, n)))
                v = self.v[face].mean(axis=0)
                f = -B @ (v - wind)
                self.rayleigh += v @ B @ (v / 2 - wind)
                self.add(face, np.tile(f / 3, 3), np.zeros((9, 9)), -np.tile(B / 9, (3, 3)))
