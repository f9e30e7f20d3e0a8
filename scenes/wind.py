"""A sheet that hangs from its upper edge in a wind of a name: how far it is lifted."""

import numpy as np

import taichi_cloth as tc
from taichi_cloth.scene.winds import lifted

SIZE = 0.5  # m
RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 4}


def build(cells: int = 16, wind: str = "breeze", fabric: str = "denim") -> tc.Scene:
    """A sheet of 0.5 m x 0.5 m, held at its upper edge.

    Args:
        cells: along the sheet's 0.5 m.
        wind: name of one that `taichi-cloth winds` prints, and an axis unless it is +x.
        fabric: name of one that `taichi-cloth fabrics` prints.
    """
    scene = tc.Scene(air=tc.Air(wind=wind, drag=1.2, lift=0.8),
                     view=tc.View(tc.Camera((0.5, 0.15, 1.9), (0.1, -0.2, 0.0), 34.0), ground=-0.7))
    cloth = scene.add_cloth(tc.grid(SIZE, cells, plane="xy"), fabric)
    x = cloth.mesh.x
    side = np.column_stack([np.zeros(len(x)), x[:, 1] - x[:, 1].max(), x[:, 0] - x[:, 0].mean()])  # broadside to the wind
    cloth.positions[:] = side
    scene.pin(cloth, "top")
    return scene


def angle(sim: "tc.Simulation") -> float:
    """From the vertical [degrees], of the line from the upper edge to the hem."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    way = x[mesh.select("bottom")].mean(axis=0) - x[mesh.select("top")].mean(axis=0)
    return float(np.degrees(np.arctan2(way[0], -way[1])))


def check(sim: "tc.Simulation"):
    """It hangs as the weight of its fabric and the force of the air let it."""
    scene, measured = sim.scene, angle(sim)
    speed = float(np.linalg.norm(scene.air.wind_at(sim.time)))
    expected = lifted(speed, scene.cloths[0].fabric.density)
    yield f"{speed:g} m/s lift it by {measured:.1f} degrees, {expected:.1f} are expected", abs(measured - expected) < 3


def metrics(sim: "tc.Simulation") -> dict[str, float]:
    """For a table by wind and fabric."""
    return {"angle": angle(sim)}


if __name__ == "__main__":
    tc.run(build)
