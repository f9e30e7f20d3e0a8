"""Cloths that start through each other, and which of them belongs outside."""

import numpy as np
import pytest
from reference.geometry import cloth_crossings
from scipy.spatial import cKDTree

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100), tc.Bend(5e-5))
THICKNESS, RADIUS, HEIGHT = 0.006, 0.11, 0.15
STILL = 1e-8  # m by which what is not moved may differ from what was given; what is moved goes by millimetres


def tube(cells: int, rows: int, waves: float, clockwise: bool = False) -> tc.TriMesh:
    """Round the y axis, with waves of a part of its radius."""
    i, j = np.meshgrid(np.arange(cells), np.arange(rows + 1))
    angle, y = 2 * np.pi * (i.ravel() + 0.3) / cells, HEIGHT * j.ravel() / rows
    r = RADIUS * (1 + waves * np.sin(3 * angle) * np.cos(20 * y))
    x = np.stack([r * np.sin(angle), y, r * np.cos(angle)], axis=1)
    at = np.arange(cells * (rows + 1)).reshape(rows + 1, cells)
    a, b = at[:-1].ravel(), np.roll(at, -1, axis=1)[:-1].ravel()
    faces = np.concatenate([np.stack([a, b, b + cells], axis=1), np.stack([a, b + cells, a + cells], axis=1)])
    return tc.TriMesh(x, faces[:, ::-1] if clockwise else faces)


def two_tubes(layers: tuple[int, int], solid: bool = True, clockwise: bool = False) -> tc.Scene:
    """A round one, which is held at its rim, and one with waves that passes in and out of it, on a capsule."""
    scene = tc.Scene()
    if solid:
        scene.add_solid(tc.Capsule((0, -0.3, 0), (0, 0.5, 0), 0.1), 0.3, 0.004, name="body")
    for name, mesh, layer in zip(("round", "wavy"), (tube(32, 7, 0.0, clockwise), tube(37, 8, 0.06)), layers):
        scene.add_cloth(mesh, FABRIC, name=name, contact=tc.ClothContact(THICKNESS, 0.3, layer=layer))
    scene.pin(scene.cloths[0], np.flatnonzero(scene.cloths[0].positions[:, 1] > HEIGHT - 1e-6))
    return scene


@pytest.mark.slow
def test_far_from_the_origin_with_a_vertex_of_no_face_and_a_seam():
    """The wavy tube is cut open and sewn; what belongs to it goes with it, and nothing else."""
    far, scene = np.array([400.0, 0, -300.0]), tc.Scene()
    scene.add_solid(tc.Capsule((0, -0.3, 0), (0, 0.5, 0), 0.1), 0.3, 0.004, position=far)
    inner, outer = tube(32, 7, 0.0), tube(37, 8, 0.06)
    n = outer.vertex_count
    a = 37 * np.arange(9)  # a seam along the tube: its second side is new vertices
    faces = outer.faces.copy()
    second = np.isin(faces, a) & np.isin(faces, 37 * np.arange(9) + 36).any(axis=1)[:, None]
    faces[second] = n + faces[second] // 37
    x = np.concatenate([outer.x, outer.x[a], [[0.3, 0.2, 0.3]]])
    with pytest.warns(UserWarning, match="belong to no face"):
        cut = tc.TriMesh(x, faces)
    scene.add_cloth(inner, FABRIC, positions=inner.x + far, contact=tc.ClothContact(THICKNESS))
    cloth = scene.add_cloth(cut, FABRIC, positions=x + far, contact=tc.ClothContact(THICKNESS, layer=1))
    scene.sew(cloth, a, n + np.arange(9))
    with tc.Simulation(scene, h=1 / 60) as sim:
        now = sim.positions()[cloth.start:]
        by = np.linalg.norm(now - x - far, axis=1)
        assert cloth_crossings(sim) == 0 and 0.006 < by.max() < 0.02 and by[-1] == 0
        assert (now[a] == now[n: n + 9]).all() and by[a].max() > 0.004
        assert np.abs(sim.positions()[: cloth.start] - inner.x - far).max() < 1e-9


def least_room(sim: tc.Simulation) -> float:
    """How far [m] the second tube is outside the first at least, at places all over both: by radii, with half the sagitta of
    their triangles."""
    inner, outer = sim.scene.cloths
    x = sim.positions()
    weights = np.array([(a, b, 4 - a - b) for a in range(5) for b in range(5 - a)]) / 4
    p, q = (np.einsum("wk,fkd->fwd", weights, x[c.start: c.start + c.mesh.vertex_count][c.mesh.faces]).reshape(-1, 3)
            for c in (inner, outer))
    def polar(x: np.ndarray) -> np.ndarray:
        return np.stack([RADIUS * np.arctan2(x[:, 0], x[:, 2]), x[:, 1]], axis=1)
    away, near = cKDTree(polar(p)).query(polar(q))
    beside = away < 0.004
    return float((np.hypot(q[:, 0], q[:, 2]) - np.hypot(*p[near][:, [0, 2]].T))[beside].min())


