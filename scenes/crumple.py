"""A sheet is crushed in a closing box and let go: where it was bent sharply it stays bent."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "newton_euler"}
SMALL = {"cells": 10}
SIDE, THICKNESS, MARGIN = 0.24, 0.003, 0.002  # m
CLOSED, OPENS, OPEN = 1.0, 1.3, 1.9  # s: when the box is closed, begins to open, is open
WIDE, NARROW = (0.27, 0.14, 0.27), (0.12, 0.07, 0.12)  # m: the box at first, and closed


def size(t: float) -> np.ndarray:
    """(3,) inner lengths of the box [m]."""
    closing = min(max(t / CLOSED, 0.0), 1.0) if t < OPENS else 1 - min((t - OPENS) / (OPEN - OPENS), 1.0)
    part = 0.5 - 0.5 * math.cos(math.pi * closing)
    return np.array(WIDE) + part * (np.array(NARROW) - np.array(WIDE))


def build(cells: int = 24, yields: float = 60.0, friction: float = 0.3) -> tc.Scene:
    """A sheet in an open box.

    Args:
        cells: along the sheet's side.
        yields: curvature beyond which the sheet stays bent [1/m].
        friction: of cloth on the box and on itself.
    """
    mesh = tc.grid(SIDE, cells)
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=tc.View(tc.Camera((0.33, 0.47, 0.65), (-0.01, 0.01, 0), 28.0), ground=0.0))
    u, v = mesh.uv.T / SIDE - 0.5
    start = np.column_stack([SIDE * u, 0.05 + 0.015 * np.sin(7 * u + 2 * v) + 0.008 * np.cos(9 * v - 3 * u), -SIDE * v])
    fabric = tc.Fabric(0.12, tc.Stretch(600, 0.6), tc.Shear(100, 0.1),
                       tc.Bend(2e-5, 1e-7, friction=4e-4, yield_=yields, hardening=0.1))
    scene.add_cloth(mesh, fabric, start, color=(0.62, 0.58, 0.48), contact=tc.ClothContact(THICKNESS, friction))
    scene.add_solid(tc.Plane(), friction=0.5, thickness=MARGIN, name="floor")
    for axis, name in ((0, "left"), (0, "right"), (2, "back"), (2, "front"), (1, "lid")):
        inwards = -1.0 if name in ("right", "front", "lid") else 1.0
        way = inwards * np.eye(3)[axis]
        drawn = {"left": 0.135, "back": 0.135}.get(name, 1e-5)  # one sees into the box: the others are less than a pixel
        scene.add_solid(tc.Plane(tuple(way.tolist()), drawn), friction=friction, thickness=MARGIN, name=name,
                        position=lambda t, axis=axis, way=way: -way * size(t)[axis] / (1 if axis == 1 else 2))
    return scene


def angles(x: np.ndarray, mesh: tc.TriMesh) -> np.ndarray:
    """(edges,) angle [rad] between the two triangles at each edge between two."""
    n = np.cross(x[mesh.faces[:, 1]] - x[mesh.faces[:, 0]], x[mesh.faces[:, 2]] - x[mesh.faces[:, 0]])
    n /= np.linalg.norm(n, axis=1)[:, None]
    ends = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    code, face = ends @ [mesh.vertex_count, 1], np.repeat(np.arange(mesh.face_count), 3)
    order = np.argsort(code, kind="stable")
    same = np.flatnonzero(code[order][1:] == code[order][:-1])
    cosine = np.sum(n[face[order[same]]] * n[face[order[same + 1]]], axis=1)
    return np.arccos(np.clip(cosine, -1, 1))


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    x, mesh = sim.positions(), sim.scene.cloths[0].mesh
    bent = angles(x, mesh)
    yield f"{100 * np.mean(bent > 0.35):.0f} % of its edges stay bent by more than 20 degrees", np.mean(bent > 0.35) > 0.05
    extent = np.ptp(x, axis=0)
    yield f"it does not lie flat again: {100 * extent[1]:.1f} cm high", extent[1] > 0.02
    speed = float(np.sqrt(np.mean(sim.velocities() ** 2)))
    yield f"it rests: {speed:.3f} m/s", speed < 0.1
    yield f"largest stretch {max(r.stretch for r in sim.log):.2f}", max(r.stretch for r in sim.log) < 1.3


if __name__ == "__main__":
    tc.run(build)
