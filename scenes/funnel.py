"""A sheet is pulled through a ring, middle first."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 14}
HOLE, TUBE, THICKNESS = 0.09, 0.03, 0.004  # m: radius of the hole, of the ring's own round, of the cloth


def ring(around: int = 40, across: int = 16) -> tc.SolidMesh:
    """A torus about the y axis."""
    a, b = np.meshgrid(2 * math.pi * np.arange(around) / around, 2 * math.pi * np.arange(across) / across, indexing="ij")
    r = HOLE + TUBE - TUBE * np.cos(b)
    x = np.stack([r * np.cos(a), TUBE * np.sin(b), r * np.sin(a)], axis=2).reshape(-1, 3)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    p, q = i * across + j, (i + 1) % around * across + j
    r_, s = (i + 1) % around * across + (j + 1) % across, i * across + (j + 1) % across
    return tc.SolidMesh(x, np.concatenate([np.stack([p, q, r_], axis=1), np.stack([p, r_, s], axis=1)]))


def build(cells: int = 50, depth: float = 0.28, friction: float = 0.1) -> tc.Scene:
    """A sheet of 0.5 m x 0.5 m over a ring.

    Args:
        cells: along the sheet's side.
        depth: by which its middle is led down in 1.8 s [m].
        friction: of cloth on the ring and on itself.
    """
    mesh = tc.grid(0.5, cells)
    scene = tc.Scene(view=tc.View(camera=tc.Camera((0.95, 0.24, 1.1), (-0.02, -0.25, -0.01), 36)))
    x = mesh.x + [-0.25, TUBE + 0.008, 0.25]
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(800, k_d=0.5), tc.Shear(80, k_d=0.05), tc.Bend(3e-5, k_d=1e-6)),
                            positions=x, color=(0.45, 0.1, 0.25), contact=tc.ClothContact(THICKNESS, friction))
    scene.add_solid(ring(), friction=friction, thickness=0.005, name="ring")
    middle = np.flatnonzero(np.linalg.norm(x[:, [0, 2]], axis=1) < max(0.02, 0.3 / cells))
    scene.move(cloth, middle, lambda t: (0.0, -depth * (0.5 - 0.5 * math.cos(math.pi * min(t / 1.8, 1.0))), 0.0),
               relative=True)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    x = sim.positions()
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    low = x[:, 1] < -TUBE
    yield f"{low.mean():.0%} of it is through the ring", low.mean() > 0.1
    passing = x[np.abs(x[:, 1]) < 0.3 * TUBE][:, [0, 2]]
    widest = float(np.linalg.norm(passing, axis=1).max(initial=0.0))
    yield f"what passes the ring keeps within {widest * 1e3:.0f} mm", widest < HOLE + 0.01
    yield f"largest stretch {sim.log[-1].stretch:.2f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
