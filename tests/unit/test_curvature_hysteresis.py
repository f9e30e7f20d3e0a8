"""What bending by curvatures remembers: forces, matrix and diagonal where sliders are away from 0, and how they follow."""

import numpy as np
import pytest
from test_forces import irregular, ladder, potential, products

import taichi_cloth as tc
from taichi_cloth.backend.rows import read, write
from taichi_cloth.forces.curvature_fit import curvatures

D, H, YIELD = (2e-2, 3e-2), 0.25, 4.0
CREASES = tc.Bend(D, yield_=YIELD, hardening=H, model="curvature")
BOTH = tc.Bend(D, friction=(0.05, 0.08), yield_=YIELD, hardening=H, model="curvature")


def frames(x, faces):
    """(m, 3, 3) rows: along the first edge, across it, normal."""
    a, b = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    n = np.cross(a, b)
    n, t = (w / np.linalg.norm(w, axis=1)[:, None] for w in (n, a))
    return np.stack([t, np.cross(n, t), n], axis=1)


def simulation(rng, bend=BOTH, **kwargs):
    mesh, x, v = irregular(rng)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, bend=bend), x, v)
    return tc.Simulation(scene, **kwargs), mesh, x, v


def curved(mesh, x):
    """(m, 3, 3) second derivatives uu, uv, vv, as rows."""
    vertices, B, _ = curvatures(mesh)
    return np.einsum("kma,kac->kmc", B, x[vertices])


def put(sim, pi):
    """Sets the sliders, (m, kinds, 3, 3)."""
    write(sim.model.remembered["curvature_sliders"].now, pi.reshape(-1, 9))


def at(sim, x, v=None):
    sim.set_state(x, 0 * x if v is None else v)
    return sim


@pytest.mark.parametrize("reach", [0.02, 3.0])
def test_force_and_energy_where_sliders_are_anywhere(rng, reach):
    """Force is -dE/dx, net force and torque are 0, and nothing changes as all turns; within reach and beyond."""
    sim, mesh, x, _ = simulation(rng)
    pi = np.stack([np.einsum("mij,maj->mai", frames(x, mesh.faces), curved(mesh, x))] * 2, axis=1)
    put(sim, pi + reach * rng.normal(size=pi.shape))
    p = rng.normal(size=x.shape)
    f = at(sim, x).forces()
    assert ladder(-np.sum(f * p), lambda eps: potential(at(sim, x + eps * p)), np.abs(np.sum(f * p))) < 1e-7
    size = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < 1e-12 * size and np.abs(np.cross(x, f).sum(axis=0)).max() < 1e-12 * size
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    energy = potential(at(sim, x))
    assert potential(at(sim, x @ Q.T + [1, 2, 3])) == pytest.approx(energy, rel=1e-12)
    assert np.abs(sim.forces() - f @ Q.T).max() < 1e-11 * np.abs(f).max()


@pytest.mark.slow
def test_the_matrix_is_exact_where_sliders_rest(rng):
    """At z = 0 Gauss-Newton's is the force's derivative; symmetric anywhere, with the preconditioner's diagonal."""
    sim, mesh, x, v = simulation(rng, CREASES)
    pi = np.einsum("mij,maj->mai", frames(x, mesh.faces), curved(mesh, x))
    put(sim, pi)
    p = rng.normal(size=x.shape)
    K_p, _ = products(at(sim, x), p)
    assert ladder(K_p, lambda eps: at(sim, x + eps * p).forces(), np.abs(K_p).max()) < 1e-7
    put(sim, pi + 5.0 * rng.normal(size=pi.shape))
    n, h = len(x), 0.01
    at(sim, x)
    dense = np.stack([sim.product(e.reshape(n, 3), h).ravel() for e in np.eye(3 * n)], axis=1)
    assert np.abs(dense - dense.T).max() < 1e-12 * np.abs(dense).max() and np.linalg.eigvalsh(dense).min() > 0
    P = read(sim.integrator.system.operator.P)[:n]
    for particle, vertex in enumerate(sim.model.user):
        block = dense[3 * vertex: 3 * vertex + 3, 3 * vertex: 3 * vertex + 3]
        assert np.abs(P[particle] - block[np.triu_indices(3)]).max() < 1e-12 * np.abs(dense).max()


