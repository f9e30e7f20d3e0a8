"""Solids that are fast, thin, sharp, or in the wrong place from the start."""

import math
import pathlib

import numpy as np
import pytest
from reference.geometry import against_solids, signed_distance

import taichi_cloth as tc
from taichi_cloth.app import scenefile

pytestmark = pytest.mark.slow

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))


def crossings(sim: tc.Simulation) -> int:
    return sum(crossed for _, crossed in against_solids(sim).values())


def hanging(cells: int = 10) -> tuple[tc.Scene, tc.Cloth]:
    mesh = tc.grid(0.5, cells, plane="xy")
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, FABRIC, positions=mesh.x - [0.25, 0.25, 0])
    scene.pin(cloth, "top")
    return scene, cloth


@pytest.mark.parametrize("precision", ["f64", "f32"])
@pytest.mark.parametrize("shape", [tc.Box((0.2, 0.2, 0.004), 0.001), tc.SolidMesh(*tc.Box((0.2, 0.2, 0.004)).core()[:2]),
                                   tc.Sphere(0.05)], ids=["box", "mesh", "ball"])
def test_a_fast_thin_solid_does_not_tunnel(shape, precision):
    """At 5 m/s it goes 83 mm in a step of 1/60 s, twenty times its own thickness."""
    scene, _ = hanging()
    scene.add_solid(shape, friction=0.2, thickness=0.004, position=lambda t: (0.0, 0.0, -0.3 + 5 * t))
    sim = tc.Simulation(scene, h=1 / 60, precision=precision)
    for _ in range(7):
        sim.step()
    inner = np.abs(scene.cloths[0].positions[:, :2]).max(axis=1) < 0.2  # a free corner may flap round it to its back
    middle = inner & (np.abs(sim.positions()[:, :2]).max(axis=1) < 0.04)
    assert (sim.positions()[middle, 2] > -0.3 + 5 * sim.time).all()  # in front of it
    assert crossings(sim) == 0


@pytest.mark.parametrize("sheets", [1, 2])
def test_what_a_fine_mesh_holds_is_not_pulled_at_by_its_edges(sheets):
    """A ball of triangles smaller than the cloth's comes from below at 1 m/s: eight steps at most are tried smaller."""
    scene, mesh = tc.Scene(), tc.grid(0.6, 20)
    damped = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5))
    scene.add_solid(tc.SolidMesh(*tc.Sphere(0.12).surface()), friction=0.4, thickness=0.006, position=lambda t: (0.0, t, 0.0))
    for k in range(sheets):
        scene.add_cloth(mesh, damped, positions=mesh.x + [-0.3, 0.14 + 0.01 * k, 0.3],
                        contact=tc.ClothContact(0.006) if sheets > 1 else None)
    sim = tc.Simulation(scene, h=1 / 100)
    while sim.time < 0.3 - 1e-9:
        sim.step()
    assert crossings(sim) == 0 and sim.intersections() == 0 and np.abs(sim.velocities()).max() < 2.5  # 2.0 with steps of 1 ms
    assert len(sim.log) < 50 and sum(sum(r.rejections.values()) for r in sim.log) <= 8
    sim.close()


@pytest.mark.parametrize("gap", [0.004, -0.002])
def test_what_solids_pinch_is_named_and_makes_no_step_small(gap):
    """Two balls of triangles close on a sheet, also beyond what leaves it any room, and open again."""
    scene, mesh = tc.Scene(gravity=None), tc.grid(0.3, 12)
    damped = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5))
    ball = tc.SolidMesh(*tc.Sphere(0.06).surface())

    def away(t: float) -> float:
        return gap / 2 + 0.06 + 0.03 * abs(min(t / 0.15, 2) - 1)

    scene.add_solid(ball, friction=0.3, thickness=0.005, position=lambda t: (0.0, away(t), 0.0), rotation=(0.0, 0.3, 0.0))
    scene.add_solid(ball, friction=0.3, thickness=0.005, position=lambda t: (0.0, -away(t), 0.0))
    scene.add_cloth(mesh, damped, positions=mesh.x + [-0.15, 0, 0.15])
    sim = tc.Simulation(scene, h=1 / 100)
    while sim.time < 0.4:
        sim.step()
        assert gap < 0 or min(near for near, _ in against_solids(sim).values()) > 0.149  # three tenths of what there is
    assert len(sim.log) == 40 and max(r.pinched for r in sim.log) > 0 and crossings(sim) == 0
    assert max(r.stretch for r in sim.log) < 1.01 and np.abs(sim.velocities()).max() < 0.01
    sim.close()


