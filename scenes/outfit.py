"""A dress and, over it, a jacket with a pocket and two buttons, sewn one after the other round a figure. Needs SciPy."""

import pathlib
from dataclasses import replace

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.4, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"spacing": 0.06}
PULL, FIRM = 100.0, 200.0  # N/m at most that closes seams of the dress, of the jacket
DRESSED, BEGUN, SEWN, WALKS = 0.7, 0.9, 2.3, 2.5  # s: the dress is let go, the jacket is sewn, is let go; steps begin
PACE, STEP, SWING = 1.8, 0.30, 0.16  # steps a second; rad by which legs and arms swing to either side
THICKNESS = 0.004
PATTERNS = pathlib.Path(__file__).parent / "patterns"
FRONT, POCKET = "left front", "pocket"


def dress() -> tc.Pattern:
    """That of the file, nearer to the figure, with armholes cut lower, so that nothing sticks out at the sides."""
    pattern = tc.load_pattern(PATTERNS / "dress.json")

    def cut(p: tc.Panel) -> tc.Panel:
        corners = p.corners.copy()
        if p.name.startswith("bodice"):
            corners[[2, 7]] = (0.20, 0.20), (-0.20, 0.20)
        return replace(p, corners=corners, translation=p.translation * [1, 1, 0.62])

    return replace(pattern, panels=tuple(cut(p) for p in pattern.panels))


def figure(scene: tc.Scene, friction: float, walk: bool) -> None:
    """Somebody made of capsules, whose legs and arms swing from the time at which steps begin."""
    def limb(name: str, a, b, radius: float, swing: float = 0.0) -> None:
        joint = np.array(max(a, b, key=lambda p: p[1]), dtype=float)

        def turn(t: float) -> np.ndarray:
            s = min(max((t - WALKS) / 0.5, 0.0), 1.0)
            angle = swing * s * s * (3 - 2 * s) * np.sin(np.pi * PACE * (t - WALKS))
            c, s = np.cos(angle), np.sin(angle)
            return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])

        moves = {"rotation": turn, "position": lambda t: joint - turn(t) @ joint} if walk and swing else {}
        scene.add_solid(tc.Capsule(a, b, radius), friction, THICKNESS, name=name, color=(0.62, 0.45, 0.36), **moves)

    limb("head", (0, 1.67, 0), (0, 1.70, 0), 0.10)
    limb("neck", (0, 1.40, 0), (0, 1.56, 0), 0.05)
    limb("shoulders", (-0.13, 1.385, 0), (0.13, 1.385, 0), 0.06)
    limb("hips", (-0.055, 0.94, 0), (0.055, 0.94, 0), 0.12)
    for side, name in ((1, "left"), (-1, "right")):
        limb(f"{name} trunk", (side * 0.05, 0.98, 0), (side * 0.05, 1.30, 0), 0.098)
        limb(f"{name} arm", (side * 0.19, 1.38, 0), (side * 0.60, 1.13, 0), 0.042, SWING * side)
        limb(f"{name} leg", (side * 0.165, 0.10, 0), (side * 0.09, 0.85, 0), 0.07, -STEP * side)


def build(spacing: float = 0.03, friction: float = 0.4, walk: bool = False) -> tc.Scene:
    """A dress and a jacket, as panels round a figure.

    Args:
        spacing: length of the triangles' edges [m].
        friction: of cloth on the figure and on cloth.
        walk: whether the figure walks on the spot after 2.5 s.
    """
    view = tc.View(ground=0.0, camera=tc.Camera((1.673, 1.785, 2.853), (0.271, 1.02, 0.304), 35))
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=view)
    figure(scene, friction, walk)
    under, over = dress().mesh(spacing), tc.load_pattern(PATTERNS / "jacket.json").mesh(spacing)
    light = tc.Fabric(0.15, tc.Stretch(400, 0.4), tc.Shear(50, 0.05), tc.Bend(1e-5, 1e-7))
    firm = tc.Fabric(0.25, tc.Stretch(600, 0.6), tc.Shear(80, 0.08), tc.Bend(5e-5, 5e-7))
    frock = scene.add_garment(under, light, name="dress", color=(0.72, 0.66, 0.50), contact=tc.ClothContact(0.003, friction),
                              pull=PULL)
    coat = scene.add_garment(over, firm, name="jacket",
                             color=tc.Appearance((0.13, 0.20, 0.36), panels={POCKET: (0.45, 0.16, 0.14)}, squares=False),
                             contact=tc.ClothContact(0.003, friction, layer=1), pull=FIRM)
    scene.pin(frock, "shoulder", "y")
    scene.pin(coat, range(over.mesh.vertex_count))

    def put_on() -> None:
        scene.unpin(coat)
        scene.pin(coat, "shoulder", "y")

    scene.at(DRESSED, lambda: scene.unpin(frock))
    scene.at(BEGUN, put_on)
    scene.at(SEWN, lambda: scene.unpin(coat))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after the jacket was let go."""
    dress, coat = sim.scene.cloths
    gaps, x = sim.seam_gaps(), sim.positions()
    yield f"all {len(gaps)} seams, pocket and buttons too, are closed: widest gap {gaps.max():.3g} m", gaps.max() == 0
    crossed = sim.intersections()
    yield f"{crossed} crossings of dress and jacket, with themselves and each other", crossed == 0
    for cloth, label, height in ((dress, "shoulder", 1.46), (coat, "shoulder", 1.46), (coat, "hem", 1.04)):
        at = x[cloth.start + cloth.mesh.groups[label], 1].mean()
        yield f"the {cloth.name} is worn: its {label} is at {at:.2f} m", abs(at - height) < 0.12
    front = x[coat.start + coat.mesh.groups[FRONT], 2].max(), x[dress.start + dress.mesh.groups["bodice front"], 2].max()
    yield f"the jacket is outside: its front is at {front[0]:.3f} m, the dress's at {front[1]:.3f}", front[0] > front[1]
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
