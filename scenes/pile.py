"""Sheets dropped on one another from different heights, each turned against the last."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.5, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 8, "sheets": 3}
THICKNESS, SIDE = 0.006, 0.4


def build(cells: int = 50, sheets: int = 5, friction: float = 0.3) -> tc.Scene:
    """Sheets of 0.4 m x 0.4 m over a floor.

    Args:
        cells: along a sheet's side.
        sheets: how many there are.
        friction: of cloth on cloth.
    """
    mesh = tc.grid(SIDE, cells)
    scene = tc.Scene(view=tc.View(camera=tc.Camera((0.53, 0.52, 0.67), (0.04, 0.14, 0.01), 40), ground=-0.006))
    colors = ((0.05, 0.16, 0.42), (0.55, 0.1, 0.08), (0.6, 0.45, 0.1), (0.1, 0.35, 0.15), (0.35, 0.12, 0.4))
    rng = np.random.default_rng(7)
    for k in range(sheets):
        a, tilt = rng.uniform(0, np.pi), rng.uniform(-0.25, 0.25)
        x = mesh.x + [-SIDE / 2, 0, SIDE / 2]
        x = x @ np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
        x = x @ np.array([[np.cos(a), 0, -np.sin(a)], [0, 1, 0], [np.sin(a), 0, np.cos(a)]])
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=0.3), tc.Shear(100, k_d=0.03), tc.Bend(5e-5, k_d=1e-6)),
                        positions=x + [0.02 * rng.normal(), 0.08 + 0.14 * k, 0.02 * rng.normal()], color=colors[k % 5],
                        contact=tc.ClothContact(THICKNESS, friction))
    scene.add_solid(tc.Plane(), friction=0.5, thickness=0.006, name="floor", position=(0, -0.006, 0))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    n = sim.scene.cloths[0].mesh.vertex_count
    heights = sim.positions()[:, 1].reshape(-1, n).mean(axis=1)
    yield f"they lie in order, at {np.round(1e3 * heights, 1).tolist()} mm", bool((np.diff(heights) > 0).all())
    nearest = min(r.min_gap_ratio for r in sim.log)
    yield f"the smallest gap was {nearest:.2f} thicknesses", nearest > 0.02


if __name__ == "__main__":
    tc.run(build)
