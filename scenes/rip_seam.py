"""Two panels sewn down the middle are pulled apart: the seam rips from the top, stitch by stitch, to a bar that holds."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.2, "fps": 30, "h": 1 / 60, "integrator": "backward_euler"}
SMALL = {"n": 8}
STRENGTH = 400.0  # N/m of the seam
THICKNESS = 0.004
UNEVEN = 1e-4  # m by which no cloth is flat: what is exactly flat never buckles


def panels(n: int) -> tuple[tc.TriMesh, np.ndarray, np.ndarray]:
    """Two panels of .25 x .6 m side by side, of n cells across each, and the rows along which they meet, from the top."""
    one = tc.grid((0.25, 0.6), (n, round(2.4 * n)), plane="xy")
    k = one.vertex_count
    x = np.concatenate([one.x - [0.251, 0, 0], one.x + [0.001, 0, 0]])
    x[:, 2] += UNEVEN * np.sin(50 * x[:, 0] + 20 * x[:, 1])
    mesh = tc.TriMesh(x, np.concatenate([one.faces, one.faces + k]),
                      np.concatenate([one.uv - [0.25, 0], one.uv]), {"left": np.arange(k), "right": np.arange(k, 2 * k)})
    along = np.argsort(-one.uv[:, 1], kind="stable")
    side = one.uv[along, 0]
    return mesh, along[side > 0.25 - 1e-9], k + along[side < 1e-9]


def build(n: int = 12, strength: float = STRENGTH, reach: float = 0.25) -> tc.Scene:
    """Two panels and the seam between them.

    Args:
        n: cells across each panel.
        strength: force a length at which the seam rips [N/m].
        reach: by which corners go apart, each in a second [m].
    """
    scene = tc.Scene(air=tc.Air(0.5, 0.1), view=tc.View(camera=tc.Camera((0.2, 0.39, 1.38), (0.02, 0.34, 0.01), 36)))
    mesh, a, b = panels(n)
    fabric = tc.Fabric(0.2, tc.Stretch(1500, 1.5), tc.Shear(150, 0.15), tc.Bend(5e-5, 5e-7))
    cloth = scene.add_cloth(mesh, fabric, name="cloth", color=(0.25, 0.38, 0.55), contact=tc.ClothContact(THICKNESS, 0.3))
    scene.sew(cloth, a[:-2], b[:-2], strength=strength)
    scene.stitch(cloth, a[-2:], b[-2:])  # a bar: it holds
    top = mesh.uv[:, 1] > 0.6 - 1e-9
    for side, outer in ((-1, mesh.uv[:, 0] < -0.15), (1, mesh.uv[:, 0] > 0.15)):
        scene.move(cloth, np.flatnonzero(top & outer), lambda t, s=side: (s * reach * min(t, 1.0) ** 2, 0, 0), relative=True)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold at the end."""
    seam, bar = sim.scene.seams
    x, (ripped, undone) = sim.positions(), sim.stitches_open()
    gaps = np.linalg.norm(x[seam.a] - x[seam.b], axis=1)
    yield f"{ripped.sum()} of {len(ripped)} stitches have given, from the top", bool(ripped.sum() > 2 and (
        np.diff(ripped.astype(int)) <= 0).all())
    yield f"what is open is open: at most {gaps.max():.3g} m", bool((gaps[~ripped] == 0).all() and gaps[0] > 0.05)
    yield "the bar holds", bool(not undone.any() and (x[bar.a] == x[bar.b]).all())
    pulled, left = (sum(r.ledger[name] for r in sim.log) for name in ("pins", "unaccounted"))
    yield f"of {pulled:.2f} J that pulled {left:.2f} J are unaccounted for", abs(left) < 0.1 * pulled
    yield f"nothing passes through anything: {sim.intersections()}", sim.intersections() == 0


if __name__ == "__main__":
    tc.run(build)
