"""Triangles inside a body, against solid angles."""

import numpy as np
import pytest
from reference.geometry import winding

import taichi_cloth as tc
from taichi_cloth.contact.solid.buried import INWARD, OUT

H = 1 / 60


def box() -> tuple[np.ndarray, np.ndarray]:
    """Vertices and triangles of a box of 1 m with 8 x 8 squares a side."""
    side, n = np.linspace(-0.5, 0.5, 9), 9
    u, v = (a.ravel() for a in np.meshgrid(side, side, indexing="ij"))
    square = np.arange(n * n).reshape(n, n)
    a, b, c, d = (part.ravel() for part in (square[:-1, :-1], square[1:, :-1], square[1:, 1:], square[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    x, corners = [], []
    for axis in range(3):
        for end in (-0.5, 0.5):
            x.append(np.roll(np.stack([np.full(n * n, end), u, v], axis=1), axis, axis=1))
            corners.append((faces if end > 0 else faces[:, ::-1]) + n * n * len(corners))
    x, corner = np.unique(np.concatenate(x).round(9), axis=0, return_inverse=True)
    return x, corner.reshape(-1)[np.concatenate(corners)]


def with_sheet(frames: np.ndarray, faces: np.ndarray, size: float) -> tc.Scene:
    """A body, and a sheet beside it."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(size, 2)
    scene.add_solid(tc.SolidMesh(frames, faces, fps=1), 0.3, 0.01, name="boxes")
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100, 1)), mesh.x + [0, 2, 0])
    return scene


@pytest.fixture(scope="module")
def crossed_boxes():
    """Two boxes as one mesh: one in line with the axes, one turned and moved into it by time."""
    x, faces = box()
    turn = tc.Scene().add_solid(tc.Plane(), 0.0, 0.01, rotation=(0.3, 0.2, 0.5)).pose(0.0)[0]
    frames = np.stack([np.concatenate([x, x @ turn.T + [2 - t, 0.1, 0.25]]) for t in (0.0, 1.7)])
    with tc.Simulation(with_sheet(frames, np.concatenate([faces, faces + len(x)]), 0.2), h=H) as sim:
        yield sim


@pytest.mark.parametrize("time, some", [(0.0, False), (0.6, True), (1.3, True), (1.7, True)])
def test_buried_triangles(crossed_boxes, time, some):
    """Those of which three places just outside of them, near their corners, are inside a box. Of the upright one all edges
    are in line with the rays."""
    detector = crossed_boxes.contacts.detector
    detector.set_time(time - H, H)
    buried = detector.surfaces.buried
    buried.look()
    x, faces = detector.solids[0].surface_at(time), detector.tree.corners.to_numpy()[: detector.tree.count]
    corner = x[faces]
    middle = corner.mean(axis=1)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    inside = np.ones(len(faces), dtype=bool)
    for k in range(3):
        way = middle - corner[:, k]
        at = corner[:, k] + INWARD * way + OUT * np.linalg.norm(way, axis=1, keepdims=True) * normal
        inside &= winding(at, x, faces) > 0.5
    assert (buried.inside.to_numpy()[: len(faces)] == inside).all()
    assert (inside.sum() > 20) == some and inside.sum() < len(faces) / 2


def test_cloth_comes_out_of_the_outer_surface():
    """A sheet inside a box, beside a smaller one that reaches into it: the nearest surface is the smaller one's, buried there,
    and the sheet is outside of that. What was pinched leaves the box."""
    x, faces = box()
    body = np.concatenate([x, 0.4 * x + [0.4, 0, 0]])
    scene = with_sheet(np.stack([body, body]), np.concatenate([faces, faces + len(x)]), 0.04)
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        sheet = tc.grid(0.04, 2).x
        start = sheet - sheet.mean(axis=0) + [0.17, -0.22, 0.0]
        sim.set_state(start, 0 * start)
        sim.contacts.solids.penetration.spare(np.arange(sim.vertex_count))
        assert (winding(sim.positions(), body, scene.solids[0].shape.faces).round() == 1).all()
        for _ in range(90):
            sim.step(H)
        assert (winding(sim.positions(), body, scene.solids[0].shape.faces).round() == 0).all()
        assert sim.positions()[:, 1].max() == pytest.approx(-0.51, abs=1e-3)
