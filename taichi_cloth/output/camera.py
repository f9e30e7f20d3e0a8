"""Cameras as matrices. numpy only."""

from dataclasses import dataclass, field

import numpy as np

from ..scene.view import Camera, View

NEAR = 1e-3  # part of the distance to the target in front of which nothing is drawn
BELOW = 0.05  # of the size of all that there is: room between it and a ground that nothing stands on
DIRECTION = (0.55, 0.3, 1.0)  # from where a fitted camera looks
SIDES = {"front": (0.0, 0.25, 1.0), "back": (0.0, 0.25, -1.0), "left": (-1.0, 0.25, 0.0), "right": (1.0, 0.25, 0.0)}


@dataclass(frozen=True)
class Frame:
    """A camera's position and axes.

    Attributes:
        eye: (3,) [m].
        axes: (3, 3) rows right, up, backward.
        focal: picture heights per unit of tangent: height/2 / tan(fov/2), in units of height.
        near: [m].
        shift: (2,) by how much the picture is moved to the right and up [picture heights].
    """

    eye: np.ndarray
    axes: np.ndarray
    focal: float
    near: float
    shift: np.ndarray = field(default_factory=lambda: np.zeros(2))

    def project(self, x: np.ndarray, width: int, height: int) -> np.ndarray:
        """(n, 3) pixel column, pixel row, 1/depth [1/m] of points (n, 3); depth is negative behind the camera."""
        local = (x - self.eye) @ self.axes.T
        depth = np.where(np.abs(local[:, 2]) < 1e-12, 1e-12, -local[:, 2])
        scale = self.focal * height / depth
        across, up = width / 2 + self.shift[0] * height, height / 2 - self.shift[1] * height
        return np.column_stack([across + local[:, 0] * scale, up - local[:, 1] * scale, 1 / depth])


def frame(camera: Camera) -> Frame:
    """The axes of a camera."""
    eye, target, up = (np.array(v, dtype=np.float64) for v in (camera.eye, camera.target, camera.up))
    back = eye - target
    distance = float(np.linalg.norm(back))
    back /= distance
    right = np.cross(up, back)
    if np.linalg.norm(right) < 1e-9:  # looking along up
        right = np.cross([0.0, 0.0, 1.0], back)
        right = right if np.linalg.norm(right) > 1e-9 else np.array([1.0, 0.0, 0.0])
    right /= np.linalg.norm(right)
    return Frame(eye, np.stack([right, np.cross(back, right), back]),
                 0.5 / np.tan(np.radians(camera.fov) / 2), NEAR * distance)


def ground_height(x: np.ndarray, view: View, cloth: float = np.inf, solid: float = np.inf) -> float:
    """Height of the ground [m]: the view's; else that of the lowest solid, where no cloth comes lower; else below all.

    Args:
        x: (n, 3) first positions [m]; the ground is below them by the view's reach and by BELOW of their size.
        cloth, solid: the lowest that these are at any time [m], if known.
    """
    if view.ground is not None:
        return view.ground
    if np.isfinite(solid) and solid <= cloth:
        return solid
    low, high = x.min(axis=0), x.max(axis=0)
    return float(min(low[1] - view.reach, cloth, solid) - BELOW * np.linalg.norm(high - low))
