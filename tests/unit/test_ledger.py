"""The energy ledger against sums made from outside, and what it is there for: no step gains energy from nowhere."""

import numpy as np
import pytest
from reference.energy import energies

import taichi_cloth as tc
from taichi_cloth.step.ledger import totals

K, K_D, SHEAR, D, DENSITY = (900.0, 700.0), 0.6, 150.0, 2e-3, 0.2
CONVERGED = {"newton_tol": 1e-11, "cg_tol": 1e-12, "newton_max": 60}


def fabric(k=K, shear=SHEAR, bend=D, damped=K_D, density=DENSITY) -> tc.Fabric:
    return tc.Fabric(density, tc.Stretch(k, damped), tc.Shear(shear), tc.Bend(bend))


def masses(sim: tc.Simulation) -> np.ndarray:
    out = np.empty(sim.vertex_count)
    out[sim.model.user] = sim.model.mass
    return out


def led(air=None, damped=K_D) -> tc.Scene:
    """A sheet held at a corner and led at another, that stretches, turns and swings."""
    mesh = tc.grid(0.6, 4)
    scene = tc.Scene(air=air)
    noise = 2e-3 * np.random.default_rng(71).normal(size=mesh.x.shape)
    cloth = scene.add_cloth(mesh, fabric(damped=damped), mesh.x + noise, velocities=20 * noise)
    scene.pin(cloth, "top_left")
    scene.move(cloth, "top_right", lambda t: (0.3 * np.sin(9 * t), 0.8 * t, 0.1 * t), relative=True)
    return scene


@pytest.mark.parametrize("integrator", ["newton_euler", "tr_bdf2"])
@pytest.mark.slow
def test_all_of_a_converged_step_is_accounted_for(integrator):
    """Pins that work, wind, damping and the method's own: nothing is left but rounding, step by step."""
    sim = tc.Simulation(led(tc.Air(normal=0.8, tangential=0.1, wind=(12.0, 0.5, 6.0))), h=1 / 200, integrator=integrator,
                        stretch_limit=9.0, **CONVERGED)
    before, sums = energies(sim), dict.fromkeys(("pins", "wind", "damping"), 0.0)
    for _ in range(3):
        sim.log.clear()
        sim.step()
        after, row = energies(sim), totals([r.ledger for r in sim.log])
        assert row["kinetic"] == pytest.approx(after[0] - before[0], abs=1e-9)
        assert row["potential"] == pytest.approx(after[1] - before[1], abs=1e-9)
        scale = abs(row["pins"]) + abs(row["wind"]) + row["damping"] + abs(row["method"])
        assert scale > 1e-3 and abs(row["unaccounted"]) < 2e-7 * scale, row
        before = after
        for name in sums:
            sums[name] += row[name]
    assert sums["pins"] > 1e-2 and abs(sums["wind"]) > 1e-3 and sums["damping"] > 1e-4, sums
    sim.close()


@pytest.mark.slow
def test_what_begins_to_be_held_as_it_flies_is_accounted_for():
    """TR-BDF2's first stage throws it back, x_g = x_0 + c (v_0 + v_g); pins do not, also in a step that is tried again."""
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(tc.grid(0.6, 4), fabric(), velocities=(0, 0, 20.0))
    scene.at(1 / 60, lambda sim: sim.pin(cloth, "top_left"))
    sim = tc.Simulation(scene, h=1 / 60, integrator="tr_bdf2", **CONVERGED | {"newton_tol": 1e-9})
    sim.run(1 / 30, 60)
    before, first = sim.log[0], sim.log[1]
    assert before.t == pytest.approx(1 / 60) and first.rejections and first.ledger["pins"] == 0, first
    scale = first.ledger["damping"] + abs(first.ledger["method"])
    assert abs(first.ledger["unaccounted"]) < 2e-7 * scale, first.ledger
    sim.close()


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["tr_bdf2", "backward_euler"])
def test_pins_work_at_their_own_velocity_where_it_jumps(integrator):
    """A sheet all of which is held at once as it flies, or led from rest: its motion's energy goes to the method, or half of
    m v^2 does, which its pins put in."""
    found = []
    for v, path in ((3.0, None), (0.0, lambda t: (2 * t - 1 / 30, 0, 0))):
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(tc.grid(0.3, 4), fabric(), velocities=(v, 0, 0))
        every = np.arange(25)
        scene.at(1 / 60, lambda s: s.pin(cloth, every) if path is None else s.move(cloth, every, path, relative=True))
        sim = tc.Simulation(scene, h=1 / 60, integrator=integrator)
        sim.run(1 / 20, 60)
        found.append(totals([r.ledger for r in sim.log]))
        sim.close()
    m = DENSITY * 0.09
    assert [found[0][k] for k in ("pins", "method", "unaccounted")] == pytest.approx([0, 4.5 * m, 0], abs=1e-9)
    assert [found[1][k] for k in ("pins", "method", "unaccounted")] == pytest.approx([4 * m, 2 * m, 0], abs=1e-9)


