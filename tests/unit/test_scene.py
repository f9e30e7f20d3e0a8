"""Fabrics and scenes: impossible values are refused by name; attachments, paths and events."""

import numpy as np
import pytest

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(1000))


def sheet(n=4, **kwargs):
    scene = tc.Scene(**kwargs)
    return scene, scene.add_cloth(tc.grid(1.0, n), FABRIC)


@pytest.mark.parametrize("make, words", [
    (lambda: tc.Fabric(0), "density = 0 kg/m"),
    (lambda: tc.Fabric(-1), "density = -1"),
    (lambda: tc.Stretch(-5), "stretch k = -5 N/m"),
    (lambda: tc.Stretch((100, 0)), "stretch k = 0 N/m"),
    (lambda: tc.Stretch(1, k_d=-1), "k_d = -1"),
    (lambda: tc.Stretch(1, b=0), "stretch b = 0"),
    (lambda: tc.Stretch((1, 2, 3)), "a number or a pair"),
    (lambda: tc.Shear((1, 2)), r"shear k = \(1, 2\) N/m: must be a positive number"),
    (lambda: tc.Shear(float("nan")), "shear k = nan"),
    (lambda: tc.Bend("stiff"), "bend D = 'stiff'"),
    (lambda: tc.Bend(1, rest="round"), "unknown bend rest 'round'"),
    (lambda: tc.Fabric(1, stretch=tc.Shear(1)), "fabric stretch = Shear.*: must be a Stretch"),
    (lambda: tc.Scene(gravity=(0, 1)), "gravity"),
    (lambda: setattr(tc.Scene(), "gravity", (0, 1)), "gravity"),
    (lambda: setattr(tc.Scene(), "air", "x"), "air = 'x': must be"),
    (lambda: setattr(tc.Scene(), "view", "x"), "view = 'x': must be"),
    (lambda: tc.Air(normal=-1), "air normal = -1"),
    (lambda: tc.Air(normal=1, wind=lambda t: (1, np.nan, 0)), "wind at t = 0"),
    (lambda: tc.Camera((0, 0, 0), (0, 0, 0)), "same point"),
])
def test_impossible_values(make, words):
    with pytest.raises(tc.SceneError, match=words):
        make()


@pytest.mark.parametrize("act, words", [
    (lambda s, c: s.pin(c, "lefft"), "did you mean 'left'"),
    (lambda s, c: s.pin(c, 99), "names vertex 99"),
    (lambda s, c: s.pin(c, []), "is empty"),
    (lambda s, c: s.pin(c, 0, "w"), "unknown axis 'w'"),
    (lambda s, c: s.pin(c, 0, [[1, 0, 0], [2, 0, 0]]), "not independent"),
    (lambda s, c: s.pin(c, 0, [[0, 0, 0]]), "not independent"),
    (lambda s, c: s.pin(c, 0, np.ones((4, 3))), r"directions: needs shape .* not \(4, 3\)"),
    (lambda s, c: s.move(c, [0, 1], lambda t: (0, 0, 0)), "moves 2 vertices .* at t = 0 s: needs shape .* relative=True"),
    (lambda s, c: s.move(c, 0, lambda t: (0, np.nan, 0)), "not finite"),
    (lambda s, c: s.move(c, 0, (0, 0, 0)), "function of time"),
    (lambda s, c: s.unpin(c, 3), "no such vertex"),
    (lambda s, c: s.at(-1, print), "at least 0"),
    (lambda s, c: s.add_mass(c, 0, 0), "point mass = 0"),
    (lambda s, c: s.add_cloth(c.mesh, FABRIC, name=c.name), "named 'cloth0' already"),
    (lambda s, c: s.add_cloth(c.mesh, FABRIC, positions=np.zeros((3, 3))), r"shape \(25, 3\)"),
    (lambda s, c: tc.Scene().pin(c, 0), "not a cloth of this scene: 'cloth0'; pass the one that its add_cloth returned"),
    (lambda s, c: s.pin(c.name, 0),
     "not a cloth of this scene: 'cloth0'; pass the one that its add_cloth returned, not a name$"),
    (lambda s, c: (s.pin(c, 0), s.move(c, 0, lambda t: (0, 0, 0))), "vertex 0 .* already held"),
])
def test_impossible_actions(act, words):
    scene, cloth = sheet()
    with pytest.raises((tc.SceneError, tc.MeshError), match=words):
        act(scene, cloth)


