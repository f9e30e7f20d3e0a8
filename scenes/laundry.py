"""A sheet on a line in gusts: a wind that differs from place to place, and cloth that feels the square of its speed."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60}
RANGES = {"cells": (8, 72), "speed": (0, 6), "gusts": (0.1, 4), "seed": (1, 20)}
SMALL = {"cells": 10}


def build(cells: int = 36, speed: float = 2.0, gusts: float = 1.0, seed: int = 1) -> tc.Scene:
    """A sheet on a line.

    Args:
        cells: along the sheet's 1.2 m.
        speed: mean wind [m/s].
        gusts: root mean square of the gusts that come on top [m/s].
        seed: of the gusts: another number, other gusts.
    """
    fabric = tc.Fabric(0.13, tc.Stretch(1500, k_d=1.0), tc.Shear(100, k_d=0.1), tc.Bend(2e-5, k_d=1e-7))
    air = tc.Air(wind=tc.Gusts((0.3 * speed, 0.0, -speed), gusts, length=1.5, seed=seed), drag=1.2, lift=0.8)
    scene = tc.Scene(air=air, view=tc.View(tc.Camera((1.66, 0.61, 1.74), (0.56, 0.4, -0.41), 34.0), ground=-0.2))
    cloth = scene.add_cloth(tc.grid((1.2, 0.9), (cells, round(cells * 0.75)), plane="xy"), fabric)
    top = cloth.mesh.select("top")
    scene.pin(cloth, top[np.argsort(cloth.mesh.x[top, 0])][:: max(1, cells // 9)])
    return scene


def check(sim: "tc.Simulation"):
    """The wind blows the sheet out, here more than there, and its pegs hold."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    hem = x[mesh.select("bottom")]
    yield f"its hem is blown out by {-hem[:, 2].mean():.2f} m", hem[:, 2].mean() < -0.1
    yield f"by {np.ptp(hem[:, 2]):.2f} m more here than there", np.ptp(hem[:, 2]) > 0.03
    yield f"largest stretch {max(r.stretch for r in sim.log):.3f}", max(r.stretch for r in sim.log) < 1.1
    work = sum(r.ledger["wind"] for r in sim.log)
    yield f"the wind did {work:.2f} J of work", work > 0


if __name__ == "__main__":
    tc.run(build)