@pytest.mark.slow
def test_each_term_of_a_backward_euler_step_is_what_forces_do():
    """Work of pins, wind and damping from forces and velocities at the end of the step, the method's own from its formula."""
    calm, windy = (tc.Simulation(led(air), h=1 / 60, integrator="backward_euler", stretch_limit=9.0)
                   for air in (None, tc.Air(normal=0.8, wind=(3.0, 0.0, 0.5))))
    h = 1 / 60
    for sim in (calm, windy):
        for _ in range(3):
            v_0, (_, potential) = sim.velocities(), energies(sim)
            row = sim.step().ledger
        x, v, m = sim.positions(), sim.velocities(), masses(sim)[:, None]
        pins = h * np.sum(sim.constraint_forces() * v)
        moving = sim.forces()
        after = energies(sim)[1]
        sim.set_state(x, 0 * v)
        resting = sim.forces()  # with the wind's on cloth that stands still
        if sim is calm:
            assert row["damping"] == pytest.approx(-h * np.sum((moving - resting) * v), rel=1e-9) and row["damping"] > 0
            assert row["wind"] == 0
            curved = -h * np.sum(resting * v) - (after - potential)
            assert row["method"] == pytest.approx(np.sum(m * (v - v_0) ** 2) / 2 + curved, rel=1e-9)
        else:
            calm.set_state(x, v)
            blown = h * np.sum((moving - calm.forces()) * v)
            assert row["wind"] == pytest.approx(blown, rel=1e-9) and abs(blown) > 1e-4
        assert row["pins"] == pytest.approx(pins, rel=1e-9) and abs(pins) > 1e-3
    calm.close()


@pytest.mark.slow
def test_what_alters_positions_works_against_elastic_forces_alone(rng):
    """A stiff, much damped sheet that starts inside a plane: dE . y from energies at both sides of the end of the step."""
    mesh, h = tc.grid(0.3, 6), 1 / 480
    scene = tc.Scene()
    v = rng.normal(scale=0.3, size=mesh.x.shape)
    place = mesh.x + [0, 0.004, 0] + rng.normal(scale=0.0005, size=mesh.x.shape)
    scene.add_cloth(mesh, fabric(k=1e5, shear=1e4, damped=1e3), place, velocities=v)
    scene.add_solid(tc.Plane(), thickness=0.005, friction=0.4)
    sim = tc.Simulation(scene, h=h, integrator="backward_euler", threads=1, contact_tol=None)
    x = sim.positions()
    record = sim.step()
    end, u = sim.positions(), sim.velocities()
    assert record.h == h
    y = end - x - h * u
    sides = []
    for part in (1e-3, -1e-3):
        sim.set_state(end + part * y, u)
        sides.append(sum(e for name, e in sim.energy().items() if name != "kinetic"))
    sim.close()
    taken = (sides[0] - sides[1]) / 2e-3
    row = record.ledger
    assert row["pushed_out"] + row["pulled_down"] == pytest.approx(taken, rel=1e-5) and abs(taken) > 1e-3
    assert row["damping"] > 0.1 * taken and row["method"] > 0


