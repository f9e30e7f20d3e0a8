"""A trampoline: pinned rim, centre pushed down by moving pins, then released."""

import math

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.5, "fps": 40, "h": 1 / 120}
SMALL = {"rings": 6}

PUSH, RELEASE = 0.35, 0.6  # depth [m] and time of release [s]


def build(rings: int = 24, stretch: float = 3000.0) -> tc.Scene:
    """A disk of radius 1 m.

    Args:
        rings: of its mesh, from the middle to the border.
        stretch: stiffness [N/m].
    """
    mesh = tc.disk(1.0, rings)
    fabric = tc.Fabric(0.3, tc.Stretch(stretch, k_d=0.5, b=0.98), tc.Shear(stretch / 5, k_d=0.1), tc.Bend(1e-4, k_d=1e-7))
    scene = tc.Scene(view=tc.View(tc.Camera((0, 0.99, 2.46), (0, -0.2, 0.08), 40.0), ground=-0.6))
    cloth = scene.add_cloth(mesh, fabric, color=(0.06, 0.19, 0.46))
    scene.pin(cloth, "rim")
    middle = np.flatnonzero(np.linalg.norm(mesh.x, axis=1) < 0.26)
    scene.move(cloth, middle, lambda t: (0, -PUSH * math.sin(math.pi / 2 * min(t / RELEASE, 1)) ** 2, 0), relative=True)
    scene.at(RELEASE, lambda scene: scene.unpin(cloth, middle))
    return scene


def check(sim: "tc.Simulation"):
    """The centre was down, came up past the rim, and the rim held."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    rim = mesh.select("rim")
    yield "the rim holds", bool(np.abs(x[rim] - mesh.x[rim]).max() < 1e-6)
    strain = [sum(v for k, v in r.energies.items() if k.startswith(("stretch", "shear"))) for r in sim.log]
    release = next(i for i, r in enumerate(sim.log) if r.t > RELEASE)
    yield f"strain energy {strain[release - 1]:.2f} J when released, the largest of all", (
        abs(max(strain) / strain[release - 1] - 1) < 0.05)
    yield f"it falls to {min(strain[release:]):.2f} J as the centre flies up", min(strain[release:]) < 0.5 * max(strain)
    yield f"the step ends at the release: t = {sim.log[release - 1].t!r} s", sim.log[release - 1].t == RELEASE


if __name__ == "__main__":
    tc.run(build)
