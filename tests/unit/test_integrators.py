"""Integrators from inside: what a step is made of, rolling back, line search, going on from a checkpoint bit for bit."""

import zlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend.rows import read, write
from taichi_cloth.backend.timing import Clock
from taichi_cloth.step.integrators.tr_bdf2 import Stage
from taichi_cloth.step.nonlinear.euler import EulerStep
from taichi_cloth.step.nonlinear.newton import NewtonTolerance, line_search, minimize, phi
from taichi_cloth.system.checkpoint import VERSION

FABRIC = tc.Fabric(0.2, tc.Stretch((900, 700), 0.6), tc.Shear(150, 0.1), tc.Bend(2e-3))


def led(fabric=FABRIC, gravity=(0.0, -9.81, 0.0), moves=True) -> tc.Scene:
    """A sheet held at a corner and led at another; with `moves` False it is free."""
    mesh = tc.grid(0.6, 4)
    scene = tc.Scene(gravity=gravity)
    noise = 2e-3 * np.random.default_rng(71).normal(size=mesh.x.shape)
    cloth = scene.add_cloth(mesh, fabric, mesh.x + noise, velocities=20 * noise)
    if moves:
        scene.pin(cloth, "top_left")
        scene.move(cloth, "top_right", lambda t: (0.3 * np.sin(9 * t), 0.8 * t, 0.1 * t), relative=True)
    return scene


