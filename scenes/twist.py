"""A tube of cloth whose ends are turned against each other, two turns in all."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"around": 24, "along": 20, "turns": 0.5}
RADIUS, LENGTH, THICKNESS = 0.1, 0.5, 0.004


def build(around: int = 64, along: int = 50, turns: float = 2.0, friction: float = 0.2) -> tc.Scene:
    """A tube whose ends turn against each other in 2.5 s, and come together by a third of its length.

    Args:
        around: cells round the tube.
        along: cells along it.
        turns: of one end against the other.
        friction: of cloth on itself.
    """
    mesh = tc.cylinder(RADIUS, LENGTH, (around, along))
    scene = tc.Scene(gravity=None, view=tc.View(camera=tc.Camera((0.68, 0.51, 0.68), (0, 0.24, 0), 36)))
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500, k_d=1.0), tc.Shear(50, k_d=0.1), tc.Bend(2e-5, k_d=2e-6)),
                            color=(0.5, 0.12, 0.1), contact=tc.ClothContact(THICKNESS, friction))
    for name, sign in (("bottom", -1), ("top", 1)):
        rim = mesh.select(name)

        def path(t: float, x=mesh.x[rim], sign=sign) -> np.ndarray:
            s = min(t / 2.5, 1.0)
            a = sign * math.pi * turns * s
            c, d = math.cos(a), math.sin(a)
            turned = x @ np.array([[c, 0, -d], [0, 1, 0], [d, 0, c]])
            return turned - [0, sign * LENGTH / 6 * s, 0]

        scene.move(cloth, rim, path)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    x = sim.positions()
    middle = np.abs(x[:, 1] - LENGTH / 2) < 0.03
    waist = np.linalg.norm(x[middle][:, [0, 2]], axis=1).mean()  # where a single fold stands out is chance
    yield f"its waist is {waist / RADIUS:.2f} of its radius", waist < 0.7 * RADIUS
    nearest = min(r.min_gap_ratio for r in sim.log)
    yield f"the smallest gap was {nearest:.2f} thicknesses", nearest > 0.02


if __name__ == "__main__":
    tc.run(build)
