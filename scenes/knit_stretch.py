"""Three sheets with the same weights: a knit that follows its measured curve, a soft weave, one with a limit of strain."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.5, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 6}
KNIT = ((0.0, 0.0), (0.17, 5.6), (0.6, 45.6))  # 33 N/m at rest, 93 from 17 % on


def build(cells: int = 20, load: float = 10.0) -> tc.Scene:
    """Sheets of 0.3 m x 0.4 m with weights on their hems.

    Args:
        cells: across each sheet's 0.3 m.
        load: weight on each sheet's hem [N/m].
    """
    scene = tc.Scene(view=tc.View(tc.Camera((0.55, 0.19, 1.64), (0.55, 0.13, 0), 34.0), ground=-0.3))
    kinds = {"knit": tc.Stretch(k_d=5.0, curve=KNIT), "soft": tc.Stretch(33, 5.0), "limited": tc.Stretch(33, 5.0, limit=1.1)}
    mesh = tc.grid((0.3, 0.4), (cells, round(cells * 4 / 3)), plane="xy")
    for k, (name, stretch) in enumerate(kinds.items()):
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, stretch, tc.Shear(15, 0.1), tc.Bend(1e-5, 1e-7)),
                                mesh.x + [0.4 * k, 0, 0], name=name)
        scene.pin(cloth, "top")
        hem = mesh.select("bottom")
        scene.add_mass(cloth, hem, load * 0.3 / 9.81 / len(hem))
    return scene


def check(sim: "tc.Simulation"):
    """Each hangs as far as its law says: tension over strain from the weights, within 3 % of a sheet's length."""
    hem = sim.scene.cloths[0].mesh.select("bottom")
    x, load = sim.positions(), 10.0 + 0.2 * 9.81 * 0.2  # in the middle of the sheet
    ends = {c.name: (0.4 - x[c.start + hem, 1].mean()) / 0.4 - 1 for c in sim.scene.cloths}
    over = (np.sqrt((33 * 0.1) ** 2 + 4 * 1000 * 33 * 0.1 * (load - 3.3)) - 33 * 0.1) / 2000 / 33
    wanted = {"knit": np.interp(load, *np.array(KNIT).T[::-1]), "soft": load / 33, "limited": 0.1 + over}
    for name, strain in ends.items():
        yield f"{name}: {100 * strain:.1f} %, by its law {100 * wanted[name]:.1f} %", abs(strain - wanted[name]) < 0.03


if __name__ == "__main__":
    tc.run(build)
