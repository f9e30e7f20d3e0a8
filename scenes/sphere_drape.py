"""A square sheet falls on a ball and hangs from it in folds."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"cells": 16}
RADIUS, THICKNESS, DROP = 0.3, 0.005, 0.1


def build(cells: int = 50, friction: float = 0.4, stretch: float = 1000.0, height: float = DROP,
          itself: bool = False) -> tc.Scene:
    """A sheet of 1 m x 1 m over a ball.

    Args:
        cells: along the sheet's side.
        friction: of cloth on the ball and on itself.
        stretch: stiffness [N/m].
        height: above the ball at which it starts [m].
        itself: whether folds meet each other, else they pass through each other.
    """
    mesh = tc.grid(1.0, cells)
    x = mesh.x + [-0.5, RADIUS + THICKNESS + height, 0.5]
    scene = tc.Scene(view=tc.View(ground=-1.0, camera=tc.Camera((1, 0.68, 1.55), (-0.03, 0.02, 0.04), 38)))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(5e-5)), positions=x,
                    contact=tc.ClothContact(THICKNESS, friction) if itself else None)
    scene.add_solid(tc.Sphere(RADIUS), friction=friction, thickness=THICKNESS, name="ball")
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after any run of at least a second."""
    x = sim.positions()
    gap = np.linalg.norm(x, axis=1).min() - RADIUS
    yield f"no vertex is inside: the nearest keeps {gap / THICKNESS:.1%} of the thickness", gap > 0.6 * THICKNESS
    yield f"it lies on the ball: top at {x[:, 1].max():.4f} m", abs(x[:, 1].max() - RADIUS - THICKNESS) < 0.01
    load = sim.solid_loads()["ball"][0]
    yield f"the ball carries {-load[1]:.2f} N", -load[1] > 0.5
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.2


if __name__ == "__main__":
    tc.run(build)
