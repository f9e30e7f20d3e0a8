"""A cloth over a moving body: --set data=FILE (.npz, .glb, .usd, .fbx, ...), or a figure of capsules that waves."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 25, "h": 1 / 100}
SMALL = {"cells": 16}
THICKNESS = 0.006


def figure(scene: tc.Scene, friction: float) -> float:
    """Trunk, head and two waving arms; returns the height of the head [m]."""
    def arm(side: float):
        def rotation(t: float) -> tuple[float, float, float]:
            return 0.0, 0.35 * math.sin(2.2 * t), side * (0.15 + 0.3 * math.sin(3.1 * t))
        return rotation

    scene.add_solid(tc.Capsule((0, 0.55, 0), (0, 1.05, 0), 0.14), friction, THICKNESS, name="trunk")
    scene.add_solid(tc.Sphere(0.11), friction, THICKNESS, position=(0.0, 1.35, 0.0), name="head")
    for side, name in ((1.0, "left arm"), (-1.0, "right arm")):
        scene.add_solid(tc.Capsule((0, 0, 0), (0.5 * side, 0, 0), 0.05), friction, THICKNESS, position=(0.15 * side, 1.1, 0.0),
                        rotation=arm(side), name=name)
    return 1.46


def build(cells: int = 50, data: str = "", friction: float = 0.4, size: float = 1.1, itself: bool = False,
          scale: float = 1.0, clip: str = "", rest: float = 0.0) -> tc.Scene:
    """A sheet that falls on the figure's head and shoulders while it moves.

    Args:
        cells: along the sheet's side.
        data: file with a body that moves, as tc.load_solid takes it (empty: a figure made here).
        friction: of cloth on the body and on itself.
        size: side of the sheet [m].
        itself: whether the sheet's folds meet each other too.
        scale: metres per unit of the file.
        clip: name of an animation in the file (empty: the first).
        rest: s in which a character goes from its rest pose to the clip's first frame [s] (0: begins with that).
    """
    scene = tc.Scene(view=tc.View(ground=-0.02, camera=tc.Camera((1.19, 1.48, 1.83), (-0.05, 0.98, 0.02), 36)))
    if data:
        body = tc.load_solid(data, scale, clip=clip or None, rest=rest or None)
        scene.add_solid(body, friction, THICKNESS, name="body")
        top = body.x[0][np.argmax(body.x[0][:, 1])]
    else:
        top = np.array([0.0, figure(scene, friction), 0.0])
    mesh = tc.grid(size, cells)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5)),
                    positions=mesh.x + top + [-size / 2, THICKNESS + 0.01, size / 2],
                    contact=tc.ClothContact(THICKNESS, friction) if itself else None)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold at any time."""
    from taichi_cloth.scene.intersections import count_crossings

    x, cloth = sim.positions(), sim.scene.cloths[0]
    crossed = sum(count_crossings(x, cloth.mesh.faces, s.surface_at(sim.time), s.shape.surface()[1])
                  for s in sim.scene.solids)
    yield f"{crossed} crossings of cloth and body", crossed == 0
    if cloth.contact is not None:
        yield f"{sim.intersections()} intersections of the cloth with itself", sim.intersections() == 0
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.4
    load = -sum(force[1] for force, _ in sim.solid_loads().values())
    yield f"the body carries {load:.2f} N", load > 0.2


if __name__ == "__main__":
    tc.run(build)
