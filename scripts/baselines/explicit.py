"""Compiled explicit cloth, one thread: the stretch and shear of [BW98], isometric bending, velocity Verlet. Needs Numba.

What an engineer writes in an afternoon, and hard to beat on soft cloth: a yardstick, not a product.
"""

import numba
import numpy as np

from taichi_cloth.scene.mesh import TriMesh
from taichi_cloth.system.elements import hinges, lumped_mass, triangles


def bending(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(vertices (k, 4), weights (k, 4) whose sum over positions is the curvature, stiffness (k,) per D) of all hinges.

    E = D/2 sum 3/A |sum w x|^2, w the cotangent weights [Bergou et al. 2006].
    """
    h = hinges(mesh)
    p = mesh.x[h.vertices]
    edge = p[:, 1] - p[:, 0]

    def cot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.einsum("ij,ij->i", a, b) / np.linalg.norm(np.cross(a, b), axis=1)

    at_0 = [cot(edge, p[:, s] - p[:, 0]) for s in (2, 3)]
    at_1 = [cot(-edge, p[:, s] - p[:, 1]) for s in (2, 3)]
    weights = np.stack([at_1[0] + at_1[1], at_0[0] + at_0[1], -at_0[0] - at_1[0], -at_0[1] - at_1[1]], axis=1)
    return h.vertices, weights, 3 / h.areas.sum(axis=1)


@numba.njit(fastmath=True, cache=False, error_model="numpy")
def _forces(x, f, tri, inverse, area, k, k_s):
    for e in range(len(tri)):
        a, b, c = tri[e]
        i00, i01, i10, i11 = inverse[e, 0, 0], inverse[e, 0, 1], inverse[e, 1, 0], inverse[e, 1, 1]
        ux = (x[b, 0] - x[a, 0]) * i00 + (x[c, 0] - x[a, 0]) * i10
        uy = (x[b, 1] - x[a, 1]) * i00 + (x[c, 1] - x[a, 1]) * i10
        uz = (x[b, 2] - x[a, 2]) * i00 + (x[c, 2] - x[a, 2]) * i10
        vx = (x[b, 0] - x[a, 0]) * i01 + (x[c, 0] - x[a, 0]) * i11
        vy = (x[b, 1] - x[a, 1]) * i01 + (x[c, 1] - x[a, 1]) * i11
        vz = (x[b, 2] - x[a, 2]) * i01 + (x[c, 2] - x[a, 2]) * i11
        s_u = area[e] * k * (1 - 1 / np.sqrt(ux * ux + uy * uy + uz * uz))
        s_v = area[e] * k * (1 - 1 / np.sqrt(vx * vx + vy * vy + vz * vz))
        s = area[e] * k_s * (ux * vx + uy * vy + uz * vz)
        gux, guy, guz = s_u * ux + s * vx, s_u * uy + s * vy, s_u * uz + s * vz
        gvx, gvy, gvz = s_v * vx + s * ux, s_v * vy + s * uy, s_v * vz + s * uz
        bx, by, bz = gux * i00 + gvx * i01, guy * i00 + gvy * i01, guz * i00 + gvz * i01
        cx, cy, cz = gux * i10 + gvx * i11, guy * i10 + gvy * i11, guz * i10 + gvz * i11
        f[b, 0] -= bx
        f[b, 1] -= by
        f[b, 2] -= bz
        f[c, 0] -= cx
        f[c, 1] -= cy
        f[c, 2] -= cz
        f[a, 0] += bx + cx
        f[a, 1] += by + cy
        f[a, 2] += bz + cz


@numba.njit(fastmath=True, cache=False, error_model="numpy")
def _bend(x, f, hinge, weight, stiff):
    for e in range(len(hinge)):
        for d in range(3):
            curved = 0.0
            for j in range(4):
                curved += weight[e, j] * x[hinge[e, j], d]
            for j in range(4):
                f[hinge[e, j], d] -= stiff[e] * weight[e, j] * curved


@numba.njit(fastmath=True, cache=False, error_model="numpy")
def run(x, v, m, pins, tri, inverse, area, k, k_s, hinge, weight, stiff, dt, steps, every):
    """Steps from rest: kick, drift; bending every few steps with as many times its weight."""
    f = np.zeros_like(x)
    for s in range(steps):
        f[:] = 0
        _forces(x, f, tri, inverse, area, k, k_s)
        if s % every == 0:
            _bend(x, f, hinge, every * weight, stiff / every)
        part = 0.5 if s == 0 else 1.0
        for i in range(len(x)):
            v[i, 0] += part * dt * f[i, 0] / m[i]
            v[i, 1] += part * dt * (f[i, 1] / m[i] - 9.81)
            v[i, 2] += part * dt * f[i, 2] / m[i]
        for p in pins:
            v[p] = 0
        for i in range(len(x)):
            for d in range(3):
                x[i, d] += dt * v[i, d]


def sheet(mesh: TriMesh, density: float, k: float, k_s: float, D: float, pins: np.ndarray):
    """A function (seconds, step, every) -> positions (n, 3) of the sheet dropped from its given shape."""
    t = triangles(mesh)
    m = lumped_mass(mesh, density)
    hinge, weight, stiff = bending(mesh)

    def go(seconds: float, dt: float, every: int) -> np.ndarray:
        x, v = mesh.x.copy(), np.zeros_like(mesh.x)
        steps = int(np.ceil(seconds / dt))
        run(x, v, m, pins, t.vertices, t.inverse, t.area, k, k_s, hinge, weight, D * stiff, seconds / steps, steps, every)
        return x

    return go
