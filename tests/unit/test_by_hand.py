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


@pytest.mark.slow
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


@pytest.mark.slow
def test_going_on_needs_the_same_changes(simulations):
    sim, _, cloth, ball = simulations
    if sim.time == 0:  # this test alone
        sim.run(0.1, fps=10)
        act(sim, cloth, ball)
    state, at = sim.checkpoint(), sim.positions()
    sim.run(0.1, fps=10)
    end = sim.positions()
    with tc.Simulation(sim.scene, h=1 / 60) as again:
        with pytest.raises(tc.SceneError, match="4 times by hand"):
            again.resume(state)
        again.resume(state, edited=True)
        assert any("changes by hand" in note for note in again.notes) and (again.positions() == at).all()
    with tc.Simulation(sim.scene, h=1 / 60) as again:
        act(again, cloth, ball)
        again.resume(state)
        again.run(0.1, fps=10)
        assert (again.positions() == end).all()


@pytest.mark.slow
def test_a_scene_that_runs_is_not_changed(simulations):
    """Neither by hand nor, where simulations have it as it was built, in an event; nothing of a change is left."""
    sim, _, cloth, ball = simulations
    scene = sim.scene
    changes = {
        "pin": lambda: scene.pin(cloth, 12), "move": lambda: scene.move(cloth, 12, lambda t: (0, t, 0), relative=True),
        "attach": lambda: scene.attach(cloth, 12, ball), "unpin": lambda: scene.unpin(cloth),
        "at": lambda: scene.at(1.0, lambda: None), "add_load": lambda: scene.add_load(cloth, 12, (0, 1, 0)),
        "add_cloth": lambda: scene.add_cloth(cloth.mesh, cloth.fabric), "add_mass": lambda: scene.add_mass(cloth, 12, 1.0),
        "add_solid": lambda: scene.add_solid(tc.Sphere(1.0), 0.1, 0.01), "sew": lambda: scene.sew(cloth, [0], [12]),
        "stitch": lambda: scene.stitch(cloth, 0, 12), "crease": lambda: scene.crease(cloth, 1.0, edges=[[7, 8]]),
        "add_force": lambda: scene.add_force(lambda fields, model, scene, K: None),
        "gravity": lambda: setattr(scene, "gravity", None), "air": lambda: setattr(scene, "air", tc.Air(1.0))}
    before = repr((scene, scene.script, scene.masses, scene.creases, scene.forces, scene.gravity, scene.air))
    built = [name for name in changes if not hasattr(sim, name) and name != "at"]
    assert len(built) == 9
    for name, change in changes.items():
        with pytest.raises(tc.SceneError, match=rf"^{name}: a simulation of this scene has begun.*close it") as error:
            change()
        assert (f"sim.{name}" in str(error.value)) == hasattr(sim, name)
        if name in built:
            with pytest.raises(tc.SceneError, match="has begun"), scene.running(sim.prescribed.script):
                change()
    assert repr((scene, scene.script, scene.masses, scene.creases, scene.forces, scene.gravity, scene.air)) == before
    with pytest.raises(tc.SceneError, match="no such vertex"):
        sim.unpin(cloth, 11)


@pytest.mark.restarts
def test_a_scene_is_free_again_when_its_simulations_are_over():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.5, 5), tc.Fabric(0.2, tc.Stretch(100)))
    with tc.Simulation(scene, h=1 / 60, integrator="verlet"):
        with pytest.raises(tc.SceneError, match="has begun"):
            scene.pin(cloth, 12)
    scene.pin(cloth, 12)
    sim = tc.Simulation(scene, h=1 / 60, integrator="verlet", precision="f32")
    with pytest.raises(tc.SceneError, match="has begun"):
        scene.pin(cloth, 13)
    sim.itself = sim
    del sim  # nobody closed it
    scene.pin(cloth, 13)
    ended = tc.Simulation(scene, h=1 / 60, integrator="verlet", precision="f32")
    with tc.Simulation(scene, h=1 / 60, integrator="verlet", precision="f64"):
        with pytest.raises(tc.SceneError, match="has begun"):
            scene.pin(cloth, 14)
    assert not ended.is_open  # by the one of another precision
    scene.pin(cloth, 14)


def test_what_would_change_nothing_is_refused():
    """Options are read where a simulation is made, gravity and air from its scene."""
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.5, 5), tc.Fabric(0.2, tc.Stretch(100)))
    with tc.Simulation(scene, h=1 / 60, integrator="verlet") as sim:
        for name, words in (("h", r"tc.Simulation\(scene, h=...\), or step\(h\)"), ("tolerance", "tolerance=..."),
                            ("integrator", "integrator=..."), ("gravity", "scene.gravity = ..."), ("air", "or set_wind")):
            with pytest.raises(tc.SceneError, match=words):
                setattr(sim, name, 0.1)
        assert sim.step().h == pytest.approx(1 / 60)
