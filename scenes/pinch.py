"""Two plates close on three sheets, further than there is room, and open again."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 6}
THICKNESS, PLATE = 0.005, 0.002


def build(cells: int = 40, sheets: int = 3, gap: float = 0.005, friction: float = 0.3) -> tc.Scene:
    """Sheets between two plates that close; where `gap` is less than sheets and thicknesses need, they pinch.

    Args:
        cells: along a sheet's side.
        sheets: how many there are.
        gap: that is left between the plates in the end [m].
        friction: of cloth on plates and on cloth.
    """
    mesh = tc.grid(0.5, cells)
    scene = tc.Scene(view=tc.View(camera=tc.Camera((0.76, 0.32, 0.87), (0.02, -0.1, 0.03), 36)))
    colors = ((0.05, 0.16, 0.42), (0.55, 0.1, 0.08), (0.6, 0.45, 0.1))
    for k in range(sheets):
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(5e-5)), color=colors[k % 3],
                        positions=mesh.x + [-0.25, 0.008 * (k - (sheets - 1) / 2), 0.25],
                        contact=tc.ClothContact(THICKNESS, friction))
    for name, normal in (("upper", (0, -1, 0)), ("lower", (0, 1, 0))):
        scene.add_solid(tc.Plane(normal, 0.3), friction=friction, thickness=PLATE, name=name,
                        position=lambda t, sign=-normal[1]: (0.0, sign * height(t, gap), 0.0))
    return scene


def height(t: float, gap: float) -> float:
    """Half the distance [m] between the plates: closed from .8 to 1.2 s."""
    s = 0.5 - 0.5 * math.cos(math.pi * min(max(t / 0.8, 0.0), 1.0)) if t < 1.2 else 0.5 + 0.5 * math.cos(
        math.pi * min((t - 1.2) / 0.5, 1.0))
    return 0.05 + (gap / 2 - 0.05) * s


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    x, v = sim.positions(), sim.velocities()
    yield "everything stays near", bool(np.isfinite(x).all() and np.abs(x).max() < 1.0)
    yield f"nothing flies: {np.abs(v).max():.2f} m/s at the end", np.abs(v).max() < 5
    yield f"largest stretch {max(r.stretch for r in sim.log):.2f}", max(r.stretch for r in sim.log) < 1.5
    crossed = sim.intersections()
    named = max(r.pinched for r in sim.log)
    yield f"{crossed} intersections at the end, {named} pinched particles were named", crossed == 0


if __name__ == "__main__":
    tc.run(build)
