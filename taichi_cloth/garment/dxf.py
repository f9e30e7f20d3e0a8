"""Patterns in DXF files of the apparel trade: a panel of each piece. numpy only, and ezdxf.

The panel's border is the piece's sew line (layer 14), or, if there is none, its outline (1) with the seam allowance.
Edges end at turn points (2). A half is opened at its mirror line (6); the grain line (7) is the warp.
"""

import math
import re
from collections import Counter, defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean
from .chains import chained
from .cutpiece import Cut, corners_of
from .dxffile import Piece, Sheet, read_sheet
from .mesher import signed_area
from .outlines import MEETS, SAME
from .pattern import Panel, Pattern
from .sidefile import joined, side_of

OUTLINE, TURNS, CURVED, MIRROR, GRAIN, SEWN = "1", "2", "3", "6", "7", "14"
MARKS = {"4": "notches", "8": "internal lines", "11": "cutouts", "13": "drill holes"}
MOST_COPIES = 50  # of a piece: more are no garment's
NONE = np.zeros((0, 2))
Notes = defaultdict[str, list[str]]  # names of pieces, by the note on them


def read_dxf(path: Path, side: Path | None, size: str | None, scale: float | None) -> Pattern:
    """The pattern of a file; `side` is its side file, or None: the one of its name, .json, if there is one.

    Args:
        size: of a file with several sizes, one of them.
        scale: metres per unit, of a file that names no unit.

    Raises:
        SceneError: a file that cannot be read, or in which something is missing or wrong, by name.
    """
    side = side or side_of(path)
    try:
        sheet = read_sheet(path, scale)
        notes: Notes = defaultdict(list)
        pieces = _of_size(sheet, size)
        panels = tuple(panel for piece in pieces for panel in _panels(piece, notes))
        if not panels:
            raise SceneError("no piece of it is cut: the quantity of each is 0")
        said = [f"pieces {what}: {', '.join(names)}" for what, names in notes.items()]
        return replace(joined(panels, side), notes=(*sheet.notes, *said, *_marks(pieces)))
    except SceneError as error:
        raise SceneError(str(error) if str(path) in str(error) else f"{path}: {error}") from None


def _of_size(sheet: Sheet, size: str | None) -> list[Piece]:
    """The pieces of a size; those that name none are of every size."""
    sizes = list(dict.fromkeys(p.said["size"] for p in sheet.pieces if p.said.get("size")))
    if size is None and len(sizes) > 1:
        sample = sheet.said.get("sample size", "")
        raise SceneError(f"has {len(sizes)} sizes: choose one by size=: {', '.join(sizes)}"
                         f"{f' (the sample size is {sample})' if sample in sizes else ''}")
    if size is not None and size not in sizes:
        raise SceneError(f"has no size {size!r}; {did_you_mean(size, sizes) if sizes else 'its pieces name none'}")
    out = [p for p in sheet.pieces if size is None or p.said.get("size", "") in ("", size)]
    twice = next((name for name, many in Counter(p.name for p in out).items() if many > 1), None)
    if twice is not None:
        raise SceneError(f"two blocks are piece {twice!r} of one size: give them names of their own")
    return out


def _panels(piece: Piece, notes: Notes) -> list[Panel]:
    """The panels of a piece: as it is drawn, and mirrored, as often as it is cut."""
    try:
        name = checks.name("name", piece.name)
        drawn, mirrored = _quantity(piece.said.get("quantity") or "1")
        if drawn + mirrored == 0:
            notes["left out, as their quantity is 0"].append(name)
            return []
        cut = _cut(piece, notes)
        out = []
        for count, one, what in ((drawn, cut, name), (mirrored, cut.mirrored(), f"{name} mirrored")):
            out += [one.panel(what if k == 0 else f"{what} {k + 1}") for k in range(count)]
        return out
    except SceneError as error:
        raise SceneError(f"piece {piece.name!r}: {error}") from None


