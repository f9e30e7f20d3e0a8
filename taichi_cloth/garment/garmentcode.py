"""Patterns in GarmentCode's JSON format. [Korosteleva, Sorkine-Hornung 2023]

Panels have corners [cm], edges that are straight or curved, a translation [cm] and a rotation R_z R_y R_x [degrees].
Stitches join two edges, the start of one to the end of the other unless "right_wrong" says otherwise.

Beyond the format: a panel may be bent, as a sleeve round an arm, by `around`, the ends of an axis [cm], `radius` [cm] and
`turn` [degrees]; other programs see its translation and rotation. In the place of `edge`, an end of a stitch may have
`points` [cm], a line or a point within the panel. And the two ends of a stitch may be followed by properties of the seam,
{"rest": degrees, "flat" or "given", "stiffness": factor, "strength": N/m}, as in `Scene.sew`.
"""

import math
from pathlib import Path

import numpy as np

from .. import checks
from ..errors import SceneError, near
from ..io.jsonfile import parse_json
from .curves import Curve
from .pattern import Panel, Pattern
from .stitch import End, Stitch

LIKE = ("rest", "stiffness", "strength")  # of a seam
CENTIMETRES = 100.0  # units in a metre, where a file does not say


def read_garmentcode(path: Path) -> Pattern:
    """The pattern of a file.

    Raises:
        SceneError: a file that cannot be read, or in which something is missing or wrong, by name.
    """
    try:
        data = parse_json(path.read_bytes())
    except OSError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}{near(path)}") from None
    except ValueError as error:
        raise SceneError(f"{path}: is not JSON: {error}") from None
    try:
        body = data["pattern"]
        per_metre = float(data.get("properties", {}).get("units_in_meter", CENTIMETRES))
        if not (np.isfinite(per_metre) and per_metre > 0):
            raise SceneError(f"units_in_meter = {per_metre}: must be a positive number")
        order = body.get("panel_order") or list(body["panels"])
        panels = tuple(_panel(name, body["panels"][name], per_metre) for name in order)
        pattern = Pattern(panels, tuple(stitch_of(k, s, per_metre) for k, s in enumerate(body.get("stitches", []))))
        for name in order:
            if "around" in body["panels"][name]:
                pattern = bent(pattern, name, body["panels"][name], per_metre)
        return pattern
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        raise SceneError(f"{path}: is not a pattern in GarmentCode's format: {type(error).__name__}: {error}") from None


def _panel(name: str, panel: dict, per_metre: float) -> Panel:
    count = len(panel["vertices"])
    corners = checks.array(f"vertices of panel {name!r}", panel["vertices"], (count, 2), row="corner") / per_metre
    edges = tuple(_edge(name, k, e, corners, per_metre) for k, e in enumerate(panel["edges"]))
    translation = checks.vector(f"translation of panel {name!r}", panel.get("translation", (0, 0, 0)), "cm") / per_metre
    angles = np.radians(checks.vector(f"rotation of panel {name!r}", panel.get("rotation", (0, 0, 0)), "degrees"))
    return Panel(checks.name("panel name", name), corners, edges, translation, turned(angles))


def bent(pattern: Pattern, name: str, place: dict, per_metre: float) -> Pattern:
    """The pattern with a panel bent round an axis: `around`, `radius` and `turn` of a file."""
    what = f"of panel {name!r}"
    ends = checks.array(f"around {what}", place["around"], (2, 3), row="end") / per_metre
    radius = checks.number(f"radius {what}", place.get("radius"), "cm", positive=True) / per_metre
    turn = checks.number(f"turn {what}", place.get("turn", 0.0), "degrees")
    return pattern.wrap(name, ends, radius, math.radians(turn))


def turned(angles: np.ndarray) -> np.ndarray:
    """R_z R_y R_x for angles (3,) [rad] about x, y and z."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return z @ y @ x


def _edge(panel: str, k: int, edge: dict, corners: np.ndarray, per_metre: float) -> Curve:
    what = f"edge {k} of panel {panel!r}"
    start, end = (int(i) for i in edge["endpoints"])
    for i in (start, end):
        if not 0 <= i < len(corners):
            raise SceneError(f"{what} ends at corner {i}; there are {len(corners)}")
    chord = float(np.linalg.norm(corners[end] - corners[start]))
    if not chord > 0:
        raise SceneError(f"{what} has no length")
    label, bend = str(edge.get("label", "") or ""), edge.get("curvature")
    if bend is None:
        return Curve(start, end, label=label)
    if isinstance(bend, list):  # as older files have it
        bend = {"type": "quadratic", "params": [bend]}
    kind = checks.choice(f"{what}: curvature", bend["type"], ("quadratic", "cubic", "circle"))
    if kind == "circle":
        radius, large, right = bend["params"]
        radius = checks.number(f"{what}: radius", radius, "cm", positive=True) / per_metre
        if 2 * radius < chord * (1 - 1e-6):
            raise SceneError(f"{what}: a circle of radius {radius:.4g} m does not reach over {chord:.4g} m")
        return Curve(start, end, kind, (max(radius, chord / 2), bool(large), bool(right)), label)
    count = {"quadratic": 1, "cubic": 2}[kind]
    control = checks.array(f"{what}: control points", bend["params"], (count, 2), row="point")
    return Curve(start, end, kind, tuple(map(tuple, control.tolist())), label)


def stitch_of(k: int, stitch: list, per_metre: float) -> Stitch:
    """A stitch as the format has it, of lengths in that many units a metre."""
    if not isinstance(stitch, list) or len(stitch) < 2:
        raise SceneError(f"stitch {k} must be two edges")
    a, b = (_end_of(f"stitch {k}", end, per_metre) for end in stitch[:2])
    like = next((dict(part) for part in stitch[2:] if isinstance(part, dict)), {})
    for name in like:
        checks.choice(f"word of stitch {k}", name, LIKE)
    if not isinstance(like.get("rest", ""), str):
        like["rest"] = math.radians(checks.number(f"stitch {k}: rest", like["rest"], "degrees", least=-180, most=180))
    try:
        return Stitch(a, b, together="right_wrong" in stitch[2:], **like)
    except SceneError as error:
        raise SceneError(f"stitch {k}: {error}") from None


def _end_of(what: str, end: dict, per_metre: float) -> End:
    """(panel, number of an edge), or (panel, points [m])."""
    if "points" not in end:
        return str(end["panel"]), int(end["edge"])
    points = checks.array(f"{what}: points", end["points"], ("n", 2), row="point") / per_metre
    return str(end["panel"]), tuple(map(tuple, points.tolist()))
