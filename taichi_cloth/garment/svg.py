"""Panels drawn in an SVG file. numpy only.

Every closed outline is a panel. Each segment of its border is an edge, counted from 0 in the order of the drawing; a
closing line is added if the last one does not end at the first point. Open lines are no panels.
"""

from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

from .. import checks
from ..errors import SceneError
from .drawing import SVG, Drawing, Shape
from .freesewing import cut_on_fold, is_freesewing, seam_lines
from .outlines import Outline, outlines_of
from .pattern import Panel, Pattern
from .sidefile import joined, side_of
from .xmlfile import parse

NAMED = 5  # names that a note has at most
UNBOXED = ("the drawing has no viewBox: numbers without a unit are pixels, 96 to an inch, whatever its width and height say; "
           'viewBox="0 0 W H" says how many of its units those are')


def read_svg(path: Path, side: Path | None) -> Pattern:
    """The pattern of a drawing; `side` is its side file, or None: the one of the drawing's name, .json, if there is one.

    Raises:
        SceneError: a file that cannot be read, or in which something is missing or wrong, by name.
    """
    root = parse(path)
    if root.tag.removeprefix(SVG) != "svg":
        raise SceneError(f"{path}: is not an SVG: its root is <{root.tag.rpartition('}')[2]}>")
    side = side or side_of(path)
    notes: tuple[str, ...] = ()
    try:
        panels, notes = _panels(root)
        return replace(joined(panels, side), notes=notes)
    except SceneError as error:
        raise SceneError(f"{path}: {error}{'; ' + UNBOXED if UNBOXED in notes else ''}") from None


def _panels(root: Element) -> tuple[tuple[Panel, ...], tuple[str, ...]]:
    """The panels of a drawing, and notes on its other elements."""
    drawing = Drawing(root)
    closed: list[tuple[Shape, Outline]] = []
    lines: list[str] = []
    for shape in drawing.shapes:
        whole, rest = outlines_of(shape.subpaths, shape.to_metres)
        closed += [(shape, outline) for outline in whole]
        lines += [shape.name] * rest
    halves: list[str] = []
    if is_freesewing(root):
        seams, halves = seam_lines(closed), cut_on_fold(root)
        lines, closed = [""] * (len(lines) + len(closed) - len(seams)), seams
    for (shape, _), (after, _) in zip(closed, closed[1:]):
        if shape is after:
            raise SceneError(f"{shape.what}: its path has several closed lines: holes and parts are panels of their own")
    if not closed:
        raise SceneError(f"there is no closed shape in it; {len(lines)} lines are open and {drawing.hidden} elements hidden")
    return tuple(_named(closed)), _notes(drawing, lines, halves)


def _named(closed: list[tuple[Shape, Outline]]) -> list[Panel]:
    """Panels; those of one group, or of a shape that is drawn several times, are told apart by numbers."""
    out, taken = [], {shape.name for shape, _ in closed if shape.own}
    for shape, outline in closed:
        if not shape.name:
            raise SceneError(f"{shape.what} is closed and has no name: give it, or its group, an id")
        name, k = shape.name, 1
        while not shape.own and name in taken:
            k += 1
            name = f"{shape.name} {k}"
        taken.add(name)
        out.append(outline.panel(checks.name("name of a shape", name)))
    return out


def _notes(drawing: Drawing, lines: list[str], halves: list[str]) -> tuple[str, ...]:
    out = []
    if lines:
        out.append(f"lines of the drawing that are no panels, such as notches and grain lines: {len(lines)}{_some(lines)}")
    if halves:
        out.append(f"halves that are cut on a fold, and are read as drawn: {len(halves)}{_some(halves)}")
    if drawing.hidden:
        out.append(f"hidden elements of the drawing that are left out: {drawing.hidden}")
    if drawing.dangling:
        out.append(f"<use> elements of the drawing that refer to nothing in it: {drawing.dangling}")
    if not drawing.scaled:
        out.append("no unit of length says how large the drawing is: 96 of its pixels are taken for an inch")
    elif not drawing.boxed:
        out.append(UNBOXED)
    return tuple(out)


def _some(names: list[str]) -> str:
    """The first of them, in brackets."""
    known = sorted({name for name in names if name})
    return f" ({', '.join(known[:NAMED])}{', ...' if len(known) > NAMED else ''})" if known else ""