def _quantity(text: str) -> tuple[int, int]:
    """(how often a piece is cut as drawn, how often mirrored) of "1" or "1,1"."""
    match = re.fullmatch(r"(\d{1,9})(?:\s*[,;/]\s*(\d{1,9}))?", text)
    if match is None:
        raise SceneError(f"'Quantity: {text}' must be a number, or two: as drawn, and mirrored")
    drawn, mirrored = int(match[1]), int(match[2] or 0)
    if drawn + mirrored > MOST_COPIES:
        raise SceneError(f"'Quantity: {text}' is more than {MOST_COPIES}")
    return drawn, mirrored


def _cut(piece: Piece, notes: Notes) -> Cut:
    fold, grain = (_longest(piece.lines.get(layer, [])) for layer in (MIRROR, GRAIN))
    points = _border(piece, fold, notes)
    points = points[np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1) > SAME * np.ptp(points, axis=0).max()]
    corner, known = corners_of(points, piece.points.get(TURNS, NONE), piece.points.get(CURVED, NONE))
    if not known:
        notes["with fewer than two turn points (layer 2) on the border: edges end at corners of 30 degrees"].append(piece.name)
    cut = Cut(points, corner, 0.0)
    if grain is not None:
        cut = cut._replace(grain=math.atan2(*(grain[1] - grain[0])[::-1]))
    else:
        notes["without a grain line (layer 7): the warp runs across, as drawn"].append(piece.name)
    cut = cut if fold is None else cut.unfolded(*fold)
    return cut if grain is None else cut.hung()


def _longest(lines: list[np.ndarray]) -> np.ndarray | None:
    """(2, 2) the ends of the line whose ends are farthest apart; None if there is none."""
    ends = [line[[0, -1]] for line in lines if len(line) > 1 and (line[0] != line[-1]).any()]
    return max(ends, key=lambda two: math.dist(*two)) if ends else None


def _border(piece: Piece, fold: np.ndarray | None, notes: Notes) -> np.ndarray:
    """(n, 2) the sew line, or the outline where there is no closed one."""
    closed, opened = _rings(piece.lines.get(OUTLINE, []), fold)
    if not closed and not opened:
        raise SceneError("has no outline: there is no line on its layer 1")
    if not closed:
        a, b = opened[0][[0, -1]]
        raise SceneError(f"its outline (layer 1) is open: its ends are {math.dist(a, b):.3g} m apart, one at "
                         f"{a.round(4).tolist()} m")
    if len(closed) > 1:
        raise SceneError(f"has {len(closed)} closed lines on layer 1: a piece has one outline; cutouts are on layer 11")
    if opened:
        notes["with further lines on layer 1, which are no outline"].append(piece.name)
    sewn, parts = _rings(piece.lines.get(SEWN, []), fold)
    if sewn:
        return max(sewn, key=lambda ring: abs(signed_area(ring)))
    if parts:
        notes["whose sew line (layer 14) is open: the outline is taken, with its seam allowance"].append(piece.name)
    return closed[0]


def _rings(lines: list[np.ndarray], fold: np.ndarray | None) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """(closed lines, open ones); one that ends on the fold at both ends is closed along it."""
    closed, opened = chained(lines)
    if fold is None or not opened:
        return closed, opened
    way = (fold[1] - fold[0]) / math.dist(*fold)
    left: list[np.ndarray] = []
    for line in opened:
        away = np.abs((line[[0, -1]] - fold[0]) @ [-way[1], way[0]])
        ends = len(line) > 2 and (away <= MEETS * np.ptp(line, axis=0).max()).all()
        (closed if ends else left).append(line)
    return closed, left


def _marks(pieces: list[Piece]) -> list[str]:
    """A note on notches, lines and holes drawn in pieces, which are no part of panels."""
    count = {what: sum(len(p.lines.get(layer, ())) + len(p.points.get(layer, ())) for p in pieces)
             for layer, what in MARKS.items()}
    some = [f"{n} {what}" for what, n in count.items() if n]
    return [f"drawn in the pieces, and no part of the panels: {', '.join(some)}"] if some else []
