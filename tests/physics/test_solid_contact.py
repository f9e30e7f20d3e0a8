"""Contact with solids against Newton's laws, Coulomb's and the solids' own motion; and resumed in the middle of it."""

import math
from functools import partial

import numpy as np
import pytest

import taichi_cloth as tc

pytestmark = pytest.mark.slow

G = 9.81
FABRIC = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5))


def over(cells: int = 8, size: float = 0.3, height: float = 0.026, **cloth) -> tuple[tc.Scene, tc.Cloth]:
    """A sheet that lies in the air round the vertical axis."""
    mesh, scene = tc.grid(size, cells), tc.Scene()
    return scene, scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-size / 2, height, size / 2], **cloth)


@pytest.mark.parametrize("h", [1 / 60, 1 / 120])
def test_what_solids_give_is_what_cloth_gets(h):
    """M (v_1 - v_0) / h = weight + contact forces, summed over the cloth, in every step, friction and pairs at edges
    included; the solid gets the opposite, with its torque about where it is."""
    scene, _ = over()
    scene.add_solid(tc.Box((0.2, 0.04, 0.2)), friction=0.3, thickness=0.005, name="box",
                    position=lambda t: (0.1 * math.sin(9 * t), 0.0, 0.0), rotation=lambda t: (0, t * t, 0))
    sim = tc.Simulation(scene, h=h, integrator="backward_euler", cg_tol=1e-10, threads=1)
    mass = sim.model.to_user(np.repeat(sim.model.mass[:, None], 3, axis=1))[:, 0]
    edges = made = 0
    for _ in range(14):
        v = sim.velocities()
        record = sim.step()
        if len(sim.log) > made + 1:  # several steps: the first's velocities are not known
            made = len(sim.log)
            continue
        made += 1
        change = mass @ (sim.velocities() - v) / record.h
        force = sim.contact_forces()
        assert force.sum(axis=0) == pytest.approx(change + [0, mass.sum() * G, 0], abs=1e-6)
        load, torque = sim.solid_loads()["box"]
        assert load == pytest.approx(-force.sum(axis=0), abs=1e-9)
        arm = sim.positions() - [0.1 * math.sin(9 * sim.time), 0, 0]
        assert torque == pytest.approx(-np.cross(arm, force).sum(axis=0), abs=1e-6)
        edges = max(edges, len(sim.contacts.solids.linearized.key))
    assert sim.log[-1].contacts > 0 and edges > 0


def test_nonlinear_backward_euler_goes_on_in_contact():
    """Friction that slides and pairs at edges count in the potential that Newton's method goes down on: without them no step
    was short enough for it."""
    scene, _ = over(8, 0.3, 0.031)
    scene.add_solid(tc.Plane((math.sin(0.4), math.cos(0.4), 0.0)), friction=0.2, thickness=0.005, position=(0.0, -0.07, 0.0))
    sim = tc.Simulation(scene, h=1 / 60, integrator="newton_euler", threads=1)
    for _ in range(18):
        assert sim.step().rejections == {}
    assert max(r.solves for r in sim.log) > 2 and sim.log[-1].contacts > 50


@pytest.mark.parametrize("h", [1 / 15, 1 / 30, 1 / 60])
def test_forces_are_told_after_steps_that_took_more_solves(h):
    """A tablecloth at large steps, whose first solves the energy test does not accept."""
    scene, _ = over(16, 1.1, 0.03)
    scene.add_solid(tc.Box((0.7, 0.04, 0.7)), friction=0.4, thickness=0.006)
    scene.add_solid(tc.Cylinder(0.025, 0.7), friction=0.4, thickness=0.006, position=(0.3, -0.37, 0.3))
    sim = tc.Simulation(scene, h=h, threads=1)
    while sim.time < 0.5:
        sim.step()
        loads = sum(force for force, _ in sim.solid_loads().values())
        assert sim.contact_forces().sum(axis=0) == pytest.approx(-loads, abs=1e-9)
    assert sim.log[-1].contacts > 0


