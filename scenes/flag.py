"""A flag on its pole in a gusty wind."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60}
RANGES = {"cells": (8, 80), "speed": (0, 15)}
SMALL = {"cells": 10}


def build(cells: int = 40, speed: float = 6.0) -> tc.Scene:
    """A flag of 1.5 m x 0.9 m on a pole.

    Args:
        cells: along the flag's 1.5 m.
        speed: of the wind [m/s].
    """

    def wind(t: float) -> tuple[float, float, float]:
        gust = 1 + 0.3 * math.sin(2.1 * t) + 0.15 * math.sin(5.3 * t + 1)
        return speed * gust, 0.0, 0.35 * speed * math.sin(3.7 * t)

    fabric = tc.Fabric(0.12, tc.Stretch(2000, k_d=1.0), tc.Shear(200, k_d=0.1), tc.Bend(3e-5, k_d=1e-7))
    scene = tc.Scene(air=tc.Air(normal=0.6, tangential=0.03, wind=wind), view=tc.View(
        tc.Camera((1.58, 0.71, 3.11), (0.69, 0.1, 0.11), 35.0), ground=-0.7))
    cloth = scene.add_cloth(tc.grid((1.5, 0.9), (cells, round(cells * 0.6)), plane="xy"), fabric)
    scene.pin(cloth, "left")
    return scene


def check(sim: "tc.Simulation"):
    """The wind carries the flag: it flies downwind, be it in a gust or a turn of the wind, and has waves."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    free = x[mesh.select("right")]
    yield f"its free edge is {free[:, 0].mean():.2f} m downwind", free[:, 0].mean() > 0.1
    yield f"it waves by {np.ptp(x[:, 2]):.2f} m", np.ptp(x[:, 2]) > 0.05
    yield f"largest stretch {max(r.stretch for r in sim.log):.3f}", max(r.stretch for r in sim.log) < 1.3
    pole = mesh.select("left")
    yield "the pole holds", bool(np.abs(x[pole] - mesh.x[pole]).max() < 1e-6)


if __name__ == "__main__":
    tc.run(build)
