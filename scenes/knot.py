"""A ribbon in an overhand knot is pulled tight by its ends."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"along": 120, "across": 2, "pull": 0.12}
SIZE, WIDTH, THICKNESS = 0.05, 0.018, 0.004  # m: of the knot's unit, of the ribbon


def knot(count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """(points (count, 3), directions across (count, 3), length [m]) of a long trefoil, equally spaced."""
    t = np.linspace(-2.12, 2.12, 20001)
    curve = SIZE * np.stack([t**3 - 3 * t, t**4 - 4 * t**2, 0.75 * (t**5 / 5 - 2 * t)], axis=1)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    at = np.linspace(0, arc[-1], count)
    x = np.stack([np.interp(at, arc, c) for c in curve.T], axis=1)
    along = np.gradient(x, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.empty_like(x)
    side[0] = np.cross(along[0], [0, 0, 1.0])
    for k in range(count):  # carried along without turning
        side[k] = side[max(k - 1, 0)]
        side[k] -= side[k] @ along[k] * along[k]
        side[k] /= np.linalg.norm(side[k])
    return x, side, float(arc[-1])


def build(along: int = 400, across: int = 5, pull: float = 0.43, friction: float = 0.1) -> tc.Scene:
    """A ribbon with a knot in it.

    Args:
        along: cells along the strip.
        across: cells across it.
        pull: by which both ends are led outwards in 1.8 s [m].
        friction: of cloth on itself.
    """
    x, side, length = knot(along + 1)
    mesh = tc.strip(length, WIDTH, (along, across))
    row = np.linspace(-WIDTH / 2, WIDTH / 2, across + 1)
    positions = (x[None] + row[:, None, None] * side[None]).reshape(-1, 3)
    scene = tc.Scene(gravity=None, view=tc.View(camera=tc.Camera((0.248, -0.018, 0.754), (0.099, -0.018, -0.017), 36)))
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=1.0), tc.Shear(100, k_d=0.1), tc.Bend(2e-5, k_d=2e-6)),
                            positions=positions, color=(0.6, 0.15, 0.1), contact=tc.ClothContact(THICKNESS, friction))
    for name, k in (("left", 0), ("right", along)):
        ends = x[0] - x[-1] if k == 0 else x[-1] - x[0]
        way = ends / np.linalg.norm(ends)
        scene.move(cloth, name, lambda t, way=way: pull * (0.5 - 0.5 * math.cos(math.pi * min(t / 1.8, 1.0))) * way,
                   relative=True)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    start, x = sim.scene.cloths[0].positions, sim.positions()
    ends = np.linalg.norm(x[sim.scene.cloths[0].mesh.select("left")].mean(axis=0)
                          - x[sim.scene.cloths[0].mesh.select("right")].mean(axis=0))
    length = np.linalg.norm(np.diff(start[: len(start)], axis=0), axis=1).max()
    yield f"the ends are {ends:.2f} m apart", ends > 0.3 and length > 0
    yield f"layers touch: {max(r.layers for r in sim.log)} pairs", max(r.layers for r in sim.log) > 0


if __name__ == "__main__":
    tc.run(build)
