"""What bending remembers: loops of moment over curvature, creases that stay, and where their energy goes."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.step.ledger import totals

EDGE, HEIGHT = 0.01, 0.002  # m: a hinge of two triangles that turns over an arc of HEIGHT
D, HB, G = 1e-5, 2.5e-4, 9.81  # N m, N


def hinge(bend, angle=None, release=None, density=0.1):
    """Two triangles; `angle` (a function of time) leads one about their edge, till `release` [s]."""
    x = np.array([[0.0, 0, 0], [0, 0, EDGE], [-HEIGHT, 0, EDGE / 2], [HEIGHT, 0, EDGE / 2]])
    mesh = tc.TriMesh(x, [[0, 1, 2], [1, 0, 3]])
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(density, tc.Stretch(200, 1e-3), tc.Shear(50, 1e-4), bend))
    scene.pin(cloth, [0, 1, 2])
    if angle is not None:
        scene.move(cloth, [3], lambda t: (HEIGHT * np.cos(angle(t)), HEIGHT * np.sin(angle(t)), EDGE / 2))
    if release is not None:
        scene.at(release, lambda s: s.unpin(cloth, [3]))
    return scene


def turned(sim):
    """Angle [rad] by which the second triangle has turned out of the plane."""
    x = sim.positions()[3]
    return np.arctan2(x[1], x[0])


def torque(sim):
    """About the edge [N m], of bending on the second triangle's tip."""
    x, f = sim.positions()[3], sim.forces()[3]
    return x[0] * f[1] - x[1] * f[0]


LOOP = 150.0  # 1/m


def looped(h: float) -> float:
    """Area [N/m] of the loop of a hinge bent to +-150 1/m and back: D kappa +- HB, closed to 1e-10."""
    most = LOOP
    scene = hinge(tc.Bend(D, friction=HB), lambda t: most * HEIGHT * np.sin(2 * np.pi * t))
    kappa, moment = [], []
    with tc.Simulation(scene, h=h, stretch_limit=9.0) as sim:
        for _ in range(round(2.25 / h)):
            sim.step()
            kappa.append(turned(sim) / HEIGHT)
            moment.append(-torque(sim) / EDGE)
    period = round(1 / h)
    k, m = np.array(kappa[-period - 1:]), np.array(moment[-period - 1:])
    assert abs(m[0] - m[-1]) < 1e-10 * np.abs(m).max() and abs(k[0] - k[-1]) < 1e-10 * most
    rising = np.diff(k, prepend=k[0]) > 0
    slid = rising & (k > -most + 10)
    assert np.abs(m[slid] - D * k[slid] - HB).max() < 1e-3 * HB and slid.sum() > period / 4
    return abs(np.sum((m[1:] + m[:-1]) / 2 * np.diff(k)))


@pytest.mark.slow
def test_the_loop_of_moment_over_curvature():
    """Area 4 HB kappa_max within 2 % in steps of 1/60 and of 1/240 s, and these within 1 % of each other."""
    areas = [looped(1 / 60), looped(1 / 240)]
    assert areas == pytest.approx([4 * HB * LOOP] * 2, rel=0.02) and areas[0] == pytest.approx(areas[1], rel=0.01)


@pytest.mark.slow
def test_what_was_folded_stays_folded_as_the_yield_law_says():
    """Folded to 2.6 rad and let go: (1 - H) (kappa - yield), 1e-3, and it stays there; what was bent less comes back."""
    H = 0.1
    for most, arc in ((2.6, HEIGHT), (0.35, HEIGHT)):
        bend = tc.Bend(D, 2e-9, yield_=200.0, hardening=H)
        scene = hinge(bend, lambda t, most=most: most * min(1.0, 4 * t), release=0.5)
        with tc.Simulation(scene, h=1 / 240, stretch_limit=9.0, integrator="backward_euler") as sim:
            sim.run(0.5, 60)
            assert turned(sim) == pytest.approx(most, abs=1e-9)
            sim.run(1.5, 10)
            expected = (1 - H) * max(0.0, most - 200 * arc)
            assert turned(sim) == pytest.approx(expected, abs=1e-3)
            settled = turned(sim)
            for _ in range(500):
                sim.step()
            assert turned(sim) == pytest.approx(settled, abs=2e-7)
            crease = sim.force_terms[1].hysteresis.creases()
            assert crease == pytest.approx(max(0.0, most - 200 * arc), abs=1e-3)


