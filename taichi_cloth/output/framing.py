"""Cameras that have all of a motion in their picture. numpy only."""

from collections.abc import Iterable

import numpy as np

from ..scene.view import Camera
from .camera import DIRECTION, frame

FOV = 35.0  # degrees
MARGIN = 0.06  # part of the picture that stays free on each side
SPOT = 1e-3  # m: the least room round points


Way = tuple[float, float, float]


def fit_all(points: Iterable[np.ndarray], reach: float, aspect: float, way: Way = DIRECTION) -> Camera:
    """The nearest camera, from a direction, that has all points and `reach` [m] round them in its picture.

    In the camera's axes, with t the tangent of half the opening angle and b the distance towards the camera, a point (r, u, b)
    is within the sides if |r - r_0| <= t (b_0 - b). The largest r + t b and -r + t b decide.

    Args:
        points: sets (n, 3) [m], one after the other.
        aspect: width of the picture by its height.
        way: from the points to the camera.
    """
    axes = frame(Camera(way, (0.0, 0.0, 0.0), FOV)).axes
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


def fit_round(points: Iterable[np.ndarray], reach: float, aspect: float, way: Way = DIRECTION) -> Camera:
    """The nearest camera that has all points in its picture from every side: it looks at the middle of their bounds.

    A point at a distance r from the vertical through that middle, and y above it, goes round as the camera does. With the
    camera's elevation e and h = r cos(angle) it is b = y sin e + h cos e towards it, u = y cos e - h sin e up, and
    r sin(angle) aside. Like in `fit_all`, aside / t + b and |u| / t + b decide, and both are largest in closed form.
    """
    sets = list(points)
    low, high = np.min([x.min(axis=0) for x in sets], axis=0), np.max([x.max(axis=0) for x in sets], axis=0)
    centre, towards = (low + high) / 2, np.array(way) / np.linalg.norm(way)
    sin, cos = towards[1], float(np.hypot(towards[0], towards[2]))
    up = np.tan(np.radians(FOV) / 2) * (1 - 2 * MARGIN)
    across, room, back = up * aspect, max(reach, SPOT), 0.0
    for x in sets:
        r, y = np.hypot(*(x - centre)[:, [0, 2]].T), x[:, 1] - centre[1]
        aside = y * sin + r * np.hypot(1 / across, cos) + room * np.hypot(1, across) / across
        above, below = (y * (sin + s * cos / up) + r * abs(cos - s * sin / up) + room * np.hypot(1, up) / up for s in (1, -1))
        back = max(back, *(float(part.max()) for part in (aside, above, below, y * sin + r * cos + room)))
    eye = centre + back * towards
    return Camera(tuple(eye.tolist()), tuple(centre.tolist()), FOV)
