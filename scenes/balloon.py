"""Two disks of foil, sewn at the rim, blown up on a string: the rim puckers. Then the hose is shut, and a ball hits it."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.8, "fps": 30, "h": 1 / 120}
SMALL = {"rings": 5}
RADIUS, FILLED, SHUT = 0.22, 0.6, 0.8  # m, s, s


def build(rings: int = 14, pressure: float = 150.0) -> tc.Scene:
    """A closed skin of two disks.

    Args:
        rings: of either disk's mesh, from the middle to the border.
        pressure: of the hose over that outside [Pa].
    """
    scene = tc.Scene(air=tc.Air(normal=0.4), view=tc.View(
        tc.Camera((0.52, 0.02, 0.85), (-0.03, -0.21, 0.14), 34.0), ground=-0.6))
    disk = tc.disk(RADIUS, rings, plane="xy")
    n, rim = disk.vertex_count, disk.groups["rim"]
    bulge = np.outer(0.02 * (1 - (disk.x**2).sum(axis=1) / RADIUS**2), [0, 0, 1])
    mesh = tc.TriMesh(np.concatenate([disk.x + bulge, disk.x - bulge]), np.concatenate([disk.faces, disk.faces + n]),
                      np.tile(disk.uv, (2, 1)), {"rim": rim})
    foil = tc.Fabric(0.06, tc.Stretch(4000, k_d=1.0), tc.Shear(400, k_d=0.1), tc.Bend(2e-5, k_d=2e-7))
    cloth = scene.add_cloth(mesh, foil, mesh.x - [0, RADIUS, 0], name="balloon", color=(0.75, 0.12, 0.2))
    scene.sew(cloth, rim, rim + n, stiffness=0.2)
    top = int(rim[disk.x[rim, 1].argmax()])
    scene.pin(cloth, top)
    scene.inflate(cloth, lambda t: pressure * min(1.0, t / FILLED))
    scene.at(SHUT, lambda s: s.inflate(cloth, gas="isothermal"))
    scene.add_solid(tc.Sphere(0.09), friction=0.2, thickness=0.004, name="ball", color=(0.2, 0.25, 0.5),
                    position=lambda t: (0.02, -RADIUS, 0.42 - 0.32 * np.sin(np.pi * np.clip((t - 1.0) / 0.6, 0, 1)) ** 2))
    return scene


def check(sim: "tc.Simulation"):
    """Its rim is drawn in and it is plump, as a Mylar balloon; what was shut in is still there, and the seam is closed."""
    log, shut = sim.log, [r for r in sim.log if r.t > SHUT + 0.05]
    V = log[-1].gas["balloon"][0] / RADIUS**3
    yield f"it holds {V:.3f} radii cubed, a Mylar balloon 1.219", 0.9 < V < 1.35
    x = sim.positions()[sim.scene.cloths[0].mesh.groups["rim"]]
    wide = np.linalg.norm(x - x.mean(axis=0), axis=1).mean() / RADIUS
    yield f"its rim is {wide:.2f} of the disk's, a Mylar balloon's .76", 0.7 < wide < 0.96
    amount = np.array([(r.gas["balloon"][1] + 101_325.0) * r.gas["balloon"][0] for r in shut])
    yield f"what is shut in stays the same to {np.ptp(amount) / amount[0]:.1e}", np.ptp(amount) < 1e-6 * amount[0]
    p = np.array([r.gas["balloon"][1] for r in shut])
    yield f"its pressure goes from {p[0]:.0f} to {p[-1]:.0f} Pa as it settles and the ball hits it", p.min() > 20
    yield f"the ball touched it with {max(r.contacts for r in log)} vertices", max(r.contacts for r in log) > 0
    yield f"its seam is closed to {sim.seam_gaps().max():.1e} m", sim.seam_gaps().max() < 1e-6
    yield f"largest stretch {max(r.stretch for r in log):.3f}", max(r.stretch for r in log) < 1.15


if __name__ == "__main__":
    tc.run(build)
