"""Side file of a drawing, in JSON: stitches, labels and places of its panels. numpy only.

    {"stitches": [[{"panel": "front", "edge": 1}, {"panel": "back", "edge": 3}], ...],   as in GarmentCode's format
     "labels": {"waist": [{"panel": "front", "edge": 2}, ...]},
     "placement": {"front": {"translation": [0, 90, 15], "rotation": [0, 0, 0]},        of the panel's middle, cm and degrees
                   "sleeve": {"around": [[40, 115, 0], [19, 138, 0]], "radius": 6, "turn": 180}}}
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean
from ..io.jsonfile import parse_json
from .curves import Curve
from .garmentcode import CENTIMETRES, bent, stitch_of, turned
from .pattern import Panel, Pattern


def side_of(path: Path) -> Path | None:
    """The side file of a drawing's name, if there is one."""
    side = path.with_suffix(".json")
    return side if side.is_file() else None


def joined(panels: tuple[Panel, ...], side: Path | None) -> Pattern:
    """The pattern of panels with the stitches, labels and places of a side file."""
    if side is None:
        return Pattern(panels)
    try:
        data = parse_json(side.read_bytes())
    except (OSError, ValueError) as error:
        raise SceneError(f"{side}: cannot be read: {error}") from None
    try:
        named = {p.name: p for p in panels}
        if len(named) == len(panels):  # else the pattern refuses them
            panels = _labelled(named, data.get("labels", {}))
        pattern = Pattern(panels, tuple(stitch_of(k, s, CENTIMETRES) for k, s in enumerate(data.get("stitches", []))))
        for name, place in data.get("placement", {}).items():
            panel = _known({p.name: p for p in pattern.panels}, name, "placement")
            pattern = _placed(pattern, panel, place)
        return pattern
    except SceneError as error:
        raise SceneError(f"{side}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SceneError(f"{side}: is not a side file of a drawing: {type(error).__name__}: {error}") from None


def _labelled(panels: dict[str, Panel], labels: dict) -> tuple[Panel, ...]:
    """The panels with labels of edges."""
    edges: dict[str, list[Curve]] = {}
    for label, ends in labels.items():
        for end in ends:
            panel = _known(panels, str(end["panel"]), f"label {label!r}")
            k = checks.integer(f"label {label!r}: edge of panel {panel.name!r}", end["edge"], least=0,
                               most=len(panel.edges) - 1)
            own = edges.setdefault(panel.name, list(panel.edges))
            own[k] = replace(own[k], label=label)
    return tuple(replace(p, edges=tuple(edges[p.name])) if p.name in edges else p for p in panels.values())


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
