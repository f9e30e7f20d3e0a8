"""Vertices of cloth that meet solids on their way through a step, against distances sampled densely along the way."""

import numpy as np
import pytest
from reference.geometry import signed_distance

import taichi_cloth as tc

H, THICK, SAMPLES = 1 / 30, 0.01, 300
SPEEDS = ((3.0, 0.0, 1.0), (0.0, 4.0, 0.0), (-2.0, 1.0, 2.0), (0.0, -3.0, 0.0))


def solids(kind: str) -> list:
    cube = tc.SolidMesh(*tc.Box((0.2, 0.2, 0.2)).core()[:2])
    analytic = [tc.Sphere(0.12), tc.Box((0.4, 0.004, 0.4)),
                tc.Capsule((0, -0.15, 0), (0, 0.15, 0), 0.05), tc.Cylinder(0.1, 0.2)]
    return {"analytic": analytic, "mesh": [cube]}[kind]


def scene_of(kind: str, count: int) -> tuple[tc.Scene, list]:
    scene = tc.Scene()
    mesh = tc.grid(1.0, count)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [0, 50, 0])
    made = []
    for k, shape in enumerate(solids(kind)):
        speed = np.array(SPEEDS[k])
        made.append(scene.add_solid(shape, friction=0.0, thickness=THICK, name=f"solid {k}",
                                    position=lambda t, k=k, speed=speed: 0.2 * np.array([k % 2, k // 2, 0]) + speed * t,
                                    rotation=(0.3 * k, 0.2, 0.5)))
    return scene, made


@pytest.mark.parametrize("kind", ["analytic", "mesh"])
def test_what_comes_within_the_thickness_is_met_and_nothing_else(kind, rng):
    """Fast vertices and moving solids, thin ones too; of several solids each, three at most; half of the vertices stand still.
    What only grazes the thickness on its way is left out."""
    scene, made = scene_of(kind, 60)
    sim = tc.Simulation(scene, h=H, threads=1)
    model, scan, n = sim.model, sim.contacts.scan, sim.model.n
    x_0 = rng.uniform(-0.5, 0.6, size=(n, 3))
    x_1 = x_0 + rng.uniform(-0.35, 0.35, size=(n, 3)) * (rng.random((n, 1)) < 0.5)
    origin = model.origin
    model.write_particles(x_0 - origin, np.zeros((n, 3)))
    model.save()
    model.write_particles(x_1 - origin, np.zeros((n, 3)))
    scan.set_time(0.0, H)
    found = scan.detect()
    missed = false = wanted = 0
    times = np.zeros(n, dtype=int)
    for k, solid in enumerate(made):
        d = np.array([signed_distance(solid, s * H, x_0 + s * (x_1 - x_0)) for s in np.linspace(0, 1, SAMPLES)])
        nearest, start = d.min(axis=0), d[0]
        must = (start > 1.05 * THICK) & (nearest < 0.3 * THICK)
        here = np.zeros(n, dtype=bool)
        here[found.index[found.solid == k]] = True
        missed += int(np.sum(must & ~here & (np.bincount(found.index, minlength=n) < 3)))
        false += int(np.sum(here & (nearest > 1.6 * THICK)))
        wanted += int(must.sum())
        times += must
    several = int(np.sum(times > 1))
    assert missed == 0 and false == 0 and wanted > 30 and (kind == "mesh" or several > 10)


def test_what_flies_through_a_thin_solid_is_kept_on_its_side():
    """The plane of contact is that of the side that was hit, though the way ends beyond the other."""
    mesh, scene = tc.grid(0.2, 6), tc.Scene()
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), positions=mesh.x + [-0.1, 0.05, 0.1])
    scene.add_solid(tc.Box((0.4, 0.004, 0.4)), friction=0.0, thickness=THICK)
    sim = tc.Simulation(scene, h=H, threads=1)
    model = sim.model
    x = model.read_particles()[0]
    model.save()
    model.write_particles(x - [0, 0.12, 0], np.zeros_like(x))
    sim.contacts.scan.set_time(0.0, H)
    found = sim.contacts.scan.detect()
    assert len(found.index) == model.n and np.allclose(found.normal, [0, 1, 0])
    for gap, height in ((found.gap, -0.07), (found.start_gap, 0.05)):
        assert np.allclose(gap, height - 0.002 - THICK, atol=1e-4)


@pytest.mark.parametrize("speed", [2.0, 6.0])
def test_what_falls_fast_is_stopped_at_the_surface_in_whole_steps(speed):
    """Without a bounce, and without a step that has to be tried smaller."""
    mesh, scene = tc.grid(0.3, 6), tc.Scene(gravity=(0.0, -9.81, 0.0))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100), tc.Shear(50), tc.Bend(1e-5)), positions=mesh.x + [0, 0.2, 0],
                    velocities=(0, -speed, 0))
    scene.add_solid(tc.Plane(), friction=0.3, thickness=THICK)
    h = 1 / 60
    sim = tc.Simulation(scene, h=h, integrator="backward_euler", threads=1)
    y, v = 0.2, -speed
    for _ in range(12):
        record = sim.step()
        assert record.rejections == {} and record.h == pytest.approx(h)
        v -= 9.81 * h
        y = max(y + h * v, THICK)  # backward Euler's free fall, to the surface and no further
        assert np.abs(sim.positions()[:, 1] - y).max() < 1e-3 * THICK
    assert np.abs(sim.positions()[:, 1] - THICK).max() < 1e-3 * THICK and np.abs(sim.velocities()).max() < 1e-3
