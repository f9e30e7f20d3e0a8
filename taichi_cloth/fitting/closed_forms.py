"""Experiments that have a closed form: a strip that hangs over an edge, and one that is pulled.

A strip of length L, level at its clamp, hangs in the elastica theta'' = -Gamma (1 - s) cos theta, Gamma = sigma g L^3 / D,
theta the slope downwards, theta(0) = 0, theta'(1) = 0 (Bickley 1934). Counted from the free end in u = Gamma^(1/3) (1 - s),
theta_uu = -u cos theta has no parameter but the slope at the free end: one integration each gives a Gamma and its shape.
"""

import functools

import numpy as np

from ..scene.fabric import STIFFER

G = 9.81  # m/s^2
SLOPES = 120  # of the free end, that are integrated; Gamma from about 1e-3 to 1e3
NEAR = (-9.0, 25.0)  # log of the slope over the rest to pi/2, of the first and the last


def cantilever(gamma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Drop and reach (k,) of the free end over the strip's length, at Gamma (k,) = sigma g L^3 / D."""
    low, high, drop, reach = _elastica()
    g = np.log(np.clip(gamma, low, high))
    return np.exp(drop(g)), reach(g)


def rigidity_range(weight: np.ndarray) -> tuple[float, float]:
    """(lowest, highest) D [N m] that the table of the elastica spans, for weights (k,) sigma g L^3 [N m]."""
    low, high, _, _ = _elastica()
    return float(weight.max() / high), float(weight.min() / low)


@functools.cache
def _elastica():
    """(least Gamma, largest, log of drop, reach), the last two as splines of log Gamma."""
    from scipy.integrate import solve_ivp
    from scipy.interpolate import CubicSpline

    def along(u, y):
        return [y[1], -u * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

    def clamped(u, y):
        return y[0]

    clamped.terminal = True  # type: ignore[attr-defined]
    slopes = np.pi / 2 / (1 + np.exp(-np.linspace(*NEAR, SLOPES)))
    rows = []
    for slope in slopes:
        end = solve_ivp(along, (0.0, 100.0), [slope, 0.0, 0.0, 0.0], events=clamped, rtol=1e-11, atol=1e-14)
        u, (_, _, x, y) = end.t_events[0][0], end.y_events[0][0]
        rows.append((3 * np.log(u), np.log(y / u), x / u))
    g, drop, reach = np.array(sorted(rows)).T
    return np.exp(g[0]), np.exp(g[-1]), CubicSpline(g, drop), CubicSpline(g, reach)


def tension(strain: np.ndarray, k: float, limit: float | None = None) -> np.ndarray:
    """T [N/m] of a strip pulled along a yarn: k C, beyond a limit L of the stretch k C + 1000 k (1 + C - L)^2 / (L - 1)."""
    out = k * strain
    if limit is not None:
        out = out + STIFFER * k * np.maximum(1 + strain - limit, 0.0) ** 2 / (limit - 1)
    return out
