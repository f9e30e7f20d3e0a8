"""Cloth that passes through cloth, and what was left alone for that: how it goes on."""

import numpy as np
import pytest
from reference.geometry import count_self_crossings, edges_through

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))
THICKNESS = 0.005


def two_sheets(above: float, degrees: float = 0.0, cells: int = 7) -> tc.Scene:
    """A sheet so much [m] above a pinned one, turned against it about a line through both."""
    scene, mesh, contact = tc.Scene(gravity=None), tc.grid(0.2, cells), tc.ClothContact(THICKNESS, 0.3)
    flat, a = mesh.x - mesh.x.mean(axis=0), np.radians(degrees)
    lower = scene.add_cloth(mesh, FABRIC, positions=flat, contact=contact)
    turn = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    scene.add_cloth(mesh, FABRIC, positions=flat @ turn.T + [0.003, above, 0.004], contact=contact)
    scene.pin(lower, np.arange(mesh.vertex_count))
    return scene


def goes_on_alike(scene: tc.Scene, states: list[dict]) -> None:
    """From the first of two states, a step apart, a simulation that is resumed there comes to the second, bit for bit."""
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        sim.resume(states[0])
        sim.step(1 / 60)
        there = sim.checkpoint()
    assert not [name for name in set(there) - {"records"} if not np.array_equal(there[name], states[1][name])]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bump", "corner"])
def test_what_went_through_comes_out(kind):
    """A bump of 4 cm through the middle of a sheet, and the corner of a sheet that lies on another: what beside it crosses
    nothing meets as ever, or else more goes through; what is well through does not, or else it stays."""
    mesh, contact = tc.grid(0.2, 28), tc.ClothContact(THICKNESS, 0.3)
    flat = mesh.x - mesh.x.mean(axis=0)
    x = flat + ([0.003, 0.006, 0.004] if kind == "bump" else [0.05, 0.006, 0.05])
    if kind == "bump":
        x[:, 1] -= 0.016 * np.clip(1 - (x[:, 0] ** 2 + x[:, 2] ** 2) / 0.04**2, 0, 1) ** 2
    else:
        s = x[:, 0] + x[:, 2]
        x[:, 1] -= 0.026 * np.clip((s.min() + 0.08 - s) / 0.08, 0, 1)
    scene = tc.Scene(gravity=None if kind == "bump" else (0, -9.81, 0))
    scene.pin(scene.add_cloth(mesh, FABRIC, positions=flat, contact=contact), np.arange(mesh.vertex_count))
    scene.add_cloth(mesh, FABRIC, positions=x, contact=contact)
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        faces, seen = np.concatenate([c.mesh.faces + c.start for c in scene.cloths]), []
        while not seen or (seen[-1] and len(seen) < 30):
            seen.append(count_self_crossings(sim.positions(), faces))
            sim.step(1 / 60)
        assert seen[0] > 40 and max(seen) < 1.5 * seen[0] and seen[-1] == 0
        assert np.abs(sim.velocities()).max() < 1


@pytest.mark.slow
def test_what_a_load_holds_through_comes_out():
    """A vertex of a sheet is pressed 4 mm through another by .15 N, more than a crossing is led with at first: a small tangle
    that lasts is led more firmly from step to step, until nothing crosses. Then one rests on the other."""
    scene, mesh, contact = tc.Scene(gravity=None), tc.grid(0.2, 20), tc.ClothContact(THICKNESS, 0.3)
    flat = mesh.x - mesh.x.mean(axis=0)
    lower, x = scene.add_cloth(mesh, FABRIC, positions=flat, contact=contact), flat + [0.003, 0.006, 0.004]
    middle = int(np.argmin(np.linalg.norm(flat, axis=1)))
    x[middle, 1] = -0.004
    upper = scene.add_cloth(mesh, FABRIC, positions=x, contact=contact)
    scene.pin(lower, np.arange(mesh.vertex_count))
    scene.pin(upper, np.flatnonzero((np.abs(flat) > 0.0999).any(axis=1)))
    scene.add_load(upper, [middle], (0, -0.15, 0))
    faces, seen, states = np.concatenate([mesh.faces, mesh.faces + mesh.vertex_count]), [], []
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        while not seen or (seen[-1] and len(seen) < 12):
            seen.append(count_self_crossings(sim.positions(), faces))
            sim.step(1 / 60)
            states.append(sim.checkpoint())
        assert seen[1] > 5 and seen[-1] == 0
        sim.step(0.2)
        assert count_self_crossings(sim.positions(), faces) == 0
        assert sim.positions()[mesh.vertex_count + middle, 1] > 0.3 * THICKNESS and np.abs(sim.velocities()).max() < 0.05
    goes_on_alike(scene, states[1:3])


