"""Layers of cloth against closed forms: lifting, gliding, falling, resting and sliding under friction."""

import math
import pathlib

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.app import scenefile
from taichi_cloth.contact.cloth import contact_pairs
from taichi_cloth.step.nonlinear.layer_contact import LayerStep

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))
THICKNESS = 0.005
REST, SPEED = 0.3, 1.5  # s, m/s of scenes/tablecloth_pull.py


def sheet_on_sheet(friction: float, gravity, gap: float = THICKNESS, v=(0.0, 0.0, 0.0),
                   contact: str = "repulsion") -> tuple[tc.Simulation, np.ndarray]:
    """A sheet of 0.3 m over a larger one that is pinned everywhere; and which vertices are the upper one's."""
    scene, meets = tc.Scene(gravity=gravity), tc.ClothContact(THICKNESS, friction)
    lower, upper = tc.grid(0.8, 16), tc.grid(0.3, 7)
    a = scene.add_cloth(lower, FABRIC, contact=meets)
    b = scene.add_cloth(upper, FABRIC, positions=upper.x + [0.1, gap, -0.25], velocities=v, contact=meets)
    scene.pin(a, np.arange(lower.vertex_count))
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler", contact=contact)
    return sim, np.arange(upper.vertex_count) + b.start


@pytest.mark.slow
def test_pressed_sheets_lift_apart_freely():
    sim, upper = sheet_on_sheet(0.3, (0, -9.81, 0))
    for _ in range(20):
        sim.step()
    x, v = sim.positions(), sim.velocities()
    v[upper] += [0, 1, 0]
    sim.set_state(x, v)
    sim.step()
    expected = 1 - 9.81 / 60
    assert sim.velocities()[upper, 1].mean() > 0.99 * expected
    sim.close()


@pytest.mark.slow
@pytest.mark.parametrize("shifts", [True, False])
def test_what_rests_lies_as_near_whatever_the_step(monkeypatch, shifts):
    """Three sheets on a plane, at steps of 1/30 to 1/480 s: they keep their distance to 1.5 %. By the stiffness alone gaps are
    the same, and lack by the load."""
    gaps = []
    if not shifts:
        monkeypatch.setattr(contact_pairs, "GROWS", 0.0)
    for h in (1 / 30, 1 / 60, 1 / 240, 1 / 480):
        scene, mesh = tc.Scene(), tc.grid(0.3, 4)
        scene.add_solid(tc.Plane(), 0.3, THICKNESS)
        for k in range(3):
            scene.add_cloth(mesh, FABRIC, mesh.x + [0, 0.006 * (k + 1), 0], contact=tc.ClothContact(THICKNESS, 0.3))
        with tc.Simulation(scene, h=h, integrator="backward_euler", threads=1, contact_tol=0.1 if shifts else None) as sim:
            while sim.time < 0.3 - 1e-9:
                sim.step()
            gaps.append(np.diff(sim.positions()[:, 1].reshape(3, -1), axis=0).mean(axis=1) / THICKNESS)
    if shifts:
        assert np.abs(np.array(gaps) - 1).max() < 0.015
        return
    assert np.abs(np.array(gaps) - gaps[1]).max() < 1e-3 and (np.array(gaps) < 0.99).all()
    lower, upper = 1 - gaps[1]
    assert lower == pytest.approx(2 * upper, rel=0.05)  # it bears two


def falling(cells: int, sheets: int = 3) -> tc.Scene:
    """Sheets that fall on a ball, each turned a little against the last, and fold."""
    scene, mesh = tc.Scene(), tc.grid(1.0, cells)
    for k in range(sheets):
        c, s = math.cos(0.35 * k), math.sin(0.35 * k)
        x = (mesh.x + [-0.5, 0, 0.5]) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        scene.add_cloth(mesh, FABRIC, positions=x + [0, 0.35 + 0.03 * k, 0], contact=tc.ClothContact(0.006, 0.3))
    scene.add_solid(tc.Sphere(0.3), friction=0.3, thickness=0.005)
    return scene


