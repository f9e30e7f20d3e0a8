"""Three sheets fall on a ball, one on the other, and keep their order."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.5, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 10}
RADIUS, THICKNESS = 0.3, 0.006


def build(cells: int = 50, sheets: int = 3, friction: float = 0.3, thickness: float = THICKNESS) -> tc.Scene:
    """Sheets of 1 m x 1 m, each turned a little against the last.

    Args:
        cells: along a sheet's side.
        sheets: how many there are.
        friction: of cloth on the ball and on cloth.
        thickness: distance that two sheets keep [m].
    """
    mesh = tc.grid(1.0, cells)
    scene = tc.Scene(view=tc.View(ground=-1.0, camera=tc.Camera((1.07, 0.71, 1.58), (-0.01, 0.03, 0.01), 38)))
    colors = ((0.05, 0.16, 0.42), (0.55, 0.1, 0.08), (0.6, 0.45, 0.1), (0.1, 0.35, 0.15))
    for k in range(sheets):
        c, s = np.cos(0.35 * k), np.sin(0.35 * k)
        x = (mesh.x + [-0.5, 0, 0.5]) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5)), color=colors[k % 4],
                        positions=x + [0, RADIUS + 0.05 + 0.03 * k, 0], contact=tc.ClothContact(thickness, friction))
    scene.add_solid(tc.Sphere(RADIUS), friction=friction, thickness=0.005, name="ball")
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after any run of at least a second."""
    x, cloths = sim.positions(), sim.scene.cloths
    n = cloths[0].mesh.vertex_count
    middle = np.argmin(np.abs(cloths[0].mesh.x - cloths[0].mesh.x.mean(axis=0)).sum(axis=1))
    tops = x[middle::n, 1]
    gaps = np.diff(tops) / cloths[0].contact.thickness
    yield f"the sheets lie on each other: gaps at the top {np.round(gaps, 2).tolist()} thicknesses", bool((gaps > 0.2).all())
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    nearest = min(r.min_gap_ratio for r in sim.log)
    yield f"the smallest gap was {nearest:.2f} thicknesses", nearest > 0.02


if __name__ == "__main__":
    tc.run(build)