@pytest.mark.slow
def test_curvatures_that_were_bent_stay_as_the_yield_law_says():
    """A strip rolled to 400 1/m and let go comes to (1 - H) (kappa - yield); one rolled to less than its yield opens flat."""
    H, most = 0.1, 400.0
    mesh = tc.grid((0.008, 0.004), (8, 4))

    def rolled(t):
        kappa = max(most * min(1.0, 4 * t), 1e-6)
        s = mesh.x[:, 0]
        return np.column_stack([np.sin(kappa * s) / kappa, (1 - np.cos(kappa * s)) / kappa, mesh.x[:, 2]])

    for yields in (200.0, 500.0):
        scene = tc.Scene(gravity=None)
        bend = tc.Bend(D, 2e-8, yield_=yields, hardening=H, model="curvature")
        cloth = scene.add_cloth(mesh, tc.Fabric(0.1, tc.Stretch(200, 1e-3), tc.Shear(50, 1e-4), bend))
        scene.move(cloth, range(mesh.vertex_count), rolled)
        scene.at(0.5, lambda s, c=cloth: s.unpin(c, range(mesh.vertex_count)))
        with tc.Simulation(scene, h=1 / 240, stretch_limit=9.0, integrator="backward_euler") as sim:
            sim.run(2.0, 10)
            x = sim.positions().reshape(*[5, 9, 3][:3])[2, 2:7]  # the middle of the strip, away from its ends
            a, b, c = x[0], x[2], x[4]
            sides = [np.linalg.norm(p - q) for p, q in ((a, b), (b, c), (c, a))]
            kappa = 2 * np.linalg.norm(np.cross(b - a, c - a)) / np.prod(sides)
            assert kappa == pytest.approx((1 - H) * max(0.0, most - yields), rel=0.03, abs=0.5)
            creased = sim.force_terms[1].hysteresis.creases()
            assert np.median(creased) == pytest.approx(max(0.0, most - yields), rel=0.03, abs=1e-9)


@pytest.mark.slow
def test_creases_recover_to_what_stays():
    """Pulled back by its hardening, a crease goes as q' = -rate H q, as far as the curvature that stays for ever."""
    rate, H = 2.0, 0.25
    scene = hinge(tc.Bend(D, 2e-9, yield_=200.0, hardening=H, recovery=(rate, 100.0)), lambda t: 2.0 * min(1.0, 4 * t),
                  release=0.75)
    with tc.Simulation(scene, h=1 / 240, stretch_limit=9.0, integrator="backward_euler") as sim:
        sim.run(0.3, 60)
        held = sim.force_terms[1].hysteresis.creases()
        sim.run(0.4, 60)
        assert held == pytest.approx(2.0 - 200 * HEIGHT, abs=1e-9)
        assert (sim.force_terms[1].hysteresis.creases() == held).all()  # not while they are held
        sim.run(0.55, 60)
        start = turned(sim)
        sim.run(1.0, 60)
        assert turned(sim) / start == pytest.approx(np.exp(-rate * H * 1.0), rel=0.01)
        sim.run(9.0, 10)
        assert turned(sim) == pytest.approx((1 - H) * 100.0 * HEIGHT, rel=1e-3)


def strip(bend, clamped=False):
    """A strip that is let go level, held at one end, which turns freely unless `clamped`."""
    mesh = tc.grid((0.2, 0.05), (8, 2))
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(0.15, tc.Stretch(200, 0.1), tc.Shear(20, 0.01), bend))
    scene.pin(cloth, np.flatnonzero(mesh.x[:, 0] < mesh.x[:, 0].min() + (0.03 if clamped else 0.01)))
    return scene


REMEMBERS, CURVED = (tc.Bend(2e-5, 1e-8, friction=3e-4, yield_=8.0, hardening=0.3, recovery=(1.0, 2.0), model=model)
                     for model in ("hinge", "curvature"))


@pytest.mark.parametrize("bend", [REMEMBERS, CURVED], ids=["hinge", "curvature"])
@pytest.mark.slow
def test_what_creases_take_is_accounted_for(bend):
    """Energy taken afresh after each step changes by what the ledger says, what friction and creases take included."""
    sim = tc.Simulation(strip(bend), h=1 / 120, integrator="newton_euler", cg_tol=1e-12, newton_tol=1e-11,
                        stretch_limit=9.0)
    before, taken = sum(sim.energy().values()), 0.0
    for _ in range(30):
        sim.log.clear()
        sim.step()
        row = totals([r.ledger for r in sim.log])
        after = sum(sim.energy().values())
        assert row["kinetic"] + row["potential"] == pytest.approx(after - before, abs=1e-12)
        assert row["plastic"] >= -1e-15
        scale = abs(row["kinetic"]) + abs(row["potential"]) + row["plastic"]
        assert abs(row["unaccounted"]) < 1e-6 * scale + 1e-12, row
        before, taken = after, taken + row["plastic"]
    assert taken > 1e-6
    sim.close()