@pytest.mark.slow
def test_solves_that_others_follow_are_preliminary(monkeypatch):
    """After two steps of which a Newton step was cut short, or changed more than a tenth of the contacts with solids, the
    first; the second, if that was cut short; never a step's last, and none where something rests since it passed through
    itself. Others are to five times `cg_tol` then, or to that, as where all but the energy is right."""
    judge, steps, tangled, went_on = LayerStep.judge, [], [], []

    def judged(step, k, part, measures):
        if k == 0:
            steps.append((step.contacts.forcing_terms.rounds, step.contacts.hindered, step.solutions, []))
        steps[-1][3].append(part)
        so = part < 1 or step.contacts.solids.unsettled > 0.1 * step.contacts.count
        went_on[len(steps) - 1:] = [so or (k > 0 and went_on[-1])]
        return judge(step, k, part, measures)

    monkeypatch.setattr(LayerStep, "judge", judged)
    with tc.Simulation(falling(10), h=1 / 60, integrator="backward_euler", cg_tol=1e-4, threads=1,
                       contact_tol=None) as sim:
        for frame in range(60):
            first = len(steps)
            if frame == 30:
                sim.contacts.layers.release_around(np.arange(20))
                free = first
            if frame >= 30:  # whatever the steps before were
                sim.contacts.forcing_terms.rounds = 2
            sim.step(1 / 60)
            tangled += [hindered for _, hindered, _, _ in steps[first:] if frame >= 30]
    told = [([s.preliminary for s in solutions[len(solutions) - len(parts):]], parts, rounds, hindered)
            for rounds, hindered, solutions, parts in steps]
    for flags, parts, rounds, hindered in told:
        first = rounds >= 2 and not hindered
        assert flags[0] is first and not any(flags[2:]) and not flags[-1]
        assert len(flags) < 2 or flags[1] is (first and parts[0] < 1)
    assert all(rounds < 2 or (went_on[k - 1] and went_on[k - 2]) for k, (*_, rounds, _) in enumerate(told[:free]))
    cut = [parts[0] < 1 for _, parts, *_ in told]
    assert sum(rounds >= 2 and not (cut[k - 1] and cut[k - 2]) for k, (*_, rounds, _) in enumerate(told[:free])) > 2
    count = [sum(flags) for flags, *_ in told]
    assert min(count.count(k) for k in (0, 1, 2)) > 2 and sum(tangled) > 2
    rough = [s for _, _, solutions, parts in steps for s in solutions[len(solutions) - len(parts):] if s.preliminary]
    assert {s.tolerance for s in rough} == {0.03} and max(s.residual for s in rough) > 5e-3
    for (rounds, hindered, solutions, parts), (flags, *_) in zip(steps, told):
        looser = 5 if rounds >= 2 and not hindered else 1
        kept = [s for s, flag in zip(solutions[len(solutions) - len(parts):], flags) if not flag]
        assert all(s.residual < 2.1 * s.tolerance for s in kept)
        usual = [s.tolerance == pytest.approx(looser * 1e-4) for s in kept]
        assert usual[0] and usual == sorted(usual, reverse=True)  # after them only
        assert all(s.tolerance == pytest.approx(1e-4) for s, so in zip(kept, usual) if not so)


@pytest.mark.slow
@pytest.mark.parametrize("h", [1 / 60, 1 / 30])
def test_no_step_of_layers_leaves_much_of_its_energy_unaccounted_for(h):
    """Three sheets that fall on a ball and fold: a fifth at most of all that a step's energy went through, or of what it gains
    in free fall, where it is not braked and took less than half of the solves that it may."""
    left = []
    with tc.Simulation(falling(10), h=h, integrator="backward_euler", cg_tol=1e-3, threads=1) as sim:
        while sim.time < 0.8 - 1e-9:
            r = sim.step()
            through = sum(abs(value) for name, value in r.ledger.items() if name != "unaccounted")
            if r.layers and r.solves < 6 and not r.ledger["kinetic_correction"]:
                left.append(abs(r.ledger["unaccounted"]) / max(through, 0.5 * 0.6 * (9.81 * r.h) ** 2))
    assert len(left) > 5 and max(left) < 0.2, (len(left), max(left))


