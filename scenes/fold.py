"""A sheet on a floor is folded in two, and in two again."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.4, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 12}
SIDE, THICKNESS, LIFT = 0.5, 0.005, 0.9  # m, m, s that a fold takes


def build(cells: int = 50, friction: float = 0.3) -> tc.Scene:
    """One edge is led over to the opposite one and let go; then half of a third, with what lies on it.

    Args:
        cells: along the sheet's side.
        friction: of cloth on itself.
    """
    mesh = tc.grid(SIDE, cells)
    scene = tc.Scene(view=tc.View(camera=tc.Camera((0.315, 0.461, 0.499), (0.202, 0.064, -0.214), 42), ground=-0.005))
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5, k_d=1e-6)),
                            color=(0.12, 0.3, 0.5), contact=tc.ClothContact(THICKNESS, friction))
    scene.add_solid(tc.Plane(), friction=0.5, thickness=0.005, name="floor", position=(0, -0.005, 0))
    n = cells + 1
    edge = np.arange(n) * n + cells  # x = SIDE
    hand(scene, cloth, edge, np.array([-(SIDE - 0.02), 2.2 * THICKNESS, 0.0]), 0.0)
    scene.at(LIFT, lambda: scene.unpin(cloth, edge))
    far = cells * n + np.arange(n // 2)  # the half of the far edge that stayed below
    scene.at(1.2, lambda: hand(scene, cloth, far, np.array([0.0, 4.5 * THICKNESS, SIDE - 0.05]), 1.2))
    scene.at(1.2 + LIFT, lambda: scene.unpin(cloth, far))
    return scene


def hand(scene: tc.Scene, cloth: tc.Cloth, vertices: np.ndarray, way: np.ndarray, begin: float) -> None:
    """Leads vertices along half a circle to where `way` [m] points."""
    across = np.array([way[0], 0.0, way[2]])

    def path(t: float) -> np.ndarray:
        s = min(max((t - begin) / LIFT, 0.0), 1.0)
        a = math.pi * (s - math.sin(2 * math.pi * s) / (2 * math.pi))
        return across * (1 - math.cos(a)) / 2 + np.array([0, np.linalg.norm(across) / 2 * math.sin(a) + s * way[1], 0])

    scene.move(cloth, vertices, path, relative=True)


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    x = sim.positions()
    size = np.ptp(x, axis=0)
    yield f"folded: {size[0]:.2f} m x {size[2]:.2f} m", size[0] < 0.9 * SIDE
    nearest = min(r.min_gap_ratio for r in sim.log)
    yield f"the smallest gap was {nearest:.2f} thicknesses", nearest > 0.02


if __name__ == "__main__":
    tc.run(build)
