"""Cameras that have all of a motion in their picture. numpy only."""

from collections.abc import Iterable

import numpy as np

from ..scene.view import Camera
from .camera import DIRECTION, frame

FOV = 35.0  # degrees
MARGIN = 0.06  # part of the picture that stays free on each side
SPOT = 1e-3  # m: the least room round points


def fit_all(points: Iterable[np.ndarray], reach: float, aspect: float) -> Camera:
    """The nearest camera, from the usual direction, that has all points and `reach` [m] round them in its picture.

    In the camera's axes, with t the tangent of half the opening angle and b the distance towards the camera, a point (r, u, b)
    is within the sides where |r - r_0| <= t (b_0 - b): the largest r + t b and -r + t b decide.

    Args:
        points: sets (n, 3) [m], one after the other.
        aspect: width of the picture by its height.
    """
    axes = frame(Camera(DIRECTION, (0.0, 0.0, 0.0), FOV)).axes
    up = np.tan(np.radians(FOV) / 2) * (1 - 2 * MARGIN)
    tangents = np.array([up * aspect, up])
    most = np.full((2, 2), -np.inf)
    nearest = -np.inf
    for x in points:
        local = x @ axes.T
        nearest = max(nearest, float(local[:, 2].max()))
        for d in range(2):
            for sign in range(2):
                value = (local[:, d] * (1 - 2 * sign) + tangents[d] * local[:, 2]).max()
                most[d, sign] = max(most[d, sign], value + max(reach, SPOT) * np.hypot(1, tangents[d]))
    back = float(max((most.sum(axis=1) / (2 * tangents)).max(), nearest + reach + SPOT))
    across, above = (most[:, 0] - most[:, 1]) / 2
    eye = np.array([across, above, back]) @ axes
    target = np.array([across, above, nearest if nearest < back else back - 1.0]) @ axes
    return Camera(tuple(eye.tolist()), tuple(target.tolist()), FOV)


def fit_round(points: Iterable[np.ndarray], reach: float, aspect: float) -> Camera:
    """A camera that has all points in its picture from every side: it looks at the middle of their bounds."""
    sets = list(points)
    low, high = np.min([x.min(axis=0) for x in sets], axis=0), np.max([x.max(axis=0) for x in sets], axis=0)
    centre = (low + high) / 2
    radius = max(float(np.linalg.norm(x - centre, axis=1).max()) for x in sets) + max(reach, SPOT)
    half = np.arctan(np.tan(np.radians(FOV) / 2) * min(1.0, aspect))
    eye = centre + np.array(DIRECTION) / np.linalg.norm(DIRECTION) * radius / np.sin(half) * 1.02
    return Camera(tuple(eye.tolist()), tuple(centre.tolist()), FOV)
