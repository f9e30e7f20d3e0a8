"""Step control: named rejections, rollback bit for bit, doubling, exact frames, fixed steps."""

import numpy as np
import pytest

import taichi_cloth as tc


def jerked(limit=0.5, **kwargs):
    """A sheet whose edge is pulled away fast for a short while."""
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(tc.grid(1.0, 6), tc.Fabric(0.2, tc.Stretch(500, 1.0), tc.Shear(50)))
    scene.pin(cloth, "left")
    scene.move(cloth, "right", lambda t: (2.0 * np.clip(t - 0.1, 0, 0.05) * 4, 0, 0), relative=True)
    return tc.Simulation(scene, stretch_limit=limit, **kwargs)


def test_a_jerk_is_taken_in_smaller_steps_by_name():
    sim = jerked(limit=0.05)
    sim.run(0.8, 10)
    rejected = [r for r in sim.log if r.rejections]
    assert rejected and all(set(r.rejections) == {"STRETCH"} for r in rejected)
    assert min(r.h for r in sim.log) <= 1 / 120
    assert max(r.h for r in sim.log[-3:]) > 0.9 / 60  # h has doubled back
    assert sim.time == pytest.approx(0.8, abs=1e-12)


def test_frames_are_hit_exactly():
    sim = jerked(h=1 / 47)
    times = []
    sim.run(0.5, 24, lambda s, frame: times.append(s.time))
    assert times == [frame / 24 for frame in range(13)]


def test_giving_up_is_named_and_rolls_back_bit_for_bit():
    sim = jerked(limit=1e-7, h_min=1 / 500)
    for _ in range(6):
        sim.step()
    x, v, t = sim.positions(), sim.velocities(), sim.time
    with pytest.raises(tc.SimulationError, match=r"gave up at t = 0.1 s: no step of at least h_min.*STRETCH.*stretch_limit"
                       ) as caught:
        sim.step()
    assert caught.value.reason == "STRETCH" and caught.value.time == sim.time == t
    assert (sim.positions() == x).all() and (sim.velocities() == v).all()


def test_solver_that_does_not_converge_is_not_accepted():
    sim = jerked(cg_max_iterations=2, h_min=1 / 200)
    with pytest.raises(tc.SimulationError, match="SOLVER .MAX_ITERATIONS"):
        sim.run(1, 10)


@pytest.mark.slow
def test_fixed_step_does_what_it_is_told_and_reports():
    sim = jerked(limit=1e-7, adaptive=False)
    sim.run(0.2, 60)
    assert len(sim.log) == 12 and all(r.h == pytest.approx(1 / 60) for r in sim.log)
    assert {r.status for r in sim.log} == {"CONVERGED", "STRETCH"}
    slow = jerked(cg_max_iterations=3, adaptive=False)
    slow.run(0.2, 60)
    assert "MAX_ITERATIONS" in {r.status for r in slow.log}


@pytest.mark.restarts
@pytest.mark.slow
def test_overflow_is_named():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, tc.Stretch(1e4)))
    scene.move(cloth, "left", lambda t: (1e28 * t, 0, 0), relative=True)
    with pytest.raises(tc.SimulationError, match="gave up at t = 0 s") as caught:
        tc.Simulation(scene, precision="f32").step()
    assert caught.value.reason in ("NOT_FINITE", "SOLVER")


def test_step_takes_exactly_the_time_asked_for():
    sim = jerked(limit=0.05)
    for h in (0.05, 0.1, 0.013):
        before = sim.time
        sim.step(h)
        assert sim.time == pytest.approx(before + h, abs=1e-15)
    with pytest.raises(tc.SceneError, match="h = -1"):
        sim.step(-1)


@pytest.mark.slow
def test_energy_test_mends_what_one_solve_would_blow_up():
    mesh = tc.grid(1.0, 10)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5)),
                    0.5 * mesh.x + 1e-4 * np.random.default_rng(99).normal(size=mesh.x.shape))
    growth, solves = {}, {}
    for newton_max in (0, 8):
        sim = tc.Simulation(scene, h=1 / 60, stretch_limit=1e9, adaptive=False, newton_max=newton_max,
                            integrator="backward_euler")
        start = sum(sim.energy().values())
        total = [start]
        for _ in range(8):
            sim.step()
            total.append(sum(sim.log[-1].energies.values()))
        growth[newton_max], solves[newton_max] = np.diff(total).max() / start, [r.solves for r in sim.log]
        if newton_max == 0:
            assert "ENERGY" in {r.status for r in sim.log}  # taken as it is in fixed steps, and named
    assert max(solves[8]) > 1 and growth[8] < 1e-9


@pytest.mark.restarts
def test_closed_and_superseded_simulations_say_so():
    sim = jerked()
    sim.close()
    with pytest.raises(tc.BackendError, match="closed"):
        sim.step()
    first = jerked()
    jerked(precision="f32").step()
    with pytest.raises(tc.BackendError, match="another was started"):
        first.positions()


@pytest.mark.restarts
@pytest.mark.slow
def test_bitwise_repeatable():
    def final():
        sim = jerked(limit=0.05, precision="f32")
        sim.run(0.3, 30)
        x = sim.positions()
        sim.close()
        return x

    assert (final() == final()).all()


def test_a_summary_adds_up_what_steps_say():
    """Rejections by name over all steps, not those of one."""
    from taichi_cloth.app.summary import summary

    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2, tc.Stretch(100)))
    sim = tc.Simulation(scene, h=1 / 60, integrator="backward_euler")
    for found in ({"CONTACT": 2}, {"CONTACT": 1, "ENERGY": 1}, {}):
        sim.step().rejections = found
    sim.recall(list(sim.log))
    assert summary(sim)["rejections"] == {"CONTACT": 3, "ENERGY": 1} and summary(sim)["steps"] == 3
