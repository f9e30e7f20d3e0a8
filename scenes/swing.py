"""A sheet dropped from horizontal, held at two corners: the benchmark that other systems are measured on."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.0, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 10}


def build(cells: int = 25, stretch: float = 1000.0) -> tc.Scene:
    """A sheet without damping; its shear stiffness is a tenth of its stretch stiffness.

    Args:
        cells: along its side of 1 m.
        stretch: stiffness [N/m].
    """
    fabric = tc.Fabric(0.2, tc.Stretch(stretch), tc.Shear(stretch / 10), tc.Bend(5e-5))
    scene = tc.Scene(view=tc.View(tc.Camera((2.26, 0.47, 0.97), (0.39, -0.44, -0.85), 38.0), ground=-1.35))
    cloth = scene.add_cloth(tc.grid(1.0, cells), fabric)
    scene.pin(cloth, "top_left")
    scene.pin(cloth, "top_right")
    return scene


def check(sim: "tc.Simulation"):
    """Mechanical energy never grows, and the sheet has swung through."""
    total = np.array([sum(r.energies.values()) for r in sim.log])
    scale = 0.2 * 9.81  # m g times the sheet's size [J]
    yield f"energy grew by at most {max(0.0, np.diff(total).max()) / scale:.1e} of m g L in a step", bool(
        np.diff(total).max() < 1e-2 * scale)
    yield f"energy lost {(total[0] - total[-1]) / scale:.2f} of m g L", total[-1] < total[0]
    depth = -min(r.energies["gravity"] for r in sim.log) / scale
    yield f"its centre swings down to {depth:.2f} m below the pins", 0.3 < depth < 0.8


if __name__ == "__main__":
    tc.run(build)
