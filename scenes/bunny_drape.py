"""A sheet falls on a bunny: --set mesh=FILE (the Stanford bunny or any closed mesh), or on a lump made here."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.5, "fps": 30, "h": 1 / 60}
SMALL = {"cells": 20}
THICKNESS, SIZE = 0.005, 0.5


def lump(rings: int = 20, sides: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """A ball with two ears: vertices and triangles of a closed mesh."""
    x = [(0.0, -0.25, 0.0)]
    for i in range(1, rings):
        a = math.pi * i / rings
        for j in range(sides):
            b = 2 * math.pi * j / sides
            n = np.array([math.sin(a) * math.cos(b), -math.cos(a), -math.sin(a) * math.sin(b)])
            ears = sum(math.exp(-40 * float(np.sum((n - e) ** 2))) for e in np.array([[0.5, 0.83, 0.2], [-0.5, 0.83, 0.2]]))
            x.append(tuple((0.25 + 0.09 * ears) * n))
    x.append((0.0, 0.25, 0.0))
    faces = [(0, 1 + (j + 1) % sides, 1 + j) for j in range(sides)]
    for i in range(rings - 2):
        for j in range(sides):
            a, b = 1 + i * sides + j, 1 + i * sides + (j + 1) % sides
            faces += [(a, b, b + sides), (a, b + sides, a + sides)]
    top = len(x) - 1
    faces += [(top, top - sides + j, top - sides + (j + 1) % sides) for j in range(sides)]
    return np.array(x), np.array(faces)


def build(cells: int = 50, mesh: str = "", friction: float = 0.4) -> tc.Scene:
    """A mesh on the floor, and a sheet above it.

    Args:
        cells: along the sheet's side.
        mesh: file with the mesh, scaled to half a metre (empty: one made here).
        friction: of cloth on the mesh and on the floor.
    """
    shape = tc.load_solid(mesh) if mesh else tc.SolidMesh(*lump())
    x = shape.x[0]
    x = (x - (x.min(axis=0) + x.max(axis=0)) / 2) * (SIZE / np.ptp(x, axis=0).max())
    shape = tc.SolidMesh(x, shape.faces)
    cloth = tc.grid(1.0, cells)
    scene = tc.Scene(view=tc.View(camera=tc.Camera((1.1, 0.76, 1.56), (-0.02, -0.03, 0.03), 36)))
    scene.add_cloth(cloth, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(5e-5)),
                    positions=cloth.x + [-0.5, x[:, 1].max() + THICKNESS + 0.02, 0.5])
    scene.add_solid(shape, friction=friction, thickness=THICKNESS, name="bunny")
    scene.add_solid(tc.Plane(), friction=friction, thickness=THICKNESS, position=(0.0, x[:, 1].min() - 0.05, 0.0),
                    name="floor")
    return scene


def check(sim: "tc.Simulation"):
    """What must hold at any time."""
    from taichi_cloth.scene.intersections import count_crossings

    x, cloth, bunny = sim.positions(), sim.scene.cloths[0], sim.scene.solids[0]
    crossed = count_crossings(x, cloth.mesh.faces, bunny.surface_at(sim.time), bunny.shape.surface()[1])
    yield f"{crossed} crossings of cloth and bunny", crossed == 0
    yield f"the bunny carries {-sim.solid_loads()['bunny'][0][1]:.2f} N", -sim.solid_loads()["bunny"][0][1] > 0.3
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