@pytest.mark.slow
@pytest.mark.parametrize("layers, clockwise", [((0, 1), False), ((2, 5), True)])
def test_the_higher_layer_starts_and_stays_outside(layers, clockwise):
    """However its triangles turn, on a body."""
    with tc.Simulation(two_tubes(layers, clockwise=clockwise), h=1 / 60, integrator="backward_euler") as sim:
        given = np.concatenate([c.positions for c in sim.scene.cloths])
        n = sim.scene.cloths[1].start
        by = np.linalg.norm(sim.positions() - given, axis=1)
        note, = (note for note in sim.notes if "lay inside" in note)
        assert f"'round', and were moved out, furthest vertex {by[n:].argmax()} by {by.max():.2g} m" in note
        assert by[:n].max() < STILL and 0.006 < by.max() < 0.02
        assert cloth_crossings(sim) == 0 and least_room(sim) > 0.5 * THICKNESS
        for _ in range(10):
            sim.step(1 / 60)
            assert cloth_crossings(sim) == 0
        assert least_room(sim) > 0.1 * THICKNESS and np.linalg.norm(sim.velocities(), axis=1).max() < 2


@pytest.mark.slow
def test_without_solids_outside_is_where_triangles_face():
    with tc.Simulation(two_tubes((0, 1), solid=False), h=1 / 60) as sim:
        assert cloth_crossings(sim) == 0 and least_room(sim) > 0.5 * THICKNESS


def test_what_pokes_out_between_vertices_is_found():
    """A bump of a fine sheet through a triangle of a coarse one, all of whose vertices are above it."""
    scene, fine, coarse = tc.Scene(gravity=None), tc.grid(0.2, 40), tc.grid(0.2, 4)
    x = fine.x.copy()
    x[:, 1] += 0.02 * np.exp(-((x - [0.065, 0, 0.065 * np.sign(x[:, 2].mean())]) ** 2)[:, [0, 2]].sum(axis=1) / 0.012**2)
    scene.add_cloth(fine, FABRIC, positions=x, contact=tc.ClothContact(THICKNESS))
    scene.add_cloth(coarse, FABRIC, positions=coarse.x + [0, 0.008, 0], contact=tc.ClothContact(THICKNESS, layer=1))
    with tc.Simulation(scene, h=1 / 60) as sim:
        assert any("lay inside" in note for note in sim.notes)
        assert cloth_crossings(sim) == 0 and np.abs(sim.positions()[: fine.vertex_count] - x).max() < STILL


def test_what_is_held_stays_and_equal_layers_have_no_order():
    with tc.Simulation(two_tubes((1, 0)), h=1 / 60) as sim:
        held = sim.positions()[: sim.scene.cloths[1].start]
        assert (held[-32:] == sim.scene.cloths[0].positions[-32:]).all() and any("lay inside" in note for note in sim.notes)
    with tc.Simulation(two_tubes((1, 1)), h=1 / 60) as sim:
        assert np.abs(sim.positions() - np.concatenate([c.positions for c in sim.scene.cloths])).max() < STILL
        assert cloth_crossings(sim) > 50


def test_what_is_on_its_side_is_not_moved():
    scene = tc.Scene(gravity=None)
    for layer, mesh in enumerate((tube(32, 7, 0.0), tube(32, 7, 0.0))):
        scene.add_cloth(mesh, FABRIC, positions=mesh.x * [1 + 0.04 * layer, 1, 1 + 0.04 * layer],
                        contact=tc.ClothContact(THICKNESS, layer=layer))
    with tc.Simulation(scene, h=1 / 60) as sim:  # nearer than their thickness
        assert np.abs(sim.positions() - np.concatenate([c.positions for c in scene.cloths])).max() < STILL
        assert not any("lay inside" in note for note in sim.notes)


def test_cloths_that_do_not_cross_stay_as_they_are_drawn():
    """A flap of the lower cloth is folded over the upper one; a third lies beneath both, and says that it lies outside."""
    scene, sheet, under = tc.Scene(gravity=None), tc.grid(0.3, 12), tc.grid(0.2, 8)
    bent = sheet.x - sheet.x.mean(axis=0)
    flap = bent[:, 0] > 0.05
    bent[flap] = np.stack([0.1 - bent[flap, 0], np.full(flap.sum(), 0.02), bent[flap, 2]], axis=1)
    scene.add_cloth(sheet, FABRIC, positions=bent, contact=tc.ClothContact(THICKNESS))
    for layer, y in ((1, 0.01), (2, -0.01)):
        scene.add_cloth(under, FABRIC, positions=(under.x - under.x.mean(axis=0)) * [0.6, 1, 1] + [-0.04, y, 0],
                        contact=tc.ClothContact(THICKNESS, layer=layer))
    with tc.Simulation(scene, h=1 / 60) as sim:
        assert cloth_crossings(sim) == 0 and not any("lay inside" in note for note in sim.notes)
        assert np.abs(sim.positions() - np.concatenate([c.positions for c in scene.cloths])).max() < STILL


@pytest.mark.parametrize("layer", [-1, 1.5, "outside"])
def test_a_layer_is_a_whole_number(layer):
    with pytest.raises(tc.SceneError, match="cloth contact layer"):
        tc.ClothContact(THICKNESS, layer=layer)
