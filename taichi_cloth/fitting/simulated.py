"""Experiments without a closed form, simulated over a range of values as a sweep, with a curve through the results.

- drape: Cusick's test. A disk lies on a smaller one; the coefficient is the part of the overhang that its shadow covers.
- swing: a strip that hangs by its upper end is let go from aslant; its lower end swings, and the swing decays.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..errors import SimulationError
from ..scene.air import Air
from ..scene.fabric import Bend, Fabric, Shear, Stretch
from ..scene.scene import Scene
from ..scene.shapes import disk, grid
from ..simulation import Simulation
from ..sweeps.sweep import sweep

DISK, SUPPORT = 0.15, 0.09  # m, radii of Cusick's test


def drape_scene(D: float, density: float = 0.15, k: float = 1000.0, shear: float = 50.0, rings: int = 15) -> Scene:
    """A disk over its support, of rigidity D [N m]; damped so that it comes to rest."""
    mesh = disk(DISK, rings)
    far = np.linalg.norm(mesh.x - mesh.x.mean(axis=0), axis=1)
    noise = 1e-4 * np.random.default_rng(1).normal(size=len(far))  # breaks the symmetry
    up = np.outer(np.where(far < SUPPORT + 1e-4, 0.0, noise), [0, 1, 0])
    bend = Bend(D, k_d=0.02 * D, model="curvature")
    scene = Scene(air=Air(normal=1.0, tangential=0.1))
    cloth = scene.add_cloth(mesh, Fabric(density, Stretch(k, k_d=2.0), Shear(shear, k_d=0.1), bend), positions=mesh.x + up)
    scene.pin(cloth, np.flatnonzero(far < SUPPORT + 1e-4))
    return scene


def drape_coefficient(sim: Simulation) -> float:
    """The part of the overhang that its shadow covers."""
    mesh, x = sim.scene.cloths[0].mesh, sim.positions()
    centre = mesh.x.mean(axis=0)
    edge = np.flatnonzero(np.linalg.norm(mesh.x - centre, axis=1) > DISK - 1e-4)
    around = edge[np.argsort(np.arctan2(*(mesh.x[edge] - centre)[:, [2, 0]].T))]

    def shade(points: np.ndarray) -> float:
        p = (points - centre)[around][:, [0, 2]]
        q = np.roll(p, -1, axis=0)
        return abs(float(np.sum(p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]))) / 2

    return (shade(x) - math.pi * SUPPORT**2) / (shade(mesh.x) - math.pi * SUPPORT**2)


def swing_scene(value: float, find: str, length: float, width: float, density: float, D: float, k: float, start: float,
                cells: int) -> Scene:
    """A strip that hangs by its upper end, aslant, its lower end `start` [m] aside; `find` names the parameter that `value`
    is of."""
    mesh = grid((width, length), (max(1, round(cells * width / length)), cells), plane="xy")
    angle = math.asin(start / length)
    top = mesh.x[mesh.select("top")].mean(axis=0)
    down = top[1] - mesh.x[:, 1]
    x = np.column_stack([mesh.x[:, 0], top[1] - down * math.cos(angle), down * math.sin(angle)])
    scene = Scene(air=Air(normal=value) if find == "air" else None)
    bend = Bend(D, k_d=value if find == "k_d" else 0.0)
    fabric = Fabric(density, Stretch(k, k_d=1e-3 * k), Shear(k / 10, k_d=1e-4 * k), bend)
    scene.pin(scene.add_cloth(mesh, fabric, positions=x), "top")
    return scene



def follow(sim: Simulation, times: tuple[float, ...]) -> dict[str, float]:
    """x of the lower end [m] at rising times [s]: goes on from the first step, and reads between steps linearly."""
    low = sim.scene.cloths[0].mesh.select("bottom")
    h, t, x = sim.time, [sim.time], [float(sim.positions()[low, 2].mean())]
    while t[-1] < times[-1]:
        sim.step(h)
        t.append(sim.time)
        x.append(float(sim.positions()[low, 2].mean()))
    return {f"x{k}": float(value) for k, value in enumerate(np.interp(times, t, x))}


class Surrogate:
    """The result of an experiment at any value of its parameter, from runs at some: a monotone cubic through log of the value.

    Args:
        build: makes the scene of `name`; metrics: one figure of a run, or several in order.
        simulate: further arguments of `sweep`.
    """

    def __init__(self, build: Callable[..., Scene], name: str, metrics: Callable, simulate: Mapping[str, Any]) -> None:
        self.build, self.name, self.metrics, self.simulate = build, name, metrics, dict(simulate)
        self.values: list[float] = []
        self.figures: list[list[float]] = []

    def add(self, values: np.ndarray) -> None:
        """Runs the experiment at these values.

        Raises:
            SimulationError: a run that did not end well, with its reason.
        """
        new = [float(f"{v:.6g}") for v in values]
        made = sweep(self.build, {self.name: [v for v in new if v not in self.values]}, self.metrics, **self.simulate)
        for row in made.rows:
            if row["status"] != "ok":
                raise SimulationError(f"fit: at {self.name} = {row[self.name]:g} the experiment {row['status']} "
                                      f"({row['reason']}): {row['message']}", row["reason"])
            names = list(row)[list(row).index("digest") + 1:list(row).index("wall_s")]
            self.values.append(row[self.name])
            self.figures.append([row[name] for name in names])

    def __call__(self, value: float) -> np.ndarray:
        """(figures,)"""
        from scipy.interpolate import PchipInterpolator

        order = np.argsort(self.values)
        return PchipInterpolator(np.log(np.array(self.values)[order]), np.array(self.figures)[order])(np.log(value))
