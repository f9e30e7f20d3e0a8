"""A shirt's front is folded flat, pressed, carried to a line and hung up: it falls open, and its creases stay."""

import numpy as np

import taichi_cloth as tc

RUN = {"duration": 2.4, "fps": 30, "h": 1 / 60, "cg_tol": 1e-3, "integrator": "backward_euler"}
SMALL = {"cells": 10}
WIDTH, LENGTH, SLEEVE = 0.5, 0.6, 0.2  # m: of the body, and how far a sleeve goes beyond it
CUFF, MIDDLE, HEM = 0.45, 0.4, 0.15  # m above the hem: lower edge of the sleeves, and the two folds across
FOLDED = ((0.0, 0.3, 0.01), (0.2, 0.5, 0.05), (0.4, 0.8, 0.15))  # s, s, rad short of flat: sleeves, hem, middle
LIFTED, HUNG, HEIGHT, HARDENING = 0.8, 1.2, 0.8, 0.1  # s, s, m


def shirt(cells: int) -> tc.TriMesh:
    """Body and sleeves in one, with a neckline: `uv` from the middle of the hem [m]."""
    size = WIDTH / cells
    grid = tc.grid((WIDTH + 2 * SLEEVE, LENGTH), (round((WIDTH + 2 * SLEEVE) / size), round(LENGTH / size)))
    uv = grid.uv - [WIDTH / 2 + SLEEVE, 0]
    u, v = np.abs(uv[grid.faces].mean(axis=1)).T
    faces = grid.faces[((u < WIDTH / 2) | (v > CUFF)) & ~((u / 0.1) ** 2 + ((LENGTH - v) / 0.07) ** 2 < 1)]
    used = np.unique(faces)
    return tc.TriMesh(np.column_stack([uv[used, 0], 0 * used, -uv[used, 1]]), np.searchsorted(used, faces), uv[used])


def part(t: float, begin: float, end: float) -> float:
    """From 0 to 1, smoothly."""
    s = min(max((t - begin) / (end - begin), 0.0), 1.0)
    return s * s * (3 - 2 * s)


def turned(x: np.ndarray, which: np.ndarray, at: float, axis: int, side: float, angle: float) -> None:
    """Turns some of points x (n, 3), (across, up the shirt, above it), up and over a line at `at` on an axis of it."""
    c, s = np.cos(angle), np.sin(angle)
    beyond, above = side * (x[which, axis] - at), x[which, 2]
    x[which, axis], x[which, 2] = at + side * (c * beyond - s * above), s * beyond + c * above


def build(cells: int = 40, stays: float = 0.9) -> tc.Scene:
    """A shirt's front on a table.

    Args:
        cells: across the body, in tens.
        stays: angle at which folds stay where nothing pulls; it sets where the fabric yields [rad].
    """
    mesh = shirt(10 * max(1, round(cells / 10)))
    size = WIDTH / (10 * max(1, round(cells / 10)))
    yields = (np.pi - 0.1 - stays / (1 - HARDENING)) / size
    fabric = tc.Fabric(0.15, tc.Stretch(600, 0.6), tc.Shear(100, 0.1),
                       tc.Bend(5e-5, 1e-7, friction=2e-4, yield_=yields, hardening=HARDENING))
    scene = tc.Scene(air=tc.Air(0.6, 0.1), view=tc.View(tc.Camera((0.44, 0.97, 2.06), (-0.02, 0.29, 0.05), 36), ground=0.0))
    look = tc.Appearance((0.55, 0.66, 0.74), squares=False)
    cloth = scene.add_cloth(mesh, fabric, name="shirt", color=look, contact=tc.ClothContact(0.002, 0.2))
    u, v = mesh.uv.T

    def led(t: float) -> np.ndarray:
        """All of it: on the table, folded, then upright."""
        x = np.column_stack([u, v, 0 * u])
        sleeves, hem, middle = (part(t, begin, end) * (np.pi - short) for begin, end, short in FOLDED)
        for side in (-1.0, 1.0):
            turned(x, side * u > WIDTH / 2 + 1e-9, side * WIDTH / 2, 0, side, sleeves)
        turned(x, v < HEM - 1e-9, HEM, 1, -1.0, hem)
        turned(x, v < MIDDLE - 1e-9, MIDDLE, 1, -1.0, middle)
        up = part(t, LIFTED, HUNG)
        c, s = np.cos(np.pi / 2 * up), np.sin(np.pi / 2 * up)
        across, along, above = x.T
        along = along - LENGTH
        return np.column_stack([across, HEIGHT * up + s * along + c * above + 0.002, s * above - c * along])

    scene.move(cloth, range(mesh.vertex_count), led)
    pegs = (v > LENGTH - 1e-9) & (np.abs(u) > 0.1 + 1e-9) & (np.abs(u) < 0.2 + 1e-9)
    scene.at(HUNG, lambda s: s.unpin(cloth, np.flatnonzero(~pegs)))
    return scene


def check(sim: "tc.Simulation"):
    """What must hold after a whole run."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    u, v = mesh.uv.T
    low = x[:, 1].min()
    yield f"it has fallen open: its hem hangs at {low:.2f} m", low < HEIGHT - LENGTH + 0.1
    beside = bends(x, mesh, np.abs(v - 0.3) < 1e-9)
    yield f"between its folds it is flat, but for {np.degrees(beside):.1f} degrees", beside < 0.1
    for name, line in (("sleeves", np.abs(np.abs(u) - WIDTH / 2) < 1e-9), ("hem", np.abs(v - HEM) < 1e-9),
                       ("middle", np.abs(v - MIDDLE) < 1e-9)):
        bent = bends(x, mesh, line)
        yield f"the fold of the {name} stays, bent by {np.degrees(bent):.1f} degrees", bent > 0.03 + 2 * beside
    crossed = sim.intersections()
    yield f"{crossed} intersections", crossed == 0


def bends(x: np.ndarray, mesh: tc.TriMesh, line: np.ndarray) -> float:
    """Mean angle [rad] between the triangles at edges between two of the vertices of a line."""
    n = np.cross(x[mesh.faces[:, 1]] - x[mesh.faces[:, 0]], x[mesh.faces[:, 2]] - x[mesh.faces[:, 0]])
    n /= np.linalg.norm(n, axis=1)[:, None]
    ends = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    face, code = np.repeat(np.arange(mesh.face_count), 3), ends @ [mesh.vertex_count, 1]
    order = np.argsort(code, kind="stable")
    same = np.flatnonzero(code[order][1:] == code[order][:-1])
    mine = same[line[ends[order[same]]].all(axis=1)]
    cosine = np.sum(n[face[order[mine]]] * n[face[order[mine + 1]]], axis=1)
    return float(np.arccos(np.clip(cosine, -1, 1)).mean())


if __name__ == "__main__":
    tc.run(build)