def test_the_corner_of_two_planes_is_loaded_once():
    """A particle that two rough planes hold bears on both together what it bears."""
    scene, cloth = over(4, 0.2)
    scene.add_solid(tc.Plane((1, 1, 0)), friction=0.9, thickness=0.004, name="left")
    scene.add_solid(tc.Plane((-1, 1, 0)), friction=0.9, thickness=0.004, name="right")
    sim = tc.Simulation(scene, h=1 / 60, threads=1, cg_tol=1e-8)
    bent = cloth.positions.copy()
    bent[:, 1] = np.abs(bent[:, 0]) + 0.004 * math.sqrt(2)
    bent[:, 0] += np.sign(bent[:, 0]) * 0
    sim.set_state(bent, 0 * bent)
    for _ in range(90):
        sim.step()
    weight = G * sim.model.mass.sum()
    assert sim.contact_forces().sum(axis=0) == pytest.approx([0, weight, 0], abs=0.02 * weight)
    right, left = sim.solid_loads()["right"][0], sim.solid_loads()["left"][0]
    assert right[1] < 0 and left[1] < 0 and right + left == pytest.approx([0, -weight, 0], abs=0.02 * weight)


@pytest.mark.parametrize("integrator", ["backward_euler", "safe"])
def test_what_begins_to_slide_is_dragged_along(integrator):
    """A floor pulled away at 3 mu g: after every step, the first included, the sheet goes its way at mu g. BDF2 takes a force
    that jumps for two thirds of its first step, and is late by up to half a step."""
    mu, began = 0.3, 5 / 60
    scene, _ = over(6, height=0.004)
    scene.add_solid(tc.Plane(), friction=mu, thickness=0.004,
                    position=lambda t: (1.5 * mu * G * max(t - began, 0.0) ** 2, 0.0, 0.0))
    sim = tc.Simulation(scene, h=1 / 60, threads=1, cg_tol=1e-8, integrator=integrator)
    for k in range(1, 16):
        sim.step()
        v = sim.velocities()
        law, late = mu * G * max(sim.time - began, 0.0), mu * G / 120 if integrator == "safe" and k > 5 else 0.0
        assert v[:, 0].min() > 0.98 * law - late - 1e-6 and v[:, 0].max() < 1.02 * law + 1e-6, f"step {k}"
        assert np.abs(v[:, 1:]).max() < 1e-3


def test_a_force_that_begins_with_a_run_is_not_late():
    """A floor goes off at 3 mu g: the sheet that lies on it slides with mu g from the first step on. Without its friction in
    what goes on, as after an impact, it would lag by half a step."""
    mu = 0.3
    scene, _ = over(6, height=0.004)
    scene.add_solid(tc.Plane(), friction=mu, thickness=0.004, position=lambda t: (1.5 * mu * G * t**2, 0.0, 0.0))
    with tc.Simulation(scene, h=1 / 60, threads=1, cg_tol=1e-8) as sim:
        for _ in range(12):
            sim.step()
        assert np.abs(sim.velocities()[:, 0] / (mu * G) - sim.time).max() < 0.01 / 60


def landing(fabric: tc.Fabric) -> tc.Scene:
    """A sheet above a ball."""
    mesh, scene = tc.grid(1.0, 20), tc.Scene()
    scene.add_cloth(mesh, fabric, positions=mesh.x + [-0.5, 0.4, 0.5])
    scene.add_solid(tc.Sphere(0.3), friction=0.4, thickness=0.005)
    return scene


def test_each_solve_of_a_step_is_twice_as_exact_as_the_one_before():
    """Without `contact_tol`, until contacts agree with one, which is then finished as exactly as was asked."""
    sim = tc.Simulation(landing(FABRIC), h=1 / 60, threads=1, integrator="backward_euler", cg_tol=1e-5, contact_tol=None)
    made, attempt = [], sim.stepper.integrator.attempt
    sim.stepper.integrator.attempt = lambda *given: made.append(attempt(*given)) or made[-1]
    for _ in range(60):
        sim.step()
    touching = [a.solutions for a in made if a.contacts and a.rejection is None]
    several = [solutions for solutions in touching if len(solutions) > 2 and solutions[-2].preliminary]
    assert len(several) > 5
    for solutions in several:
        rough = [s.tolerance for s in solutions if s.preliminary]
        assert rough == pytest.approx([0.01 / 2**k for k in range(len(rough))])
    assert sum(not s[-1].preliminary for s in touching) > len(several) and min(len(s) for s in touching[-10:]) < 4
    assert max(r.residual for r in sim.log if not r.unconverged_contacts and r.solves == 1) < 2e-5


