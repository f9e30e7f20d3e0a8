"""Wavefront OBJ: positions, texture corners, groups. A vertex may carry several texture coordinates (a seam).

Lines are sorted by their first words, and numbers are computed for all lines of a kind at once.
"""

import itertools
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..errors import MeshError
from .polygon import cut
from .text import text_of

GROUPS = ("o", "g", "usemtl")
LONGEST = 7  # letters of a first word that are looked at: one more than these have
BLANK = np.array([chr(k).isspace() for k in range(256)])  # letters between words
NONE = np.iinfo(np.int64).min  # in place of the number of a texture coordinate


class _Lines:
    """The lines of a file that count, by kind.

    Attributes:
        numbers: of the lines of a kind, in the file.
        rows: their text behind the first word.
        marks: (face from which it holds, kind of group, names).
    """

    def __init__(self, text: str) -> None:
        lines, numbers = _joined(text)
        keys = np.array([line[:LONGEST].partition(" ")[0] for line in lines])
        at = {kind: np.flatnonzero(keys == kind) for kind in ("v", "vt", "f")}
        self.numbers = {kind: numbers[k] for kind, k in at.items()}
        self.rows = {kind: [lines[row][len(kind):] for row in k.tolist()] for kind, k in at.items()}
        self.marks = [(int(np.searchsorted(at["f"], row)), str(keys[row]), lines[row].split()[1:])
                      for row in np.flatnonzero(np.isin(keys, GROUPS)).tolist()]

    def words(self, kind: str) -> tuple[str, np.ndarray]:
        """The text of all lines of a kind, and how many words each has."""
        rows = self.rows[kind]
        text = "\n".join(rows)
        if not text.isascii():
            return text, np.array([len(row.split()) for row in rows])
        letters = np.frombuffer(text.encode(), np.uint8)
        blank = BLANK[letters]
        first = np.flatnonzero(~blank & np.concatenate([[True], blank])[:-1])  # letters of words
        row = np.searchsorted(np.flatnonzero(letters == ord("\n")), first)
        return text, np.bincount(row, minlength=len(rows))

    def before_faces(self, kind: str) -> np.ndarray:
        """(f,) how many lines of a kind there are before each face."""
        return np.searchsorted(self.numbers[kind], self.numbers["f"])


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, np.ndarray], np.ndarray]:
    """Reads v, vt, f, g, o and usemtl; everything else is passed over.

    Returns:
        positions (n, 3), triangles (m, 3), texture coordinates per corner (m, 3, 2) or None where the file has none for
        some face, rows of triangles by the names of objects, groups and materials, and (m,) the polygon of each. Names of
        `o` and `usemtl` are the rest of their lines; `g a b` makes a and b, as the format has it, and "a b", as programs
        mean that write spaces.
        A material with the name of a group or an object is left out.

    Raises:
        MeshError: a line that does not parse or an index out of range, with the line's number.
    """
    try:
        lines = _Lines(text_of(path.read_bytes()))
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    try:
        v, vt = _numbers(lines, "v", 3), _numbers(lines, "vt", 2)
        counts, vertex, texture = _corners(lines)
    except _Wrong as wrong:
        line = " ".join([wrong.kind, *lines.rows[wrong.kind][wrong.row].split()])
        raise MeshError(f"{path}: line {lines.numbers[wrong.kind][wrong.row]}: {line[:60]!r}: {wrong}") from None
    if not len(counts):
        raise MeshError(f"{path}: the mesh has no faces")
    places, face = cut(v, vertex, counts)
    uv = vt[texture[places]] if len(vt) and (texture >= 0).all() else None
    return v, vertex[places], uv, _parts(lines.marks, face), face


class _Wrong(ValueError):
    """The fault of a row of a kind of lines."""

    def __init__(self, kind: str, row: int | np.integer, text: object) -> None:
        super().__init__(str(text))
        self.kind, self.row = kind, int(row)


def _joined(text: str) -> tuple[list[str], np.ndarray]:
    """Lines and their numbers: comments cut, continued lines joined, words apart by spaces."""
    lines = text.replace("\t", " ").splitlines()
    if "#" in text:
        lines = [line.partition("#")[0] if "#" in line else line for line in lines]
    if "\\" in text or any(map(str.startswith, lines, itertools.repeat(" "))):
        lines = [line.strip() for line in lines]
    numbers = np.arange(1, len(lines) + 1)
    if "\\" not in text:
        return lines, numbers
    goes_on = np.array([line.endswith("\\") for line in lines[:-1]] + [False] * bool(lines), dtype=bool)
    first = np.flatnonzero(~np.concatenate([[False], goes_on[:-1]])) if lines else np.arange(0)
    ends = [*first[1:].tolist(), len(lines)]
    joined = [" ".join(line.removesuffix("\\") for line in lines[a:b]).strip() for a, b in zip(first.tolist(), ends)]
    return joined, numbers[first]


