"""Pins and motions that are changed between steps, against events that do the same."""

import numpy as np
import pytest

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(500, k_d=0.5), tc.Shear(100), tc.Bend(1e-5))


def hung(act=None):
    scene = tc.Scene()
    ball = scene.add_solid(tc.Sphere(0.1), 0.3, 0.01, position=lambda t: (2.0 + t, 0.0, 0.0))
    cloth = scene.add_cloth(tc.grid(0.5, 5), FABRIC)
    scene.pin(cloth, [0, 5])
    if act is not None:
        scene.at(0.1, lambda s: act(s, cloth, ball))
    return scene, cloth, ball


def lift(t):
    return 0.0, 0.5 * (t - 0.1), 0.0


def act(what, cloth, ball):
    """On a scene in an event, or on a simulation."""
    what.unpin(cloth, [0])
    what.move(cloth, [30, 35], lift, relative=True)
    what.pin(cloth, 17, "y")
    what.attach(cloth, [3], ball, 0.1)


@pytest.fixture(scope="module")
def simulations():
    scene, cloth, ball = hung()
    with tc.Simulation(scene, h=1 / 60) as sim, tc.Simulation(hung(act)[0], h=1 / 60) as other:
        yield sim, other, cloth, ball


def test_between_steps_as_in_events(simulations):
    sim, other, cloth, ball = simulations
    sim.run(0.1, fps=10)
    before = sim.positions()
    act(sim, cloth, ball)
    sim.run(0.1, fps=10)
    other.run(0.2, fps=10)
    x = sim.positions()
    assert (x == other.positions()).all()
    assert np.allclose(x[[30, 35]], before[[30, 35]] + [0, 0.05, 0], atol=1e-12)
    assert x[17, 1] == pytest.approx(before[17, 1], abs=1e-12) and abs(x[17] - before[17]).max() > 1e-4
    assert np.allclose(x[3], before[3] + [0.1, 0, 0], atol=1e-9)  # the ball goes at 1 m/s
    assert abs(x[0] - before[0]).max() > 1e-3 and (x[5] == before[5]).all()
    assert len(sim.scene.script.attachments) == 1  # the scene stays as it was built


def test_going_on_needs_the_same_changes(simulations):
    sim, _, cloth, ball = simulations
    state = sim.checkpoint()
    sim.run(0.1, fps=10)
    end = sim.positions()
    with tc.Simulation(sim.scene, h=1 / 60) as again:
        with pytest.raises(tc.SceneError, match="4 times by hand"):
            again.resume(state)
    with tc.Simulation(sim.scene, h=1 / 60) as again:
        act(again, cloth, ball)
        again.resume(state)
        again.run(0.1, fps=10)
        assert (again.positions() == end).all()


def test_a_scene_that_runs_says_that_it_is_not_followed(simulations):
    sim, _, cloth, _ = simulations
    with pytest.warns(UserWarning, match=r"sim\.pin"):
        sim.scene.pin(cloth, 12)
    with pytest.warns(UserWarning, match=r"sim\.pin"):
        sim.scene.unpin(cloth, 12)
    with pytest.raises(tc.SceneError, match="no such vertex"):
        sim.unpin(cloth, 11)