@pytest.mark.parametrize("kwargs, words", [
    ({"h": 0}, "h = 0"), ({"h": -1}, "h = -1"), ({"cg_tol": 0}, "cg_tol"), ({"K": "full"}, "unknown K 'full'"),
    ({"integrator": "backward_eular"}, "did you mean 'backward_euler'"), ({"arch": "cpuu"}, "did you mean 'cpu'"),
    ({"precision": "f16"}, "unknown precision"), ({"h": "1"}, "h = '1' s"), ({"h": 1e300}, "h = 1e"),
    ({"h": 1e-13}, "h = 1e-13"),
    ({"h_min": 0.5}, "h_min = 0.5 s: must be at most h"), ({"cg_max_iterations": 10**19}, "cg_max_iterations = 1000"),
    ({"cg_tol": 1.5}, "cg_tol = 1.5"), ({"newton_max": 1.5}, "newton_max = 1.5"), ({"newton_max": -1}, "newton_max = -1"),
    ({"tolerance": np.nan}, "tolerance = nan m"), ({"adaptive": 1}, "adaptive = 1"),
    ({"stretch_limit": None}, "stretch_limit"),
    ({"count_intersections": "no"}, "count_intersections = 'no'"), ({"newton_tol": -1e-4}, "newton_tol"),
    ({"debug": 0}, "debug = 0"),
    ({"threads": 10**6}, "threads = 1000000: must be a whole number from 1 to"), ({"threads": 0}, "threads = 0"),
    ({"substep": 0, "integrator": "verlet"}, "substep = 0"), ({"preconditioner": None}, "unknown preconditioner None"),
    ({"tangles": "cut"}, "unknown tangles 'cut'"), ({"contact": 3}, "unknown contact 3"),
])
def test_impossible_simulations(kwargs, words):
    with pytest.raises((tc.SceneError, tc.BackendError), match=words):
        tc.Simulation(sheet()[0], **kwargs)


def test_impossible_requests_of_a_simulation():
    """They are refused before anything is computed: nothing moves, and nothing waits for 1e302 steps."""
    sim = tc.Simulation(sheet()[0])
    before = sim.positions()
    for act, words in (
            (lambda: sim.run(1e300, 30), "duration = 1e[+]300"), (lambda: sim.run(1e29, 1e-20),
                                                                  "steps of h .* at most 1e[+]10"),
            (lambda: sim.run(1e5, 1e4), "number of frames, = 1000000000"), (lambda: sim.run(1, 30, 3), "on_frame = 3"),
            (lambda: sim.run(1, 30, lambda a: None), "cannot be called with 2"),
            (lambda: sim.run(1, 30, resumed=-1), "resumed = -1"),
            (lambda: sim.step(1e29), "steps of h"), (lambda: sim.step(np.nan), "h = nan s"),
            (lambda: sim.step(10**400), "h = 1000"),
            (lambda: sim.set_state(before[:3], before), r"set_state: positions: needs shape \(25, 3\), not \(3, 3\)"),
            (lambda: sim.set_state(before, np.full_like(before, np.inf)), "set_state: velocities: vertex 0 .* not finite"),
            (lambda: sim.product(before * np.nan, 0.1), "product: p: vertex 0"), (lambda: sim.product(before, -1), "h = -1"),
            (lambda: sim.solve(0.1, [3]), "constraint = 3: must be a Constraint"),
            (lambda: sim.solve(0.1, 3), "constraints = 3"),
            (lambda: sim.solve(0.1, [tc.Constraint(25)]), "vertex 25 is not simulated"), (lambda: sim.resume(3), "state = 3")):
        with pytest.raises(tc.SceneError, match=words):
            act()
    assert sim.time == 0 and not sim.log and (sim.positions() == before).all()


def test_empty_scene_and_absent_arch():
    with pytest.raises(tc.SceneError, match="at least one cloth"):
        tc.Simulation(tc.Scene())
    with pytest.raises(tc.BackendError, match="arch 'metal' .*no f64|arch 'metal' does not run here; what does: cpu"):
        tc.Simulation(sheet()[0], arch="metal")


