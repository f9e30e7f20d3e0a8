"""Loads and wind that are changed as a scene runs: against gravity, against functions of time, against events."""

import numpy as np
import pytest

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(500, k_d=0.5), tc.Shear(100), tc.Bend(1e-5))
G = np.array([0.0, -9.81, 0.0])


def sheet(gravity=None, air=None):
    scene = tc.Scene(gravity=gravity, air=air)
    cloth = scene.add_cloth(tc.grid(0.4, 4), FABRIC)
    scene.pin(cloth, [0, 4])
    return scene, cloth


def masses(scene) -> np.ndarray:
    with tc.Simulation(scene) as sim:
        m = np.zeros(sim.vertex_count)
        m[sim.model.user] = sim.model.mass
    return m


@pytest.mark.parametrize("integrator", ["backward_euler", "tr_bdf2", "verlet"])
def test_a_load_of_m_g_is_gravity(integrator):
    """The same motion; the work that the ledger has of it is what gravity's energy falls by."""
    scene, cloth = sheet()
    scene.add_load(cloth, np.arange(cloth.mesh.vertex_count), masses(scene)[:, None] * G)
    runs = []
    for made in (sheet(G)[0], scene):
        with tc.Simulation(made, h=1 / 120, integrator=integrator, cg_tol=1e-12) as sim:
            sim.run(0.1, fps=20)
            runs.append((sim.positions(), sim.forces(), [r.ledger for r in sim.log], [r.energies for r in sim.log]))
    (x, f, before, energies), (y, g, ledger, _) = runs
    assert np.abs(x - y).max() < 1e-9 and np.allclose(f, g, rtol=0, atol=1e-7)
    assert x[:, 1].min() < -0.02
    if integrator != "verlet":  # which knows the wind's work only at the ends of its long steps
        assert sum(e["wind"] for e in ledger) == pytest.approx(-energies[-1]["gravity"], rel=0.1)
        assert np.allclose([e["unaccounted"] for e in ledger], [e["unaccounted"] for e in before], rtol=0, atol=1e-9)


def test_functions_of_time_and_the_order_of_vertices():
    """Of free particles v = integral F/m dt, each by its own force, in the order given."""
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(tc.grid(0.4, 2), tc.Fabric(0.2, tc.Stretch(1e-9)))
    push = np.array([[1e-3, 0, 0], [0, 2e-3, 0]])
    scene.add_load(cloth, [7, 3], lambda t: t * push)
    scene.add_load(cloth, 3, (0.0, 0.0, 1e-3))
    m = masses(scene)
    with tc.Simulation(scene, h=0.01, integrator="backward_euler") as sim:
        for _ in range(10):
            sim.step()
        v = sim.velocities()
    assert v[7] == pytest.approx(push[0] * 0.01**2 * 55 / m[7], rel=1e-5, abs=1e-12)
    assert v[3] == pytest.approx((push[1] * 0.01**2 * 55 + [0, 0, 1e-3 * 0.1]) / m[3], rel=1e-5)
    assert np.abs(np.delete(v, [3, 7], axis=0)).max() < 1e-6


def act(what, cloth, load):
    """On a scene in an event, or on a simulation."""
    what.remove_load(load)
    what.add_load(cloth, "left", (0.0, 1e-3, 0.0))
    what.set_wind((0.0, 12.0, 0.0))