@pytest.mark.slow
def test_a_triangle_that_collapses_has_no_jump(rng):
    """A corner goes through the opposite edge: energy and force change by no more than the step."""
    sim, mesh, x, _ = simulation(rng, CREASES)
    put(sim, 5.0 * rng.normal(size=(len(mesh.faces), 3, 3)))
    a, b, c = mesh.faces[7]
    way = (x[a] + x[b]) / 2 - x[c]
    energies, works = [], []
    parts = np.linspace(0.98, 1.02, 2001)
    for part in parts:
        y = x.copy()
        y[c] += part * way
        energies.append(potential(at(sim, y)))
        works.append(sim.forces()[c] @ way)
    steps, scale = np.diff(energies), np.abs(energies).max()
    assert np.isfinite(energies).all() and np.abs(steps).max() < 0.02 * scale
    mean = (np.array(works[1:]) + works[:-1]) / 2 * np.diff(parts)
    assert np.abs(steps + mean).sum() < 0.02 * np.abs(steps).sum()


def cylinder(mesh, kappa, angle=0.0):
    """(n, 3) positions of a flat mesh bent to a curvature [1/m] in a direction of its pattern; the same sides up."""
    d, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    s, w = mesh.uv @ d, mesh.uv @ across
    k = kappa if abs(kappa) > 1e-9 else 1e-9
    return np.outer(np.sin(k * s) / k, [d[0], 0, -d[1]]) + np.outer(w, [across[0], 0, -across[1]]) + np.outer(
        (1 - np.cos(k * s)) / k, [0, 1, 0])


LOOP, SIDES = 150.0, (0.008, 0.006)  # 1/m, m


def loop(h, bend, angle=0.0):
    """(curvatures, moments [N], work a round per area [N/m]) of the second round of a sheet bent to +-LOOP."""
    mesh = tc.grid(SIDES, (6, 5))
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.1, bend=bend), cylinder(mesh, 0.0, angle))
    scene.move(cloth, range(mesh.vertex_count), lambda t: cylinder(mesh, LOOP * np.sin(2 * np.pi * t), angle))
    kappa, moment, per, tiny = [], [], round(1 / h), 0.1
    with tc.Simulation(scene, h=h, integrator="backward_euler", stretch_limit=1e9) as sim:
        for _ in range(2 * per + per // 4 + 1):
            sim.step()
            kappa.append(LOOP * np.sin(2 * np.pi * sim.time))
            change = (cylinder(mesh, kappa[-1] + tiny, angle) - cylinder(mesh, kappa[-1] - tiny, angle)) / (2 * tiny)
            moment.append(-np.sum(sim.forces() * change) / np.prod(SIDES))
    k, m = np.array(kappa[-per - 1:]), np.array(moment[-per - 1:])
    return k, m, abs(np.sum((m[1:] + m[:-1]) / 2 * np.diff(k)))


@pytest.mark.parametrize("h, angle", [(1 / 60, 0.0), (1 / 240, 0.0), (1 / 60, np.pi / 4)])
@pytest.mark.slow
def test_the_loop_of_moment_over_curvature(h, angle):
    """Area 4 HB kappa_max within 2 % along the warp and on the bias, closed to 1e-10, at either step."""
    HB = 2.5e-4
    k, m, area = loop(h, tc.Bend(1e-5, friction=HB, model="curvature"), angle)
    assert area == pytest.approx(4 * HB * LOOP, rel=0.02)
    assert abs(m[0] - m[-1]) < 1e-10 * np.abs(m).max() and abs(k[0] - k[-1]) < 1e-10 * LOOP
