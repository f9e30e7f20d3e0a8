"""A sheet is pulled apart from a slit: it tears from the slit's end across, and the halves swing away."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.0, "fps": 30, "h": 1 / 120, "integrator": "backward_euler"}
SMALL = {"cells": 8}
SIZE, SLIT = (0.3, 0.2), 0.06


def build(cells: int = 20, strength: float = 300.0, speed: float = 0.12) -> tc.Scene:
    """A sheet with a slit.

    Args:
        cells: along the sheet's 0.3 m.
        strength: force a length at which it tears [N/m].
        speed: at which its ends part [m/s].
    """
    scene = tc.Scene(view=tc.View(camera=tc.Camera((0.15, 0.382, 0.692), (0.15, 0.113, -0.004), 38)))
    mesh = tc.grid(SIZE, (cells, round(cells * 2 / 3)), plane="xy")
    fabric = tc.Fabric(0.15, tc.Stretch(1500, 1.5), tc.Shear(300, 0.3), tc.Bend(3e-5, 3e-7))
    cloth = scene.add_cloth(mesh, fabric, color=(0.62, 0.25, 0.2), tear=tc.Tear(strength, length=0.02))
    deep = round(SLIT / (SIZE[1] / round(cells * 2 / 3))) * SIZE[1] / round(cells * 2 / 3)
    scene.score(cloth, [(SIZE[0] / 2, SIZE[1]), (SIZE[0] / 2, SIZE[1] - deep)], 0.0)
    for name, way in (("left", -1), ("right", 1)):
        scene.move(cloth, name, lambda t, way=way: (way * speed * t * min(1, 2 * t), 0, 0), relative=True)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold at the end."""
    cloth = sim.scene.cloths[0]
    faces = sim.faces()
    label = np.arange(sim.vertex_count)
    for _ in range(len(label)):
        low = label[faces].min(axis=1)
        before = label.copy()
        for k in range(3):
            np.minimum.at(label, faces[:, k], low)
        if (label == before).all():
            break
    left, right = (label[faces[np.isin(cloth.mesh.faces, cloth.mesh.select(n)).any(axis=1)]] for n in ("left", "right"))
    yield "the ends hang together no more", not np.isin(left, right).any()
    opened = sim.stitches_open()[0]
    u = cloth.mesh.uv[cloth.split.a[opened], 0]
    yield f"it is torn within {np.abs(u - SIZE[0] / 2).max():.3g} m of its middle", np.abs(u - SIZE[0] / 2).max() < 0.06
    most = max(r.ledger["kinetic"] + r.ledger["potential"] - r.ledger["pins"] for r in sim.log)
    yield f"energy grew by no more than what pulled put in: {most:.2g} J over", most < 1e-4


if __name__ == "__main__":
    tc.run(build)
