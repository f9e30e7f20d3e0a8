"""A square tablecloth falls on a table with sharp corners and hangs over its edges."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"cells": 16}
TOP, THICKNESS = (0.7, 0.04, 0.7), 0.006


def build(cells: int = 40, friction: float = 0.4, mesh: bool = False) -> tc.Scene:
    """A cloth of 1.1 m x 1.1 m on a table.

    Args:
        cells: along the cloth's side.
        friction: of cloth on the table.
        mesh: whether the table top is made of triangles, else it is a box.
    """
    cloth = tc.grid(1.1, cells)
    x = cloth.x + [-0.55, TOP[1] / 2 + THICKNESS + 0.05, 0.55]
    scene = tc.Scene(view=tc.View(ground=-0.75, camera=tc.Camera((1.18, 0.51, 1.64), (-0.02, -0.37, 0.04), 38)))
    scene.add_cloth(cloth, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5)), positions=x)
    box = tc.Box(TOP)
    scene.add_solid(tc.SolidMesh(*box.core()[:2]) if mesh else box, friction=friction, thickness=THICKNESS, name="top")
    for k, (sx, sz) in enumerate(((-1, -1), (-1, 1), (1, -1), (1, 1))):
        scene.add_solid(tc.Cylinder(0.025, 0.7), friction=friction, thickness=THICKNESS, name=f"leg{k}",
                        position=(0.3 * sx, -0.37, 0.3 * sz))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after any run of at least a second."""
    x = sim.positions()
    half = np.array(TOP) / 2
    inside = (np.abs(x) - half).max(axis=1)
    yield f"no vertex inside the table: nearest {inside.min() * 1e3:.2f} mm", inside.min() > 0.6 * THICKNESS
    lies = np.abs(x[:, 1] - half[1] - THICKNESS) < 1e-3
    yield f"{lies.mean():.0%} of it lie on the table", 0.2 < lies.mean() < 0.6
    yield f"it hangs to {x[:, 1].min():.2f} m", x[:, 1].min() < -0.15
    weight = 9.81 * sim.model.mass.sum()
    load = -sum(force[1] for force, _ in sim.solid_loads().values())
    yield f"the table carries {load / weight:.3f} of its weight", abs(load / weight - 1) < 0.2


if __name__ == "__main__":
    tc.run(build)
