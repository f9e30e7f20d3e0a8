"""A cut piece of a pattern: corners and edges, a fold that is opened, mirrored copies. numpy only."""

import math
from typing import NamedTuple

import numpy as np

from ..errors import SceneError
from .chains import Places
from .curves import Curve
from .outlines import MEETS
from .pattern import Panel

SHARP = math.radians(30)  # by which a line turns at a corner, where a file marks none; curves turn less from point to point
ACROSS = math.radians(22.5)  # from the x axis: half the way to the bias


class Cut(NamedTuple):
    """A piece's closed line.

    Attributes:
        points: (n, 2) [m], the first not repeated.
        corner: (n,) whether an edge ends there.
        grain: [rad] from the x axis to the warp.
    """

    points: np.ndarray
    corner: np.ndarray
    grain: float

    def hung(self) -> "Cut":
        """Turned by a quarter if its grain lies across, so that its right side is up."""
        if abs((self.grain + math.pi / 2) % math.pi - math.pi / 2) > ACROSS:
            return self
        return Cut(self.points @ np.array([[0.0, 1.0], [-1.0, 0.0]]), self.corner, self.grain + math.pi / 2)

    def mirrored(self) -> "Cut":
        """Left for right, edge by edge."""
        return Cut(self.points * [-1.0, 1.0], self.corner, math.pi - self.grain)

    def unfolded(self, a: np.ndarray, b: np.ndarray) -> "Cut":
        """With its other half, where it is a half that ends along the line from a to b (2,); its edges begin at the fold.

        Raises:
            SceneError: a half that does not end along the line.
        """
        along = (b - a) / np.linalg.norm(b - a)
        across = np.array([-along[1], along[0]])
        away = (self.points - a) @ across
        near = MEETS * float(np.ptp(self.points, axis=0).max())
        if away.min() < -near and away.max() > near:
            return self  # it is whole
        on = np.abs(away) <= near
        begins = np.flatnonzero(on & ~np.roll(on, -1))  # points on the line before one off it
        if len(begins) != 1 or on.sum() < 2:
            raise SceneError("its mirror line (layer 6) is not an edge of its outline: one edge of a half lies on it, from "
                             "end to end")
        points, turns, off = (np.roll(some, -begins[0], axis=0) for some in (self.points, self.corner, ~on))
        ends = points[[0, int(np.flatnonzero(off)[-1] + 1) % len(points)]]
        ends, half, turns = ends - np.outer((ends - a) @ across, across), points[off], turns[off]
        other = half - 2 * np.outer((half - a) @ across, across)
        return Cut(np.concatenate([ends[:1], half, ends[1:], other[::-1]]),
                   np.concatenate([[True], turns, [True], turns[::-1]]), self.grain)

    def panel(self, name: str) -> Panel:
        """The panel, with its origin in the middle of the box round it; its edges begin at the first corner.

        Raises:
            SceneError: a border that meets itself.
        """
        first = int(np.argmax(self.corner))
        points, corner = np.roll(self.points, -first, axis=0), np.roll(self.corner, -first)
        points = points - (points.min(axis=0) + points.max(axis=0)) / 2
        at = np.flatnonzero(corner)
        ends = [*at[1:], len(points)]
        edges = tuple(_edge(points, int(i), int(j), k, (k + 1) % len(at)) for k, (i, j) in enumerate(zip(at, ends)))
        return Panel(name, points[at], edges, grain=self.grain % math.pi)


def corners_of(points: np.ndarray, turns: np.ndarray, curved: np.ndarray) -> tuple[np.ndarray, bool]:
    """((n,) where edges end on a closed line, whether these are turn points: with fewer than two, where it turns sharply).

    Args:
        turns, curved: (k, 2) points that are marked as corners and as points of curves.
    """
    places = Places(points, MEETS * float(np.ptp(points, axis=0).max()))
    marked = [np.zeros(len(points), dtype=bool) for _ in range(2)]
    for mask, some in zip(marked, (turns, curved)):
        for point in some:
            mask[places.at(point)] = True
    corner, known = marked[0], bool(marked[0].sum() > 1)
    if not known:
        way = np.roll(points, -1, axis=0) - points
        before = np.roll(way, 1, axis=0)
        turn = np.arctan2(before[:, 0] * way[:, 1] - before[:, 1] * way[:, 0], (before * way).sum(axis=1))
        corner = corner | ((np.abs(turn) > SHARP) & ~marked[1])
    if corner.sum() < 2:
        first = int(np.argmax(corner))
        long = np.cumsum(np.linalg.norm(np.diff(np.roll(points, -first, axis=0), axis=0), axis=1))
        corner[[first, (first + 1 + int(np.searchsorted(long, long[-1] / 2))) % len(points)]] = True
    return corner, known


def _edge(points: np.ndarray, i: int, j: int, start: int, end: int) -> Curve:
    """From point i to point j, by those between them."""
    if j == i + 1:
        return Curve(start, end)
    a, b = points[i], points[j % len(points)]
    along, own = b - a, points[i + 1:j] - a
    left = np.array([-along[1], along[0]])
    parameters = np.column_stack([own @ along, own @ left]) / (along @ along)
    return Curve(start, end, "polyline", tuple(map(tuple, parameters.tolist())))