@pytest.mark.slow
def test_what_alters_positions_works_against_layers_too(rng):
    """A sheet that starts inside a plane, another on it: the lower one is brought out against the forces of the pairs."""
    mesh, h = tc.grid(0.2, 4), 1 / 480
    scene, contact = tc.Scene(), tc.ClothContact(0.004, 0.3)
    for height in (0.0045, 0.0075):
        place = mesh.x + [0, height, 0] + rng.normal(scale=1e-4, size=mesh.x.shape)
        scene.add_cloth(mesh, fabric(), place, velocities=(0, -0.1, 0), contact=contact)
    scene.add_solid(tc.Plane(), thickness=0.005, friction=0.0)
    sim = tc.Simulation(scene, h=h, integrator="backward_euler", threads=1)
    x = sim.positions()
    record = sim.step()
    end, u = sim.positions(), sim.velocities()
    pairs = sim.model.to_user(sim.contacts.layers.pushes().add(np.zeros((sim.model.n, 3))))
    y = end - x - h * u
    sides = []
    for part in (1e-3, -1e-3):
        sim.set_state(end + part * y, u)
        sides.append(sum(e for name, e in sim.energy().items() if name != "kinetic"))
    sim.close()
    against, row = -float(np.sum(pairs * y)), record.ledger
    assert record.h == h and against > 1e-6
    assert row["pushed_out"] + row["pulled_down"] - (sides[0] - sides[1]) / 2e-3 == pytest.approx(against, rel=1e-2)


def twisted(turn: float) -> tc.Scene:
    """A free sheet whose bending is stiff against its stretch, turned by so much [rad] a half width."""
    mesh = tc.grid(1.0, 8)
    x = mesh.x - mesh.x.mean(axis=0)
    angle = turn * x[:, 0] / 0.5
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, fabric(31.0, 31.0, 0.9, 0.0, 7.5),
                    np.stack([x[:, 0], x[:, 2] * np.sin(angle), x[:, 2] * np.cos(angle)], axis=1))
    return scene


@pytest.mark.parametrize("integrator, part", [("backward_euler", 1e-9), ("newton_euler", 1e-9), ("safe", 0.03)])
@pytest.mark.slow
def test_a_twisted_sheet_gains_nothing(integrator, part):
    """Backward Euler's potential does not bound kinetic energy where bending is not convex: its steps gained 45 J."""
    sim = tc.Simulation(twisted(2.8), h=1 / 60, integrator=integrator, stretch_limit=9.0)
    total = [sum(energies(sim))]
    for _ in range(20):
        sim.step()
        total.append(sum(energies(sim)))
    assert max(total) <= (1 + part) * total[0], total
    if integrator != "safe":
        assert np.diff(total).max() <= 1e-9 * total[0]
    sim.close()


def test_slowing_down_keeps_momenta_and_what_is_held(rng):
    from taichi_cloth.step.nonlinear.energy import KineticEnergyCorrection

    scene = tc.Scene(gravity=None)
    for shift in (0.0, 3.0):
        mesh = tc.grid(1.0, 3)
        scene.add_cloth(mesh, fabric(), mesh.x + [shift, 0, 0], velocities=rng.normal(size=mesh.x.shape))
    sim = tc.Simulation(scene)
    m, x, v = masses(sim)[:, None], sim.positions(), sim.velocities()
    assert KineticEnergyCorrection(sim.model, scene).take(0.05, None)
    slow = sim.velocities()
    assert np.sum(m * (v**2 - slow**2)) / 2 == pytest.approx(0.05, rel=1e-10)
    for mine in (slice(0, 16), slice(16, 32)):
        for moment in (lambda u: m[mine] * u[mine], lambda u: np.cross(x[mine], m[mine] * u[mine])):
            np.testing.assert_allclose(moment(slow).sum(axis=0), moment(v).sum(axis=0), atol=1e-13)
    assert (sim.positions() == x).all()
    assert not KineticEnergyCorrection(sim.model, scene).take(1e3, None) and (sim.velocities() == slow).all()
    sim.close()


