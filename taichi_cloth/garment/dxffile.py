"""Pieces in a DXF file of the apparel trade, with texts, lines and points by layer. Read by ezdxf.

A piece is a block; its layers are numbers. [AAMA-DXF-292, ASTM D6673]
"""

import io
import logging
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .xmlfile import bytes_of

LINES = ("LINE", "POLYLINE", "LWPOLYLINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE")
FLAT = 1e-5  # of a curve's size within which straight pieces follow it
PARTS = 8  # Bezier curves that stand for an arc: they follow it as near
SAYS = re.compile(r"\s*([A-Za-z][A-Za-z ]*?)\s*:\s*(.*?)\s*$")
WORDS = {"metric": 1e-3, "mm": 1e-3, "cm": 1e-2, "english": 0.0254, "inch": 0.0254, "inches": 0.0254}  # metres
INSUNITS = {1: 0.0254, 2: 0.3048, 4: 1e-3, 5: 1e-2, 6: 1.0, 14: 0.1}  # metres
NO_UNIT = ("no unit of length is named, neither by a text 'Units: METRIC' (millimetres) or 'Units: ENGLISH' (inches) nor by "
           "$INSUNITS: scale=0.001 takes its numbers for millimetres")


class Heard(logging.Handler):
    """Keeps the warnings of a library in place of printing them."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Keeps a message."""
        self.said.append(record.getMessage())


class Piece(NamedTuple):
    """A block in which a piece is drawn.

    Attributes:
        said: texts of the form "Key: value", by key in small letters.
        lines: points (k, 2) [m] of each line, by layer.
        points: (k, 2) [m], by layer.
    """

    name: str
    said: dict[str, str]
    lines: dict[str, list[np.ndarray]]
    points: dict[str, np.ndarray]


class Sheet(NamedTuple):
    """The pieces of a file, its own texts "Key: value", and notes."""

    pieces: list[Piece]
    said: dict[str, str]
    notes: tuple[str, ...]


def read_sheet(path: Path, scale: float | None) -> Sheet:
    """The pieces of a file; scale: metres per unit, where it names none.

    Raises:
        SceneError: ezdxf is not installed, a file that cannot be read, has no pieces or no unit.
    """
    data = bytes_of(path)
    document, mended = _document(data)
    if not data.rstrip().endswith(b"EOF"):
        raise SceneError("is cut off: a DXF ends with EOF")
    said = _said(document.modelspace())
    blocks = [block for block in document.blocks if not block.is_any_layout]
    texts = {block.name: _said(block) for block in blocks}
    for text in texts.values():
        said = {**{key: text[key] for key in ("units", "sample size") if key in text}, **said}
    blocks = [b for b in blocks if "piece name" in texts[b.name] or any(
        e.dxf.layer == "1" and e.dxftype() in LINES for e in b)]
    if not blocks:
        raise SceneError("there are no pieces in it: a piece is a block with its outline on layer 1, as files of the apparel "
                         "trade have it (AAMA, ASTM D6673)")
    metres, notes = _metres(said.get("units", ""), int(document.header.get("$INSUNITS", 0)), scale)
    _refuse_scaled(document.modelspace(), {b.name for b in blocks})
    if mended:
        notes += (f"the file is damaged, and mended as far as it goes: {mended[-1]}",)
    return Sheet([_piece(b, texts[b.name], metres) for b in blocks], said, notes)


def _document(data: bytes) -> tuple[Any, list[str]]:
    """(the document, messages on its damage)."""
    try:
        from ezdxf import recover
    except ImportError:
        raise SceneError("DXF is read by the package ezdxf: pip install 'taichi-cloth[dxf]'") from None
    heard, log = Heard(), logging.getLogger("ezdxf")
    log.addHandler(heard)
    try:
        document, auditor = recover.read(io.BytesIO(data), errors="ignore")
    except Exception as error:  # of any kind: of the parser, of its tables, of numbers
        raise SceneError(f"is not a DXF file, or a damaged one: {type(error).__name__}: {shown(str(error))}") from None
    finally:
        log.removeHandler(heard)
    return document, [*heard.said, *(error.message for error in auditor.errors)]


def _said(entities: Iterable[Any]) -> dict[str, str]:
    out: dict[str, str] = {}
    for entity in entities:
        if entity.dxftype() in ("TEXT", "MTEXT"):
            text = entity.plain_text() if entity.dxftype() == "MTEXT" else entity.dxf.text
            for line in text.splitlines():
                match = SAYS.match(line)
                if match:
                    out.setdefault(match[1].lower(), match[2])
    return out


def _metres(word: str, number: int, scale: float | None) -> tuple[float, tuple[str, ...]]:
    """(metres per unit, notes); word: of the text "Units: ..."; number: $INSUNITS."""
    if word and word.lower() not in WORDS:
        raise SceneError(f"'Units: {word}' is not a known unit: METRIC are millimetres, ENGLISH inches")
    own = WORDS[word.lower()] if word else INSUNITS.get(number)
    if scale is not None and own is not None:
        raise SceneError("names its unit itself: leave out scale=")
    if own is None and scale is None:
        raise SceneError(NO_UNIT)
    if word and INSUNITS.get(number, own) != own:
        return WORDS[word.lower()], (f"$INSUNITS = {number} says another unit than the text 'Units: {word}', which is taken",)
    return own or scale or 1.0, ()


def _refuse_scaled(modelspace: Any, names: set[str]) -> None:
    for insert in modelspace.query("INSERT"):
        factors = [abs(insert.dxf.get(key, 1.0)) for key in ("xscale", "yscale")]
        if insert.dxf.get("name") in names and factors != [1.0, 1.0]:
            raise SceneError(f"block {insert.dxf.name!r} is inserted {factors[0]:g} by {factors[1]:g} times as large as it is "
                             "drawn: write pieces in their own size")


def _piece(block: Any, said: dict[str, str], metres: float) -> Piece:
    name = said.get("piece name") or block.name
    lines: dict[str, list[np.ndarray]] = {}
    points: dict[str, list[np.ndarray]] = {}
    try:
        for entity in block:
            layer, kind = entity.dxf.layer, entity.dxftype()
            if kind in LINES:
                lines.setdefault(layer, []).append(_flattened(entity) * metres)
            elif kind == "POINT":
                points.setdefault(layer, []).append(np.array([entity.dxf.location.x, entity.dxf.location.y]) * metres)
    except Exception as error:  # of ezdxf's geometry
        raise SceneError(f"piece {name!r}: a line of it is damaged: {type(error).__name__}: {shown(str(error))}") from None
    for layer, all_ in [*lines.items(), *points.items()]:
        if not all((np.abs(some) <= checks.LARGEST).all() for some in all_):
            raise SceneError(f"piece {name!r}: layer {layer!r} has coordinates that are no numbers, or too large")
    return Piece(name, said, lines, {layer: np.array(all_) for layer, all_ in points.items()})


def _flattened(entity: Any) -> np.ndarray:
    """(k, 2) points of a line, in the file's units; more than its own only where it is curved."""
    from ezdxf import path

    drawn = path.make_path(entity, segments=PARTS)
    own = np.array([(p.x, p.y) for p in drawn.control_vertices()]).reshape(-1, 2)
    size = float(np.ptp(own, axis=0).max()) if len(own) else 0.0
    if not (drawn.has_curves and 0 < size <= checks.LARGEST):
        return own
    return np.array([(p.x, p.y) for p in drawn.flattening(FLAT * size)])
