"""A strip that hangs by its upper edge stretches by sigma g L^2 / 2k, at any resolution."""

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 10, "h": 1 / 30, "cg_tol": 1e-8}
SMALL = {"cells": 5}

LENGTH, DENSITY, GRAVITY = 1.0, 0.2, 9.81


def build(cells: int = 20, stretch: float = 500.0) -> tc.Scene:
    """A strip of a metre, strongly damped.

    Args:
        cells: along it.
        stretch: stiffness [N/m].
    """
    fabric = tc.Fabric(DENSITY, tc.Stretch(stretch, k_d=stretch / 5), tc.Shear(stretch / 5))
    scene = tc.Scene(gravity=(0, -GRAVITY, 0))
    cloth = scene.add_cloth(tc.grid((0.2, LENGTH), (max(1, cells // 5), cells), plane="xy"), fabric)
    scene.pin(cloth, "top")
    return scene


def check(sim: "tc.Simulation"):
    """Elongation within 1e-3 of the closed form."""
    cloth = sim.scene.cloths[0]
    k = cloth.fabric.stretch.k
    expected = DENSITY * GRAVITY * LENGTH**2 / (2 * k)
    bottom = cloth.mesh.select("bottom")
    measured = float((cloth.mesh.x[bottom, 1] - sim.positions()[bottom, 1]).mean())
    error = measured / expected - 1
    yield f"elongation {measured * 1e3:.4f} mm, closed form {expected * 1e3:.4f} mm, off by {error:.1e}", abs(error) < 1e-3


if __name__ == "__main__":
    tc.run(build)