def test_a_step_is_slowed_down_only_if_it_fits_otherwise(rng):
    """What gained energy and left much unaccounted for besides is solved further, from the velocities that it has."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(1.0, 3)
    scene.add_cloth(mesh, fabric(), velocities=rng.normal(size=mesh.x.shape))
    with tc.Simulation(scene, integrator="backward_euler") as sim:
        test = sim.stepper.integrator.energy
        start = test.meter.measure()
        sim.set_state(sim.positions(), fast := 1.01 * sim.velocities())
        now, seen = test.meter.measure(), []

        def fits(good: bool):
            return test.conclude(1 / 60, None, start, now, 0.5,
                                 fits=lambda _, ledger: seen.append(ledger.kinetic_correction) or good)

        assert fits(False) is None and (sim.velocities() == fast).all()
        measures, ledger = fits(True)
        assert seen == [0, 0] and ledger.kinetic_correction > 0 and measures.total == pytest.approx(start.total, rel=1e-9)
        assert np.abs(sim.velocities()).max() < np.abs(fast).max()


def test_verlets_pins_work_as_much_as_the_energy_grows():
    """Nothing damps, nothing blows: what the pins that are led put in is all that changes the energy."""
    sim = tc.Simulation(led(damped=0.0), h=1 / 60, integrator="verlet")
    start = sum(energies(sim))
    for _ in range(12):
        sim.step()
    work = sum(r.ledger["pins"] for r in sim.log)
    assert work > 0.02 and sum(energies(sim)) - start == pytest.approx(work, rel=2e-2)
    sim.close()


@pytest.mark.parametrize("steps", [60, 240])
@pytest.mark.slow
def test_a_sheet_that_comes_to_rest_on_a_plane_gains_nothing(steps, rng):
    """The default method, through first contact; energy and its largest part, that of the fall, from positions."""
    mesh, scene = tc.grid(0.6, 8), tc.Scene()
    scene.add_cloth(mesh, fabric(5000.0, 500.0), mesh.x + [0, 0.02, 0] + rng.normal(scale=5e-4, size=mesh.x.shape))
    scene.add_solid(tc.Plane(), friction=0.3, thickness=0.005)
    sim = tc.Simulation(scene, h=1 / steps, threads=1)
    kinetic, total = zip(*((t, t + v) for t, v in energy_at_each_step(sim, steps // 4)))
    weight = masses(sim).sum() * 9.81
    sim.close()
    before = total[0] - min(total)
    assert before > 0.01 * weight and max(np.diff(total)) < 1e-3 * before
    assert max(kinetic) < 1.2 * before and kinetic[-1] < 0.02 * max(kinetic)


@pytest.mark.parametrize("friction, account, other", [(0.8, "solids", "friction"), (0.1, "friction", "solids")])
@pytest.mark.slow
def test_a_plane_that_carries_a_sheet_works_by_solids_and_one_that_drags_it_by_friction(friction, account, other):
    """Off at 3 m/s^2: the sheet follows with it, or with mu g where that is less. Either way the work of contact is the force
    times the way of the sheet, from positions."""
    mesh, scene, (a, g, h) = tc.grid(0.4, 4), tc.Scene(), (3.0, 9.81, 1 / 240)
    scene.add_cloth(mesh, fabric(5000.0, 500.0, damped=0.0), mesh.x + [0, 0.005, 0])
    scene.add_solid(tc.Plane(), friction, 0.005, position=lambda t: (0.5 * a * t**2, 0.0, 0.0))
    sim = tc.Simulation(scene, h=h, integrator="newton_euler", contact_tol=1e-3, threads=1)
    start, x = sum(energies(sim)), sim.positions()
    for _ in range(48):
        sim.step()
    mass, sums = masses(sim), totals([r.ledger for r in sim.log])
    force = min(a, friction * g) * mass.sum()
    way = float(mass @ (sim.positions() - x)[:, 0] / mass.sum())
    contact = sums["solids"] + sums["friction"] + sums["pushed_out"] + sums["pulled_down"]
    assert way > 0.018 and sums[account] == pytest.approx(force * way, rel=0.03) and abs(sums[other]) < 1e-3 * contact, sums
    assert contact == pytest.approx(force * way, rel=0.03)
    assert sum(energies(sim)) - start == pytest.approx(contact - sums["method"] - sums["damping"], rel=0.02)
    sim.close()


def energy_at_each_step(sim: tc.Simulation, steps: int):
    yield energies(sim)
    for _ in range(steps):
        sim.step()
        yield energies(sim)
