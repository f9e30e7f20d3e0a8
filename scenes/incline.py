"""Patches on a slope of 20 degrees: whether they stick, and how far they slide, by friction alone."""

import math

import numpy as np

import taichi_cloth as tc
from taichi_cloth.scene.solids import rotation_matrix

RUN = {"duration": 1.0, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 5}
ANGLE, THICKNESS, SIZE, GAP = math.radians(20), 0.004, 0.2, 0.1
MU = (0.1, 0.2, 0.3, 0.36, 0.37)


def build(cells: int = 10) -> tc.Scene:
    """One patch for each coefficient of friction, side by side, each on a plank of its own.

    Args:
        cells: along a patch's side.
    """
    slope = rotation_matrix((0.0, 0.0, -ANGLE))
    scene = tc.Scene(view=tc.View(ground=-1.0, camera=tc.Camera((0.88, 1, 3.06), (0.5, -0.16, 0.69), 30)))
    mesh = tc.grid(SIZE, cells)
    for k, mu in enumerate(MU):
        along = (SIZE + GAP) * k
        x = mesh.x + [0.0, THICKNESS, along + SIZE]
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(5e-5)), positions=x @ slope.T,
                        name=f"mu={mu}")
        scene.add_solid(tc.Box((2.2, 0.04, SIZE + 0.6 * GAP), 0.004), friction=mu, thickness=THICKNESS, rotation=slope,
                        position=slope @ np.array([0.9, -0.02, along + SIZE / 2]), name=f"plank {mu}")
    return scene


def check(sim: "tc.Simulation"):
    """Slides are g t^2/2 (sin - mu cos), and what the backward Euler steps add; to 1 %, or a step late: a step may be off
    Coulomb's law by .1 % of all forces."""
    x, t = sim.positions(), sim.time
    down = np.array([math.cos(ANGLE), -math.sin(ANGLE), 0.0])
    for cloth, mu in zip(sim.scene.cloths, MU):
        moved = float(((x[cloth.start: cloth.start + cloth.mesh.vertex_count] - cloth.positions) @ down).mean())
        g = 9.81 * max(0.0, math.sin(ANGLE) - mu * math.cos(ANGLE))
        h = t / len(sim.log)
        wanted = g * t * (t + h) / 2
        yield f"mu = {mu}: {moved:.4f} m of {wanted:.4f} m", abs(moved - wanted) <= max(0.01 * wanted, g * h * t) + 1e-9


if __name__ == "__main__":
    tc.run(build)
