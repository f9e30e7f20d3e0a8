"""A free sheet, twisted by 2.8 radians a half width, whose bending is stiff against its stretch: triangles collapse, folds
pass through themselves, and energy must come from nowhere."""

import numpy as np
import pytest

import taichi_cloth as tc


def twisted(cells, bend):
    mesh = tc.grid(1.0, cells)
    u, _, w = (mesh.x - mesh.x.mean(axis=0)).T  # a grid lies in x and z
    x = np.column_stack([u, w * np.sin(5.6 * u), w * np.cos(5.6 * u)])
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(7.5, tc.Stretch(31.0), bend=tc.Bend(0.9, model=bend)), x)
    return scene


@pytest.mark.parametrize("bend, integrator, h, gain", [
    ("hinge", "backward_euler", 1 / 60, 0.15),
    ("hinge", "safe", 1 / 480, 0.02),
    ("hinge", "verlet", 1 / 60, 0.02),
    ("curvature", "backward_euler", 1 / 60, 0.0),
])
def test_a_twisted_sheet_gains_no_energy(bend, integrator, h, gain):
    sim = tc.Simulation(twisted(6, bend), h=h, integrator=integrator)
    start = sum(sim.energy().values())
    assert start > 30
    for _ in range(round(0.4 / h)):
        sim.step(h)
    totals = [sum(record.energies.values()) for record in sim.log]
    assert max(totals) < (1 + gain) * start + 1e-9
    assert np.isfinite(sim.positions()).all()
    sim.close()