@pytest.mark.slow
def test_smooth_sheets_glide():
    sim, upper = sheet_on_sheet(0.0, (0, -9.81, 0), v=(2.0, 0, 0))
    for _ in range(10):
        sim.step()
    v = sim.velocities()[upper].mean(axis=0)
    assert v[0] > 0.99 * 2 and np.abs(v[1:]).max() < 0.02 and sim.log[-1].layers > 20
    sim.close()


def test_the_upper_sheet_falls_freely():
    sim, upper = sheet_on_sheet(0.3, (0, -9.81, 0), gap=0.5)
    for _ in range(15):
        sim.step()
    assert sim.velocities()[upper, 1].mean() == pytest.approx(-9.81 * sim.time, rel=1e-3)
    sim.close()


@pytest.mark.slow
def test_what_rests_does_not_creep():
    sim, upper = sheet_on_sheet(0.3, (0, -9.81, 0))
    for _ in range(30):
        sim.step()
    x = sim.positions()
    for _ in range(60):
        sim.step()
    assert np.abs(sim.velocities()).max() < 1e-4 and np.abs(sim.positions() - x).max() < 1e-4
    assert np.mean([r.solves for r in sim.log]) < 2.5
    sim.close()


@pytest.mark.parametrize("degrees", [12, 25])
@pytest.mark.slow
def test_a_sheet_slides_on_a_sheet_as_coulomb_says(degrees):
    mu, angle = 0.3, math.radians(degrees)
    sim, upper = sheet_on_sheet(mu, 9.81 * np.array([math.sin(angle), -math.cos(angle), 0]))
    for _ in range(4):
        sim.step()
    v = sim.velocities()[upper, 0].mean()
    for _ in range(12):
        sim.step()
    gained = (sim.velocities()[upper, 0].mean() - v) * 60 / 12
    expected = 9.81 * max(math.sin(angle) - mu * math.cos(angle), 0.0)
    # within 5 % of the friction that acts; below the angle of friction it stays
    if expected:
        assert abs(gained - expected) < 0.05 * mu * 9.81 * math.cos(angle)
    else:
        assert np.abs(sim.velocities()).max() < 2e-4
    sim.close()


@pytest.mark.slow
def test_springs_of_the_paper_carry_a_sheet_with_one_solve_a_step():
    """They hold what falls on them apart, by forces that add up to nothing, and know nothing of what is not near yet."""
    sim, upper = sheet_on_sheet(0.3, (0, -9.81, 0), gap=1.05 * THICKNESS, contact="springs")
    for _ in range(60):
        sim.step()
    assert sim.intersections() == 0 and all(r.solves == 1 and not r.rejections for r in sim.log)
    weight = 9.81 * sim.model.mass[sim.model.particle[upper]].sum()
    forces = sim.model.to_user(sim.contacts.layers.pushes().add(np.zeros((sim.model.n, 3))))
    assert np.abs(forces.sum(axis=0)).max() < 1e-12 and forces[upper, 1].sum() == pytest.approx(weight, rel=0.01)
    lower = np.setdiff1d(np.arange(sim.vertex_count), np.arange(sim.vertex_count)[upper])
    x = sim.positions()[:, 1]
    assert 0.97 * THICKNESS < x[upper].mean() - x[lower].mean() < THICKNESS  # a spring gives by .02 mm
    sim.close()


@pytest.mark.slow
def test_springs_let_nothing_through_that_comes_fast():
    sim, upper = sheet_on_sheet(0.3, (0, 0, 0), gap=0.2, v=(0, -5.0, 0), contact="springs")
    while sim.time < 0.07:
        sim.step()
    assert sim.intersections() == 0 and sum(r.rejections.get("CONTACT", 0) for r in sim.log) > 0
    assert sim.velocities()[upper, 1].mean() > -0.5
    state = sim.checkpoint()
    sim.step()
    x = sim.positions()
    sim.close()
    again, _ = sheet_on_sheet(0.3, (0, 0, 0), gap=0.2, v=(0, -5.0, 0), contact="springs")
    again.resume(state)
    again.step()
    assert np.array_equal(again.positions(), x)
    again.close()


