"""Layers of cloth that slide, lie and are pressed on each other."""

import math

import numpy as np

import taichi_cloth as tc

from .case import CREEP, G, Result, case, fabric, follow, gained, noisy, speed
from .distance import apart

THICK, MU = 0.005, 0.3  # m
MEETS = tc.ClothContact(THICK, MU)
SHEET = fabric(k=1000.0, bend=5e-5)


def tilted(degrees: float, h: float, cells: int, start: int, threads: int) -> tuple[np.ndarray, np.ndarray]:
    """(times, mean way [m] down the slope) of a sheet of .2 m on a wider one that is held everywhere, gravity tilted."""
    angle = math.radians(degrees)
    scene = tc.Scene(gravity=(G * math.sin(angle), -G * math.cos(angle), 0))
    lower, upper = tc.grid(0.5, 2 * cells + 3, centred=True), tc.grid(0.2, cells, centred=True)
    held = scene.add_cloth(lower, SHEET, positions=lower.x + [0.1, 0, 0.003], contact=MEETS)
    scene.pin(held, np.arange(lower.vertex_count))
    scene.add_cloth(upper, SHEET, positions=noisy(upper.x + [0, THICK, 0], start), contact=MEETS)
    t, x = follow(scene, h, threads, 0.35)
    return t, x[:, lower.vertex_count:, 0].mean(axis=1)