def test_path_that_goes_bad_later_is_named():
    scene, cloth = sheet()
    scene.move(cloth, "left", lambda t: (0, 0, 0) if t < 0.05 else (0, np.inf, 0), relative=True)
    sim = tc.Simulation(scene)
    with pytest.raises(tc.SceneError, match="moves 5 vertices of 'cloth0', at t = 0.05 s: is not finite: .*inf"):
        sim.run(1, 20)


def test_partial_directions_hold_exactly_and_the_rest_is_free():
    scene, cloth = sheet()
    tilted = np.array([1.0, 1.0, 0.5]) / 1.5
    scene.pin(cloth, 0, tilted)
    scene.pin(cloth, 24, [[1, 0, 0], [0, 1, 0]])
    scene.pin(cloth, 12, "y")
    sim = tc.Simulation(scene)
    for _ in range(20):
        sim.step()
    moved = sim.positions() - cloth.mesh.x
    assert abs(moved[0] @ tilted) < 1e-14 and np.linalg.norm(moved[0]) > 0.01
    assert np.abs(moved[24, :2]).max() < 1e-15 and abs(moved[24, 2]) > 1e-4
    assert abs(moved[12, 1]) < 1e-15


def test_prescribed_motion_is_exact_at_every_step():
    scene, cloth = sheet()
    path = lambda t: np.array([0.3 * np.sin(3 * t), 0.1 * t, 0])
    scene.move(cloth, "left", path, relative=True)
    scene.move(cloth, [24], lambda t: cloth.mesh.x[[24]] + path(2 * t))
    sim = tc.Simulation(scene)
    left = cloth.mesh.select("left")
    for _ in range(10):
        sim.step()
        moved = sim.positions() - cloth.mesh.x
        assert np.abs(moved[left] - path(sim.time)).max() < 1e-14
        assert np.abs(moved[24] - path(2 * sim.time)).max() < 1e-14


def test_motion_rows_follow_the_order_given():
    scene, cloth = sheet()
    targets = {3: (5.0, 0, 0), 1: (7.0, 0, 0)}
    scene.move(cloth, [3, 1], lambda t: [targets[3], targets[1]])
    sim = tc.Simulation(scene, adaptive=False, K="gauss_newton")
    sim.step()
    assert sim.positions()[3, 0] == 5 and sim.positions()[1, 0] == 7


@pytest.mark.slow
def test_events_end_steps_and_leave_the_scene_as_it_was():
    scene, cloth = sheet()
    times = []
    scene.pin(cloth, "left")
    scene.at(0.11, lambda s: (times.append("a"), s.unpin(cloth, "left")))
    scene.at(0.05, lambda: times.append("b"))
    for _ in range(2):
        sim = tc.Simulation(scene)
        sim.run(0.3, 10)
        assert times == ["b", "a"]
        times.clear()
        assert {0.05, 0.11} <= {r.t for r in sim.log}
        held = [r for r in sim.log if r.t <= 0.11]
        fall = sim.positions()[0, 1]
        assert fall < -0.1 and len(held) >= 7
        assert len(scene.script.attachments) == 1


def test_point_masses_pull():
    scene, cloth = sheet()
    before = tc.Simulation(scene).forces()[12, 1]
    scene.add_mass(cloth, [12, 12], 0.5)  # named twice it is there once
    assert tc.Simulation(scene).forces()[12, 1] == pytest.approx(before - 9.81 * 0.5)


def test_gravity_and_air_are_assigned_as_they_are_given():
    scene = tc.Scene()
    for gravity in ((0, 0, 0), None):
        scene.gravity = gravity
        assert isinstance(scene.gravity, np.ndarray) and not scene.gravity.any()
    air = tc.Air(1.0)
    scene.gravity, scene.air = [0, -1.6, 0], air
    assert scene.gravity.tolist() == [0, -1.6, 0] and scene.air is air
    scene.air = None
    assert scene.air is None
    with pytest.raises(ValueError, match="read-only"):
        scene.gravity[1] = -9.81


@pytest.mark.restarts
@pytest.mark.parametrize("density, told", [(0.001, True), (0.2, False)])
def test_f32_says_where_rounding_outweighs_cloth(density, told):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.01, 8), tc.Fabric(density, tc.Stretch(1e5, 100)))
    with tc.Simulation(scene, precision="f32") as sim:
        assert any("it may hang in the air; use f64" in note for note in sim.notes) == told
