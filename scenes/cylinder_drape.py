"""A sheet of the paper's size drapes over a lying cylinder: [BW98] fig. 1."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"cells": 16}
RADIUS, LENGTH, THICKNESS = 0.2, 0.8, 0.005


def build(cells: int = 50, friction: float = 0.3, stretch: float = 1000.0) -> tc.Scene:
    """A sheet of 1 m x 1 m over a cylinder.

    Args:
        cells: along the sheet's side; 50 in the paper.
        friction: of cloth on the cylinder.
        stretch: stiffness [N/m].
    """
    mesh = tc.grid(1.0, cells)
    scene = tc.Scene(view=tc.View(ground=-0.75, camera=tc.Camera((1.16, 0.69, 1.54), (0, -0.06, 0.05), 36)))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(5e-5)),
                    positions=mesh.x + [-0.5, RADIUS + THICKNESS + 0.05, 0.5])
    scene.add_solid(tc.Cylinder(RADIUS, LENGTH), friction=friction, thickness=THICKNESS, name="cylinder",
                    rotation=(math.pi / 2, 0.0, 0.0))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after any run of at least a second."""
    x = sim.positions()
    over = np.abs(x[:, 2]) < LENGTH / 2
    gap = np.hypot(x[:, 0], x[:, 1])[over].min() - RADIUS
    yield f"no vertex is inside: the nearest keeps {gap / THICKNESS:.1%} of the thickness", gap > 0.6 * THICKNESS
    yield f"it hangs to {x[:, 1].min():.2f} m", x[:, 1].min() < -0.1
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.2


if __name__ == "__main__":
    tc.run(build)
