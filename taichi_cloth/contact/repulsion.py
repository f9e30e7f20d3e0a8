"""The law by which two places of cloth repel each other. numpy only.

Over the stiffness k of the pair, with s what its distance d is above a floor of a fifth of the distance r that it should
keep, and R = r - floor: phi'' = 1 from R down to R/2, and phi = -R^2 / 4 log s below: joined with two continuous
derivatives, convex, growing towards the floor. From just above the floor on, where only what solids press together gets to, it
grows with -log d.
"""

import numpy as np

FLOOR = 0.2  # of a pair's distance
SHALLOW = 0.02  # part of what is above the floor from which on downwards the force grows more slowly, and of r its end


def height(part: float, r: np.ndarray) -> np.ndarray:
    """(k,) distances at a part of the way from the floor up to r."""
    return (FLOOR + part * (1 - FLOOR)) * r


def room(d: np.ndarray, r: np.ndarray) -> np.ndarray:
    """(k,) what parts of that way distances d are at; negative below the floor."""
    return (d / r - FLOOR) / (1 - FLOOR)


def law(d: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(force, its slope) at distances d, over the stiffness."""
    low, top = height(SHALLOW, r), (1 - FLOOR) * r
    s, b = np.maximum(d, low) - FLOOR * r, np.clip(d, SHALLOW * r, low)
    far, most = s >= top / 2, top / (4 * SHALLOW)
    force = np.where(far, np.maximum(top - s, 0.0), top**2 / (4 * s))
    slope = np.where(far, np.where(s <= top, 1.0, 0.0), top**2 / (4 * s**2))
    return np.where(d < low, most * low / b, force), np.where(d < low, most * low / b**2, slope)


def potential(d: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Energy at distances d, over the stiffness [m^2]."""
    low, top = height(SHALLOW, r), (1 - FLOOR) * r
    s, b = np.maximum(d, low) - FLOOR * r, np.clip(d, SHALLOW * r, low)
    energy = np.where(s >= top / 2, np.maximum(top - s, 0.0) ** 2 / 2, top**2 / 8 + top**2 / 4 * np.log(top / (2 * s)))
    most = top / (4 * SHALLOW) * low
    return energy + most * np.log(low / b) + np.maximum(SHALLOW * r - d, 0.0) * most / (SHALLOW * r)
