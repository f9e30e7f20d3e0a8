"""A ridge tent in gusts from the side, one sheet pegged down along its hems: the wind presses it in here and sucks there."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 3.0, "fps": 30, "h": 1 / 60, "integrator": "backward_euler"}
SMALL = {"cells": 8}
LENGTH, HEIGHT, HALF, SLACK = 2.0, 1.05, 0.75, 1.01  # m; the sheet is so much larger than the frame
RISES, CAP = 0.5, 0.2  # s in which the wind gets up; part of a slope that a pole's cap holds


def build(cells: int = 28, speed: float = 9.0, gusts: float = 2.5, seed: int = 3) -> tc.Scene:
    """A sheet over a ridge.

    Args:
        cells: along the ridge.
        speed: mean wind [m/s].
        gusts: root mean square of the gusts that come on top [m/s].
        seed: of the gusts: another number, other gusts.
    """
    cells -= cells % 4
    wind = tc.Gusts((0.15 * speed, 0.0, speed), gusts, length=2.0, seed=seed)
    air = tc.Air(wind=lambda x, t: min(1.0, t / RISES) * wind(x, t), drag=1.1, lift=0.9)
    scene = tc.Scene(air=air, view=tc.View(tc.Camera((2.8, 1.09, -1.88), (0.11, 0.28, 0.07), 34.0), ground=0.0))
    slant = np.hypot(HEIGHT, HALF)
    sheet = tc.grid((SLACK * LENGTH, 2 * SLACK * slant), (cells, cells))
    along, down = sheet.uv[:, 0] / (SLACK * LENGTH), sheet.uv[:, 1] / (SLACK * slant) - 1  # down from the ridge, -1 to 1
    x = np.stack([LENGTH * (along - 0.5), 0.01 + HEIGHT * (1 - np.abs(down)), -HALF * down], axis=1)
    groups = {**sheet.groups, "ridge": np.flatnonzero(np.abs(down) < 1e-9), "windward": down > 0.3, "lee": down < -0.3}
    mesh = tc.TriMesh(sheet.x, sheet.faces, sheet.uv, {k: np.flatnonzero(v) if k in ("windward", "lee") else v
                                                       for k, v in groups.items()})
    ripstop = tc.Fabric(0.07, tc.Stretch(9000, k_d=3.0), tc.Shear(600, k_d=0.3), tc.Bend(3e-5, k_d=3e-7))
    cloth = scene.add_cloth(mesh, ripstop, x, name="tent", color=(0.62, 0.42, 0.1))
    pegs = np.abs(along * 4 - np.round(along * 4)) < 1e-9
    hem = np.isin(np.arange(len(x)), np.concatenate([mesh.groups["top"], mesh.groups["bottom"]]))
    ends = np.isin(np.arange(len(x)), np.concatenate([mesh.groups["left"], mesh.groups["right"]]))
    scene.pin(cloth, (pegs & hem) | (ends & (np.abs(down) < CAP)))
    return scene


def check(sim: "tc.Simulation"):
    """It stands, pressed in where the wind comes from and blown out behind; the pegs hold what the wind pulls."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    flat = np.array([[0, HALF, HEIGHT], [0, HALF, -HEIGHT]]) / np.hypot(HEIGHT, HALF)  # outward, of lee and windward side
    ridge = np.array([0.0, 0.01 + HEIGHT, 0.0])
    out = {name: float(np.mean((x[mesh.groups[name]] - ridge) @ n)) for name, n in zip(("lee", "windward"), flat)}
    sides = f"windward side {100 * out['windward']:.1f} cm out, lee side {100 * out['lee']:.1f} cm"
    yield sides, out["windward"] < out["lee"] - 0.02
    yield f"the ridge sags to {x[mesh.groups['ridge'], 1].min():.2f} m", x[mesh.groups["ridge"], 1].min() > 0.7 * HEIGHT
    pull = -sim.constraint_forces().sum(axis=0)
    yield f"the wind pulls at its pegs and poles with {pull[2]:.1f} N across", pull[2] > 1
    yield f"largest stretch {max(r.stretch for r in sim.log):.3f}", max(r.stretch for r in sim.log) < 1.15


if __name__ == "__main__":
    tc.run(build)
