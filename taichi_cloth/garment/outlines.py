"""Closed outlines of subpaths, as panels with one edge a segment. numpy only."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ..errors import SceneError
from .curves import Curve
from .pathdata import Segment, Subpath
from .pattern import Panel

SAME = 1e-9  # of an outline's size within which two points are one
MEETS = 1e-4  # of an outline's size within which its ends meet: .1 mm of a metre, more than drawings are rounded to
ROUND = 1e-6  # relative difference of the radii of a circle
FLAT = 1e-12  # relative radius of an ellipse that is a line


class Outline(NamedTuple):
    """A closed outline.

    Attributes:
        segments: each from the end of the one before; the last ends, within `MEETS`, where the first begins.
        to_metres: (2, 2) from their coordinates.
    """

    segments: list[Segment]
    to_metres: np.ndarray

    @property
    def extent(self) -> float:
        """Area of the box round it [m^2]."""
        return float(np.ptp(self._corners(), axis=0).prod())

    def panel(self, name: str) -> Panel:
        """The panel, with its origin in the middle of the box round its corners.

        Raises:
            SceneError: a border that meets itself, or a segment that ends where it begins.
        """
        corners, n = self._corners(), len(self.segments)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        edges = tuple(self._edge(name, k, (k + 1) % n, s) for k, s in enumerate(self.segments))
        return Panel(name, corners - middle, edges)

    def _corners(self) -> np.ndarray:
        return _xy(s.points[0] for s in self.segments) @ self.to_metres.T

    def _edge(self, panel: str, start: int, end: int, segment: Segment) -> Curve:
        if segment.kind == "L":
            return Curve(start, end)
        if segment.arc is not None:
            return self._arc(start, end, *segment.arc)
        a, *control, b = _xy((*segment.points[:-1], self.segments[end].points[0])) @ self.to_metres.T
        along = b - a
        left, square = np.array([-along[1], along[0]]), float(along @ along)
        if not square > 0:
            raise SceneError(f"panel {panel!r}: edge {start} ends where it begins: cut it in two")
        parameters = tuple((float((p - a) @ along / square), float((p - a) @ left / square)) for p in control)
        return Curve(start, end, "quadratic" if segment.kind == "Q" else "cubic", parameters)

    def _arc(self, start: int, end: int, rx: float, ry: float, tilt: float, large: bool, grows: bool) -> Curve:
        turn = np.array([[math.cos(tilt), -math.sin(tilt)], [math.sin(tilt), math.cos(tilt)]])
        axes, (long, short), _ = np.linalg.svd(self.to_metres @ turn @ np.diag([rx, ry]))
        right = grows == bool(np.linalg.det(self.to_metres) > 0)  # with y up
        if short <= FLAT * long:
            return Curve(start, end)
        if long - short <= ROUND * long:
            return Curve(start, end, "circle", (float(long), large, right))
        return Curve(start, end, "ellipse", (float(long), float(short), math.atan2(axes[1, 0], axes[0, 0]), large, right))


def outlines_of(subpaths: list[Subpath], to_metres: np.ndarray) -> tuple[list[Outline], int]:
    """(closed outlines, how many subpaths are none: their ends do not meet, or they enclose no area)."""
    closed = []
    for subpath in subpaths if np.linalg.det(to_metres) != 0 else ():
        segments, meets = _cleaned(subpath)
        if meets and not _is_flat(segments):
            closed.append(Outline(segments, to_metres))
    return closed, len(subpaths) - len(closed)


def _cleaned(subpath: Subpath) -> tuple[list[Segment], bool]:
    """(segments without those that are a point, whether the last ends where the first begins)."""
    points = np.array([p for s in subpath.segments for p in s.points])
    size = float(max(np.ptp(points.real), np.ptp(points.imag)))
    out = [part for s in subpath.segments if max(abs(p - s.points[0]) for p in s.points[1:]) > SAME * size
           for part in (_halves(s) if abs(s.points[-1] - s.points[0]) <= SAME * size else (s,))]
    if not out:
        return out, False
    if subpath.closed and out[-1].kind == "L" and abs(out[-1].points[1] - out[-1].points[0]) <= MEETS * size:
        out.pop()
    elif not subpath.closed and abs(out[-1].points[-1] - out[0].points[0]) > MEETS * size:
        return out, False
    return out, len(out) > 1


def _halves(loop: Segment) -> tuple[Segment, Segment]:
    """A Bezier curve that ends where it begins, cut in two by de Casteljau's construction."""
    points, first, last = loop.points, [loop.points[0]], [loop.points[-1]]
    while len(points) > 1:
        points = tuple((p + q) / 2 for p, q in zip(points, points[1:]))
        first, last = [*first, points[0]], [points[-1], *last]
    return Segment(loop.kind, tuple(first)), Segment(loop.kind, tuple(last))


def _is_flat(segments: list[Segment]) -> bool:
    """Whether straight segments go to and fro on one line."""
    if any(s.kind != "L" for s in segments):
        return False
    p = _xy(s.points[0] for s in segments)
    p -= p[0]
    far = p[np.abs(p).sum(axis=1).argmax()]
    return bool(np.abs(p[:, 0] * far[1] - p[:, 1] * far[0]).max() <= SAME * (far @ far))


def _xy(points: Iterable[complex]) -> np.ndarray:
    """(n, 2) of complex numbers."""
    return np.fromiter(points, dtype=np.complex128).view(np.float64).reshape(-1, 2)