@pytest.mark.parametrize("mu", [0.2, 0.5])
@pytest.mark.slow
def test_a_strip_between_plates_slips_at_the_force_of_both(mu):
    """Drawn slowly from between the floor and a loaded sheet that can only rise and fall."""
    scene, meets, speed = tc.Scene(), tc.ClothContact(THICKNESS, mu), 0.2
    strip, plate = tc.grid((0.5, 0.1), (25, 5)), tc.grid(0.16, 6)
    scene.add_solid(tc.Plane(), friction=mu, thickness=0.004, name="floor")
    drawn = scene.add_cloth(strip, FABRIC, positions=strip.x - strip.x.mean(axis=0) + [0, 0.004, 0], contact=meets)
    loaded = tc.Fabric(1.5, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-3))
    upper = scene.add_cloth(plate, loaded, positions=plate.x - plate.x.mean(axis=0) + [0, 0.004 + THICKNESS, 0],
                            contact=meets)
    scene.pin(upper, np.arange(plate.vertex_count), "xz")
    scene.move(drawn, np.flatnonzero(strip.x[:, 0] > 0.5 - 1e-6), lambda t: (speed * t, 0.0, 0.0), relative=True,
               directions="xz")
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    force = []
    for k in range(36):
        sim.step()
        if k >= 18:
            force.append(sim.contact_forces())
    mean, weight = np.mean(force, axis=0), 9.81 * np.array([0.05 * 0.2, 0.16**2 * 1.5])
    on_strip, on_plate = mean[: strip.vertex_count, 0].sum(), mean[strip.vertex_count:, 0].sum()
    assert on_plate == pytest.approx(mu * weight[1], rel=0.05)
    assert -on_strip == pytest.approx(mu * (weight[0] + 2 * weight[1]), rel=0.05)
    sim.close()


@pytest.mark.parametrize("cells, contact_tol", [(16, None), (22, None), (22, 0.1)])
@pytest.mark.slow
def test_a_sheet_is_drawn_along_by_no_more_than_friction(cells, contact_tol):
    """A cloth is jerked from under another (`scenes/tablecloth_pull.py`): by its velocities the upper one gains mu g a second
    while it slips, within 20 % on the mean and 80 % in all frames but one; then both go on as one, in whole steps but for two
    at most. Of ten starts that differ by a rounding one has 1.15 times as much on the mean and 4.4 times in a frame, the other
    nine within a tenth on the mean. `contact_laws.py` asks for 2 %."""
    pull = scenefile.read(str(pathlib.Path(__file__).parents[2] / "scenes" / "tablecloth_pull.py"))
    scene = pull.make({"cells": cells})
    sim = tc.Simulation(scene, h=1 / 60, cg_tol=1e-3, integrator="backward_euler", contact_tol=contact_tol)
    mine, most, before, gained = scene.cloths[0].mesh.vertex_count, scene.cloths[0].contact.friction * 9.81, 0.0, []
    while sim.time < REST + 0.8:
        sim.step(1 / 60)
        v = sim.velocities()[:, 0]
        if v[:mine].mean() - v[mine:].mean() > 0.05 and sim.time > REST + 0.05:
            gained.append((v[mine:].mean() - before) * 60)
        before = v[mine:].mean()
    assert len(gained) > 25
    assert np.mean(gained) == pytest.approx(most, rel=0.2) and np.sum(np.array(gained) > 1.8 * most) <= 1
    assert before == pytest.approx(SPEED, rel=0.02)
    assert sum(sum(r.rejections.values()) for r in sim.log) < 3, [r.rejections for r in sim.log if r.rejections]
    sim.close()
