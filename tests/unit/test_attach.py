"""Vertices that ride on solids: rigid ones, deforming ones, from an event on, and after a resume."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.scene.glue import places

FABRIC = tc.Fabric(0.2, tc.Stretch(500, 0.5), tc.Shear(50), tc.Bend(1e-4))


def turning(t: float) -> np.ndarray:
    return np.array([0.3 * t, 2.0 * t, -0.1 * t])


def drum(frames: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """(frames, n, 3) of a cylinder that turns as a whole, and widens in the second half; (m, 3)."""
    mesh = tc.cylinder(0.2, 0.4, (16, 6))
    out = []
    for k in range(frames):
        wide = 1 + 0.02 * max(0, k - frames // 2)
        R = tc.Solid("s", tc.Sphere(0.1), 0.0, 0.01, (0, 0, 0), (0, 0.1 * k, 0)).pose(0.0)[0]
        out.append((mesh.x * [wide, 1, wide]) @ R.T + [0.01 * k, 0, 0])
    return np.array(out), mesh.faces


def test_places_on_a_solid_that_does_not_deform(rng):
    scene = tc.Scene()
    shape = tc.Capsule((0, 0, 0), (0, 1, 0), 0.1)
    solid = scene.add_solid(shape, 0.3, 0.01, position=lambda t: (t, 0, t * t), rotation=turning)
    points = rng.normal(size=(7, 3))
    found = places(solid, 0.4, points)
    assert np.abs(found.at(solid, 0.4) - points).max() < 1e-14
    (R, p), (S, q) = solid.pose(0.4), solid.pose(1.3)
    assert np.abs(found.at(solid, 1.3) - ((points - p) @ R @ S.T + q)).max() < 1e-14


def test_places_on_a_mesh_that_deforms(rng):
    """Where they were; as the mesh turns, turned with it; the nearest of all places, by dense sampling."""
    x, faces = drum()
    scene = tc.Scene()
    solid = scene.add_solid(tc.SolidMesh(x, faces, fps=25), 0.3, 0.01)
    angle, y = rng.uniform(0, 2 * np.pi, 40), rng.uniform(0.02, 0.38, 40)
    points = np.column_stack([0.21 * np.cos(angle), y, 0.21 * np.sin(angle)])
    found = places(solid, 0.0, points)
    assert np.abs(found.at(solid, 0.0) - points).max() < 1e-14
    R = tc.Solid("s", tc.Sphere(0.1), 0.0, 0.01, (0, 0, 0), (0, 0.5, 0)).pose(0.0)[0]
    assert np.abs(found.at(solid, 0.2) - (points @ R.T + [0.05, 0, 0])).max() < 1e-12
    assert (found.weights >= 0).all() and np.abs(found.weights.sum(axis=1) - 1).max() < 1e-12
    near = np.einsum("ka,kai->ki", found.weights, x[0][found.faces])
    w = rng.dirichlet([1, 1, 1], 200)
    sampled = np.einsum("sa,fai->fsi", w, x[0][faces]).reshape(-1, 3)
    best = np.array([np.linalg.norm(sampled - p, axis=1).min() for p in points])
    assert (np.linalg.norm(near - points, axis=1) <= best + 1e-12).all()
    grown = found.at(solid, 0.76) - [0.19, 0, 0]
    assert np.hypot(grown[:, 0], grown[:, 2]) == pytest.approx(np.hypot(points[:, 0], points[:, 2]) + 0.2 * 0.18, abs=2e-3)


@pytest.mark.slow
def test_a_sheet_on_a_drum_from_an_event_on_and_resumed():
    def make() -> tuple[tc.Simulation, np.ndarray, tc.Solid]:
        x, faces = drum()
        scene = tc.Scene()
        solid = scene.add_solid(tc.SolidMesh(x, faces, fps=25), friction=0.3, thickness=0.004)
        mesh = tc.grid(0.3, 6)
        cloth = scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.15, 0.42, 0.15])
        row = np.arange(7)
        scene.pin(cloth, row)
        scene.at(0.1, lambda: (scene.unpin(cloth), scene.attach(cloth, row, solid, since=0.1)))
        scene.at(0.5, lambda: scene.unpin(cloth, row))
        return tc.Simulation(scene, h=1 / 50, threads=1), row, solid

    sim, row, solid = make()
    start = sim.positions()[row]
    sim.run(0.1, fps=50)
    assert (sim.positions()[row] == start).all()
    ride = places(solid, 0.1, start)
    sim.run(0.2, fps=50)
    assert np.abs(sim.positions()[row] - ride.at(solid, sim.time)).max() < 1e-12
    state = sim.checkpoint()
    sim.run(0.3, fps=50)
    x = sim.positions()
    assert np.abs(x[row] - ride.at(solid, sim.time)).max() > 1e-3  # let go at .5 s
    sim.close()
    again, _, _ = make()
    again.resume(state)
    again.run(0.3, fps=50)
    assert (again.positions() == x).all()
    again.close()


def test_what_cannot_be_attached():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.3, 2), FABRIC)
    other = tc.Scene().add_solid(tc.Sphere(0.1), 0.3, 0.01, name="far")
    with pytest.raises(tc.SceneError, match="'far'"):
        scene.attach(cloth, 0, other)
    with pytest.raises(tc.SceneError, match="attach"):
        scene.attach(cloth, 0, "ball")
    solid = scene.add_solid(tc.Sphere(0.1), 0.3, 0.01)
    with pytest.raises(tc.SceneError, match="since"):
        scene.attach(cloth, 0, solid, since=-1)
    scene.attach(cloth, [0, 1], solid)
    with pytest.raises(tc.SceneError, match="already held"):
        scene.move(cloth, 1, lambda t: (0, 0, 0), relative=True)
    with pytest.raises(tc.SceneError, match="already held"):
        scene.pin(cloth, 0)