def _numbers(lines: _Lines, kind: str, width: int) -> np.ndarray:
    """(n, width) of all lines of a kind; a second texture coordinate that is not there is 0."""
    text, counts = lines.words(kind)
    few = np.flatnonzero(counts < (3 if kind == "v" else 1))
    if len(few):
        raise _Wrong(kind, few[0], f"needs {width} numbers, not {counts[few[0]]}")
    if not (counts != width).any():
        values = _plain(text, float)
        if values is not None:
            return values.reshape(-1, width)
    words = text.split()
    if (counts != width).any():
        first = (np.cumsum(counts) - counts).tolist()
        words = [word for k, count in zip(first, counts.tolist()) for word in [*words[k: k + min(count, width)], "0"][:width]]
    try:
        return np.array(list(map(float, words))).reshape(-1, width)
    except ValueError:
        row, error = _first_wrong(words, float)
        raise _Wrong(kind, row // width, error) from None


def _plain(text: str, dtype: type) -> np.ndarray | None:
    """All words of a text that has nothing but numbers, in ASCII; None for another text, which is to be read word by word."""
    if not text.isascii() or "/" in text:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # a value that is no number ends the reading
        try:
            return np.fromstring(text, dtype, sep=" ")
        except (DeprecationWarning, ValueError):
            return None


def _corners(lines: _Lines) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(f,) corners of each face, (k,) vertices and texture coordinates of the corners of all, -1 if there are none."""
    text, counts = lines.words("f")
    if (counts > 2).all() and (plain := _plain(text, np.int64)) is not None:
        before = np.repeat(lines.before_faces("v"), counts)
        return counts, _places(plain, before, "vertex", np.cumsum(counts)), np.full(len(plain), -1)
    words = text.split()
    index = {word: k for k, word in enumerate(dict.fromkeys(words))}  # a corner is read once, however many faces have it
    ends = np.cumsum(counts)
    try:
        parts = [word.split("/", 2) for word in index]
        pairs = np.array([int(part[0]) for part in parts] + [_texture(part) for part in parts], dtype=np.int64)
    except (ValueError, OverflowError):
        k, error = _first_wrong(words, _one)
        raise _Wrong("f", np.searchsorted(ends, k, side="right"), error) from None
    few = np.flatnonzero(counts < 3)
    if len(few):
        raise _Wrong("f", few[0], f"a face needs at least 3 corners, not {counts[few[0]]}")
    at = np.fromiter(map(index.__getitem__, words), np.int64, len(words))
    out = [_places(pairs[k * len(index):][at], np.repeat(lines.before_faces(kind), counts), what, ends)
           for k, (kind, what) in enumerate((("v", "vertex"), ("vt", "texture coordinate")))]
    return counts, out[0], out[1]


def _places(numbers: np.ndarray, before: np.ndarray, what: str, ends: np.ndarray) -> np.ndarray:
    """Rows from 0 of numbers from 1, or from -1 back; before: (k,) how many there are then; ends: of the faces."""
    bad = ((numbers == 0) | (numbers > before) | (numbers < -before)) & (numbers != NONE)
    if bad.any():
        k = int(np.argmax(bad))
        raise _Wrong("f", np.searchsorted(ends, k, side="right"),
                     f"{what} {numbers[k]} is out of range: there are {before[k]} before this line")
    return np.where(numbers > 0, numbers - 1, np.where(numbers == NONE, -1, before + numbers))


def _texture(parts: list[str]) -> int:
    return int(parts[1]) if len(parts) > 1 and parts[1] else NONE


def _one(word: str) -> np.ndarray:
    parts = word.split("/", 2)
    return np.array([int(parts[0]), _texture(parts)], dtype=np.int64)


def _first_wrong(words: list[str], parse: Callable[[str], object]) -> tuple[int, Exception]:
    """The first word that does not parse, and why."""
    for k, word in enumerate(words):
        try:
            parse(word)
        except (ValueError, OverflowError) as error:
            return k, error
    raise AssertionError("every word parses")


def _parts(marks: list[tuple[int, str, list[str]]], face: np.ndarray) -> dict[str, np.ndarray]:
    """Rows of triangles of each group; face: (m,) the one that each triangle is of."""
    ranges: dict[bool, dict[str, list[tuple[int, int]]]] = {False: {}, True: {}}  # by whether a material is meant
    for key in GROUPS:
        mine = [mark for mark in marks if mark[1] == key]
        ends = [mark[0] for mark in mine[1:]] + [int(face[-1]) + 1]
        for (start, _, words), end in zip(mine, ends):
            whole = " ".join(words)
            for name in dict.fromkeys([whole, *words] if key == "g" else [whole]):
                if name and start < end:
                    ranges[key == "usemtl"].setdefault(name, []).append((start, end))
    out = {}
    for name, of in (ranges[True] | ranges[False]).items():
        rows = np.searchsorted(face, np.array(of))
        out[name] = np.unique(np.concatenate([np.arange(a, b) for a, b in rows]))
    return out
