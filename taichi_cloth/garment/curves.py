"""Edges of a panel, straight or curved, and points at equal arc length on them. numpy only."""

import math
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown

FINE = 512  # pieces in which a curve's length is measured
CONTROLS = {"quadratic": 1, "cubic": 2}  # points


@dataclass(frozen=True)
class Curve:
    """An edge from one corner of a panel to another.

    Attributes:
        start, end: numbers of the corners.
        kind: "line", "polyline", "quadratic", "cubic", "circle" or "ellipse".
        parameters: depend on the kind. Bezier curves: control points (1 or 2, 2) along the edge and to its left, in parts of
            its length. Polyline: the points (n, 2) between its ends, in the same coordinates. Circle: (radius, whether it is
            the large arc, whether it bends to the right). Ellipse: (radius, other radius, angle of the first to the panel's u
            axis [rad], large, right).
        label: its name in the file, or "".
    """

    start: int
    end: int
    kind: str = "line"
    parameters: tuple = ()
    label: str = ""

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        for name in ("start", "end"):
            set_(self, name, checks.integer(f"curve: {name}", getattr(self, name), least=0))
        checks.choice("curve: kind", self.kind, ("line", "polyline", *CONTROLS, "circle", "ellipse"))
        if not (isinstance(self.label, str) and not self.label):
            set_(self, "label", checks.name("curve: label", self.label))
        if not isinstance(self.parameters, (list, tuple)):
            raise SceneError(f"curve: parameters = {shown(self.parameters)}: must be a tuple")
        if self.kind == "line" and len(self.parameters):
            raise SceneError("curve: a line has no parameters")
        if self.kind in ("circle", "ellipse"):
            names = ("radius", *(("other radius", "angle") if self.kind == "ellipse" else ()), "large", "right")
            if len(self.parameters) != len(names):
                raise SceneError(f"curve: a {self.kind} has the parameters {', '.join(names)}")
            set_(self, "parameters", tuple(
                checks.flag(f"curve: {name}", value) if name in ("large", "right") else
                checks.number(f"curve: {name}", value, "rad" if name == "angle" else "m", positive=name != "angle")
                for name, value in zip(names, self.parameters)))
        elif self.kind != "line":
            points = checks.array("curve: control points", self.parameters, (CONTROLS.get(self.kind, "n"), 2), row="point")
            set_(self, "parameters", tuple(map(tuple, points.tolist())))

    def points(self, corners: np.ndarray, t: np.ndarray) -> np.ndarray:
        """(k, 2) at parameters t (k,) in 0..1, for corners (n, 2)."""
        a, b = corners[self.start], corners[self.end]
        t = t[:, None]
        if self.kind == "line":
            return (1 - t) * a + t * b
        if self.kind == "circle":
            return _arc(a, b, t, *self.parameters)
        if self.kind == "ellipse":
            long, short, angle, large, right = self.parameters
            c, s = math.cos(angle), math.sin(angle)
            stretch = np.array([[c * long, -s * short], [s * long, c * short]])  # of the circle of radius 1
            start, end = np.linalg.solve(stretch, np.array([a, b]).T).T
            return _arc(start, end, t, 1.0, large, right) @ stretch.T
        if self.kind == "polyline":
            line = self.drawn(corners, FINE)
            way = _way(line)
            return np.column_stack([np.interp(t[:, 0] * way[-1], way, column) for column in line.T])
        along = b - a
        left = np.array([-along[1], along[0]])
        control = [a + p[0] * along + p[1] * left for p in self.parameters]
        if self.kind == "quadratic":
            return (1 - t) ** 2 * a + 2 * t * (1 - t) * control[0] + t**2 * b
        return (1 - t) ** 3 * a + 3 * t * (1 - t) ** 2 * control[0] + 3 * t**2 * (1 - t) * control[1] + t**3 * b

    def drawn(self, corners: np.ndarray, pieces: int) -> np.ndarray:
        """(k, 2) points, both ends among them, of straight pieces that stand for it: its own, or as many of a curve."""
        if self.kind == "line":
            return corners[[self.start, self.end]]
        if self.kind != "polyline":
            return self.points(corners, np.linspace(0, 1, pieces + 1))
        a, along = corners[self.start], corners[self.end] - corners[self.start]
        own = a + np.array(self.parameters) @ np.array([along, [-along[1], along[0]]])
        return np.concatenate([corners[[self.start]], own, corners[[self.end]]])

    def length(self, corners: np.ndarray) -> float:
        """Length [m] between corners (k, 2) [m] of the panel."""
        if self.kind == "line":
            return math.dist(corners[self.start], corners[self.end])
        return float(_way(self.drawn(corners, FINE))[-1])

    def divided(self, corners: np.ndarray, count: int) -> np.ndarray:
        """(count + 1, 2) points, both ends among them, at equal arc length."""
        if self.kind in ("line", "polyline"):
            return self.points(corners, np.linspace(0, 1, count + 1))
        t = np.linspace(0, 1, FINE + 1)
        way = _way(self.points(corners, t))
        out = self.points(corners, np.interp(np.linspace(0, way[-1], count + 1), way, t))
        out[0], out[-1] = corners[self.start], corners[self.end]
        return out


def _way(line: np.ndarray) -> np.ndarray:
    """(k,) lengths from the first of points (k, 2) on."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])


def _arc(a: np.ndarray, b: np.ndarray, t: np.ndarray, radius: float, large: bool, right: bool) -> np.ndarray:
    """(k, 2) points of an arc from a to b; where its radius does not reach so far, of half a circle."""
    along = b - a
    chord = float(np.linalg.norm(along))
    left, radius = np.array([-along[1], along[0]]) / chord, max(radius, chord / 2)
    height = math.sqrt(max(radius**2 - chord**2 / 4, 0.0))
    middle = (a + b) / 2 + left * height * (1 if bool(large) != bool(right) else -1)
    begin, finish = (math.atan2(*(p - middle)[::-1]) for p in (a, b))
    turn = (finish - begin) % (2 * math.pi)
    turn = turn if right else turn - 2 * math.pi  # with y up, a positive turn bends to the right of its chord
    angle = begin + t * turn
    return middle + radius * np.concatenate([np.cos(angle), np.sin(angle)], axis=1)
