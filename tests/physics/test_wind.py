"""Air that varies: plates that drag and lift, wind in space, gusts; against formulas taken afresh from positions."""

import numpy as np
import pytest

import taichi_cloth as tc

RHO, U = 1.2, np.array([4.0, 0.0, 0.0])


def sheet(air, angle=0.0, n=4, gravity=None, bend=None, density=0.1, pinned=False):
    """A sheet in the plane z = 0 whose normal is turned by an angle round y; small motions of its own."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    mesh = tc.grid(0.5, n)
    flat = mesh.x[:, [0, 2, 1]] if np.ptp(mesh.x[:, 1]) == 0 else mesh.x
    scene = tc.Scene(gravity=gravity, air=air)
    cloth = scene.add_cloth(mesh, tc.Fabric(density, tc.Stretch(500), bend=bend), (flat - flat.mean(axis=0)) @ turn.T)
    if pinned:
        scene.pin(cloth, range(mesh.vertex_count))
    return scene, cloth


def plate(x, v, faces, wind, air):
    """(n, 3) [N] of each triangle by the formula in the class `Air`, a third on each corner."""
    f = np.zeros_like(x)
    for face in faces:
        a, b, c = x[face]
        twice = np.cross(b - a, c - a)
        area, n = np.linalg.norm(twice) / 2, twice / np.linalg.norm(twice)
        u = v[face].mean(axis=0) - wind[face].mean(axis=0)
        size = np.linalg.norm(u)
        e, cosine = u / size, abs(n @ u) / size
        along = -air.normal * (n @ u) * n - air.tangential * (u - (n @ u) * n)
        squared = -0.5 * air.density * size**2 * (air.drag * cosine * e + air.lift * ((n @ e) * n - cosine**2 * e))
        f[face] += area * (along + squared) / 3
    return f


def swirl(x, t):
    """A wind that turns, shears and grows."""
    return np.column_stack([1 - 3 * x[:, 1] + t, 2 + 3 * x[:, 0], np.sin(4 * x[:, 0] * x[:, 2]) + 0 * t])


@pytest.mark.parametrize("air", [tc.Air(0.8, 0.2, swirl), tc.Air(wind=swirl, drag=1.3, lift=0.9),
                                 tc.Air(0.3, 0.1, U, 1.1, 1.1, density=2.0), tc.Air(0.3, wind=lambda t: (3, t, 1), drag=1)])
def test_forces_are_the_formula(rng, air):
    scene, cloth = sheet(air, 0.3)
    sim = tc.Simulation(scene)
    x = cloth.positions + 0.03 * rng.normal(size=cloth.positions.shape)
    v = rng.normal(size=x.shape)
    still = tc.Simulation(sheet(None, 0.3)[0])
    for s in (still, sim):
        s.set_state(x, v)
    wind = np.broadcast_to(air.wind_at(0.0, x), x.shape)
    expected = plate(x, v, cloth.mesh.faces, wind, air)
    f = sim.forces() - still.forces()
    assert np.abs(f - expected).max() < 1e-12 * max(np.abs(expected).max(), np.abs(still.forces()).max())
    p, h = rng.normal(size=x.shape), 1 / 60
    drag = (sim.product(p, h) - still.product(p, h)) / h  # A B of the state: what is linear in the velocity
    wind = np.broadcast_to(air.wind_at(h, x), x.shape)  # of the end of such a step
    eps = 1e-6
    frozen = [plate_frozen(x, v, v + s * eps * p, cloth.mesh.faces, wind, air) for s in (1, -1)]
    assert np.abs(drag + (frozen[0] - frozen[1]) / (2 * eps)).max() < 1e-6 * np.abs(drag).max()
    assert np.sum(p * drag) > 0
    for s in (still, sim):
        s.close()


def plate_frozen(x, v, now, faces, wind, air):
    """The same with |u| and c of velocities v, where the velocities are `now`."""
    f = np.zeros_like(x)
    for face in faces:
        a, b, c = x[face]
        twice = np.cross(b - a, c - a)
        area, n = np.linalg.norm(twice) / 2, twice / np.linalg.norm(twice)
        u, w = v[face].mean(axis=0) - wind[face].mean(axis=0), now[face].mean(axis=0) - wind[face].mean(axis=0)
        size = np.linalg.norm(u)
        c = abs(n @ u) / size
        B = (air.normal * np.outer(n, n) + air.tangential * (np.eye(3) - np.outer(n, n))
             + 0.5 * air.density * size * (air.drag * c * np.eye(3) + air.lift * (np.outer(n, n) - c**2 * np.eye(3))))
        f[face] -= area * B @ w / 3
    return f


def test_a_plate_at_an_angle_drags_and_lifts():
    """C_D rho/2 U^2 A c along the wind, C_L rho/2 U^2 A c sqrt(1 - c^2) across it, upwards where the plate leans back."""
    angle, area = 0.5, 0.25
    scene, _ = sheet(tc.Air(wind=U, drag=1.2, lift=0.8), angle, pinned=True)
    with tc.Simulation(scene) as sim:
        total = sim.forces().sum(axis=0)
        c = np.sin(angle)
        scale = 0.5 * RHO * (U @ U) * area
        assert total[0] == pytest.approx(scale * 1.2 * c, rel=1e-12)
        assert np.hypot(*total[1:]) == pytest.approx(scale * 0.8 * c * np.sqrt(1 - c * c), rel=1e-12)
        sim.step()
        assert np.abs(sim.constraint_forces().sum(axis=0) + total).max() < 1e-9 * scale


@pytest.mark.parametrize("integrator", ["backward_euler", "tr_bdf2", "verlet"])
@pytest.mark.slow
def test_a_falling_sheet_comes_to_its_speed(integrator):
    """m v' = m g - rho/2 C_D A v^2: v = V tanh(g t / V), V^2 = 2 sigma g / (rho C_D); of first order in the step."""
    drag, sigma, g, t = 1.4, 0.1, 9.81, 0.15
    V = np.sqrt(2 * sigma * g / (RHO * drag))
    errors = []
    for n in (15, 30, 60):
        scene, _ = sheet(tc.Air(drag=drag), gravity=(0, 0, -g))
        sim = tc.Simulation(scene, h=t / n, integrator=integrator, cg_tol=1e-10)
        for _ in range(n):
            sim.step(t / n)
        assert len(sim.log) == n
        errors.append(abs(-sim.velocities()[:, 2].mean() - V * np.tanh(g * t / V)))
        if n == 60:
            sim.run(1.0, 10)
            assert -sim.velocities()[:, 2].mean() == pytest.approx(V, rel=1e-3)
        sim.close()
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert errors[-1] < 0.01 * V and (rates > 0.85).all(), (errors, rates)