@pytest.mark.parametrize("integrator, bend, key", [
    ("safe", REMEMBERS, "hinge_sliders"), ("backward_euler", REMEMBERS, "hinge_sliders"),
    ("verlet", REMEMBERS, "hinge_sliders"),
    ("safe", CURVED, "curvature_sliders"), ("verlet", CURVED, "curvature_sliders")])
@pytest.mark.slow
def test_a_run_with_creases_is_resumed_bit_for_bit(integrator, bend, key):
    def run():
        return tc.Simulation(strip(bend), h=1 / 120, integrator=integrator)

    with run() as sim:
        for _ in range(20):
            sim.step()
        state = sim.checkpoint()
        assert np.abs(state[f"particles.state_{key}"]).max() > 0.01
        for _ in range(15):
            sim.step()
        end = sim.positions()
    with run() as sim:
        sim.resume(state)
        for _ in range(15):
            sim.step()
        assert (sim.positions() == end).all()


@pytest.mark.slow
def test_friction_takes_the_swing_of_a_clamped_strip():
    """What it takes is what is missing; without friction the strip still swings, with it far less."""
    ends = []
    for friction in (0.0, 2e-3):
        with tc.Simulation(strip(tc.Bend(2e-4, friction=friction), clamped=True), h=1 / 120) as sim:
            start = sum(sim.energy().values())
            sim.run(1.5, 10)
            late, rows = [], totals([r.ledger for r in sim.log])
            assert rows["kinetic"] + rows["potential"] == pytest.approx(sum(sim.energy().values()) - start, abs=1e-12)
            for _ in range(60):
                sim.step()
                late.append(sim.energy()["kinetic"])
            ends.append((max(late), rows["plastic"]))
    assert ends[1][0] < 0.25 * ends[0][0] and ends[0][1] == 0 and ends[1][1] > 5 * ends[1][0], ends


@pytest.mark.slow
def test_second_order_steps_go_on_where_friction_stops_what_moves():
    """What friction took counts against what steps gain: small motions about a rest that it holds are no growth of energy."""
    with tc.Simulation(strip(tc.Bend(5e-5, friction=4e-4)), h=1 / 120, integrator="tr_bdf2") as sim:
        sim.run(1.0, 10)
        assert sum(len(r.rejections) for r in sim.log) <= 2 and sum(r.solves for r in sim.log) < 7 * len(sim.log)


def test_what_layers_store_is_not_what_creases_take():
    """Two sheets held at half of their thickness: repulsion stays in the energy from step to step, and nothing creases."""
    mesh, scene = tc.grid(0.04, 2), tc.Scene(gravity=None)
    for height in (0.0, 0.002):
        cloth = scene.add_cloth(mesh, tc.Fabric(0.1, tc.Stretch(200, 0.01), bend=REMEMBERS), mesh.x + [0, height, 0],
                                contact=tc.ClothContact(0.004))
        scene.pin(cloth, range(mesh.vertex_count))
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        for _ in range(6):  # by then what repels further away from step to step does so by all that it may
            row = sim.step().ledger
            assert sim.log[-1].energies["contact"] > 1e-9 and abs(row["plastic"]) < 1e-15
            assert abs(row["unaccounted"]) < 1e-9 * sim.log[-1].energies["contact"]
        assert abs(row["layers"]) < 1e-6 * sim.log[-1].energies["contact"]


@pytest.mark.parametrize("model", ["hinge", "curvature"])
def test_what_does_not_remember_has_no_sliders(model):
    with tc.Simulation(strip(tc.Bend(2e-5, model=model))) as sim:
        bend = next(f for f in sim.force_terms if hasattr(f, "hysteresis"))
        assert bend.hysteresis is None and not sim.model.remembered


@pytest.mark.parametrize("make, words", [
    (lambda: tc.Bend(1e-5, friction=-1), "bend friction = -1"),
    (lambda: tc.Bend(1e-5, yield_=0), "bend yield_ = 0"),
    (lambda: tc.Bend(1e-5, yield_=10, hardening=1), "hardening = 1: must be less than 1"),
    (lambda: tc.Bend(1e-5, yield_=10, hardening=0), "hardening = 0"),
    (lambda: tc.Bend(1e-5, recovery=1), "nothing stays bent without yield_"),
    (lambda: tc.Bend(1e-5, yield_=10, recovery=(-1, 0)), "bend recovery"),
])
def test_impossible_memories_are_refused(make, words):
    with pytest.raises(tc.SceneError, match=words):
        make()
