"""A shirt: four panels hang round a figure, are sewn in the first three quarters of a second, and drape. Needs SciPy."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"spacing": 0.06}
SEWN = 0.8  # s at which shoulders are let go
FRONT, BACK, RIGHT, LEFT = "front", "back", "right sleeve", "left sleeve"
THICKNESS = 0.004
PULL = 100.0  # N/m by which seams close


def body_panel(name: str, z: float, neck: float) -> tc.Panel:
    """Front or back [m]: hem, sides, armholes, shoulders and a neckline that is `neck` of its width deep."""
    corners = np.array([[-26, 0], [26, 0], [26, 40], [21, 58], [8, 62], [-8, 62], [-21, 58], [-26, 40]]) / 100
    edges = (tc.Curve(0, 1, label="hem"), tc.Curve(1, 2), tc.Curve(2, 3, "quadratic", ((0.45, 0.22),)), tc.Curve(3, 4),
             tc.Curve(4, 5, "quadratic", ((0.5, 2 * neck),), "neckline"), tc.Curve(5, 6),
             tc.Curve(6, 7, "quadratic", ((0.55, 0.22),)), tc.Curve(7, 0))
    turned = np.diag([1.0, 1, 1]) if z > 0 else np.diag([-1.0, 1, -1])
    return tc.Panel(name, corners, edges, np.array([0, 0.87, z]), turned)


def sleeve(name: str, side: int) -> tc.Panel:
    """A sleeve, bent round the arm of that side (1 or -1)."""
    corners = np.array([[-16, 0], [16, 0], [18, 11], [0, 20.5], [-18, 11]]) / 100
    edges = (tc.Curve(0, 1, label="cuff"), tc.Curve(1, 2), tc.Curve(2, 3, "cubic", ((0.35, -0.1), (0.7, 0.25))),
             tc.Curve(3, 4, "cubic", ((0.3, 0.25), (0.65, -0.1))), tc.Curve(4, 0))
    down = np.array([side, -1, 0]) / np.sqrt(2)
    up = np.array([side, 1, 0]) / np.sqrt(2)
    axes = np.stack([np.cross(-down, up), -down, up], axis=1)
    return tc.Panel(name, corners, edges, np.array([side * 0.175, 1.395, 0]) + 0.285 * down, axes, 0.065)


def pattern() -> tc.Pattern:
    """The shirt: sides, shoulders, sleeves."""
    panels = (body_panel(FRONT, 0.18, 0.33), body_panel(BACK, -0.18, 0.09), sleeve(RIGHT, 1), sleeve(LEFT, -1))
    pairs = (((FRONT, 1), (BACK, 7)), ((FRONT, 7), (BACK, 1)), ((FRONT, 3), (BACK, 5)), ((FRONT, 5), (BACK, 3)),
             ((RIGHT, 1), (RIGHT, 4)), ((LEFT, 1), (LEFT, 4)), ((RIGHT, 2), (BACK, 6)), ((RIGHT, 3), (FRONT, 2)),
             ((LEFT, 2), (FRONT, 6)), ((LEFT, 3), (BACK, 2)))
    return tc.Pattern(panels, tuple(tc.Stitch(a, b) for a, b in pairs))


def figure(scene: tc.Scene, friction: float) -> None:
    """Somebody made of capsules, arms held out."""
    def limb(name: str, a, b, radius: float) -> None:
        scene.add_solid(tc.Capsule(a, b, radius), friction, THICKNESS, name=name, color=(0.62, 0.45, 0.36))

    reach = 0.42 / np.sqrt(2)
    limb("shoulders", (-0.13, 1.385, 0), (0.13, 1.385, 0), 0.06)
    limb("neck", (0, 1.40, 0), (0, 1.56, 0), 0.05)
    limb("head", (0, 1.67, 0), (0, 1.70, 0), 0.10)
    for side, name in ((1, "right"), (-1, "left")):
        limb(f"{name} trunk", (side * 0.06, 0.98, 0), (side * 0.05, 1.30, 0), 0.115)
        limb(f"{name} arm", (side * 0.17, 1.39, 0), (side * (0.17 + reach), 1.39 - reach, 0), 0.042)
        limb(f"{name} leg", (side * 0.09, 0.12, 0), (side * 0.08, 0.9, 0), 0.08)


def build(spacing: float = 0.03, friction: float = 0.3, stretch: float = 300.0) -> tc.Scene:
    """Panels round a figure.

    Args:
        spacing: length of the triangles' edges [m].
        friction: of cloth on the figure and on itself.
        stretch: stiffness [N/m].
    """
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=tc.View(ground=0.0, camera=tc.Camera((0.7, 1.5, 2.2), (0, 1.12, 0), 36)))
    figure(scene, friction)
    garment = pattern().mesh(spacing)
    fabric = tc.Fabric(0.187, tc.Stretch(stretch, stretch / 1000), tc.Shear(37, 0.04), tc.Bend(1e-5, 1e-7))
    cloth = scene.add_garment(garment, fabric, name="shirt", color=(0.20, 0.35, 0.62),
                              contact=tc.ClothContact(0.003, friction), pull=PULL)
    groups = garment.mesh.groups
    above = np.flatnonzero(garment.mesh.uv[:, 1] > 0.57)
    shoulders = above[np.isin(above, np.concatenate([groups[FRONT], groups[BACK]]))]
    scene.pin(cloth, shoulders, "y")
    scene.at(SEWN, lambda: scene.unpin(cloth))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a second."""
    x, seams = sim.positions(), sim.scene.seams
    gap = max(float(np.abs(x[s.a] - x[s.b]).max()) for s in seams)
    yield f"all {len(seams)} seams are closed: widest gap {gap:.3g} m", gap == 0
    low = x[:, 1].min()
    yield f"it is worn: its hem is at {low:.2f} m", 0.6 < low < 1.0
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3
    crossed = sim.intersections()
    yield f"{crossed} crossings with itself", crossed == 0


if __name__ == "__main__":
    tc.run(build)
