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
DRESS = pathlib.Path(__file__).parent / "patterns" / "dress.json"
LEFT, RIGHT, BACK, POCKET = "left front", "right front", "back", "pocket"
LEAN = np.radians(7.7)  # of fronts and back towards the shoulders
POCKET_SIZE = 0.12, 0.11  # m
BUTTONS = ((0.0, 0.22), (0.0, 0.34))  # m, in both fronts
CORNER = np.array([0.08, 0.21])  # m, in the left front, where the pocket's lower corner is


def panel(name: str, corners, edges, at, back: bool = False) -> tc.Panel:
    """A part of the jacket's body [cm], before the figure or behind it."""
    c, s = np.cos(LEAN), np.sin(LEAN)
    lean = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    turned = np.diag([-1.0, 1, -1]) if back else np.eye(3)
    return tc.Panel(name, np.array(corners) / 100, edges, np.array(at) / 100, turned @ lean)


def front(name: str, side: int, z: float) -> tc.Panel:
    """The half of the front on that side (1 or -1), which goes 3 cm over the middle."""
    corners = [(-3, 18), (25, 18), (22.5, 41), (19.5, 59), (8, 63), (-3, 40)]
    hole = (0.1144, 0.1865), (0.4766, 0.1928)
    edges = (tc.Curve(0, 1, label="hem"), tc.Curve(1, 2), tc.Curve(2, 3, "cubic", hole), tc.Curve(3, 4, label="shoulder"),
             tc.Curve(4, 5), tc.Curve(5, 0))
    if side < 0:
        corners = [(-x, y) for x, y in corners]
        hole = tuple((1 - u, v) for u, v in hole[::-1])
        edges = (tc.Curve(1, 0, label="hem"), tc.Curve(0, 5), tc.Curve(5, 4), tc.Curve(4, 3, label="shoulder"),
                 tc.Curve(3, 2, "cubic", hole), tc.Curve(2, 1))
    return panel(name, corners, edges, (0, 85, z))


def jacket() -> tc.Pattern:
    """Two fronts that overlap, a back, sleeves, and a pocket on the left front."""
    hole = (0.1144, 0.1865), (0.4766, 0.1928)
    other = tuple((1 - u, v) for u, v in hole[::-1])
    corners = [(-25, 18), (25, 18), (22.5, 41), (19.5, 59), (8, 63), (-8, 63), (-19.5, 59), (-22.5, 41)]
    edges = (tc.Curve(0, 1, label="hem"), tc.Curve(1, 2), tc.Curve(2, 3, "cubic", hole), tc.Curve(3, 4, label="shoulder"),
             tc.Curve(4, 5, "quadratic", ((0.5, 0.2),)), tc.Curve(5, 6, label="shoulder"),
             tc.Curve(6, 7, "cubic", other), tc.Curve(7, 0))
    w, h = POCKET_SIZE
    pocket = tc.Panel(POCKET, np.array([(0, 0), (w, 0), (w, h), (0, h)]), tuple(tc.Curve(k, (k + 1) % 4) for k in range(4)))
    left = front(LEFT, 1, 27)
    at = left.placed(CORNER[None])[0] + left.rotation @ [0, 0, 0.015]
    pocket = replace(pocket, translation=at, rotation=left.rotation)
    parts = (left, front(RIGHT, -1, 25), panel(BACK, corners, edges, (0, 85, -25), True), pocket)
    pattern = tc.Pattern((*parts, *(sleeve(f"{name} sleeve") for name in ("left", "right"))), tuple(seams()))
    for side, name in ((1, "left"), (-1, "right")):
        arm = np.array([[0.2071 * side, 1.3696, 0], [0.5008 * side, 1.1905, 0]])
        pattern = pattern.wrap(f"{name} sleeve", arm, 0.07, side * np.pi / 2)
    return pattern


def dress() -> tc.Pattern:
    """That of the file, nearer to the figure, with armholes cut lower, so that nothing sticks out at the sides."""
    pattern = tc.load_pattern(DRESS)

    def cut(p: tc.Panel) -> tc.Panel:
        corners = p.corners.copy()
        if p.name.startswith("bodice"):
            corners[[2, 7]] = (0.20, 0.20), (-0.20, 0.20)
        return replace(p, corners=corners, translation=p.translation * [1, 1, 0.62])

    return replace(pattern, panels=tuple(cut(p) for p in pattern.panels))


def sleeve(name: str) -> tc.Panel:
    """Before it is bent round an arm."""
    corners = np.array([(-13.5, 0), (13.5, 0), (17.5, 26), (0, 34.4), (-17.5, 26)]) / 100
    cap = (0.2389, 0.0975), (0.6052, -0.1895)
    return tc.Panel(name, corners, (tc.Curve(0, 1, label="cuff"), tc.Curve(1, 2), tc.Curve(2, 3, "cubic", cap),
                                    tc.Curve(3, 4, "cubic", tuple((1 - u, v) for u, v in cap[::-1])), tc.Curve(4, 0)))


def seams():
    """Sides, shoulders, sleeves; the pocket on three lines of the left front; two buttons."""
    yield tc.Stitch((LEFT, 1), (BACK, 7))
    yield tc.Stitch((RIGHT, 5), (BACK, 1))
    yield tc.Stitch((LEFT, 3), (BACK, 5))
    yield tc.Stitch((RIGHT, 3), (BACK, 3))
    for name, near, far in (("left", (LEFT, 2), (BACK, 6)), ("right", (BACK, 2), (RIGHT, 4))):
        yield tc.Stitch((f"{name} sleeve", 1), (f"{name} sleeve", 4))
        yield tc.Stitch((f"{name} sleeve", 2), far)
        yield tc.Stitch((f"{name} sleeve", 3), near)
    w, h = POCKET_SIZE
    for edge, ends in ((0, [(0, 0), (w, 0)]), (1, [(w, 0), (w, h)]), (3, [(0, h), (0, 0)])):
        yield tc.Stitch((POCKET, edge), (LEFT, CORNER + np.array(ends)), together=True)
    for button in BUTTONS:
        yield tc.Stitch((LEFT, [button]), (RIGHT, [button]))


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
    view = tc.View(ground=0.0, camera=tc.Camera((0.704, 1.243, 1.76), (0.038, 1.006, -0.017), 36))
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=view)
    figure(scene, friction, walk)
    under, over = dress().mesh(spacing), jacket().mesh(spacing)
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
    front = x[coat.start + coat.mesh.groups[LEFT], 2].max(), x[dress.start + dress.mesh.groups["bodice front"], 2].max()
    yield f"the jacket is outside: its front is at {front[0]:.3f} m, the dress's at {front[1]:.3f}", front[0] > front[1]
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
