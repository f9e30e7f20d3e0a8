"""Drawings of FreeSewing: a group for each part, in which classes tell the seam line from everything else. numpy only."""

from xml.etree.ElementTree import Element

from .drawing import SVG, Shape
from .outlines import Outline

MATERIALS = {"fabric", "lining", "interfacing", "canvas", "various"}  # classes of seam lines, where they have any
LOOKS = ("stroke-", "fill-")  # beginnings of classes that say how a line looks
FOLD = "url(#cutonfoldFrom)"  # the arrow along a fold


def is_freesewing(root: Element) -> bool:
    """Whether a drawing says that FreeSewing made it."""
    return "freesewing" in root.get("class", "").split() or root.get("freesewing") is not None


def seam_lines(closed: list[tuple[Shape, Outline]]) -> list[tuple[Shape, Outline]]:
    """The largest outline of each part that is drawn as cloth is, named as the part.

    Seam allowances, notes, marks and dashed lines have classes of their own.
    """
    parts: dict[str, tuple[Shape, Outline]] = {}
    for shape, outline in closed:
        name = _name(shape.part)
        cloth = all(c in MATERIALS or c.startswith(LOOKS) for c in shape.classes)
        if name and cloth and (name not in parts or outline.extent > parts[name][1].extent):
            parts[name] = (shape._replace(name=name, own=True), outline)
    return list(parts.values())


def cut_on_fold(root: Element) -> list[str]:
    """Names of the parts that are halves, of which one edge is a fold."""
    groups = ((_name(group.get("id", "")), group) for group in root.iter(SVG + "g"))
    return [name for name, group in groups if name and any(child.get("marker-start") == FOLD for child in group)]


def _name(part: str) -> str:
    """Name of a part from the id of its group, such as fs-stack-brian.back-part-brian.back."""
    return part.partition("-part-")[2]
