"""A ball turns under a sheet and carries it round by friction."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 16}
RADIUS, THICKNESS, SETTLE = 0.3, 0.005, 1.0


def build(cells: int = 40, friction: float = 0.5, turns: float = 0.25) -> tc.Scene:
    """The scene.

    Args:
        cells: along the sheet's side.
        friction: of cloth on the ball.
        turns: of the ball, reached after a second [1/s].
    """

    def rotation(t: float) -> tuple[float, float, float]:
        s = max(0.0, t - SETTLE)
        return 0.0, 2 * math.pi * turns * (s - 0.5 + 0.5 * math.exp(-2 * s)), 0.0

    mesh = tc.grid(1.0, cells)
    scene = tc.Scene(view=tc.View(ground=-1.0, camera=tc.Camera((0.98, 0.72, 1.52), (-0.04, 0, 0.03), 38)))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5, k_d=1e-6)),
                    positions=mesh.x + [-0.5, RADIUS + THICKNESS + 0.02, 0.5])
    scene.add_solid(tc.Sphere(RADIUS), friction=friction, thickness=THICKNESS, rotation=rotation, name="ball")
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after any run that goes on beyond the first second."""
    x, v = sim.positions(), sim.velocities()
    gap = np.linalg.norm(x, axis=1).min() - RADIUS
    yield f"no vertex is inside: the nearest keeps {gap / THICKNESS:.1%} of the thickness", gap > 0.6 * THICKNESS
    top = np.hypot(x[:, 0], x[:, 2]) < 0.15
    turning = np.cross(x[top], v[top])[:, 1].sum() / (x[top][:, [0, 2]] ** 2).sum()
    R = sim.scene.solids[0].pose
    step = R(sim.time)[0] @ R(sim.time - 1e-3)[0].T
    wanted = math.atan2(step[0, 2], step[2, 2]) / 1e-3
    yield f"the top turns at {turning:.2f} of {wanted:.2f} rad/s", abs(turning - wanted) < 0.15 * abs(wanted) + 0.02


if __name__ == "__main__":
    tc.run(build)
