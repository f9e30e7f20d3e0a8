"""A law's result, the list of cases, and what they are made of: noise, motion from positions, sheets."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import taichi_cloth as tc

G = 9.81  # m/s^2
NOISE = 1e-9  # m by which starts differ
SETTINGS: dict[str, object] = {}  # options of simulations, where these are not the usual ones
CREEP = 1e-6  # of a solid's speed, or of 1 m/s where it rests: what sticks slips by less


@dataclass(frozen=True)
class Result:
    """One number of a case beside what the law says.

    Attributes:
        name: of the number.
        measured: from positions, unless the case says otherwise; NaN where the run gave up.
        law: what it should be.
        tolerance: by which it may be off.
        unit: of the three; empty for a ratio.
        sense: "=", or "<=" and ">=" where the law is a bound.
        wrong: what a deliberately wrong law says, twice the friction for example: a case that cannot tell measures nothing.
    """

    name: str
    measured: float
    law: float
    tolerance: float
    unit: str = ""
    sense: str = "="
    wrong: float | None = None

    def off(self, law: float) -> float:
        """By how much a law is missed; below 0 where a bound is kept."""
        more = self.measured - law
        return {"=": abs(more), "<=": more, ">=": -more}[self.sense]

    def fits(self, law: float) -> bool:
        """Whether what was measured is within the tolerance of a law."""
        return bool(self.off(law) <= self.tolerance)

    @property
    def holds(self) -> bool:
        """Whether it is within the tolerance of its own; NaN is not."""
        return self.fits(self.law)

    def __str__(self) -> str:
        return f"{self.name}: {self.measured:.4g} {self.unit} ({self.sense} {self.law:.4g} +- {self.tolerance:.2g})"


@dataclass(frozen=True)
class Case:
    """A function `run(h, cells, start, threads)` -> results: step [s], cells along the longer side, seed of the noise."""

    name: str
    run: Callable[[float, int, int, int], tuple[Result, ...]]
    cells: tuple[int, ...]


CASES: dict[str, Case] = {}


def enter(name: str, run: Callable, *cells: int) -> None:
    """Enters a case, with the meshes that it is run with, the smallest first."""
    CASES[name] = Case(name, run, cells)


def case(*cells: int) -> Callable:
    """Enters a function among the cases, by its own name."""
    def named(run: Callable) -> Callable:
        enter(run.__name__, run, *cells)
        return run
    return named


def noisy(x: np.ndarray, start: int) -> np.ndarray:
    """Positions (n, 3) [m] moved by the noise of a start."""
    return x + NOISE * np.random.default_rng(7000 + start).standard_normal(x.shape)


def fabric(density: float = 0.2, k: float = 500.0, bend: float = 1e-6) -> tc.Fabric:
    """Density [kg/m^2], stiffness [N/m] of stretch, in shear a fifth, damping a thousandth [s] of both; bending [N m]."""
    return tc.Fabric(density, tc.Stretch(k, k / 1000), tc.Shear(k / 5, k / 5000), tc.Bend(bend))


def follow(scene: tc.Scene, h: float, threads: int, until: float, **options: object) -> tuple[np.ndarray, np.ndarray]:
    """Runs with the usual settings, or `SETTINGS`: (times (s + 1,) [s], positions (s + 1, n, 3) [m]), the start's included."""
    with tc.Simulation(scene, h=h, threads=threads, **{**SETTINGS, **options}) as sim:
        t, x = [0.0], [np.array(sim.positions())]
        while sim.time < until - 1e-9:
            sim.step()
            t.append(sim.time)
            x.append(np.array(sim.positions()))
    return np.array(t), np.array(x)


def speed(t: np.ndarray, x: np.ndarray, since: float, until: float) -> np.ndarray:
    """Mean velocity [m/s] of x (s, ...) between two times [s], from the positions next to these."""
    a, b = np.abs(t - since).argmin(), np.abs(t - until).argmin()
    return (x[b] - x[a]) / (t[b] - t[a])


def gained(t: np.ndarray, x: np.ndarray, since: float, until: float) -> float:
    """Acceleration of x (s,) between two times, by second differences over half of that; exact of a constant one."""
    a, c = np.abs(t - since).argmin(), np.abs(t - until).argmin()
    b = (a + c) // 2
    c = 2 * b - a
    return float((x[c] - 2 * x[b] + x[a]) / (t[c] - t[b]) ** 2)


def turned(x: np.ndarray, angle: np.ndarray, axis: int) -> np.ndarray:
    """Positions (s, n, 3) turned about a coordinate axis (1: y, 2: z) by angles (s,) [rad], right-handed."""
    i, j = {1: (2, 0), 2: (0, 1)}[axis]
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    y = x.copy()
    y[..., i], y[..., j] = c * x[..., i] - s * x[..., j], s * x[..., i] + c * x[..., j]
    return y