def test_a_spinning_edge(rng):
    """A bar with sharp edges that turns under a lying sheet."""
    mesh = tc.grid(0.5, 16)
    scene = tc.Scene()
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.25, 0.075, 0.25])
    bar = tc.SolidMesh(*tc.Box((0.3, 0.04, 0.04)).core()[:2])
    scene.add_solid(bar, friction=0.3, thickness=0.005, rotation=lambda t: (3 * t, 0.0, 0.0))
    sim = tc.Simulation(scene, h=1 / 100)
    for _ in range(60):
        sim.step()
        assert crossings(sim) == 0
    assert max(r.contacts for r in sim.log) > 0


@pytest.mark.parametrize("shape", [tc.Sphere(0.2), tc.SolidMesh(*tc.Box((0.4, 0.4, 0.4)).core()[:2])],
                         ids=["analytic", "mesh"])
def test_cloth_that_starts_inside_is_pushed_out_and_counted(shape):
    mesh = tc.grid(0.3, 12)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [-0.15, 0.19, 0.15])
    solid = scene.add_solid(shape, friction=0.2, thickness=0.004, name="ball")
    sim = tc.Simulation(scene, h=1 / 60)
    assert any("ball" in note and "start inside" in note for note in sim.notes), sim.notes
    for _ in range(30):
        sim.step()
    assert signed_distance(solid, 0.0, sim.positions()).min() > 0.004 - 4e-5
    assert np.abs(sim.velocities()).max() < 1.0 and sim.log[-1].stretch < 1.2


@pytest.mark.parametrize("angle", [0.0, math.radians(30)])
def test_in_the_corner_of_two_planes(angle):
    """A particle in the corner has two contacts, and stays in it."""
    mesh = tc.grid(0.2, 6)
    scene = tc.Scene()
    scene.add_cloth(mesh, FABRIC, positions=mesh.x + [0.004, 0.004 + 0.2 * math.tan(angle), 0])
    scene.add_solid(tc.Plane(), friction=0.0, thickness=0.004)
    scene.add_solid(tc.Plane((math.cos(angle), math.sin(angle), 0)), friction=0.0, thickness=0.004)
    sim = tc.Simulation(scene, h=1 / 60)
    for _ in range(40):
        sim.step()
    x = sim.positions()
    assert x[:, 1].min() > 0.004 - 4e-5
    assert (x[:, 0] * math.cos(angle) + x[:, 1] * math.sin(angle)).min() > 0.004 - 4e-5


@pytest.mark.parametrize("gap", [0.005, 0.0])
def test_plates_that_close_on_layers(gap):
    """Three sheets between plates that leave them half of what all thicknesses need, or nothing, and open again: steps stay
    within an eighth of what was asked, no sheet passes through another, and they part."""
    path = pathlib.Path(__file__).parents[2] / "scenes" / "pinch.py"
    sim = tc.Simulation(scenefile.read(str(path)).make({"cells": 4, "gap": gap}), h=1 / 60, cg_tol=1e-3,
                        integrator="backward_euler")
    while sim.time < 1.5:
        sim.run(1 / 60, fps=60)
        assert sim.intersections() == 0
    assert min(r.h for r in sim.log) > 1 / 60 / 8 - 1e-9 and max(r.pinched for r in sim.log) == sim.vertex_count
    assert np.isfinite(sim.positions()).all() and max(r.stretch for r in sim.log) < 1.1
    heights = sim.positions()[:, 1].reshape(3, -1)
    assert (np.diff(heights, axis=0) > 0.004).all() and sim.log[-1].h == pytest.approx(1 / 60)
    sim.close()


@pytest.mark.parametrize("last", [tc.Sphere(0.1), tc.SolidMesh(*tc.Box((0.2, 0.2, 0.2)).surface())], ids=["ball", "mesh"])
def test_a_vertex_among_many_solids_meets_the_one_that_it_is_deepest_in(last):
    """Nine balls just below the one that a sheet falls on: none of them takes its place."""
    scene, mesh = tc.Scene(), tc.grid(0.1, 3)
    for k in range(9):
        scene.add_solid(tc.Sphere(0.1), friction=0.3, thickness=0.006, position=(0.0, -0.103 - 1e-4 * k, 0.0))
    scene.add_solid(last, friction=0.3, thickness=0.006, position=(0.0, -0.1, 0.0))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1), tc.Shear(100), tc.Bend(5e-5)),
                    positions=mesh.x + [-0.05, 0.02, 0.05], velocities=(0, -0.5, 0))
    sim = tc.Simulation(scene, h=1 / 60, threads=1)
    for _ in range(12):
        sim.step()
    x = sim.positions()
    sim.close()
    distance = np.linalg.norm(x - [0, -0.1, 0], axis=1) - 0.1 if isinstance(last, tc.Sphere) else x[:, 1]
    assert 0.0055 < distance.min() < 0.0065
