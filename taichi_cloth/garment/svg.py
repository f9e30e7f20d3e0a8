"""Panels drawn in an SVG file, and what a side file says of them: stitches, labels, where they hang. numpy only.

Every closed shape (path, polygon, rect) is a panel named by its id; each segment of its border is an edge, counted from 0 in
the order of the drawing, with a closing line where the last one does not end at the first point. The side file is JSON:

    {"stitches": [[{"panel": "front", "edge": 1}, {"panel": "back", "edge": 3}], ...],   as in GarmentCode's format
     "labels": {"waist": [{"panel": "front", "edge": 2}, ...]},
     "placement": {"front": {"translation": [0, 90, 15], "rotation": [0, 0, 0]},        of the panel's middle, cm and degrees
                   "sleeve": {"around": [[40, 115, 0], [19, 138, 0]], "radius": 6, "turn": 180}}}
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean, near
from .curves import Curve
from .garmentcode import CENTIMETRES, bent, stitch_of, turned
from .pattern import Panel, Pattern

UNITS = {"": 0.0254 / 96, "px": 0.0254 / 96, "pt": 0.0254 / 72, "pc": 0.0254 / 6, "in": 0.0254, "mm": 1e-3, "cm": 1e-2}  # m
TOKEN = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)|([^\s,])")
TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}  # numbers of a command
SAME = 1e-9  # of a shape's size within which two points are one
FLAT = 1e-6  # relative difference of the radii of a circle


def read_svg(path: Path, side: Path | None) -> Pattern:
    """The pattern of a drawing; `side` is its side file, or None: the one of the drawing's name, .json, where there is one.

    Raises:
        SceneError: a file that cannot be read, or in which something is missing or wrong, by name.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}{near(path)}") from None
    except ElementTree.ParseError as error:
        raise SceneError(f"{path}: is no SVG: {error}") from None
    if _tag(root) != "svg":
        raise SceneError(f"{path}: is no SVG: its root is <{_tag(root)}>")
    side = side or (path.with_suffix(".json") if path.with_suffix(".json").is_file() else None)
    try:
        panels = tuple(panel for panel in _shapes(root, _to_metres(root)))
        if not panels:
            raise SceneError("there is no closed shape in it")
        return _joined(panels, side)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _joined(panels: tuple[Panel, ...], side: Path | None) -> Pattern:
    """Panels with what a side file says."""
    if side is None:
        return Pattern(panels)
    try:
        data = json.loads(side.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SceneError(f"{side}: cannot be read: {error}") from None
    try:
        named = {p.name: p for p in panels}
        for label, ends in data.get("labels", {}).items():
            for end in ends:
                panel = _known(named, str(end["panel"]), f"label {label!r}")
                k = checks.integer(f"label {label!r}: edge of panel {panel.name!r}", end["edge"], least=0,
                                   most=len(panel.edges) - 1)
                edges = [replace(e, label=label) if i == k else e for i, e in enumerate(panel.edges)]
                named[panel.name] = replace(panel, edges=tuple(edges))
        pattern = Pattern(tuple(named.values()), tuple(stitch_of(k, s) for k, s in enumerate(data.get("stitches", []))))
        for name, place in data.get("placement", {}).items():
            panel = _known({p.name: p for p in pattern.panels}, name, "placement")
            pattern = _placed(pattern, panel, place)
        return pattern
    except SceneError as error:
        raise SceneError(f"{side}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SceneError(f"{side}: is no side file of a drawing: {type(error).__name__}: {error}") from None


def _known(panels: dict[str, Panel], name: str, what: str) -> Panel:
    if name not in panels:
        raise SceneError(f"{what}: there is no panel {name!r}; {did_you_mean(name, list(panels))}")
    return panels[name]


def _placed(pattern: Pattern, panel: Panel, place: dict) -> Pattern:
    what = f"of panel {panel.name!r}"
    if "around" in place:
        return bent(pattern, panel.name, place, CENTIMETRES)
    R = turned(np.radians(checks.vector(f"rotation {what}", place.get("rotation", (0, 0, 0)), "degrees")))
    at = checks.vector(f"translation {what}", place.get("translation", (0, 0, 0)), "cm") / CENTIMETRES
    return pattern.with_panel(replace(panel, rotation=R, translation=at))


def _to_metres(root: ElementTree.Element) -> np.ndarray:
    """(2, 3) from the drawing's numbers to metres, y up."""
    scale = UNITS["px"]
    box = [float(number) for number in re.split(r"[\s,]+", root.get("viewBox", "").strip()) if number]
    match = re.fullmatch(r"\s*([\d.eE+-]+)\s*([a-z]*)\s*", root.get("width", ""))
    if len(box) == 4 and match and match[2] in UNITS and box[2] > 0:
        scale = float(match[1]) * UNITS[match[2]] / box[2]
    elif len(box) == 4:
        raise SceneError("how large it is, is not said: give the drawing a width in mm, cm or in")
    return np.array([[scale, 0, 0], [0, -scale, 0]])


def _shapes(node: ElementTree.Element, to: np.ndarray) -> Iterator[Panel]:
    for child in node:
        tag = _tag(child)
        if tag in ("defs", "clipPath", "mask", "symbol", "pattern", "marker"):
            continue
        here = to @ np.vstack([_transform(child.get("transform", "")), [0, 0, 1]])
        if tag in ("path", "polygon", "polyline", "rect"):
            yield _panel(child, tag, here)
        else:
            yield from _shapes(child, here)


def _tag(node: ElementTree.Element) -> str:
    return node.tag.rsplit("}", 1)[-1] if isinstance(node.tag, str) else ""


def _transform(text: str) -> np.ndarray:
    """(2, 3) of a `transform`."""
    out = np.eye(3)
    for name, body in re.findall(r"(\w+)\s*\(([^)]*)\)", text):
        n = [float(x) for x in re.split(r"[\s,]+", body.strip())]
        one = np.eye(3)
        if name == "matrix":
            one[:2] = np.array(n).reshape(3, 2).T
        elif name == "translate":
            one[:2, 2] = n[0], n[1] if len(n) > 1 else 0.0
        elif name == "scale":
            one[0, 0], one[1, 1] = n[0], n[-1]
        elif name == "rotate":
            a, about = math.radians(n[0]), np.array(n[1:] or (0.0, 0.0))
            one[:2, :2] = [[math.cos(a), -math.sin(a)], [math.sin(a), math.cos(a)]]
            one[:2, 2] = about - one[:2, :2] @ about
        else:
            raise SceneError(f"transform {name!r} is not read: apply it to the shapes")
        out = out @ one
    return out[:2]


def _panel(node: ElementTree.Element, tag: str, to: np.ndarray) -> Panel:
    name = checks.name("id of a shape", node.get("id") or "")
    what = f"panel {name!r}"
    if tag == "path":
        segments = _segments(what, node.get("d", ""))
    else:
        numbers = [float(x) for x in re.split(r"[\s,]+", node.get("points", "").strip()) if x]
        if tag == "rect":
            x, y, w, h = (float(node.get(key, 0)) for key in ("x", "y", "width", "height"))
            numbers = [x, y, x + w, y, x + w, y + h, x, y + h]
        points = np.array(numbers[:len(numbers) // 2 * 2]).reshape(-1, 2)
        segments = [("L", [a, b]) for a, b in zip(points, np.roll(points, -1, axis=0))]
    segments = [(kind, [p if isinstance(p, tuple) else to[:, :2] @ p + to[:, 2] for p in data]) for kind, data in segments]
    size = max((float(np.abs(data[-1] - data[0]).max()) for _, data in segments), default=0.0)
    segments = [s for s in segments if len(s[1]) > 2 or np.abs(s[1][-1] - s[1][0]).max() > SAME * size]
    if len(segments) < 2:
        raise SceneError(f"{what}: its border is no closed line")
    corners = np.array([data[0] for _, data in segments])
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
    edges = tuple(_curve(what, k, (k + 1) % len(segments), s, to[:, :2]) for k, s in enumerate(segments))
    return Panel(name, corners - middle, edges)


def _curve(what: str, start: int, end: int, segment: tuple[str, list], to: np.ndarray) -> Curve:
    kind, data = segment
    a, b = data[0], data[-1]
    along = b - a
    if kind == "A":
        radii, large, sweep = data[1]
        scale = np.linalg.svd(to, compute_uv=False)
        if abs(radii[0] - radii[1]) > FLAT * radii[0] or scale[0] - scale[1] > FLAT * scale[0]:
            raise SceneError(f"{what}: edge {start} is an arc of an ellipse: draw it as a Bezier curve")
        turns_left = bool(sweep) == bool(np.linalg.det(to) > 0)  # with y up
        radius = max(radii[0] * float(scale[0]), float(np.linalg.norm(along)) / 2)
        return Curve(start, end, "circle", (radius, bool(large), turns_left))
    if kind == "L":
        return Curve(start, end)
    left = np.array([-along[1], along[0]])
    square = float(along @ along)
    if not square > 0:
        raise SceneError(f"{what}: edge {start} ends where it begins: cut it in two")
    control = tuple((float((p - a) @ along / square), float((p - a) @ left / square)) for p in data[1:-1])
    return Curve(start, end, "quadratic" if kind == "Q" else "cubic", control)


def _segments(what: str, d: str) -> list[tuple[str, list]]:
    """(command, [start, what is between, end]) of the segments of a path's one closed line."""
    tokens = []
    for command, number, wrong in TOKEN.findall(d):
        if wrong:
            raise SceneError(f"{what}: its path has {wrong!r}, which is no command")
        tokens.append(command or float(number))
    out: list[tuple[str, list]] = []
    at = first = np.zeros(2)
    k, command, closed = 0, "", False
    while k < len(tokens):
        if isinstance(tokens[k], str):
            command, k = tokens[k], k + 1
        upper, n = command.upper(), tokens[k:k + TAKES.get(command.upper(), 0)]
        if not command or len(n) < TAKES[upper] or any(isinstance(x, str) for x in n) or (closed and upper != "Z"):
            raise SceneError(f"{what}: its path is no single closed line of {', '.join(TAKES)}")
        k += len(n)
        base = at if command.islower() else np.zeros(2)
        if upper == "M":
            if out:
                raise SceneError(f"{what}: its path has several lines: holes and parts are panels of their own")
            at = first = base + n
            command = "l" if command == "m" else "L"
            continue
        if upper == "Z":
            closed = True
            out.append(("L", [at, first]))
            if k < len(tokens) and not isinstance(tokens[k], str):
                raise SceneError(f"{what}: its path goes on after its end")
            at = first
            continue
        out.append(_segment(upper, np.array(n), base, at, out))
        at = out[-1][1][-1]
    if not closed:
        out.append(("L", [at, first]))
    return out


def _segment(upper: str, n: np.ndarray, base: np.ndarray, at: np.ndarray, before: list[tuple[str, list]]) -> tuple[str, list]:
    """One of a path."""
    if upper in "HV":
        end = at.copy()
        end["HV".index(upper)] = base["HV".index(upper)] + n[0]
        return "L", [at, end]
    if upper == "A":
        return "A", [at, ((abs(n[0]), abs(n[1])), n[3], n[4]), base + n[5:]]
    points = [base + p for p in n.reshape(-1, 2)]
    if upper in "ST":  # the control point of the segment before, mirrored
        kind = "C" if upper == "S" else "Q"
        same = before and before[-1][0] == kind
        points.insert(0, 2 * at - before[-1][1][-2] if same else at)
        return kind, [at, *points]
    return upper, [at, *points]
