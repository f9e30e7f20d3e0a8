"""Folds of cloth in the crease of a body that closes on them and opens."""

import math

import numpy as np

import taichi_cloth as tc
from taichi_cloth.scene.intersections import count_self_crossings

from .case import Result, case, fabric, noisy

THICK, FOLDS, HEIGHT, WIDTH, GAP = 0.004, 3, 0.03, 0.06, 0.005  # m; layers, their height, width, and what is between them


def folded(cells: int, start: int) -> tuple[tc.TriMesh, np.ndarray, np.ndarray]:
    """A strip in zigzag: (mesh, positions, numbers of the upright layers that vertices are of, -1 between them)."""
    per = max(2, round(HEIGHT / GAP))
    rows = FOLDS * per + FOLDS - 1
    mesh = tc.grid((rows * GAP, WIDTH), (rows, cells))
    row = np.rint(mesh.uv[:, 0] / GAP).astype(int)
    layer, up = row // (per + 1), row % (per + 1)
    y = np.where(layer % 2 == 0, up, per - up) * GAP
    x = np.stack([(layer - (FOLDS - 1) / 2) * GAP, y, mesh.uv[:, 1]], axis=1)
    return mesh, noisy(x, start), layer


@case(3, 6)
def crease(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A crease closes on three folds of cloth, which is drawn meanwhile, and opens: none cross, and all keep their order.

    Two walls turn about the line where they meet, from 28 degrees each to 10, where folds half way up have three quarters
    of the room that they need, and back, in .1 s. Crossings are counted from positions; the order is that of the mean
    places of neighbouring layers, half way up.
    """
    mesh, x, layer = folded(cells, start)
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, fabric(k=1000.0), positions=x + [0, 0.02, 0], contact=tc.ClothContact(THICK, 0.3))
    bound, closed = math.radians(28), math.radians(10)

    def angle(t: float) -> float:
        return closed + (bound - closed) * abs(1 - min(t, 0.1) / 0.05)

    for side in (-1, 1):
        scene.add_solid(tc.Box((0.04, 0.3, 0.4), 0.0), 0.3, THICK, rotation=lambda t, s=side: (0, 0, -s * angle(t)),
                        position=lambda t, s=side: leaned(s, angle(t)))
    scene.move(cloth, mesh.select("top"), lambda t: (0, 0, 0.4 * t), relative=True, directions="z")
    with tc.Simulation(scene, h=h, threads=threads) as sim:
        while sim.time < 0.15 - 1e-9:
            sim.step()
        end = np.array(sim.positions())
    middle = np.abs(x[:, 1] - HEIGHT / 2) < GAP
    places = [end[middle & (layer == k), 0].mean() for k in range(FOLDS)]
    return (Result("crossings", float(count_self_crossings(end, mesh.faces)), 0.0, 0.0, wrong=1.0),
            Result("in order", float(np.mean(np.diff(places) > 0)), 1.0, 0.0, wrong=0.5))


def leaned(side: int, angle: float) -> tuple[float, float, float]:
    """Middle of a wall whose inner face goes through the z axis, leaned outwards by an angle."""
    c, s = math.cos(angle), math.sin(angle)
    return side * (0.02 * c + 0.14 * s), 0.14 * c - 0.02 * s, 0.03