def test_friction_in_every_step_is_coulombs():
    """A sheet that has landed on a ball, counted from what contacts bear: what pulls, and what shears beyond its cone, is less
    than a hundredth of all that they bear; in three steps, which further Newton steps mended, less than a twentieth."""
    sim = tc.Simulation(landing(FABRIC), h=1 / 60, threads=1)
    shares = []
    for _ in range(60):
        sim.step()
        force = sim.contact_forces()
        out = sim.positions() / np.linalg.norm(sim.positions(), axis=1, keepdims=True)  # normals of a ball at the origin
        if sim.time < 0.4:  # the impact: further Newton steps, for its energy, hold what the first one held
            continue
        normal = np.einsum("ni,ni->n", force, out)
        shear = np.linalg.norm(force - normal[:, None] * out, axis=1)
        beyond = np.maximum(shear - 0.4 * np.maximum(normal, 0), 0) + np.maximum(-normal, 0)
        shares.append(beyond.sum() / np.abs(normal).sum())
    assert len(shares) > 30 and max(shares) < 0.05 and sorted(shares)[-4] < 0.01, shares


@pytest.mark.parametrize("integrator", ["safe", "backward_euler"])
def test_what_sticks_goes_where_the_solid_goes(integrator):
    """In every step exactly, up, down, sideways and round, as far as the solid's own motion says at that time."""
    def where(t):
        return np.array([0.02 * math.sin(7 * t), 0.01 * math.sin(5 * t), -0.03 * t])

    def turned(t, x):
        c, s = math.cos(0.8 * t), math.sin(0.8 * t)
        return x @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T

    scene, cloth = over(5, height=0.024)
    box = tc.SolidMesh(*tc.Box((0.4, 0.04, 0.4)).core()[:2])
    scene.add_solid(box, friction=2.0, thickness=0.004, position=where, rotation=lambda t: (0.0, 0.8 * t, 0.0))
    sim = tc.Simulation(scene, h=1 / 60, threads=1, integrator=integrator)
    here = []
    for _ in range(20):
        sim.step()
        here.append(turned(-sim.time, sim.positions() - where(sim.time)))
        assert np.abs(here[-1][:, 1] - 0.024).max() < 1e-6
    assert np.abs(here[5] - cloth.positions).max() < 2e-3  # what it began with has come to rest on it
    assert np.abs(here[-1] - here[5]).max() < 2e-5


def pressed(speed: float, turn: float) -> tc.Scene:
    """A sheet over the sharp edges of a sliding box, pressed on it by a block of triangles, beyond what leaves it room."""
    scene, _ = over(6)
    scene.add_solid(tc.Box((0.2, 0.04, 0.2)), friction=0.2, thickness=0.005,
                    position=lambda t: (0.03 * math.sin(20 * t), 0.0, 0.0))
    scene.add_solid(tc.SolidMesh(*tc.Box((0.1, 0.1, 0.1)).core()[:2]), friction=0.2, thickness=0.005,
                    position=lambda t: (0.0, 0.084 - speed * min(t, 0.08), 0.0), rotation=(0.0, turn, 0.0), name="press")
    return scene


def slid() -> tc.Scene:
    """A sheet over the sharp edges of a sliding box of triangles, with room: nothing jumps, so a tolerance can be kept."""
    scene, _ = over(6)
    scene.add_solid(tc.SolidMesh(*tc.Box((0.2, 0.04, 0.2)).core()[:2]), friction=0.2, thickness=0.005,
                    position=lambda t: (0.05 * math.sin(20 * t), 0.0, 0.0))
    return scene


def in_the_middle_of_it(sim: tc.Simulation, easy: bool) -> bool:
    """Runs to where pairs were linearised and are there, and, but for `easy`, something is pushed, pinched and passed."""
    while sim.time < 0.25:
        sim.step()
        c = sim.contacts.solids
        if len(c.accepted.key) and len(c.linearized.key) and (easy or (
                c.accepted.push.any() and sim.contacts.counts()["pinched"] and len(c.penetration.before))):
            return True
    return False


PRESSED = [partial(pressed, speed, turn) for speed, turn in ((0.2, 0.3), (0.25, 0.5), (0.2, 0.5), (0.28, 0.5), (0.4, 0.6))]


