"""Path data, numbers and transforms of SVG drawings. numpy only.

Points are complex numbers, x + iy, in the drawing's own units, y down. [SVG 2, chapters 8 and 9]
"""

import math
import re
from typing import NamedTuple

import numpy as np

from .. import checks
from ..errors import SceneError, shown

NUMBER = re.compile(r"\s*,?\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
FLAG = re.compile(r"\s*,?\s*([01])")
COMMAND = re.compile(r"\s*([MmLlHhVvCcSsQqTtAaZz])")
FUNCTION = re.compile(r"[\s,]*([A-Za-z]+)\s*\(([^()]*)\)")
TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}  # numbers of a command
FUNCTIONS = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3), "skewX": (1,), "skewY": (1,)}  # numbers


class Segment(NamedTuple):
    """A piece of a subpath.

    Attributes:
        kind: "L" straight, "Q" or "C" a Bezier curve, "A" an arc.
        points: start, control points, end.
        arc: (radius along x, along y, tilt [rad], whether the large arc, whether its angle grows) of an arc.
    """

    kind: str
    points: tuple[complex, ...]
    arc: tuple[float, float, float, bool, bool] | None = None


class Subpath(NamedTuple):
    """Segments, each from the end of the one before, and whether the last one ends at the start of the first."""

    segments: list[Segment]
    closed: bool


def number(what: str, text: str) -> float:
    """A decimal number.

    Raises:
        SceneError: one that is too large.
    """
    value = float(text)
    if not abs(value) <= checks.LARGEST:
        raise SceneError(f"{what}: the number {shown(text)} is too large")
    return value


def numbers(what: str, text: str) -> list[float]:
    """Decimal numbers with spaces or commas between them.

    Raises:
        SceneError: anything else among them, or a number that is too large.
    """
    out, at, text = [], 0, text.strip()
    while at < len(text):
        match = NUMBER.match(text, at)
        if match is None:
            raise SceneError(f"{what}: {shown(text[at:at + 20].strip())} is not a number")
        out.append(number(what, match[1]))
        at = match.end()
    return out


def linear_part(what: str, text: str) -> np.ndarray:
    """The linear part (2, 2) of a `transform`. Translations are left out: a panel is placed by its middle.

    Raises:
        SceneError: an unknown function, or one with too few or too many numbers.
    """
    out, at, text = np.eye(2), 0, text.strip()
    while at < len(text):
        match = FUNCTION.match(text, at)
        if match is None or match[1] not in FUNCTIONS:
            raise SceneError(f"{what}: transform {shown(text[at:at + 40])} is not read: known are {', '.join(FUNCTIONS)}")
        n, at = numbers(f"{what}: {match[1]}", match[2]), match.end()
        if len(n) not in FUNCTIONS[match[1]]:
            raise SceneError(f"{what}: {match[1]} has {len(n)} numbers: it takes {' or '.join(map(str, FUNCTIONS[match[1]]))}")
        out = out @ _function(match[1], n)
    return out


def _function(name: str, n: list[float]) -> np.ndarray:
    if name == "matrix":
        return np.array([[n[0], n[2]], [n[1], n[3]]])
    if name == "scale":
        return np.diag([n[0], n[-1]])
    a = math.radians(n[0])
    if name == "rotate":
        return np.array([[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]])
    if name == "skewX":
        return np.array([[1, math.tan(a)], [0, 1]])
    if name == "skewY":
        return np.array([[1, 0], [math.tan(a), 1]])
    return np.eye(2)


def subpaths(what: str, d: str) -> list[Subpath]:
    """The subpaths of path data.

    Raises:
        SceneError: an unknown command, too few numbers after one, a number that is too large.
    """
    out: list[Subpath] = []
    segments: list[Segment] = []
    at = first = 0j
    for command, n in _commands(what, d):
        upper, base = command.upper(), at if command.islower() else 0j
        if upper == "Z":
            if segments:
                out.append(Subpath([*segments, Segment("L", (at, first))], True))
            at, segments = first, []
        elif upper == "M":
            if segments:
                out.append(Subpath(segments, False))
            at = first = base + complex(*n)
            segments = []
        else:
            segments.append(_segment(upper, n, base, at, segments[-1] if segments else None))
            at = segments[-1].points[-1]
    return [*out, Subpath(segments, False)] if segments else out


def _commands(what: str, d: str) -> list[tuple[str, list[float]]]:
    """Each command with its numbers; where numbers go on, the command again, and L after M."""
    out: list[tuple[str, list[float]]] = []
    at, end = 0, len(d.rstrip())
    while at < end:
        match = COMMAND.match(d, at)
        if match is None or not out and match[1] not in "Mm":
            rest = d[at:].lstrip()
            raise SceneError(f"{what}: its path has {shown(rest[:20].strip())} at character {len(d) - len(rest) + 1}, "
                             f"{'which is not a command' if match is None else 'and does not begin with M'}")
        command, at = match[1], match.end()
        takes = TAKES[command.upper()]
        flags = (3, 4) if takes == 7 else ()
        while True:
            n: list[float] = []
            while len(n) < takes:
                match = (FLAG if len(n) in flags else NUMBER).match(d, at)
                if match is None:
                    raise SceneError(f"{what}: its path has {len(n)} of {takes} numbers after {command}, at character "
                                     f"{at + 1}")
                n.append(number(f"{what}: its path", match[1]))
                at = match.end()
            out.append((command, n))
            if not takes or not NUMBER.match(d, at):
                break
            command = {"M": "L", "m": "l"}.get(command, command)
    return out


def _segment(upper: str, n: list[float], base: complex, at: complex, before: Segment | None) -> Segment:
    """One of a path, after the one before it."""
    if upper == "H":
        return Segment("L", (at, complex(base.real + n[0], at.imag)))
    if upper == "V":
        return Segment("L", (at, complex(at.real, base.imag + n[0])))
    if upper == "A":
        return arc(at, base + complex(*n[5:]), n[0], n[1], math.radians(n[2]), bool(n[3]), bool(n[4]))
    points = [base + complex(x, y) for x, y in zip(n[::2], n[1::2])]
    kind = {"S": "C", "T": "Q"}.get(upper, upper)
    if kind != upper:  # the control point of the segment before, mirrored; of another kind, the point itself
        points.insert(0, 2 * at - before.points[-2] if before and before.kind == kind else at)
    return Segment(kind, (at, *points))


def arc(start: complex, end: complex, rx: float, ry: float, tilt: float = 0.0, large: bool = False,
        grows: bool = True) -> Segment:
    """Arc of an ellipse; a straight line if a radius is 0."""
    if not (rx and ry):
        return Segment("L", (start, end))
    return Segment("A", (start, end), (abs(rx), abs(ry), tilt, large, grows))