@pytest.mark.slow
def test_work_of_the_wind_is_what_its_forces_do():
    """In converged steps nothing of the energy is left over, and the air's work is h f.v with f by the formula at the end."""
    air = tc.Air(0.2, 0.05, tc.Gusts((3.0, 0.0, 1.0), 1.5, 0.6, seed=3), drag=1.2, lift=0.6)
    scene, cloth = sheet(air, 0.4, bend=tc.Bend(1e-5), gravity=(0, 0, -9.81))
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    sim = tc.Simulation(scene, h=1 / 120, integrator="newton_euler", cg_tol=1e-12, newton_tol=1e-11, stretch_limit=9.0)
    for _ in range(6):
        t, x, v = sim.time, sim.positions(), sim.velocities()
        record = sim.step()
        assert record.h == pytest.approx(1 / 120)
        wind = air.wind_at(t + record.h, x)
        v_1 = sim.velocities()
        work = record.h * np.sum(felt(x, v, v_1, cloth.mesh.faces, wind, air) * v_1)
        row = record.ledger
        assert row["wind"] == pytest.approx(work, rel=1e-9) and abs(work) > 1e-4
        assert abs(row["unaccounted"]) < 1e-6 * (abs(row["wind"]) + abs(row["method"]))
    sim.close()


def felt(x, v, v_1, faces, wind, air):
    """Forces at the end of a step that began at x, v and ended with v_1."""
    f = np.zeros_like(x)
    for face in faces:
        n, area = normal(x[face])
        u, w = v[face].mean(axis=0) - wind[face].mean(axis=0), v_1[face].mean(axis=0) - wind[face].mean(axis=0)
        size = np.linalg.norm(u)
        c, N = abs(n @ u) / size, np.outer(n, n)
        B = (air.normal * N + air.tangential * (np.eye(3) - N)
             + 0.5 * air.density * size * (air.drag * c * np.eye(3) + air.lift * (N - c**2 * np.eye(3))))
        f[face] -= area * B @ w / 3
    return f


def normal(corners):
    """(unit normal, area)"""
    twice = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    return twice / np.linalg.norm(twice), np.linalg.norm(twice) / 2


def test_gusts_are_as_strong_as_they_say_and_lose_no_air(rng):
    gusts = tc.Gusts((5.0, 0.0, 0.0), 2.0, 1.5, seed=11)
    x = rng.uniform(-40, 40, size=(40_000, 3))
    w = gusts(x, 0.7)
    assert np.abs(w.mean(axis=0) - [5, 0, 0]).max() < 0.1
    assert np.sqrt(((w - [5, 0, 0]) ** 2).sum(axis=1).mean()) == pytest.approx(2.0, rel=0.02)
    eps, divergence = 1e-6, 0
    for k in range(3):
        d = eps * np.eye(3)[k]
        divergence = divergence + (gusts(x[:100] + d, 0.2)[:, k] - gusts(x[:100] - d, 0.2)[:, k]) / (2 * eps)
    assert np.abs(divergence).max() < 1e-6
    assert (tc.Gusts((5.0, 0, 0), 2.0, 1.5, seed=11)(x, 0.7) == w).all()
    assert np.abs(tc.Gusts((5.0, 0, 0), 2.0, 1.5, seed=12)(x, 0.7) - w).max() > 1
    # carried along by the mean: what is here now is downwind later, but for what has changed meanwhile
    here, later = gusts(x[:500], 0.0), gusts(x[:500] + [0.1, 0, 0], 0.02)
    stays, goes = np.abs(gusts(x[:500], 0.02) - here).mean(), np.abs(later - here).mean()
    assert goes < 0.4 * stays


