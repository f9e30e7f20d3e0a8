"""Any mesh file, hung by its highest vertices: --set mesh=FILE --set scale=0.1"""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 16}


def build(mesh: str = "", scale: float = 1.0, uv: str = "auto", pins: int = 0, density: float = 0.2,
          stretch: float = 1000.0, cells: int = 40, up: str = "y") -> tc.Scene:
    """A mesh, held at the top of each of its pieces.

    Args:
        mesh: file with a mesh (empty: a tube made here).
        scale: metres per unit of the file.
        uv: rest shape: auto, pattern or flatten, as tc.load takes it.
        pins: how many of the highest vertices of each piece are held; 0: the top 3 % of its height.
        density: mass an area [kg/m^2].
        stretch: stiffness [N/m].
        cells: round the tube made here.
        up: axis of the file that points up, y or z.
    """
    shape = tc.load(mesh, scale, uv) if mesh else tc.cylinder(0.25 * scale, 0.8 * scale, (cells, cells))
    x = shape.x if up == "y" else shape.x[:, [0, 2, 1]] * [1, 1, -1]
    used = np.unique(shape.faces)
    held = np.concatenate([highest(x, piece, pins) for piece in pieces(shape)])
    fabric = tc.Fabric(density, tc.Stretch(stretch, k_d=1e-3 * stretch), tc.Shear(stretch / 10, k_d=1e-4 * stretch),
                       tc.Bend(5e-5, k_d=2e-7))
    scene = tc.Scene(air=tc.Air(normal=0.3, tangential=0.03), view=tc.View(reach=0.15 * float(np.ptp(x[used], axis=0).max())))
    cloth = scene.add_cloth(shape, fabric, positions=x)
    scene.pin(cloth, held)
    return scene


def pieces(mesh: tc.TriMesh) -> list[np.ndarray]:
    """The vertices of each connected piece."""
    label = np.arange(mesh.vertex_count)
    while True:
        least = label.copy()
        np.minimum.at(least, mesh.faces.ravel(), np.repeat(label[mesh.faces].min(axis=1), 3))
        least = least[least]
        if (least == label).all():
            used = np.unique(mesh.faces)
            return [used[label[used] == k] for k in np.unique(label[used])]
        label = least


def highest(x: np.ndarray, piece: np.ndarray, pins: int) -> np.ndarray:
    """The highest vertices of a piece: so many of them, or those in the top 3 % of its height."""
    height = x[piece, 1]
    if pins:
        return piece[np.argsort(-height, kind="stable")[:pins]]
    held = piece[height >= height.max() - 0.03 * np.ptp(height)]
    if len(held) == len(piece):
        raise tc.SceneError("the mesh lies flat, so that all of it would be held: say up=z, or pins=2 for two of its vertices")
    return held


def check(sim: "tc.Simulation"):
    """It hangs from its pins, settled enough, and no triangle is torn out of shape."""
    held = np.unique(np.concatenate([a.vertices for a in sim.scene.script.attachments]))
    x, start = sim.positions(), sim.scene.cloths[0].positions
    yield f"{len(held)} vertices hold", bool(np.abs(x[held] - start[held]).max() < 1e-6)
    yield f"largest stretch {sim.log[-1].stretch:.2f}", sim.log[-1].stretch < 2
    speed = float(np.sqrt(np.mean(np.sum(sim.velocities() ** 2, axis=1))))
    yield f"RMS speed {speed:.2f} m/s", speed < 3
    yield "it hangs below", x[:, 1].min() < start[:, 1].max()


if __name__ == "__main__":
    tc.run(build)