def forces_at(sim: tc.Simulation, x: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(n, 3) accelerations [m/s^2] in a state."""
    mass = np.empty(sim.vertex_count)
    mass[sim.model.user] = sim.model.mass
    sim.set_state(x, v)
    return sim.forces() / mass[:, None]


def field(sim: tc.Simulation, rows) -> np.ndarray:
    return sim.model.to_user(read(rows))


@pytest.mark.slow
def test_a_tr_bdf2_step_solves_the_formulas_two_stages():
    """TR to t + g h, BDF2 from there to t + h [Hosea & Shampine 1996], with forces taken from outside."""
    sim = tc.Simulation(led(moves=False), h=1 / 90, integrator="tr_bdf2", newton_tol=1e-12, cg_tol=1e-12, newton_max=60)
    g = 2 - np.sqrt(2)
    other = tc.Simulation(led(moves=False), h=1 / 90, integrator="backward_euler")
    for h in (1 / 90, 1 / 90, 1 / 200):  # the first step begins with the force there, the others with the one implied
        x_0, v_0 = sim.positions(), sim.velocities()
        assert sim.step(h).h == pytest.approx(h) and not sim.log[-1].rejections
        x_1, v_1, v_g = sim.positions(), sim.velocities(), field(sim, sim.integrator.v_g)
        x_g = x_0 + g * h / 2 * (v_0 + v_g)
        a_0, a_g, a_1 = (forces_at(other, x, v) for x, v in ((x_0, v_0), (x_g, v_g), (x_1, v_1)))
        np.testing.assert_allclose(v_g, v_0 + g * h / 2 * (a_0 + a_g), atol=1e-8)
        ahead, back, c = 1 / (g * (2 - g)), (1 - g) ** 2 / (g * (2 - g)), (1 - g) / (2 - g) * h
        np.testing.assert_allclose(v_1, ahead * v_g - back * v_0 + c * a_1, atol=1e-8)
        np.testing.assert_allclose(x_1, ahead * x_g - back * x_0 + c * v_1, atol=1e-12)
    assert np.abs(v_1 - v_0).max() > 0.02
    other.close()


def test_tr_bdf2_holds_what_is_led_where_it_is_at_each_stage():
    """At the beginning, at t + g h and at the end."""
    sim, asked = tc.Simulation(led(), h=1 / 60, integrator="tr_bdf2"), []
    sim.model.save()

    def held_at(s: float):
        asked.append(s)
        return sim.prescribed.at(0.0, s)

    made = sim.integrator.attempt(1 / 60, held_at, sim.meter.measure())
    assert made.rejection is None and asked == pytest.approx([0, (2 - np.sqrt(2)) / 60, 1 / 60])


@pytest.mark.slow
def test_verlets_substeps_are_kicks_and_drifts():
    """Two substeps by hand; damping by the velocity predicted at the whole substep; bending as the rest."""
    fabric = tc.Fabric(0.2, tc.Stretch((900, 700), 0.6), tc.Shear(150, 0.1), tc.Bend(0.4, 1e-4))
    sim = tc.Simulation(led(fabric, moves=False), integrator="verlet")
    other = tc.Simulation(led(fabric, moves=False), integrator="backward_euler")
    verlet = sim.integrator
    h = 0.8 * verlet.stable_step
    assert verlet.every == 1
    x, v = sim.positions(), sim.velocities()
    sim.step(2 * h)
    assert sim.log[-1].evaluations == 3
    u = v + h / 2 * (a := forces_at(other, x, v))
    for s in range(2):
        x = x + h * u
        predicted = u + h / 2 * a
        a = forces_at(other, x, predicted)
        u = u + (h / 2 if s else h) * a
    np.testing.assert_allclose(sim.positions(), x, atol=1e-11)
    np.testing.assert_allclose(sim.velocities(), u, atol=1e-7)


@pytest.mark.parametrize("integrator", ["verlet", "safe"])
def test_free_fall_is_exact(integrator):
    """A rigid sheet in free fall: x = g t^2/2 by every method of second order, to rounding."""
    scene = tc.Scene(gravity=(0.3, -9.81, 0.2))
    mesh = tc.grid(0.5, 4)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), tc.Shear(10), tc.Bend(1e-5)))
    sim = tc.Simulation(scene, h=1 / 60, integrator=integrator)
    for _ in range(12):
        sim.step()
    t = sim.time
    np.testing.assert_allclose(sim.positions() - mesh.x, np.tile(scene.gravity * t**2 / 2, (25, 1)), atol=1e-13)
    np.testing.assert_allclose(sim.velocities(), np.tile(scene.gravity * t, (25, 1)), atol=1e-12)


def test_restoring_brings_back_all_that_a_step_starts_from():
    sim = tc.Simulation(led(), integrator="safe")
    model = sim.model
    model.save()
    x, v = model.read_particles()
    model.write_particles(x + 1, v - 1)
    model.v_base.fill(7.0)
    model.restore()
    for rows, wanted in ((model.x, x), (model.v, v), (model.v_base, v)):
        assert (read(rows) == wanted).all()
    model.write_particles(x, v + 2)
    model.save()
    assert (read(model.v_base) == v + 2).all() and (read(model.v_saved) == v + 2).all()
    assert (read(model.x_saved) == x).all()


@pytest.mark.slow
def test_newton_goes_no_further_than_its_potential_falls():
    """A solve's answer a hundred times too long is taken back until the potential falls, x with it: in all problems."""
    for integrator, k in (("tr_bdf2", 0), ("newton_euler", 1)):  # backward Euler's first solve places the model
        sim = tc.Simulation(led(moves=False), h=1 / 60, integrator=integrator)
        made, model, c = sim.integrator, sim.model, 0.005
        model.save()
        if integrator == "tr_bdf2":
            problem = Stage(made.system, c, None, NewtonTolerance(0.0, 0.0, 1e-6, 1e-6), True, Clock(), [])
        else:
            start, exact = made.system.meter.measure(), NewtonTolerance(0.0, 0.0, 1e-4, 1e-4)
            problem = EulerStep(made.system, made.energy, exact, c, None, start, Clock(), [])
        assert problem.solve(k) is None
        before = problem.before
        dv = read(made.system.solver.dv)
        write(made.system.solver.dv, 100 * dv)
        x, v = model.read_particles()
        part, measures = line_search(problem, k)
        assert 0 < part < 0.1 and phi(measures, c) <= phi(before, c)
        np.testing.assert_allclose(model.read_particles()[1], v + part * 100 * dv, rtol=1e-12)
        np.testing.assert_allclose(model.read_particles()[0], x + part * c * 100 * dv, rtol=1e-12)


def test_a_first_solve_that_is_not_finite_is_not_shortened_but_named():
    """With what is led a shorter step would leave it behind."""
    sim = tc.Simulation(led(), h=1 / 60, integrator="backward_euler")
    made, held = sim.integrator, sim.prescribed.at(0.0, 1 / 60)
    sim.model.save()
    start = sim.meter.measure()
    problem = EulerStep(made.system, made.energy, None, 1 / 60, held, start, Clock(), [])
    place, parts = made.system.place, []
    made.system.place = lambda h, part: (parts.append(part), place(h, part), sim.model.v.fill(np.nan))
    assert minimize(problem, 9).rejection == "NOT_FINITE" and parts == [1.0]
    sim.close()


CASES = {
    "tr_bdf2": {"integrator": "tr_bdf2", "h": 1 / 60},
    "tr_bdf2 with an error asked for": {"integrator": "tr_bdf2", "tolerance": 2e-4, "h": 1 / 60},
    "safe": {"integrator": "safe", "h": 1 / 30, "stretch_limit": 0.05},
    "backward_euler": {"integrator": "backward_euler", "h": 1 / 60, "stretch_limit": 0.05},
    "newton_euler": {"integrator": "newton_euler", "h": 1 / 60},
    "verlet": {"integrator": "verlet", "h": 1 / 60},
}


def test_what_checkpoints_hold_has_a_version():
    """Other names, another version: else an older checkpoint would be refused as one of other options, or taken in part."""
    names = set()
    for integrator in ("safe", "backward_euler", "bdf2"):
        mesh, scene = tc.grid(0.3, 4), tc.Scene()
        scene.add_cloth(mesh, FABRIC, mesh.x + [0, 0.2, 0], contact=tc.ClothContact(0.005, 0.3))
        scene.add_solid(tc.Box((0.1, 0.1, 0.1)), friction=0.3, thickness=0.005)
        with tc.Simulation(scene, h=1 / 60, integrator=integrator) as sim:
            names |= set(sim.checkpoint())
    for integrator in ("tr_bdf2", "newton_euler", "verlet"):
        with tc.Simulation(led(), h=1 / 60, integrator=integrator) as sim:
            names |= set(sim.checkpoint())
    assert len(names) > 60
    told = VERSION, zlib.crc32(" ".join(sorted(names)).encode())
    assert told == (16, 2773614102), "count VERSION up, and write its sum here"


@pytest.mark.parametrize("name", CASES)
@pytest.mark.slow
def test_going_on_from_a_checkpoint_is_going_on(name):
    """Bit for bit, also for what a step remembers of the one before: forces implied, debts, step sizes, substeps."""
    whole = tc.Simulation(led(), **CASES[name])
    for _ in range(4):
        whole.step()
    if name == "verlet":
        whole.integrator.part *= 0.5  # as after a step that gained energy
    state = {k: np.array(a) for k, a in whole.checkpoint().items()}
    whole.log.clear()
    for _ in range(5):
        whole.step()
    x, v = whole.positions(), whole.velocities()
    rows = [(r.t, r.h, r.iterations, r.energies, r.rejections, r.ledger, r.error) for r in whole.log]
    whole.close()
    resumed = tc.Simulation(led(), **CASES[name])
    resumed.resume(state)
    for _ in range(5):
        resumed.step()
    assert (resumed.positions() == x).all() and (resumed.velocities() == v).all()
    assert [(r.t, r.h, r.iterations, r.energies, r.rejections, r.ledger, r.error) for r in resumed.log] == rows
    resumed.close()


def test_what_tr_bdf2_and_safe_remember_comes_back():
    """Every number of theirs, as it is and not only where this run would show it."""
    sim = tc.Simulation(led(), h=1 / 60, integrator="safe")
    sim.step()
    made, numbers = sim.integrator.accurate, {"c": 0.125, "power": 3.5, "accumulated_gain": 0.75, "motion": 2.25}
    for name, value in numbers.items():
        setattr(made, name, value)
    made.known, sim.integrator.touching, sim.integrator.largest = True, True, 0.5
    sim.integrator.mean = np.full((25, 3), 1.5)
    state = sim.integrator.checkpoint()
    other = tc.Simulation(led(), h=1 / 60, integrator="safe")
    other.integrator.resume(state)
    again = other.integrator.accurate
    assert {name: getattr(again, name) for name in numbers} == numbers and again.known is True
    assert other.integrator.touching is True and other.integrator.largest == 0.5 and (other.integrator.mean == 1.5).all()
    for name in ("a_0", "v_p"):
        assert (read(getattr(again, name)) == read(getattr(made, name))).all()
    assert (read(other.integrator.system.solver.dv) == read(sim.integrator.system.solver.dv)).all()
    assert (again.pins[0] == made.pins[0]).all() and (again.pins[1] == made.pins[1]).all()


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
@pytest.mark.slow
def test_an_error_asked_for_is_kept_where_a_pin_starts_at_speed(tolerance):
    """The jump of half a metre a second is the script's, and no error: it made the run give up at t = 0."""

    def at(**options) -> np.ndarray:
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(1.0, 8), tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100), tc.Bend(5e-5)))
        scene.pin(cloth, "top_left")
        scene.move(cloth, "top_right", lambda t: (0, 0.5 * t, 0), relative=True)
        sim = tc.Simulation(scene, **options)
        sim.run(0.1, 10)
        x = sim.positions()
        assert len(sim.log) < 80 or "tolerance" not in options
        sim.close()
        return x

    off = at(tolerance=tolerance) - at(h=1 / 1500, integrator="verlet")
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < tolerance


@pytest.mark.parametrize("integrator", ["backward_euler", "newton_euler", "tr_bdf2", "safe", "verlet"])
def test_a_pin_that_holds_what_had_a_velocity(integrator):
    """No Newton step is shortened on the way to the pins: what is recorded is the energy that there is."""
    mesh, scene = tc.grid(0.4, 6), tc.Scene()
    fabric = tc.Fabric(0.03, tc.Stretch(700, 0.7), tc.Shear(70), tc.Bend(1.5e-6))
    cloth = scene.add_cloth(mesh, fabric, velocities=(-0.7, -0.01, 0.6))
    scene.pin(cloth, np.flatnonzero(mesh.x[:, 0] < 1e-9))
    sim = tc.Simulation(scene, h=1 / 30, integrator=integrator)
    for _ in range(3):
        sim.step()
        recorded, there = sim.log[-1].energies, sim.energy()
        assert recorded == pytest.approx(there, rel=1e-9, abs=1e-12)
    assert sum(there.values()) < 0.03
    sim.close()