@pytest.mark.slow
def test_a_run_in_gusts_is_resumed_bit_for_bit():
    def run():
        scene, cloth = sheet(tc.Air(wind=tc.Gusts((6.0, 0.0, 0.0), 3.0, 0.5, seed=5), drag=1.3, lift=1.0), 0.8,
                             bend=tc.Bend(1e-5), gravity=(0, 0, -9.81))
        scene.pin(cloth, "left")
        return tc.Simulation(scene, h=1 / 100)

    with run() as sim:
        for _ in range(10):
            sim.step()
        state = sim.checkpoint()
        for _ in range(10):
            sim.step()
        end = sim.positions()
    with run() as sim:
        sim.resume(state)
        for _ in range(10):
            sim.step()
        assert (sim.positions() == end).all()


def test_air_that_does_not_vary_costs_nothing_more():
    from taichi_cloth.forces.external import Drag

    for air, local in ((tc.Air(0.5), False), (tc.Air(0.5, wind=lambda t: (t, 0, 0)), False), (tc.Air(drag=1.0), True),
                       (tc.Air(0.5, wind=swirl), True)):
        with tc.Simulation(sheet(air)[0]) as sim:
            drag = next(f for f in sim.force_terms if isinstance(f, Drag))
            assert (type(drag) is not Drag) == local and hasattr(drag, "local") == local


@pytest.mark.parametrize("make, words", [
    (lambda: tc.Air(), "neither drags nor lifts"),
    (lambda: tc.Air(drag=1, lift=1.2), "lift = 1.2: must be at most drag = 1"),
    (lambda: tc.Air(drag=-1), "air drag = -1"),
    (lambda: tc.Air(drag=1, density=0), "air density = 0"),
    (lambda: tc.Air(1, wind=lambda a, b, c: 0), "function of time, or of positions and time"),
    (lambda: tc.Air(1, wind=lambda x, t: x[:, :2]), r"wind at t = 0 s: needs shape \(1, 3\)"),
    (lambda: tc.Air(1, wind=lambda x, t: x + np.nan), "not finite"),
    (lambda: tc.Gusts((1, 0, 0), 0), "gusts strength = 0"),
    (lambda: tc.Gusts((1, 0, 0), 1, seed=-1), "gusts seed = -1"),
    (lambda: tc.Gusts((1, 0), 1), "gusts mean"),
])
def test_impossible_air_is_refused(make, words):
    with pytest.raises(tc.SceneError, match=words):
        make()


def test_a_wind_that_turns_bad_on_the_way_is_named():
    def wind(x, t):
        return np.full(x.shape, np.inf if t > 0.05 else 1.0)

    scene, _ = sheet(tc.Air(1.0, wind=wind))
    with tc.Simulation(scene, h=1 / 50) as sim, pytest.raises(tc.SceneError, match="wind at t = 0.05.* s.*not finite"):
        for _ in range(5):
            sim.step()


SLOW = [pytest.param(*words, marks=pytest.mark.slow) for words in (("draught", "charmeuse"), ("light_breeze", "wool_coating"))]


@pytest.mark.parametrize("wind, fabric", [("breeze", "denim"), *SLOW])
def test_a_named_wind_lifts_cloth_by_the_angle_of_the_table(wind, fabric):
    """1.5 degrees: cloth stretches, bends at its upper edge, and still swings a little."""
    from taichi_cloth.app import scenefile

    scene = scenefile.read("wind")
    with tc.Simulation(scene.make({"cells": 3, "wind": wind, "fabric": fabric}), h=1 / 60) as sim:
        sim.run(3.0, 10)
        x, mesh = sim.positions(), sim.scene.cloths[0].mesh
    down, away = x[mesh.select("top")].mean(axis=0) - x[mesh.select("bottom")].mean(axis=0), np.array([-1, 0, 0])
    density, speed = tc.fabrics[fabric].density, {"draught": 0.5, "breeze": 3.0, "light_breeze": 2.5}[wind]
    a = np.arctan2(down @ away, down[1])
    q, s, c = 0.6 * speed**2, np.sin(a), np.cos(a)  # weight and air force across the cloth are as large
    slope = density * 9.81 * c + q * (1.2 * np.sin(2 * a) + 0.8 * (s**3 - 2 * s * c**2))  # of their difference, by the angle
    off = np.degrees((density * 9.81 * s - q * c * (1.2 * c + 0.8 * s**2)) / slope)
    assert abs(off) < 1.5
