"""Layers that start nearer to each other than they may, and smooth ones: they stay, part, or are refused by name."""

from functools import partial

import numpy as np

import taichi_cloth as tc
from taichi_cloth.errors import ClothError

from .case import G, Result, case, enter, fabric, follow, noisy

THICK = 0.006  # m
SHEET = fabric(0.15, 1000.0, 2e-5)
NONE = Result("speed", 0.0, 0.0, 0.0, "m/s", "<=", 1.0)  # of a start that is refused by name


def fastest(scene: tc.Scene, h: float, threads: int, until: float, falls: bool) -> Result:
    """The highest speed of any vertex in any step, against what parts layers in a step, and free fall.

    Nothing moves by itself: layers may part by a thickness in the shortest time there is, and what falls has g t.
    """
    try:
        t, x = follow(scene, h, threads, until)
    except ClothError:
        return NONE
    v = np.linalg.norm(np.diff(x, axis=0), axis=2) / np.diff(t)[:, None]
    law = THICK / h + falls * G * until
    return Result("speed", float(v.max()), law, 0.0, "m/s", "<=", wrong=0.0)


def near(part: float, pinned: bool, h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Two sheets that start nearer than they may stay or part, no faster than a thickness a step, and what falls.

    Where they start in one place noise decides which lies where: that is the fastest of three starts.
    """
    if not part and start >= 0:
        return max((near(part, pinned, h, cells, -1 - 3 * start - k, threads)[0] for k in range(3)), key=lambda r: r.measured),
    mesh, scene = tc.grid(0.3, cells, plane="xy"), tc.Scene()
    for k in range(2):
        cloth = scene.add_cloth(mesh, SHEET, positions=noisy(mesh.x + [0, 0, k * part * THICK], abs(start) + 100 * k),
                                contact=tc.ClothContact(THICK))
        if pinned:
            scene.pin(cloth, "top")
    return fastest(scene, h, threads, 0.1, not pinned),


for _part in (0.0, 0.1, 0.2, 0.5, 0.9):
    for _pinned in (True, False):
        enter(f"near_{100 * _part:.0f}_{'pinned' if _pinned else 'free'}", partial(near, _part, _pinned), 6, 12)


@case(6, 12)
def pillow(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A pillow case, both sides of which start in one place with a common border, stays or parts."""
    side = tc.grid(0.3, cells)
    border = np.zeros(side.vertex_count, dtype=bool)
    border[side.select("border")] = True
    other = np.where(border, np.arange(side.vertex_count), side.vertex_count + np.cumsum(~border) - 1)
    x = np.concatenate([side.x, side.x[~border]])
    faces = np.concatenate([side.faces, other[side.faces][:, ::-1]])
    scene = tc.Scene()
    mesh = tc.TriMesh(x, faces, np.concatenate([side.uv, side.uv[~border]]))
    scene.add_cloth(mesh, SHEET, positions=noisy(x, start), contact=tc.ClothContact(THICK))
    return fastest(scene, h, threads, 0.1, True),


@case(3, 6)
def smooth_on_smooth(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Two smooth sheets on a smooth floor, the upper one at .3 m/s: it glides on, in steps of full length.

    It is v t further; no step is smaller than was asked for.
    """
    mesh, scene = tc.grid(0.2, cells, centred=True), tc.Scene()
    scene.add_solid(tc.Plane(), 0.0, THICK)
    for k, v in enumerate((0.0, 0.3)):
        scene.add_cloth(mesh, SHEET, positions=noisy(mesh.x + [0, THICK * (k + 1), 0], start), velocities=(v, 0, 0),
                        contact=tc.ClothContact(THICK, 0.0))
    with tc.Simulation(scene, h=h, threads=threads) as sim:
        x = np.array(sim.positions())
        while sim.time < 0.05 - 1e-9:
            sim.step()
        went = (sim.positions() - x)[:, 0].reshape(2, -1).mean(axis=1)
        steps = len(sim.log) * h / sim.time
    return (Result("upper went", float(went[1]), 0.015, 0.02 * 0.015, "m", wrong=0.01),
            Result("steps", steps, 1.0, 0.01, "of those asked for", wrong=2.0))
