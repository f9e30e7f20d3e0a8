"""Cloth that lands: gravity's work against fine steps, what no energy accounts for, and the order of the error in the step."""

from functools import cache, partial

import numpy as np

import taichi_cloth as tc

from .case import SETTINGS, G, Result, case, enter, fabric, follow, noisy

THICK = 0.005  # m
UNTIL, FINE = 0.25, 1 / 480  # s


def falling(onto: str, cells: int, start: int) -> tuple[tc.Scene, tc.TriMesh]:
    """A sheet of .5 m that starts a centimetre above a ball, a table's top, or other cloth held along two sides."""
    mesh, scene = tc.grid(0.5, cells, centred=True), tc.Scene()
    meets = tc.ClothContact(THICK, 0.3) if onto == "cloth" else None
    height = {"ball": 0.125 + THICK, "table": 0.02 + THICK, "cloth": THICK}[onto] + 0.01
    scene.add_cloth(mesh, fabric(k=1000.0, bend=5e-5), positions=noisy(mesh.x + [0.002, height, 0.001], start), contact=meets)
    if onto == "ball":
        scene.add_solid(tc.Sphere(0.125), 0.4, THICK)
    elif onto == "table":
        scene.add_solid(tc.Box((0.25, 0.04, 0.25), 0.005), 0.4, THICK)
    else:
        wide = tc.grid(0.6, cells, centred=True)
        below = scene.add_cloth(wide, fabric(k=1000.0, bend=5e-5), positions=wide.x, contact=meets)
        scene.pin(below, "left")
        scene.pin(below, "right")
    return scene, mesh


def fallen(scene: tc.Scene, mesh: tc.TriMesh, h: float, threads: int, **options: object) -> tuple[float, float]:
    """(gravity's work on the sheet [J] by its positions, the sum of what steps leave unaccounted [J], by the log)."""
    weight = G * 0.2 * np.bincount(mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3))
    with tc.Simulation(scene, h=h, threads=threads, **{**SETTINGS, **options}) as sim:
        x = np.array(sim.positions())[:mesh.vertex_count]
        for _ in range(round(UNTIL / h)):
            sim.step()
        lost = sum(abs(record.ledger["unaccounted"]) for record in sim.log if record.ledger)
        return float(weight @ (x - sim.positions()[:mesh.vertex_count])[:, 1]), lost


@cache
def fine(onto: str, cells: int) -> float:
    """Gravity's work by steps of 1/480 s that are solved to the end: there is no closed form."""
    return fallen(*falling(onto, cells, 0), FINE, 1, integrator="newton_euler")[0]


def landing(onto: str, h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """Of a sheet that lands, gravity's work is what fine steps say, and next to nothing is unaccounted for in .25 s.

    `newton_euler` with steps of 1/480 s stands for the law: half of its step changes the work by less than a percent.
    What is unaccounted for is the sum of sizes in the log, over gravity's work.
    """
    work, lost = fallen(*falling(onto, cells, start), h, threads)
    told = Result("unaccounted", lost / work, 0.0, 0.02, wrong=1.0)
    if onto == "cloth":
        return told,
    law = fine(onto, cells)
    return Result("gravity's work", work, law, 0.02 * law, "J", wrong=2 * law), told


for _onto, _cells in (("ball", 8), ("table", 8), ("cloth", 6)):
    enter(f"landing_{_onto}", partial(landing, _onto), _cells, 2 * _cells)


def stopped(h: float, start: int, threads: int, mu: float = 0.3) -> float:
    """Mean error [m] of where small sheets come to rest that were thrown on a floor from six heights (see `order_impact`)."""
    mesh, scene, v = tc.grid(0.05, 2, centred=True), tc.Scene(), 1.0
    heights = np.linspace(0.02, 0.07, 6)
    for k, height in enumerate(heights):
        scene.add_cloth(mesh, fabric(k=1000.0), velocities=(v, 0, 0),
                        positions=noisy(mesh.x + [0, THICK + height, 0.2 * k], start + 100 * k))
    scene.add_solid(tc.Plane(), mu, THICK)
    _, x = follow(scene, h, threads, 0.45)
    went = (x[-1] - x[0])[:, 0].reshape(6, -1).mean(axis=1)
    falls = np.sqrt(2 * heights / G)
    law = v * falls + np.maximum(v - mu * G * falls, 0) ** 2 / (2 * mu * G)
    return float(np.abs(went - law).mean())


@case(2)
def order_impact(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """The error of where cloth stops that was thrown on a floor falls in proportion to the step, impact included.

    It falls for T = sqrt(2 H / g), loses mu g T of its velocity v at the impact and mu g a second then: it stops after
    v T + (v - mu g T)^2 / (2 mu g). The mean over six heights, as where in a step an impact is decides its error; of
    backward Euler the first part is exact in x, the last off by (v - mu g T) h / 2.
    """
    coarse, half = (stopped(step, start, threads) for step in (h, h / 2))
    return Result("order", float(np.log2(coarse / half)), 1.0, 0.3, sense=">=", wrong=2.0),


def pushed(h: float, start: int, threads: int, **options: object) -> float:
    """Error [m] of how far a sheet went that a changing force pushes over a floor (see `order_contact`)."""
    mesh, scene, mu, wave = tc.grid(0.1, 3, centred=True), tc.Scene(), 0.3, 12.0
    cloth = scene.add_cloth(mesh, fabric(k=1000.0), velocities=(1.0, 0, 0), positions=noisy(mesh.x + [0, THICK, 0], start))
    scene.add_solid(tc.Plane(), mu, THICK)
    mass = 0.2 * np.bincount(mesh.faces.ravel(), np.repeat(mesh.material_areas / 3, 3))
    every = np.arange(mesh.vertex_count)
    scene.add_load(cloth, every, lambda t: np.outer(mass * G * mu * (1 + np.sin(wave * t)), [1.0, 0, 0]))
    t, x = follow(scene, h, threads, 0.4, **options)
    law = t[-1] + mu * G * (t[-1] / wave - np.sin(wave * t[-1]) / wave**2)
    return float(abs((x[-1] - x[0])[:, 0].mean() - law))


@case(3)
def order_contact(h: float, cells: int, start: int, threads: int) -> tuple[Result, ...]:
    """The error of a sheet that slides, pushed by mu m g (1 + sin(w t)), is of order 2 in the step, and 1 by backward Euler.

    m v' = mu m g sin(w t): it went v t + mu g (t / w - sin(w t) / w^2).
    """
    usual = [pushed(step, start, threads) for step in (h, h / 2)]
    first = [pushed(step, start, threads, integrator="backward_euler") for step in (h, h / 2)]
    return (Result("order", float(np.log2(usual[0] / usual[1])), 2.0, 0.2, sense=">=", wrong=3.0),
            Result("order of backward Euler", float(np.log2(first[0] / first[1])), 1.0, 0.2, sense=">=", wrong=2.0))
