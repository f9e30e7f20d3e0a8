"""Bending by curvatures: exact for quadratics, and in balance under constant curvature, on any triangulation."""

import numpy as np
import pytest
from test_forces import irregular, ladder, products

import taichi_cloth as tc
from taichi_cloth.backend.language import ti
from taichi_cloth.forces import curvature_bend
from taichi_cloth.forces.curvature_fit import curvatures, edge_gradients


def jittered(rng, n=8, seam=False):
    """A square whose inner vertices are moved and whose diagonals are random; with `seam`, each triangle's material
    coordinates are turned, mirrored and moved on their own."""
    grid = tc.grid(1.0, n)
    uv = np.array(grid.uv)
    inner = (uv > 1e-9).all(axis=1) & (uv < 1 - 1e-9).all(axis=1)
    uv[inner] += 0.25 / n * rng.uniform(-1, 1, (int(inner.sum()), 2))
    faces = np.array(grid.faces)
    corner = uv[faces]
    if seam:
        angle = rng.uniform(0, 6, len(faces))
        turn = np.stack([np.stack([np.cos(angle), -np.sin(angle)], 1), np.stack([np.sin(angle), np.cos(angle)], 1)], 1)
        turn[::3, :, 0] *= -1  # and some are mirrored
        corner = np.einsum("kij,kaj->kai", turn, corner) + rng.uniform(-3, 3, (len(faces), 1, 2))
    return uv, tc.TriMesh(np.column_stack([uv[:, 0], 0 * uv[:, 0], uv[:, 1]]), faces, corner)


@pytest.mark.parametrize("seam", [False, True])
def test_quadratics_are_exact(rng, seam):
    uv, mesh = jittered(rng, 12, seam)
    vertices, B, area = curvatures(mesh)
    field = 0.7 * uv[:, 0] ** 2 - 0.4 * uv[:, 0] * uv[:, 1] + 0.9 * uv[:, 1] ** 2 + uv @ [3.0, -2.0] + 5
    q = np.einsum("kma,ka->km", B, field[vertices])
    density = q[:, 0] ** 2 + 2 * q[:, 1] ** 2 + q[:, 2] ** 2  # the same in any frame
    exact = 1.4**2 + 2 * 0.4**2 + 1.8**2
    assert (np.abs(density / exact - 1) < 1e-8).sum() > len(density) - 4  # all but single triangles in corners
    plane = np.einsum("kma,ka->km", B, (uv @ [3.0, -2.0] + 5)[vertices])
    assert np.abs(plane).max() < 1e-9
    if not seam:
        good = np.abs(density / exact - 1) < 1e-8
        assert np.abs(q[good] - [1.4, -0.4, 1.8]).max() < 1e-7
        force = np.zeros((3, len(uv)))  # of a constant curvature, on each vertex
        for m in range(3):
            np.add.at(force[m], vertices, area[:, None] * B[:, m])
        inner = (np.abs(uv - 0.5) < 0.5 - 3.4 / 12).all(axis=1)
        assert inner.sum() >= 1 and np.abs(force[:, inner]).max() < 1e-9


def test_an_irregular_cantilever_has_its_rigidity(rng):
    """Tip of a clamped strip under its weight, q L^4 / 8 D at small slopes; the clamp is half a cell uncertain."""
    n, rows = 40, 4
    grid = tc.grid((1.0, rows / n), (n, rows))
    uv = np.array(grid.uv)
    inner = (uv > uv.min(axis=0) + 1e-9).all(axis=1) & (uv < uv.max(axis=0) - 1e-9).all(axis=1)
    uv[inner] += 0.2 / n * rng.uniform(-1, 1, (int(inner.sum()), 2))
    mesh = tc.TriMesh(np.column_stack([uv[:, 0], 0 * uv[:, 0], -uv[:, 1]]), grid.faces, uv)
    vertices, B, area = curvatures(mesh)
    K = np.zeros((len(uv), len(uv)))
    for v, b, a in zip(vertices, B, area):
        np.add.at(K, (v[:, None], v[None]), a * (b.T * [1, 2, 1]) @ b)
    weight = np.zeros(len(uv))
    np.add.at(weight, mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3))
    free = uv[:, 0] > uv[:, 0].min() + 1 / n + 1e-9
    w = np.zeros(len(uv))
    w[free] = np.linalg.solve(K[np.ix_(free, free)], weight[free])
    tip = w[uv[:, 0] > uv[:, 0].max() - 1e-9].mean()
    assert (1 - 1 / n) ** 4 / 8 < tip * 1.03 and tip < 1.03 * (1 - 0.5 / n) ** 4 / 8
    assert (np.linalg.eigvalsh(K)[:3] < 1e-6).all() and np.linalg.eigvalsh(K)[3] > 0.1  # only planes cost nothing


