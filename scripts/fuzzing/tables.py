"""Trials of what is read as text: measurements and stitches in CSV, patterns in JSON, whole in many guises, or damaged.

A whole file must give back what was put into it; a damaged one must load, or be refused by one of the project's own errors
that names the file, within seconds and a bounded amount of memory.
"""

import json
import pathlib
import tempfile

import numpy as np
from fuzz import FAILED, OK, Outcome

import taichi_cloth as tc
from fuzzing.files import Limits, damage
from taichi_cloth.errors import ClothError
from taichi_cloth.fitting import data

KINDS = ("measurements", "stitches", "pattern")
PANELS = "".join(f"v {x} 0 {z}\nvt {x} {z}\n" for x in (0, 1, 3, 4) for z in (0, 1)) + (
    "f 1/1 3/3 4/4\nf 1/1 4/4 2/2\nf 5/5 7/7 8/8\nf 5/5 8/8 6/6\n")
SQUARE = [[0, 0], [40, 0], [40, 40], [0, 40]]
EXTREME = ("1e400", "1" + "0" * 400, "NaN", "-Infinity", "[" * 100_000, '{"a":' * 100_000, "null", "\"\"", "true", "1_0",
           "0x1f", "1,5", "\x00", "\"", "2" * 200_000, "{}", "[]", "-1", "0.5")


def table(names: tuple[str, ...], rows: np.ndarray, rng: np.random.Generator) -> bytes:
    """Rows in CSV, in one of the guises in which programs write it."""
    delimiter, end = str(rng.choice([",", ";", "\t"])), str(rng.choice(["\n", "\r\n", "\r"]))
    quote, space = ('"' if rng.random() < 0.3 else ""), (" " if rng.random() < 0.3 else "")
    lines = [(delimiter + space).join(f"{quote}{cell}{quote}" for cell in row)
             for row in (names, *([repr(float(v)) for v in row] for row in rows))]
    for extra in ("", "# made by hand", "   "):
        if rng.random() < 0.3:
            lines.insert(int(rng.integers(len(lines) + 1)), extra)
    return (b"\xef\xbb\xbf" if rng.random() < 0.3 else b"") + (end.join(lines) + (end if rng.random() < 0.7 else "")).encode()


def pattern() -> dict:
    """Two squares that are sewn along a side."""
    edges = [{"endpoints": [k, (k + 1) % 4]} for k in range(4)]
    edges[1]["curvature"] = {"type": "quadratic", "params": [[0.5, 0.1]]}
    panels = {name: {"vertices": SQUARE, "edges": edges, "translation": [0, 90, z], "rotation": [0, 0, 0]}
              for name, z in (("front", 10), ("back", -10))}
    return {"pattern": {"panels": panels, "stitches": [[{"panel": "front", "edge": 0}, {"panel": "back", "edge": 0}]]},
            "properties": {"units_in_meter": 100}}


def spoilt(text: bytes, rng: np.random.Generator) -> tuple[bytes, str]:
    """A file's bytes, damaged, or with something extreme in place of a word."""
    if rng.random() < 0.5:
        return damage(text, rng)
    a = int(rng.integers(len(text)))
    b, word = min(len(text), a + int(rng.integers(0, 6))), str(rng.choice(EXTREME))
    return text[:a] + word.encode() + text[b:], f"{text[a:b]!r} at {a} is now {word[:12]!r}"


def trial(seed: int, precision: str) -> Outcome:
    """One file; `precision` makes no difference."""
    rng = np.random.default_rng([seed, 78])
    kind, whole, way = str(rng.choice(KINDS)), rng.random() < 0.3, "whole"
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        rows = rng.uniform(0.01, 1, (int(rng.integers(1, 9)), 2))
        columns = ("length", "drop")
        if kind == "stitches":
            rows, columns = np.array([[2, 4, 4, 0], [3, 5, 5, 0], [2, 4, 5, 0.0]])[: int(rng.integers(1, 4))], (
                "vertex", "edge_a", "edge_b", "t")
        (folder / "panels.obj").write_text(PANELS)
        path = folder / ("file.json" if kind == "pattern" else "file.csv")
        text = json.dumps(pattern()).encode() if kind == "pattern" else table(columns, rows, rng)
        if not whole:
            text, way = spoilt(text, rng)
        path.write_bytes(text)
        case = f"seed {seed}: {kind}, {way}"
        try:
            with Limits():
                right = read(kind, path, rows)
        except ClothError as error:
            if whole or str(path) not in str(error) or len(str(error)) > 600:
                return Outcome(FAILED, f"{case}: refused: {str(error)[:600]}")
            return Outcome(OK)
        except Exception as error:
            return Outcome(FAILED, f"{case}: {type(error).__name__}: {str(error)[:600]}")
    return Outcome(FAILED, f"{case}: other values came back") if whole and not right else Outcome(OK)


def read(kind: str, path: pathlib.Path, rows: np.ndarray) -> bool:
    """Reads a file; whether it holds the rows, or the pattern's two panels."""
    if kind == "measurements":
        found = data.read(path, ("length",), ("drop", "angle"))
        return "drop" in found and np.array_equal(np.column_stack([found["length"], found["drop"]]), rows)
    if kind == "stitches":
        seams = tc.load_stitched(path.parent / "panels.obj", path).seams
        sewn = {tuple(sorted(pair)) for seam in seams for pair in zip(np.ravel(seam[0]).tolist(), np.ravel(seam[1]).tolist())}
        return {tuple(sorted(map(int, row[:2]))) for row in rows} <= sewn
    return [panel.name for panel in tc.load_pattern(path).panels] == ["front", "back"]
