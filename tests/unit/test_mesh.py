"""Meshes: what is accepted, what is refused and with which words."""

import dataclasses

import numpy as np
import pytest

import taichi_cloth as tc

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
TWO = [[0, 1, 2], [0, 2, 3]]
UV = SQUARE[:, :2]


def test_is_frozen_and_copies():
    x = SQUARE.copy()
    mesh = tc.TriMesh(x, TWO, UV)
    x[0] = 9
    assert mesh.x[0, 0] == 0
    with pytest.raises(ValueError):
        mesh.x[0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        mesh.x = x


@pytest.mark.parametrize("x, faces, uv, words", [
    (SQUARE, np.zeros((0, 3), int), UV, "no faces"),
    (SQUARE, [[0, 1, 4]], UV, r"face 0 \[0, 1, 4\] names a vertex out of range, but there are 4 vertices"),
    (SQUARE, [[0, 1, -1]], UV, "out of range"),
    (SQUARE, [[0, 1, 2], [0, 0, 2]], UV, "face 1 repeats a vertex"),
    (np.where(SQUARE == 1, np.nan, SQUARE), TWO, UV, r"positions: vertex 1 \(3 such\) is not finite: \[nan"),
    (SQUARE, TWO, np.where(UV == 1, np.inf, UV), r"material coordinates: vertex or face 1 \(3 such\) is not finite"),
    (SQUARE, TWO, UV * [1, 0], "triangle 0 .* has no area"),
    (SQUARE, TWO, UV[:3], r"material coordinates: needs shape \(4, 2\) or \(2, 3, 2\), not \(3, 2\)"),
    (SQUARE[:, :2], TWO, UV, r"positions: needs shape \(n, 3\), not \(4, 2\)"),
    (SQUARE, [[0.5, 1, 2]], UV, "integer"),
    (np.vstack([SQUARE, [[0, 0, 1], [0, 0, -1]]]), [[0, 1, 2], [1, 0, 4], [0, 1, 5]], None,
     r"edge \(0, 1\) is shared by 3 triangles"),
])
def test_refuses(x, faces, uv, words):
    with pytest.raises(tc.MeshError, match=words):
        tc.TriMesh(x, faces, uv)


def test_loose_vertices_are_kept_out_with_a_warning():
    with pytest.warns(UserWarning, match="1 of 5 vertices belong to no face"):
        mesh = tc.TriMesh(np.vstack([SQUARE, [[5, 5, 5]]]), TWO)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)))
    with pytest.raises(tc.SceneError, match="vertex 4 .* belongs to no face"):
        scene.pin(cloth, 4)
    sim = tc.Simulation(scene)
    sim.step()
    assert sim.positions().shape == (5, 3)
    assert (sim.positions()[4] == 5).all() and (sim.positions()[:4, 1] < SQUARE[:, 1]).all()


def test_selections():
    mesh = tc.grid(1, 2)
    assert mesh.select("left").tolist() == [0, 3, 6]
    assert mesh.select(mesh.x[:, 0] == 1).tolist() == [2, 5, 8]
    assert mesh.select(["left", "bottom_right", "left"]).tolist() == [0, 2, 3, 6]
    with pytest.raises(tc.MeshError, match="did you mean 'bottom_left'"):
        mesh.select("botom_left")
    with pytest.raises(tc.MeshError, match="names vertex 9, but there are 9"):
        mesh.select([0, 9])


def test_a_grid_can_have_its_middle_at_the_origin():
    for make, args in ((tc.grid, ((2, 1), (4, 3))), (tc.strip, (2, 1, 4))):
        for plane in ("xz", "xy"):
            aside, mesh = make(*args, plane=plane), make(*args, plane=plane, centred=True)
            assert np.allclose(mesh.x.min(axis=0), -mesh.x.max(axis=0), atol=1e-15)
            assert np.allclose(mesh.x - mesh.x[0], aside.x - aside.x[0]) and not mesh.uv[0].any()
            assert (mesh.uv == aside.uv).all()
            assert (mesh.faces == aside.faces).all() and set(mesh.groups) == set(aside.groups)


@pytest.mark.parametrize("diagonals, faces, vertices", [("alternating", 24, 20), ("uniform", 24, 20), ("cross", 48, 32)])
def test_grid(diagonals, faces, vertices):
    mesh = tc.grid((2, 1), (4, 3), diagonals)
    assert (mesh.face_count, mesh.vertex_count) == (faces, vertices)
    assert mesh.material_areas.sum() == pytest.approx(2)
    assert (mesh.x[mesh.select("top"), 2] == -1).all()  # v runs along -z, so that the normal is up
    normals = np.cross(*(mesh.x[mesh.faces[:, k]] - mesh.x[mesh.faces[:, 0]] for k in (1, 2)))
    assert (normals[:, 1] > 0).all()


def test_other_shapes():
    assert tc.disk(2, 20).material_areas.sum() == pytest.approx(np.pi * 4, rel=2e-3)
    tube = tc.cylinder(0.5, 2, (24, 3))
    assert tube.uv.shape == (tube.face_count, 3, 2) and tube.material_areas.sum() == pytest.approx(2 * np.pi)
    assert len(np.unique(tube.faces)) == tube.vertex_count == 24 * 4
    strip = tc.equilateral_strip(4, 2, 4)
    sides = np.linalg.norm(strip.x[strip.faces] - strip.x[np.roll(strip.faces, 1, axis=1)], axis=2)
    assert np.isclose(sides, 1).all(axis=1).sum() == 14  # all but the half triangles at the ends
    assert tc.strip(1, 0.2, 10).vertex_count == 11 * 3
    for bad in (lambda: tc.grid(-1, 2), lambda: tc.grid(1, 0), lambda: tc.grid(1, 2, "zigzag"), lambda: tc.disk(1, 0.5)):
        with pytest.raises((tc.MeshError, tc.SceneError)):
            bad()
