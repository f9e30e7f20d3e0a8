"""Cloth that meets cloth fast: nothing that starts clean passes through itself, at any step size."""

import numpy as np

import taichi_cloth as tc

FABRIC = tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5))
THICKNESS = 0.005


def test_a_sheet_at_20_m_s_does_not_pass_through_one_that_is_held_at_a_point():
    """In a step of 1/10 s it goes 2 m, and in a 64th of that still six times the thickness; meshes differ in size."""
    scene, contact = tc.Scene(gravity=None), tc.ClothContact(THICKNESS, 0.3)
    lower, upper = tc.grid(0.3, 10), tc.grid(0.2, 7)
    held = scene.add_cloth(lower, FABRIC, contact=contact)
    thrown = scene.add_cloth(upper, FABRIC, positions=upper.x + [0.04, 0.1, -0.06], velocities=(0, -20, 0), contact=contact)
    scene.pin(held, 60)
    sim = tc.Simulation(scene, h=1 / 10, integrator="backward_euler", threads=1, count_intersections=True)
    sim.step()
    assert [r.intersections for r in sim.log] == [r.tangled for r in sim.log] == [0] * len(sim.log)
    assert max(r.pinched for r in sim.log) == 0 and max(r.layers for r in sim.log) > 20
    v = sim.velocities()
    mean = v[thrown.start:].mean(axis=0)
    assert -19 < mean[1] and np.abs(v).max() < 25  # it was met, and nothing was given speed
    sim.close()
