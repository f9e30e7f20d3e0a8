"""Pictures through a lens and over the time that a shutter is open: many exposures, their mean."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from .camera import Frame

STEPS = (0.8566749, 0.7338919, 0.6287067, 0.5385973)  # of a low-discrepancy sequence of four numbers [M. Roberts, 2018]


def spots(count: int) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """The exposures of a picture.

    Yields:
        part of the time [0, 1); (2,) point of the lens in a circle of radius 1; (2,) point of the pixel, +-1/2.
    """
    for k in range(count):
        u, w, *pixel = (0.5 + k * np.array(STEPS)) % 1
        lens = np.sqrt(u) * np.array([np.cos(2 * np.pi * w), np.sin(2 * np.pi * w)])
        yield (k + 0.5) / count, lens, np.array(pixel) - 0.5


def through(camera: Frame, lens: np.ndarray, focus: float, pixel: np.ndarray) -> Frame:
    """A camera from a point of its lens (2,) [m]; the plane at the distance `focus` [m] stays where it is in the picture.

    Args:
        pixel: (2,) by how much the picture is moved [picture heights].
    """
    eye = camera.eye + lens @ camera.axes[:2]
    return replace(camera, eye=eye, shift=lens * camera.focal / focus + pixel)


def focused(camera: Frame, focus: float | None, x: np.ndarray) -> float:
    """Distance along the view at which a picture is sharp [m]: the given one, or that of the middle of points (n, 3)."""
    return focus if focus is not None else max(float(camera.axes[2] @ (camera.eye - x.mean(axis=0))), 10 * camera.near)


def between(frame: dict[str, np.ndarray], after: dict[str, np.ndarray] | None, part: float,
            step: float) -> dict[str, np.ndarray]:
    """A frame at a part of the time until the next one: cloth by cubics with its velocities, solids along straight lines.

    Args:
        after: the next frame; None goes on as the cloth moves, and leaves solids where they are.
        step: time between frames [s].
    """
    x, v = frame["x"].astype(np.float64), frame["v"].astype(np.float64)
    out = dict(frame, t=frame["t"] + part * step, x=x + part * step * v)
    if after is not None:
        y, w, s = after["x"].astype(np.float64), after["v"].astype(np.float64), part
        out["x"] = ((2 * s**3 - 3 * s**2 + 1) * x + (3 * s**2 - 2 * s**3) * y
                    + step * ((s**3 - 2 * s**2 + s) * v + (s**3 - s**2) * w))
        if "solid_x" in frame and "solid_x" in after:
            out["solid_x"] = frame["solid_x"] + s * (after["solid_x"] - frame["solid_x"])
    return out
