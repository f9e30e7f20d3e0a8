"""Random scenes: soft and stiff, light and heavy sheets on jittered meshes, thrown at solids that stand still or move.

Stiffness goes over eight decades and density over four, steps from 1/240 to 1/10 s, speeds up to 20 m/s. Scenes are of a few
makes, which share their compiled kernels.
"""

import numpy as np
from fuzz import Outcome

from . import drives, judged

SCENE = """flat = tc.grid(0.4, {cells})
shift = np.random.default_rng({seed}).uniform(-{jitter}, {jitter}, (len(flat.x), 2)) * 0.4 / {cells}
shift[np.abs(flat.uv - 0.2).max(axis=1) > 0.199] = 0
mesh = tc.TriMesh(flat.x + np.insert(shift * [1, -1], 1, 0, axis=1), flat.faces, flat.uv + shift)
scene = tc.Scene()
fabric = tc.Fabric({density}, tc.Stretch({k}, {k_d}), tc.Shear({k_s}), tc.Bend({D}))
cloth = scene.add_cloth(mesh, fabric, positions=mesh.x + [-0.2, 0.3, 0.2], velocities={v}, contact={contact})
pinned = np.flatnonzero({held})
if len(pinned):
    scene.pin(cloth, pinned)
{solids}sim = tc.Simulation(scene, h={h}, precision=precision, threads=1)
"""
HELD = {"nothing": "np.zeros(len(mesh.x))", "edge": "mesh.x[:, 0] < 0.001",
        "corners": "(mesh.x[:, 0] < 0.001) & (np.abs(mesh.x[:, 2] + 0.2) > 0.199)"}
SOLID = "scene.add_solid({shape}, friction={friction}, thickness={thickness}, position={position})\n"
SHAPES = {"ball": ("", "tc.Sphere({a})"), "capsule": ("", "tc.Capsule((-{b}, 0, 0), ({b}, 0, 0.02), {a} / 3)"),
          "box": ("", "tc.Box(({a}, {a} / 2, {b}))"), "torus": (drives.TORUS.format(n=12, m=7, R="{a}", r="{a} / 3"), "shape")}


def case(seed: int) -> tuple[str, int]:
    """(lines of code, steps) of a scene."""
    rng = np.random.default_rng(seed)

    def pick(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")

    kind, floor, moves = str(rng.choice(list(SHAPES))), rng.random() < 0.5, rng.random() < 0.5
    h = float(rng.choice([1 / 240, 1 / 60, 1 / 30, 1 / 10]))
    k = pick(10.0, 1e9)
    a, b = str(pick(0.05, 0.12)), str(pick(0.02, 0.1))
    before, shape = (part.replace("{a}", a).replace("{b}", b) for part in SHAPES[kind])
    way, rate = round(float(rng.uniform(0, 0.06)), 3), pick(1, 20)
    position = f"lambda t: ({way} * np.sin({rate} * t), 0.1, 0.0)" if moves else "(0.0, 0.1, 0.0)"
    rough = {"friction": round(float(rng.uniform(0, 1)), 2), "thickness": pick(0.002, 0.006)}
    solids = before + SOLID.format(shape=shape, position=position, **rough)
    if floor:
        solids += SOLID.format(shape="tc.Plane()", position="(0.0, -0.1, 0.0)", **rough)
    v = rng.normal(size=3)
    v *= pick(0.05, 20) * (rng.random() < 0.7) / np.linalg.norm(v)
    v[1] = -abs(v[1])
    code = SCENE.format(cells=8, seed=seed, jitter=round(float(rng.uniform(0, 0.25)), 3), density=pick(0.01, 100), k=k,
                        k_d=float(f"{k / 1000:.3g}"), k_s=float(f"{k / 10:.3g}"), D=pick(1e-7, 1e-2),
                        v=tuple(round(float(c), 3) for c in v),
                        contact="tc.ClothContact(0.004, 0.3)" if rng.random() < 0.5 else "None",
                        held=HELD[str(rng.choice(list(HELD)))], solids=solids, h=f"{h:.6g}")
    return code, int(min(max(0.5 / h, 6), 40))


def trial(seed: int, precision: str) -> Outcome:
    """One scene."""
    code, steps = case(seed)
    return judged.run(code, steps, precision)
