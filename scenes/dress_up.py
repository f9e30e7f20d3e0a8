"""Panels from a pattern's file round a figure: sewn, let go and draped; by default a skirt with darts. Needs SciPy."""

import pathlib

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.0, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3}
SMALL = {"spacing": 0.05}
PULL = 100.0  # N/m at most that closes seams
SEWN = 1.0  # s at which what is held up is let go
THICKNESS = 0.004
PATTERN = pathlib.Path(__file__).parent / "patterns" / "skirt.json"


def figure(scene: tc.Scene, friction: float) -> None:
    """Somebody made of capsules, from head to foot."""
    def limb(name: str, a, b, radius: float) -> None:
        scene.add_solid(tc.Capsule(a, b, radius), friction, THICKNESS, name=name, color=(0.62, 0.45, 0.36))

    limb("head", (0, 1.67, 0), (0, 1.70, 0), 0.10)
    limb("neck", (0, 1.40, 0), (0, 1.56, 0), 0.05)
    limb("shoulders", (-0.13, 1.385, 0), (0.13, 1.385, 0), 0.06)
    limb("hips", (-0.055, 0.94, 0), (0.055, 0.94, 0), 0.12)
    for side, name in ((1, "right"), (-1, "left")):
        limb(f"{name} trunk", (side * 0.05, 0.98, 0), (side * 0.05, 1.30, 0), 0.098)
        limb(f"{name} arm", (side * 0.19, 1.38, 0), (side * 0.60, 1.13, 0), 0.042)
        limb(f"{name} leg", (side * 0.165, 0.10, 0), (side * 0.09, 0.85, 0), 0.07)


def build(pattern: str = "", body: str = "", spacing: float = 0.03, friction: float = 0.4, held: str = "", turn: float = 0.0,
          shift: tuple[float, float, float] = (0.0, 0.0, 0.0), scale: float = 1.0, up: str = "", side: str = "",
          pattern_size: str = "") -> tc.Scene:
    """Hangs the panels, to be sewn.

    Args:
        pattern: file with panels and stitches, as `dress` takes it; patterns/ has five (empty: a skirt with darts).
        body: file with a mesh or a character, as tc.load_solid takes it (empty: a figure made of capsules).
        spacing: length of the triangles' edges [m].
        friction: of cloth on the body and on itself.
        held: label of the edges that are held up while panels are sewn (empty: shoulders, or the waist).
        turn: of the pattern about the vertical, z towards x, to where the body faces [degrees].
        shift: x,y,z by which the pattern is then moved [m].
        scale: metres per unit of the body's file.
        up: axis of the body's file that points up, y or z (empty: its own, or y).
        side: file with stitches of an SVG, a DXF or an OBJ (empty: the one of its name).
        pattern_size: name of a size, of a DXF with several.
    """
    loaded = tc.load_pattern(pattern or PATTERN, side or None, size=pattern_size or None)
    garment = loaded.mesh(spacing).placed(turn, shift)
    at = float(np.mean([garment.positions[:, 1].min(), garment.positions[:, 1].max()]))  # m, where it hangs
    x, _, z = shift
    view = tc.View(ground=0.0, camera=tc.Camera((x + 0.8, at + 0.35, z + 1.9), (x, at, z), 34))
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=view)
    if body:
        scene.add_solid(tc.load_solid(body, scale, up=up or None), friction, THICKNESS, name="body", color=(0.62, 0.45, 0.36))
    else:
        figure(scene, friction)
    fabric = tc.Fabric(0.19, tc.Stretch(400, 0.4), tc.Shear(50, 0.05), tc.Bend(2e-5, 2e-7))
    cloth = scene.add_garment(garment, fabric, name="garment", color=(0.13, 0.30, 0.28),
                              contact=tc.ClothContact(0.003, friction), pull=PULL)
    held = held or next((label for label in ("shoulder", "waist") if label in garment.mesh.groups), "")
    if held:
        scene.pin(cloth, held, "y")
        scene.at(SEWN, lambda: scene.unpin(cloth))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a second."""
    cloth, gaps = sim.scene.cloths[0], sim.seam_gaps()
    yield f"all {len(gaps)} seams are closed: widest gap {gaps.max():.3g} m", gaps.max() == 0
    x, hung, groups = sim.positions(), cloth.mesh.x, cloth.mesh.groups
    for label in [label for label in ("shoulder", "waist", "hem", "cuff") if label in groups]:
        at, was = x[groups[label], 1].mean(), hung[groups[label], 1].mean()
        yield f"it is worn: {label} at {at:.2f} m, hung at {was:.2f}", abs(at - was) < 0.1
    ring = groups["waist" if "waist" in groups else "hem"]
    around = np.ptp(np.arctan2(x[ring, 2], x[ring, 0]))
    yield f"it goes round: {np.degrees(around):.0f} degrees", around > 5.5
    crossed = sim.intersections()
    yield f"{crossed} crossings with itself", crossed == 0
    yield f"largest stretch {sim.log[-1].stretch:.3f}", sim.log[-1].stretch < 1.3


if __name__ == "__main__":
    tc.run(build)