def test_what_has_just_come_apart_does_not_go_back():
    """A sheet that lies a twelfth of the distance above another, as where a crossing has gone, is pressed down: its pairs
    rest, and are led apart meanwhile."""
    scene = two_sheets(THICKNESS)
    upper = scene.cloths[1]
    scene.add_load(upper, np.arange(upper.mesh.vertex_count), (0, -0.003 / upper.mesh.vertex_count, 0))
    with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
        x = sim.positions()
        x[len(x) // 2:, 1] = 0.08 * THICKNESS
        sim.set_state(x, 0 * x)
        tangles = sim.contacts.layers.intersections
        tangles.resting, tangles.active = np.ones(len(x), dtype=bool), True
        sim.contacts.layers.detector.let_rest(tangles.resting)
        faces = np.concatenate([c.mesh.faces + c.start for c in scene.cloths])
        states = []
        for _ in range(12):
            sim.step(1 / 60)
            states.append(sim.checkpoint())
            assert count_self_crossings(sim.positions(), faces) == 0
        assert sim.log[1].pinched > len(x) / 2 and sim.log[-1].pinched == 0
        assert sim.positions()[len(x) // 2:, 1].min() > 0.9 * THICKNESS and np.abs(sim.velocities()).max() < 0.05
    goes_on_alike(scene, states[:2])


@pytest.mark.parametrize("gap, stuck", [(0.02, True), (0.15, False)])
def test_what_rests_no_more_but_starts_too_near_does_not_stop_the_rest(gap, stuck):
    """Sheets a fiftieth of their distance apart, or a seventh, as where a crossing beside them has gone: no step is cut for
    that. What is as good as tangled rests on, and is said to; the other parts."""
    with tc.Simulation(two_sheets(THICKNESS), h=1 / 60, integrator="backward_euler") as sim:
        x = sim.positions()
        x[len(x) // 2:, 1] = gap * THICKNESS
        sim.set_state(x, 0 * x)
        tangles, detector = sim.contacts.layers.intersections, sim.contacts.layers.detector
        tangles.resting, tangles.active = np.ones(len(x), dtype=bool), True
        detector.let_rest(tangles.resting)
        for _ in range(4):
            sim.step()
        assert len(sim.log) == 4 and not any(r.rejections for r in sim.log)
        assert (sim.log[1].pinched > len(x) / 2) == stuck
        assert stuck or sim.log[-1].min_gap_ratio > 0.9


def test_crossings_are_known_after_every_step():
    """Where cloth is looked at for them only where it is left alone."""
    with tc.Simulation(two_sheets(0.0, degrees=20, cells=14), h=1 / 60, integrator="backward_euler") as sim:
        seen = []
        for _ in range(12):
            sim.step()
            faces = np.concatenate([c.mesh.faces + c.start for c in sim.scene.cloths])
            assert sim.log[-1].known_intersections == count_self_crossings(sim.positions(), faces)
            seen.append(sim.log[-1].known_intersections)
            tangles, there = sim.contacts.layers.intersections, sim.model.read_particles()[0]
            i, j = edges_through(there, tangles.edges, there, tangles.faces[tangles.rows])
            assert set(range(seen[-1])) <= set(i[i == j])  # and which they are
        assert seen[0] > 5