@pytest.mark.slow
def test_rigidity_does_not_depend_on_the_triangulation(rng):
    """A cylinder of curvature 1: energy D/2 an area, on a jittered mesh, bent along any direction; hinges are off."""
    uv, mesh = jittered(rng, 16)
    found: dict[str, list[float]] = {"curvature": [], "hinge": []}
    for angle in (0.0, 0.4, 0.8, 2.0):
        s = uv @ [np.cos(angle), np.sin(angle)] - 0.6
        across = uv @ [-np.sin(angle), np.cos(angle)]
        x = np.column_stack([np.sin(s), 1 - np.cos(s), across])
        for model, energies in found.items():
            scene = tc.Scene(gravity=None)
            scene.add_cloth(mesh, tc.Fabric(0.2, bend=tc.Bend(1e-3, model=model)), x)
            sim = tc.Simulation(scene, preconditioner="block_jacobi")
            energies.append(sim.energy()["bend"] / 0.5e-3)
            sim.close()
    assert np.abs(np.array(found["curvature"]) - 1).max() < 0.02, found
    assert np.ptp(found["hinge"]) > 5 * np.ptp(found["curvature"]), found


def test_a_given_rest_shape_is_refused():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, bend=tc.Bend(1e-3, rest="given", model="curvature")), name="dress")
    with pytest.raises(tc.SceneError, match="dress.*flat rest shape.*hinge"):
        tc.Simulation(scene)


def test_a_pattern_far_from_its_origin_bends_alike():
    """Fits of curvature are the same where u and v are larger by a binary number that costs them no digit."""
    mesh = tc.grid(1.0, 4)
    far = tc.TriMesh(mesh.x, mesh.faces, mesh.uv + 2.0**40)
    for near, there in zip(edge_gradients(mesh), edge_gradients(far)):
        assert there == pytest.approx(near, abs=1e-12)


D, STIFFER = 2e-2, 10.0  # N m, 1/J


@ti.data_oriented
class Stiffening(curvature_bend.CurvatureBend):
    """E = area D/2 s + STIFFER/4 s^2 a triangle, s = |x_uu|^2 + 2 |x_uv|^2 + |x_vv|^2 by the weights of D."""

    @ti.func
    def square(self, e, q):
        """area D s"""
        total = 0.0
        for m, c in ti.static(ti.ndrange(3, 3)):
            total += self.k[e][m] * q[m, c] ** 2
        return total

    @ti.func
    def add_energy(self, e, q, moved, sums: ti.template()):
        """Both terms, and their rates."""
        s, M = self.square(e, q), self.moment(e, q)
        sums[0] += 0.5 * s + 0.25 * STIFFER * s * s
        for m, c in ti.static(ti.ndrange(3, 3)):
            sums[2] += M[m, c] * moved[m, c]

    @ti.func
    def moment(self, e, q):
        """Their derivative."""
        out, factor = q, 1 + STIFFER * self.square(e, q)
        for m, c in ti.static(ti.ndrange(3, 3)):
            out[m, c] = factor * self.k[e][m] * q[m, c]
        return out

    @ti.func
    def stiffness(self, e, q):
        """Moment over curvature."""
        return (1 + STIFFER * self.square(e, q)) * ti.Vector([self.k[e][0], self.k[e][1], self.k[e][2]])


@pytest.mark.slow
def test_another_law_over_the_same_loops(rng, monkeypatch):
    """Three functions are all of it: force by differences of energy, and the product by dense matrices."""
    monkeypatch.setattr(curvature_bend, "CurvatureBend", Stiffening)
    mesh, x, v = irregular(rng)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, bend=tc.Bend(D, model="curvature")), x, 0 * v)
    p = rng.normal(size=x.shape)
    with tc.Simulation(scene) as sim:
        def energy(eps):
            sim.set_state(x + eps * p, 0 * x)
            return sim.energy()["bend"]

        power, here = np.sum(sim.forces() * p), sim.energy()["bend"]
        assert ladder(-power, energy, abs(power)) < 1e-7
        energy(0.0)
        K_p = products(sim, p)[0]
    vertices, B, area = curvatures(mesh)
    q = np.einsum("kma,kac->kmc", B, x[vertices])
    k = D * area[:, None] * [1, 2, 1]
    s = np.einsum("km,kmc->k", k, q**2)
    assert here == pytest.approx(np.sum(s / 2 + STIFFER * s**2 / 4), rel=1e-12) and STIFFER * s.max() > 0.1
    wanted = np.zeros_like(x)
    moment = ((1 + STIFFER * s)[:, None] * k)[:, :, None] * np.einsum("kma,kac->kmc", B, p[vertices])
    np.add.at(wanted, vertices, -np.einsum("kma,kmc->kac", B, moment))
    assert K_p == pytest.approx(wanted, abs=1e-9 * np.abs(wanted).max())
