"""Subpaths of SVG shapes: path, polygon, polyline, line, rect, circle, ellipse. numpy only. [SVG 2, chapter 10]"""

import math
from collections.abc import Callable
from xml.etree.ElementTree import Element

from ..errors import SceneError, shown
from .pathdata import NUMBER, Segment, Subpath, arc, number, numbers, subpaths

PIXEL = 0.0254 / 96  # m
UNITS = {"": PIXEL, "px": PIXEL, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "in": 0.0254, "mm": 1e-3, "cm": 1e-2, "Q": 0.25e-3}  # m
SHAPES = ("path", "polygon", "polyline", "line", "rect", "circle", "ellipse")

Length = Callable[[str, str], "float | None"]


def length(what: str, text: str, whole: float = 0.0) -> float:
    """A length in user units; a percentage is a part of `whole`.

    Raises:
        SceneError: no number, or another unit.
    """
    match = NUMBER.match(text)
    if match is None:
        raise SceneError(f"{what} = {shown(text)}: is not a length")
    value, unit = number(what, match[1]), text[match.end():].strip()
    if unit == "%" and not whole > 0:
        raise SceneError(f"{what} = {shown(text)}: a part of a size that is not given: give the drawing a width and a height")
    if unit == "%":
        return value / 100 * whole
    if unit not in UNITS:
        raise SceneError(f"{what} = {shown(text)}: the unit {unit!r} is not read: known are {', '.join(filter(None, UNITS))}")
    return value * UNITS[unit] / PIXEL


def subpaths_of(node: Element, tag: str, what: str, size: tuple[float, float]) -> list[Subpath]:
    """The subpaths of a shape, in its own coordinates.

    Args:
        size: width and height of the viewport, for percentages.

    Raises:
        SceneError: an attribute that is no length or no path data.
    """
    whole = {"x": size[0], "y": size[1], "both": math.hypot(*size) / math.sqrt(2)}

    def at(name: str, axis: str) -> float | None:
        text = node.get(name, "").strip()
        return length(f"{what}: {name}", text, whole[axis]) if text and text != "auto" else None

    if tag == "path":
        return subpaths(what, node.get("d", ""))
    if tag in ("polygon", "polyline"):
        return _through(what, node.get("points", ""), closed=tag == "polygon")
    if tag == "line":
        ends = (complex(at(f"x{k}", "x") or 0.0, at(f"y{k}", "y") or 0.0) for k in "12")
        return [Subpath([Segment("L", tuple(ends))], False)]
    if tag == "rect":
        return _box(what, at)
    r = (at("r", "both"),) * 2 if tag == "circle" else _radii(at)
    return _ellipse(what, complex(at("cx", "x") or 0.0, at("cy", "y") or 0.0), r[0] or 0.0, r[1] or 0.0)


def _through(what: str, points: str, closed: bool) -> list[Subpath]:
    """Straight segments from point to point."""
    n = numbers(f"{what}: points", points)
    if len(n) % 2:
        raise SceneError(f"{what}: points: {len(n)} numbers are not points: the last has no y")
    corners = [complex(x, y) for x, y in zip(n[::2], n[1::2])]
    ends = corners[1:] + corners[:1] if closed else corners[1:]
    return [Subpath([Segment("L", pair) for pair in zip(corners, ends)], closed)] if len(corners) > 1 else []


def _radii(at: Length) -> tuple[float | None, float | None]:
    """Along x and y; one that is not given is as large as the other."""
    rx, ry = at("rx", "x"), at("ry", "y")
    return (ry if rx is None else rx), (rx if ry is None else ry)


def _box(what: str, at: Length) -> list[Subpath]:
    """The border of a rect, from its corner at x, y on; round corners are edges of their own."""
    x, y, w, h = (at(name, axis) or 0.0 for name, axis in (("x", "x"), ("y", "y"), ("width", "x"), ("height", "y")))
    rx, ry = (r or 0.0 for r in _radii(at))
    _refuse_negative(what, width=w, height=h, rx=rx, ry=ry)
    if not (w and h):
        return []
    rx, ry = (min(rx, w / 2), min(ry, h / 2)) if rx and ry else (0.0, 0.0)
    corners = [complex(x + a, y + b) for a, b in ((0, 0), (w, 0), (w, h), (0, h))]
    ways, cut = (1, 1j, -1, -1j), (rx, ry, rx, ry)  # along each side, and how much its round ends take
    out = []
    for k, way in enumerate(ways):
        onward = (k + 1) % 4
        end = corners[onward] - way * cut[k]
        out.append(Segment("L", (corners[k] + way * cut[k], end)))
        if rx:
            out.append(arc(end, corners[onward] + ways[onward] * cut[onward], rx, ry))
    return [Subpath(out, True)]


def _ellipse(what: str, middle: complex, rx: float, ry: float) -> list[Subpath]:
    """Four arcs, from the side of +x on."""
    _refuse_negative(what, rx=rx, ry=ry)
    if not (rx and ry):
        return []
    at = [middle + complex(a * rx, b * ry) for a, b in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    return [Subpath([arc(a, b, rx, ry) for a, b in zip(at, at[1:] + at[:1])], True)]


def _refuse_negative(what: str, **lengths: float) -> None:
    for name, value in lengths.items():
        if value < 0:
            raise SceneError(f"{what}: {name} = {value:g}: must be 0 or more")