@case(4, 7)
def layers_slip(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet on a sheet, tilted by 25 degrees, mu = .3, gains g (sin - mu cos): 2 % of the friction that acts."""
    t, way = tilted(25, h, cells, start, threads)
    s, c = G * math.sin(math.radians(25)), G * math.cos(math.radians(25))
    return Result("gains", gained(t, way, 0.1, 0.35), s - MU * c, 0.02 * MU * c, "m/s^2", wrong=s - 2 * MU * c),


@case(4, 7)
def layers_stick(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet on a sheet, tilted by 12 degrees, mu = .3, stays: tan(12) = .21."""
    t, way = tilted(12, h, cells, start, threads)
    return Result("slip", float(abs(speed(t, way, 0.2, 0.35))), 0.0, CREEP, "m/s", wrong=0.5),


@case(4, 8)
def layers_momentum(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Two free sheets that hit each other aslant without gravity keep their momentum together, 1e-10 of one's."""
    mesh, scene = tc.grid(0.2, cells, centred=True), tc.Scene(gravity=None)
    scene.add_cloth(mesh, SHEET, positions=mesh.x, contact=MEETS)
    scene.add_cloth(mesh, SHEET, positions=noisy(mesh.x + [0.023, 0.02, 0.011], start),
                    velocities=(0.5, -1.0, 0.2), contact=MEETS)
    t, x = follow(scene, h, threads, 0.1)
    mass = np.tile(np.bincount(mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3)), 2)
    v = np.einsum("n,sni->si", mass, np.diff(x, axis=0) / np.diff(t)[:, None, None]) / mass[: mesh.vertex_count].sum()
    one = x[:, : mesh.vertex_count].mean(axis=1)
    kicked = np.linalg.norm((one[-1] - one[-2]) / (t[-1] - t[-2]))  # that they met at all
    return Result("lost", float(np.abs(v - v[0]).max()), 0.0, 1e-10, "m/s", wrong=float(kicked)),


@case(4, 8)
def middle_drawn(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Of three sheets on a floor the middle one is drawn by 3 mu g: the upper one gains mu g, the lower one stays.

    The lower one is pushed by mu 2 m g of what lies on it, and held by up to mu 3 m g of the floor.
    """
    mesh, scene = tc.grid(0.2, cells, centred=True), tc.Scene()
    scene.add_solid(tc.Plane(), MU, THICK)
    for k in range(3):
        piece = mesh if k == 2 else tc.grid(0.4, 2 * cells + 1, centred=True)
        at = piece.x + [0, THICK * (k + 1), 0]
        cloth = scene.add_cloth(piece, SHEET, positions=noisy(at, start) if k == 2 else at, contact=MEETS)
        if k == 1:
            scene.move(cloth, np.arange(piece.vertex_count), lambda t: (1.5 * MU * G * max(t - 0.1, 0) ** 2, 0, 0),
                       relative=True, directions="x")
    t, x = follow(scene, h, threads, 0.25)
    n = (x.shape[1] - mesh.vertex_count) // 2
    lower, gains = x[:, :n, 0].mean(axis=1), gained(t, x[:, 2 * n:, 0].mean(axis=1), 0.13, 0.25)
    return (Result("upper gains", gains, MU * G, 0.02 * MU * G, "m/s^2", wrong=2 * MU * G),
            Result("creeps", float(abs(speed(t, lower, 0.13, 0.25))), 0.0, CREEP, "m/s", wrong=0.01))


@case(3, 6)
def ten_at_rest(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Ten sheets at rest are as far apart as was asked, and the floor bears the weight of all: 20 Pa.

    The load is the one that the run tells.
    """
    mesh, scene = tc.grid(0.1, cells, centred=True), tc.Scene()
    scene.add_solid(tc.Plane(), MU, THICK, name="floor")
    for k in range(10):
        scene.add_cloth(mesh, SHEET, positions=noisy(mesh.x + [0, THICK * (k + 1), 0], start + 100 * k), contact=MEETS)
    with tc.Simulation(scene, h=h, threads=threads) as sim:
        while sim.time < 0.5 - 1e-9:
            sim.step()
        y = sim.positions()[:, 1].reshape(10, -1)
        load = -sim.solid_loads()["floor"][0][1]
    gaps, weight = np.diff(y, axis=0).mean(axis=1) / THICK, 10 * 0.2 * 0.1**2 * G
    return (Result("least gap", float(gaps.min()), 1.0, 0.02, "of the thickness", wrong=0.5),
            Result("floor bears", float(load / weight), 1.0, 1e-3, "of the weight", wrong=0.9))


def nearest(scene: tc.Scene, mesh: tc.TriMesh, h: float, threads: int, until: float, every: bool) -> float:
    """The least distance of two sheets of one mesh, over the thickness: in every step, or in the end."""
    _, x = follow(scene, h, threads, until)
    n = mesh.vertex_count
    return min(apart(p[:n], p[n: 2 * n], mesh.faces) for p in (x if every else x[-1:])) / THICK


@case(3, 6)
def pressed(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet under one a hundred times as heavy, on a floor, keeps more than half of the distance."""
    mesh, scene = tc.grid(0.1, cells, centred=True), tc.Scene()
    scene.add_solid(tc.Plane(), MU, THICK)
    for k, density in enumerate((0.2, 20.0)):
        scene.add_cloth(mesh, fabric(density, 1000.0, 5e-5), positions=noisy(mesh.x + [0.004 * k, THICK * (k + 1), 0], start),
                        contact=MEETS)
    return Result("least gap", nearest(scene, mesh, h, threads, 0.3, False), 0.5, 0.0, "of the thickness", ">=", wrong=1.5),


@case(6, 12)
def taut_over_ridge(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Of two sheets over a round bar, drawn taut, none comes nearer to the other than half of the distance."""
    mesh, scene = tc.grid((0.3, 0.1), (2 * cells, cells // 2), centred=True), tc.Scene()
    scene.add_solid(tc.Cylinder(0.03, 0.4), MU, THICK, rotation=(math.pi / 2, 0, 0))
    for k in range(2):
        at = noisy(mesh.x + [0, 0.03 + THICK * (k + 1), 0], start)
        cloth = scene.add_cloth(mesh, SHEET, positions=at, contact=MEETS)
        for side, sign in (("left", -1), ("right", 1)):
            scene.move(cloth, mesh.select(side), lambda t, s=sign: (0.01 * s * min(t, 0.2), -0.4 * min(t, 0.2), 0),
                       relative=True)
    return Result("least gap", nearest(scene, mesh, h, threads, 0.25, True), 0.5, 0.0, "of the thickness", ">=", wrong=1.5),


@case(5, 10)
def hit_at_10(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """A sheet that hits one held along two sides with 10 m/s never comes nearer than half of the distance."""
    mesh, scene = tc.grid(0.2, cells, centred=True), tc.Scene()
    held = scene.add_cloth(mesh, SHEET, positions=mesh.x, contact=MEETS)
    scene.pin(held, "left")
    scene.pin(held, "right")
    scene.add_cloth(mesh, SHEET, positions=noisy(mesh.x + [0.013, 0.04, 0.007], start), velocities=(0, -10.0, 0),
                    contact=MEETS)
    return Result("least gap", nearest(scene, mesh, h, threads, 0.06, True), 0.5, 0.0, "of the thickness", ">=", wrong=1.5),
