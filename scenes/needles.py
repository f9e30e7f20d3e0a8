"""A sheet falls on a bed of needles, points finer than its mesh, and none pokes through."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.5, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 12, "side": 3}
HEIGHT, BASE, THICKNESS, SIDES = 0.3, 0.02, 0.006, 8


def needle() -> tuple[np.ndarray, np.ndarray]:
    """A cone with its point at the origin: vertices and triangles."""
    ring = [(BASE * math.cos(a), -HEIGHT, -BASE * math.sin(a)) for a in 2 * math.pi * np.arange(SIDES) / SIDES]
    x = np.array([(0.0, 0.0, 0.0), (0.0, -HEIGHT, 0.0), *ring])
    faces = [(0, 2 + k, 2 + (k + 1) % SIDES) for k in range(SIDES)] + [(1, 2 + (k + 1) % SIDES, 2 + k) for k in range(SIDES)]
    return x, np.array(faces)


def build(cells: int = 30, side: int = 4, friction: float = 0.3) -> tc.Scene:
    """Needles in a square under a sheet of 0.8 m x 0.8 m.

    Args:
        cells: along the sheet's side.
        side: needles along a side of the square.
        friction: of cloth on needles and on the floor.
    """
    mesh = tc.grid(0.8, cells)
    scene = tc.Scene(view=tc.View(ground=-HEIGHT, camera=tc.Camera((0.87, 0.45, 1.24), (-0.03, -0.22, 0), 36)))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5)),
                    positions=mesh.x + [-0.4, 0.03, 0.4])
    scene.add_solid(tc.Plane(), friction=friction, thickness=THICKNESS, position=(0.0, -HEIGHT, 0.0), name="floor")
    x, faces = needle()
    places = 0.56 * (np.arange(side) / (side - 1) - 0.5) + 0.0037  # not on the mesh's lines
    for i, a in enumerate(places):
        for j, b in enumerate(places):
            scene.add_solid(tc.SolidMesh(x, faces), friction=friction, thickness=THICKNESS, position=(a, 0.0, b),
                            name=f"needle {i} {j}")
    return scene


def check(sim: "tc.Simulation"):
    """What must hold at any time."""
    from taichi_cloth.scene.intersections import count_crossings

    x, cloth = sim.positions(), sim.scene.cloths[0]
    crossed = sum(count_crossings(x, cloth.mesh.faces, s.surface_at(sim.time), s.shape.surface()[1])
                  for s in sim.scene.solids if isinstance(s.shape, tc.SolidMesh))
    yield f"{crossed} crossings of cloth and needles", crossed == 0
    held = sum(-force[1] for name, (force, _) in sim.solid_loads().items() if name != "floor")
    yield f"the needles carry {held:.3f} N", held > 0.1
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
