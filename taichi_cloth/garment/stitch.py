"""Two places of a pattern that are sewn to each other: edges of panels, lines within them, points. numpy only."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from ..scene.garment import seam_angle, seam_strength

Line = tuple[tuple[float, float], ...]
End = tuple[str, "int | Line"]


@dataclass(frozen=True)
class Stitch:
    """Two edges that are sewn to each other, an edge to a line within a panel, as of a pocket, or a point to a point, as by a
    button.

    Attributes:
        a, b: (name of the panel, number of the edge), or (name of the panel, points (k, 2) [m]). Points are a line from
            point to point in the panel's coordinates, within it, or a single point there or at a corner.
        together: whether both run the same way; else the start of one meets the end of the other.
        rest, stiffness, strength: angle of the seam at rest, factor of its hinges' stiffness, force a length [N/m] at which it
            rips, as in `Scene.sew`; along a line within a panel there are no hinges.
    """

    a: End
    b: End
    together: bool = False
    rest: float | str = "flat"
    stiffness: float = 1.0
    strength: float | None = None

    def __post_init__(self) -> None:
        for name in ("a", "b"):
            object.__setattr__(self, name, _end(name, getattr(self, name)))
        object.__setattr__(self, "together", checks.flag("stitch: together", self.together))
        object.__setattr__(self, "rest", seam_angle("stitch: rest", self.rest))
        object.__setattr__(self, "stiffness", checks.number("stitch: stiffness", self.stiffness, least=0.0))
        object.__setattr__(self, "strength", seam_strength("stitch: strength", self.strength))
        points = [is_point(end) for end in (self.a, self.b)]
        if points[0] != points[1]:
            raise SceneError(f"stitch: {place_of(self.a)} to {place_of(self.b)}: a point is sewn to a point, and an edge or a "
                             "line to an edge or a line")
        if points[0] and self.strength is not None:
            raise SceneError("stitch: a point has no strength, which is a force a length: use Scene.stitch(force=...)")


def _end(name: str, end: object) -> End:
    if not (isinstance(end, (list, tuple)) and len(end) == 2 and isinstance(end[0], str)):
        raise SceneError(f"stitch: {name} = {shown(end)}: must be (name of a panel, number of an edge or points within it)")
    if not isinstance(end[1], (list, tuple, np.ndarray)):
        return end[0], checks.integer(f"stitch: {name}, edge", end[1], least=0)
    if not len(end[1]):
        raise SceneError(f"stitch: {name}, points of panel {end[0]!r}: there is none")
    points = checks.array(f"stitch: {name}, points", end[1], ("n", 2), row="point")
    if len(points) > 1 and not (np.diff(points, axis=0) != 0).any(axis=1).all():
        raise SceneError(f"stitch: {name}, points of panel {end[0]!r}: one of them follows itself")
    return end[0], tuple((float(u), float(v)) for u, v in points)


def is_point(end: End) -> bool:
    """Whether an end of a stitch is a single point."""
    return isinstance(end[1], tuple) and len(end[1]) == 1


def place_of(end: End) -> str:
    """In words."""
    if not isinstance(end[1], tuple):
        return f"edge {end[1]} of panel {end[0]!r}"
    kind = "a point" if len(end[1]) == 1 else "a line"
    return f"{kind} at {', '.join(f'({u:.4g}, {v:.4g})' for u, v in end[1][:2])} m of panel {end[0]!r}"


def line_length(points: Line) -> float:
    """[m] from the first of points to the last, by all."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def line_divided(points: Line, count: int) -> np.ndarray:
    """(count + 1, 2) points at equal lengths along a line, both ends among them; one of a single point."""
    if len(points) == 1:
        return np.array(points)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, way[-1], count + 1)
    return np.column_stack([np.interp(at, way, column) for column in zip(*points)])