@pytest.mark.parametrize("lift", [0.0, 0.5])
def test_between_steps_as_in_events_and_as_functions_of_time(lift):
    air = tc.Air(0.5, 0.1, drag=lift, lift=lift)
    ended = []
    for way in ("hand", "event", "function"):
        scene, cloth = sheet(G, air)
        load = scene.add_load(cloth, "right", (0.0, 0.0, 2e-3))
        if way == "event":
            scene.at(0.1, lambda s, cloth=cloth, load=load: act(s, cloth, load))
        if way == "function":
            scene.remove_load(load)
            scene.set_wind(lambda t: (0.0, 12.0 * (t > 0.1001), 0.0))
            scene.add_load(cloth, "right", lambda t: (0.0, 0.0, 2e-3 * (t < 0.1001)))
            scene.add_load(cloth, "left", lambda t: (0.0, 1e-3 * (t > 0.1001), 0.0))
        with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
            sim.run(0.1, fps=10)
            if way == "hand":
                act(sim, cloth, load)
                kept = sim.checkpoint()
            sim.run(0.1, fps=10)
            ended.append(sim.positions())
        if way == "hand":
            with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as again:
                with pytest.raises(tc.SceneError, match="3 times by hand"):
                    again.resume(kept)
                act(again, cloth, load)
                again.resume(kept)
                again.run(0.1, fps=10)
                assert (again.positions() == ended[0]).all()
    assert (ended[0] == ended[1]).all() and np.abs(ended[0] - ended[2]).max() < 1e-9
    assert ended[0][:, 1].max() > 0.002  # blown up


def test_what_cannot_be_is_refused():
    scene, cloth = sheet()
    with pytest.raises(tc.SceneError, match="has no air"):
        scene.set_wind((1.0, 0.0, 0.0))
    with pytest.raises(tc.SceneError, match="the load on 2 vertices of 'cloth0', at t = 0 s"):
        scene.add_load(cloth, [0, 1], lambda t: np.zeros((3, 3)))
    with pytest.raises(tc.SceneError, match="named twice"):
        scene.add_load(cloth, [1, 1], (0.0, 0.0, 1.0))
    assert not scene.script.loads
    with tc.Simulation(scene) as sim:
        assert not [f for f in sim.force_terms if type(f).__name__ == "Loads"]
        with pytest.raises(tc.SceneError, match="made without loads"):
            sim.add_load(cloth, 1, (0.0, 0.0, 1.0))
        assert sim.prescribed.changes == 0
    scene, cloth = sheet(air=tc.Air(1.0))
    load = scene.add_load(cloth, 1, (0.0, 0.0, 1.0))
    scene.remove_load(load)
    with pytest.raises(tc.SceneError, match="not a load that is there"):
        scene.remove_load(load)
    with tc.Simulation(scene, integrator="verlet") as sim:
        sim.add_load(cloth, 1, (0.0, 0.0, 1.0))
        with pytest.raises(tc.SceneError, match="'verlet' takes its steps"):
            sim.set_wind(lambda t: (t, 0.0, 0.0))
        sim.set_wind((-1.0, 0.0, 0.0))
        sim.step(0.01)
        sim.set_wind(np.array([1.0, 0.0, 0.0]))  # another one instead
        sim.step(0.05)
        assert sim.velocities()[:, 0].max() > 1e-3
    with tc.Simulation(scene, integrator="backward_euler") as sim, pytest.raises(tc.SceneError, match="the same everywhere"):
        sim.set_wind(lambda x, t: x)


@pytest.mark.parametrize("force, words", [
    ((0, 0, np.nan), r"is not finite: \[0.0, 0.0, nan\]"), ((0, 1e31, 0), r"is beyond 1e\+30: \[0.0, 1e\+31, 0.0\]"),
    ([(0, 0, 0), (0, np.inf, 0)], r"vertex 7 is not finite: \[0.0, inf, 0.0\]"),
    ([(0, np.nan, 0)] * 2, r"vertex 9 \(2 such\) is not finite: \[0.0, nan, 0.0\]")])
def test_what_is_not_finite_is_named_by_the_vertices_of_the_cloth(force, words):
    scene, cloth = sheet()
    with pytest.raises(tc.SceneError, match=f"^add_load: force: {words}$"):
        scene.add_load(cloth, [9, 7], force)
    load = scene.add_load(cloth, [9, 7], lambda t: force if t > 0.1 else (0, 0, 0))
    with pytest.raises(tc.SceneError, match=f"^the load on 2 vertices of 'cloth0', at t = 0.2 s: {words}$"):
        load.at(0.2)
