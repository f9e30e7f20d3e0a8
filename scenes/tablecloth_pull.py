"""A cloth is jerked away under another: friction draws the upper one along until it goes as fast."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 1.2, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 12}
THICKNESS, REST, SPEED = 0.005, 0.3, 1.5  # m, s before the pull, m/s


def build(cells: int = 50, friction: float = 0.25, acceleration: float = 8.0) -> tc.Scene:
    """A cloth of 0.8 m x 0.6 m under one of 0.3 m x 0.3 m.

    Args:
        cells: along the longer side of the lower cloth.
        friction: of cloth on cloth.
        acceleration: with which the lower cloth is pulled away [m/s^2].
    """

    def pull(t: float) -> tuple[float, float, float]:
        s, up = max(t - REST, 0.0), SPEED / acceleration
        return (acceleration * min(s, up) ** 2 / 2 + SPEED * max(s - up, 0.0), 0.0, 0.0)

    scene = tc.Scene(view=tc.View(camera=tc.Camera((1.15, 0.98, 1.98), (1.02, -0.11, 0.06), 50), ground=-0.005))
    fabric = tc.Fabric(0.2, tc.Stretch(1000, k_d=0.5), tc.Shear(100, k_d=0.05), tc.Bend(5e-5, k_d=1e-6))
    lower = tc.grid((0.8, 0.6), (cells, 3 * cells // 4))
    upper = tc.grid(0.3, 3 * cells // 8)
    cloth = scene.add_cloth(lower, fabric, positions=lower.x + [0, 0, 0.3], color=(0.5, 0.08, 0.07), name="lower",
                            contact=tc.ClothContact(THICKNESS, friction))
    scene.add_cloth(upper, fabric, positions=upper.x + [0.42, THICKNESS, 0.15], color=(0.75, 0.72, 0.62), name="upper",
                    contact=tc.ClothContact(THICKNESS, friction))
    scene.add_solid(tc.Plane(), friction=0.1, thickness=0.005, name="table", position=(0, -0.005, 0))
    scene.move(cloth, "right", pull, relative=True)
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    x, lower = sim.positions(), sim.scene.cloths[0].mesh.vertex_count
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0
    moved = float((x[lower:] - sim.scene.cloths[1].positions)[:, 0].mean())
    gains, t = sim.scene.cloths[1].contact.friction * 9.81, sim.time - REST  # m/s^2 until it goes with the lower one
    slips = SPEED / max(gains, 1e-9)
    expected = gains * min(t, slips) ** 2 / 2 + SPEED * max(t - slips, 0.0)
    yield f"the upper one went {moved:.2f} m, as friction says {expected:.2f} m", abs(moved - expected) < 0.1 * expected + 0.01
    flat = np.ptp(x[lower:, 1])
    yield f"the upper one stays flat within {flat * 1e3:.1f} mm", flat < 0.05


if __name__ == "__main__":
    tc.run(build)
