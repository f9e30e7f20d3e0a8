"""A skirt with ironed pleats: creases to and fro round a waist that turns left and right; one seam closes it."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"pleats": 12, "cells": 1}
WAIST, LENGTH, WIDTH = 0.135, 0.42, 0.048  # m: radius of inner folds at the waist, of the skirt, of a pleat's side
TOP = 1.05  # height of the waist [m]
TURNED, RATE = 2.4, 2.6  # rad and rad/s: how far and how fast the figure turns to and fro
IRONED = 1.2  # rad: the angle of folds at rest


def folded(mesh: tc.TriMesh, pleats: int) -> np.ndarray:
    """(n, 3) the flat piece as a star round the figure: folds lie on two circles, sides are straight between them."""
    step = np.pi / pleats
    if WAIST * np.sin(step) >= WIDTH:
        raise tc.SceneError(f"pleats = {pleats}: so few do not go round the waist: at least 9")
    outer = WAIST * np.cos(step) + np.sqrt(WIDTH**2 - (WAIST * np.sin(step)) ** 2)
    side, along = np.divmod(mesh.uv[:, 0] / WIDTH + 1e-9, 1.0)
    corners = [np.where((side + k) % 2 == 0, WAIST, outer) * np.exp(1j * step * (side + k)) for k in (0, 1)]
    ring = (1 - along) * corners[0] + along * corners[1]
    return np.column_stack([ring.real, TOP - LENGTH + mesh.uv[:, 1], -ring.imag])


def build(pleats: int = 15, cells: int = 2, friction: float = 0.3, ironed: float = IRONED) -> tc.Scene:
    """A skirt, closed by one seam.

    Args:
        pleats: how many there are, of two sides each.
        cells: edges across a pleat's side.
        friction: of cloth on the figure and on itself.
        ironed: angle of folds at rest [rad].
    """
    columns, rows = 2 * pleats * cells, round(LENGTH / WIDTH * cells)
    mesh = tc.grid((2 * pleats * WIDTH, LENGTH), (columns, rows))
    scene = tc.Scene(air=tc.Air(0.6, 0.1), view=tc.View(ground=0.0, camera=tc.Camera((0.49, 1.01, 0.84), (0, 0.81, 0), 34)))

    def turn(t: float) -> tuple[float, float, float]:
        return 0.0, TURNED * np.sin(RATE * t) ** 2 * np.sign(np.sin(RATE * t)), 0.0

    for name, shape in (("trunk", tc.Capsule((0, 0.95, 0), (0, 1.45, 0), 0.11)),
                        ("right leg", tc.Capsule((0.06, 0.1, 0), (0.055, 0.9, 0), 0.055)),
                        ("left leg", tc.Capsule((-0.06, 0.1, 0), (-0.055, 0.9, 0), 0.055)),
                        ("head", tc.Sphere(0.1))):
        place = (0.0, 1.66, 0.0) if name == "head" else (0.0, 0.0, 0.0)
        scene.add_solid(shape, friction, 0.004, position=place, rotation=turn, name=name, color=(0.62, 0.45, 0.36))
    fabric = tc.Fabric(0.2, tc.Stretch(400, 0.4), tc.Shear(60, 0.06), tc.Bend(4e-5, 1e-6))
    cloth = scene.add_cloth(mesh, fabric, positions=folded(mesh, pleats), name="skirt", color=(0.50, 0.12, 0.16),
                            contact=tc.ClothContact(0.003, friction))
    first, last = (np.flatnonzero(np.abs(mesh.uv[:, 0] - u) < 1e-9) for u in (0.0, 2 * pleats * WIDTH))
    ways = -ironed * (-1.0) ** np.arange(2 * pleats)  # fold 0 is the seam, an inner one
    scene.sew(cloth, first, last, rest=ways[0], stiffness=8.0)
    for k in range(1, 2 * pleats):
        scene.crease(cloth, ways[k], line=[(k * WIDTH, 0.0), (k * WIDTH, LENGTH)], stiffness=8.0)
    scene.attach(cloth, "top", scene.solids[0])
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a second."""
    x, cloth = sim.positions(), sim.scene.cloths[0]
    seam, uv = sim.scene.seams[0], cloth.mesh.uv
    gap = float(np.abs(x[seam.a] - x[seam.b]).max())
    yield f"the seam is closed: {gap:.3g} m", gap == 0
    crossed = sim.intersections()
    yield f"{crossed} crossings with itself", crossed == 0
    hem, waist = (np.hypot(*x[np.abs(uv[:, 1] - v) < 1e-9][:, [0, 2]].T) for v in (0.0, LENGTH))
    yield f"pleats open towards the hem: radius {hem.mean():.3f} m, {waist.mean():.3f} at the waist", hem.mean() > waist.mean()
    yield f"and stay: the hem goes in and out by {np.ptp(hem):.3f} m", np.ptp(hem) > 0.02
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
