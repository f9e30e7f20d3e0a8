"""Random drives: a box, capsule, torus of triangles or needle driven into a sheet that hangs or is held all round, and that
may meet itself.

Two meshes of cloth and one of the torus: scenes of the same make share their compiled kernels.
"""

import numpy as np
from fuzz import Outcome

from . import judged

TORUS = """a, b = np.meshgrid(np.arange({n}), np.arange({m}), indexing="ij")
turn, tube = 2 * np.pi * a.ravel() / {n}, 2 * np.pi * b.ravel() / {m}
ring = {R} + {r} * np.cos(tube)
torus = np.column_stack([ring * np.cos(turn), ring * np.sin(turn), {r} * np.sin(tube)])
corner = [(((a + i) % {n}) * {m} + (b + j) % {m}).ravel() for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
shape = tc.SolidMesh(torus, np.concatenate([np.stack(corner)[[0, 1, 2]].T, np.stack(corner)[[0, 2, 3]].T]))
"""
NEEDLE = """x = np.array([[{r}, 0, -{l}], [-{r}, {r}, -{l}], [-{r}, -{r}, -{l}], [0, 0, 0]])
shape = tc.SolidMesh(x, [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
"""
SCENE = """mesh = tc.grid(0.5, {cells}, plane="xy")
scene = tc.Scene()
fabric = tc.Fabric({density}, tc.Stretch({k}, {k_d}), tc.Shear({k_s}), tc.Bend({D}))
cloth = scene.add_cloth(mesh, fabric, positions=mesh.x - [0.25, 0.25, 0], contact={contact})
pinned = np.flatnonzero({held})
scene.pin(cloth, pinned)
{shape}scene.add_solid(shape, friction={friction}, thickness={thickness}, rotation={rotation},
                position=lambda t: ({x}, {y}, {z} + min({speed} * t, {way})))
sim = tc.Simulation(scene, h={h}, precision=precision, threads=1)
"""
HELD = {"top": "mesh.x[:, 1] > 0.4999", "corners": "(mesh.x[:, 1] > 0.4999) & (np.abs(mesh.x[:, 0] - 0.25) > 0.2499)",
        "rim": "np.abs(mesh.x[:, :2] - 0.25).max(axis=1) > 0.2499"}
REACH = 0.12  # m from a solid's origin that it may extend


def case(seed: int) -> tuple[str, int]:
    """(lines of code, steps) of a drive."""
    rng = np.random.default_rng(seed)

    def pick(low: float, high: float) -> float:
        return float(f"{np.exp(rng.uniform(np.log(low), np.log(high))):.3g}")

    def place(size: float) -> float:
        return round(float(rng.uniform(-size, size)), 3)

    kind = rng.choice(["box", "capsule", "torus", "needle"])
    if kind == "box":
        sides = ", ".join(str(pick(0.01, 0.12)) for _ in range(3))
        shape = f"shape = tc.Box(({sides}), {rng.choice([0.0, 0.002])})\n"
    elif kind == "capsule":
        shape = f"shape = tc.Capsule(({place(.06)}, 0, 0), (0, {place(.06)}, 0.03), {pick(0.004, 0.04)})\n"
    elif kind == "torus":
        shape = TORUS.format(n=12, m=7, R=pick(0.04, 0.08), r=pick(0.01, 0.03))
    else:
        shape = NEEDLE.format(r=pick(0.002, 0.02), l=0.1)
    speed, way = pick(0.1, 20.0), round(float(rng.uniform(0.15, 0.35)), 3)
    h = float(rng.choice([1 / 240, 1 / 60, 1 / 30, 1 / 15]))
    k = pick(100.0, 1e4)
    turned = [0.0, 0.0, 0.0] if kind == "needle" else [place(3.0) for _ in range(3)]
    held = str(rng.choice(list(HELD)))
    code = SCENE.format(cells=rng.choice([6, 10]), density=pick(0.05, 0.5), k=k, k_d=round(k / 1000, 4), k_s=round(k / 10, 2),
                        D=pick(1e-6, 1e-3), held=HELD[held], shape=shape,
                        friction=round(float(rng.uniform(0, 0.8)), 2), thickness=pick(0.002, 0.008),
                        rotation=tuple(turned), x=place(.1), y=place(.1) if held == "rim" else round(place(.15) - .05, 3),
                        z=-REACH - 0.01, speed=speed, way=way, h=f"{h:.6g}",
                        contact="tc.ClothContact(0.004, 0.3)" if rng.random() < 0.5 else "None")
    return code, int(min(max(way / speed / h + 4, 6), 90))


def trial(seed: int, precision: str) -> Outcome:
    """One drive."""
    code, steps = case(seed)
    return judged.run(code, steps, precision)
