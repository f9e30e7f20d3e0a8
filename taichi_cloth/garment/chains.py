"""Chains of lines: lines whose ends meet become one line each. numpy only."""

import math
from collections.abc import Sequence

import numpy as np

from .outlines import MEETS


class Places:
    """Points (n, 2), to be found by place, within `reach`."""

    def __init__(self, points: np.ndarray, reach: float) -> None:
        self.points, self.reach = points, reach
        self._cells: dict[tuple[int, int], list[int]] = {}
        for k, point in enumerate(points):
            self._cells.setdefault(self._cell(point), []).append(k)

    def _cell(self, point: np.ndarray) -> tuple[int, int]:
        return int(point[0] // self.reach), int(point[1] // self.reach)

    def at(self, point: np.ndarray) -> list[int]:
        """Numbers of the points within reach of a point (2,)."""
        i, j = self._cell(point)
        found = [k for a in (i - 1, i, i + 1) for b in (j - 1, j, j + 1) for k in self._cells.get((a, b), ())]
        return [k for k in found if math.dist(self.points[k], point) <= self.reach]


def chained(lines: Sequence[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """(closed lines, whose first point is not repeated; open ones) of lines (k, 2); lines drawn twice count once."""
    size = float(np.ptp(np.concatenate(lines), axis=0).max()) if len(lines) else 0.0
    if not size > 0:
        return [], []
    own: dict[bytes, np.ndarray] = {}
    for line in lines:
        line = line[np.concatenate([[True], (np.diff(line, axis=0) != 0).any(axis=1)])]
        if len(line) > 1:
            own.setdefault(min(line.tobytes(), line[::-1].tobytes()), line)
    left = list(own.values())
    places = Places(np.array([end for line in left for end in (line[0], line[-1])]), MEETS * size)
    used = [False] * len(left)
    closed, opened = [], []
    for k, line in enumerate(left):
        if not used[k]:
            used[k] = True
            line = _grown(_grown(line, left, used, places)[::-1], left, used, places)[::-1]
            if _closes(line[0], line[-1], len(line), places.reach):
                closed.append(line[:-1])
            else:
                opened.append(line)
    return closed, opened


def _grown(line: np.ndarray, left: list[np.ndarray], used: list[bool], places: Places) -> np.ndarray:
    """A line with those that go on from its end, until it is closed or none does."""
    parts, count = [line], len(line)
    while not _closes(line[0], parts[-1][-1], count, places.reach):
        end = next((k for k in places.at(parts[-1][-1]) if not used[k // 2]), None)
        if end is None:
            break
        used[end // 2] = True
        parts.append(left[end // 2][:: -1 if end % 2 else 1][1:])
        count += len(parts[-1])
    return np.concatenate(parts)


def _closes(first: np.ndarray, last: np.ndarray, count: int, reach: float) -> bool:
    return count > 3 and math.dist(first, last) <= reach
