"""A sheet that hangs from two particles: [BW98] fig. 2, at the paper's size (51 x 51)."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60}
RANGES = {"cells": (4, 100), "size": (0.2, 2), "stretch": (50, 5000), "density": (0.03, 0.6)}
SMALL = {"cells": 12}


def build(cells: int = 50, size: float = 1.0, stretch: float = 1000.0, density: float = 0.15) -> tc.Scene:
    """A square sheet, held at two corners.

    Args:
        cells: along a side.
        size: of a side [m].
        stretch: stiffness [N/m].
        density: mass an area [kg/m^2].
    """
    mesh = tc.grid(size, cells)
    fabric = tc.Fabric(density, tc.Stretch(stretch, k_d=stretch * 1e-3), tc.Shear(stretch / 10, k_d=stretch * 1e-4),
                       tc.Bend(5e-5, k_d=2e-7))
    scene = tc.Scene(air=tc.Air(normal=0.3, tangential=0.02), view=tc.View(tc.Camera(
        (0.72 * size, 0.3 * size, 1.35 * size), (0.43 * size, -0.57 * size, -0.8 * size), 36.0),
        ground=-1.25 * size, light="sun"))
    cloth = scene.add_cloth(mesh, fabric, color=tc.Appearance("orange", hem=0.015 * size))
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    return scene


def check(sim: "tc.Simulation"):
    """It hangs below its pins, at its own length, and the pins have not moved."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    pins = mesh.select("top_left").tolist() + mesh.select("top_right").tolist()
    yield "the pins are where they were", bool(np.abs(x[pins] - mesh.x[pins]).max() < 1e-6)
    size = np.ptp(mesh.x[:, 0])
    yield f"the lowest vertex hangs {-x[:, 1].min() / size:.2f} sizes below", 0.7 < -x[:, 1].min() / size < 1.6
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3
    yield "no step was rejected", not any(r.rejections for r in sim.log)


if __name__ == "__main__":
    tc.run(build)