@pytest.mark.parametrize("scenes, options", [(PRESSED, {}), ([slid], {"tolerance": 0.05})], ids=["steps", "tolerance"])
def test_a_run_is_resumed_in_contact_bit_for_bit(scenes, options):
    """What just begins to slide, pairs at edges, and what is pinched are there when the run is cut."""
    for scene in scenes:  # rounding, which differs among processors, decides in which of them all of that comes at once
        whole = tc.Simulation(scene(), h=1 / 60, threads=1, **options)
        if in_the_middle_of_it(whole, bool(options)):
            break
        whole.close()
    else:
        pytest.fail("no scene ever has all of that at once")

    def goes_on(sim: tc.Simulation) -> list:
        rows = []
        for _ in range(5):
            r = sim.step()
            rows.append((sim.positions(), sim.velocities(), sim.contact_forces(), (r.t, r.h, r.iterations, r.pinched)))
        return rows

    state, pinched, crossed = whole.checkpoint(), whole.contacts.counts()["pinched"], whole.contacts.solids.penetration.before
    went = goes_on(whole)
    whole.close()
    with tc.Simulation(scene(), h=1 / 60, threads=1, **options) as resumed:
        resumed.resume(state)
        assert resumed.contacts.counts()["pinched"] == pinched
        assert (resumed.contacts.solids.penetration.before == crossed).all() and (options or len(crossed))
        for before, now in zip(went, goes_on(resumed)):
            assert all(np.array_equal(a, b) for a, b in zip(before, now)), now[3]


def test_solids_hold_nothing_where_pins_do():
    """A sheet is attached along its top to a bar, inside the bar's thickness: the pins bear all of it, the bar only pushes on
    the row below, and steps need no further solves for what the pins pull but the second one of a motion that goes on, or
    in one of ten a third."""
    scene, mesh = tc.Scene(), tc.grid(0.5, 10, plane="xy")
    fabric = tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100, 0.1), tc.Bend(1e-5))
    cloth = scene.add_cloth(mesh, fabric, positions=mesh.x - [0.25, 0.5, 0])
    bar = scene.add_solid(tc.Box((0.8, 0.1, 0.1)), friction=0.3, thickness=0.01,
                          position=lambda t: (0.05 * math.sin(t), 0, -0.055))
    scene.attach(cloth, "top", bar)
    sim = tc.Simulation(scene)
    for _ in range(60):
        sim.step()
    top = mesh.x[:, 1] > 0.499
    pushed, held = sim.contact_forces(), sim.constraint_forces()
    assert not pushed[top].any() and not held[~top & ~pushed.any(axis=1)].any()
    acceleration = 0.05 * math.sin(1.0) * np.array([-1.0, 0, 0])  # as far as the sheet goes with the bar
    whole = (pushed + held * top[:, None]).sum(axis=0)
    assert whole == pytest.approx(0.05 * (np.array([0, 9.8, 0]) + acceleration), abs=0.03)
    assert pushed[:, 1].sum() < 0.1 * whole[1] and sorted(r.solves for r in sim.log[20:])[-5] == 2
    assert max(r.solves for r in sim.log[20:]) <= 3
    assert sum(r.ledger["pins"] for r in sim.log[20:]) != 0 and sum(abs(r.ledger["solids"]) for r in sim.log[20:]) < 1e-3
    sim.close()


@pytest.mark.parametrize("start", [0, 2])
def test_steps_without_contact_know_nothing_of_attempts_in_contact(start):
    """A strip over a bar, moved by a nanometre: the first step in contact is tried smaller, and begun again by TR-BDF2.

    With the points of contact of the refused attempt in its system, TR-BDF2 finds no way down at any step.
    """
    mesh, scene, radius = tc.strip(0.5, 0.09, (50, 2)), tc.Scene(), 0.034
    over = (mesh.uv[:, 0] - (0.2 - math.pi * radius)) / radius  # angle on the bar
    turned, hangs = np.clip(over, 0, math.pi), radius * (over - np.clip(over, 0, math.pi))
    x = np.column_stack([-radius * np.cos(turned), radius * np.sin(turned), mesh.uv[:, 1]])
    x[:, 1] += np.where(over < 0, hangs, -hangs)
    x += 1e-9 * np.random.default_rng(7000 + start).standard_normal(x.shape)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(200, 0.2), tc.Bend(1e-6)), positions=x)
    scene.add_solid(tc.Cylinder(0.03, 0.5), 0.2, 0.004, rotation=(math.pi / 2, 0, 0))
    with tc.Simulation(scene, h=1 / 60, integrator="tr_bdf2", threads=1) as sim:
        sim.step()
        assert sum(sim.log[0].rejections.values()) > 0 and len(sim.log) == 2, "no attempt in contact was refused"
