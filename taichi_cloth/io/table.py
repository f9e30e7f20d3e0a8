"""Tables of numbers in CSV: names in the first line, faults named by their line. numpy is not needed."""

import csv
import math
import pathlib
from collections.abc import Iterator

from ..errors import SceneError, near

DELIMITERS = ";\t,"  # the first of these that is in the line of names
LONGEST = 60  # characters of a name, as messages have room for


def read_table(path: pathlib.Path, most: int) -> tuple[dict[str, list[float]], list[int]]:
    """(columns by name, the line of each row) of a file with at most so many rows.

    A byte order mark, empty lines and lines that begin with # are skipped; cells may be in quotes.

    Raises:
        SceneError: a file that cannot be read or is no text, names that are missing or there twice, a row of another length,
            or a value that is no finite number: with its line.
    """
    columns: dict[str, list[float]] = {}
    names: list[str] = []
    lines: list[int] = []
    delimiter = ","
    for number, line in _lines(path):
        if not names:
            delimiter = next((d for d in DELIMITERS if d in line), ",")
            names = [cell.strip() for cell in _cells(path, number, line, delimiter)]
            if len(set(names)) < len(names) or not all(0 < len(name) <= LONGEST for name in names):
                raise SceneError(f"{path}, line {number}: needs a name for each column, each once and of at most {LONGEST} "
                                 f"characters, not {line.strip()[:LONGEST]!r}")
            columns = {name: [] for name in names}
            continue
        cells = _cells(path, number, line, delimiter)
        if len(cells) != len(names):
            raise SceneError(f"{path}, line {number}: has {len(cells)} values, not {len(names)}")
        if len(lines) == most:
            raise SceneError(f"{path}, line {number}: has more than {most:,} rows")
        for name, cell in zip(names, cells):
            columns[name].append(_number(cell, f"{path}, line {number}: {name}"))
        lines.append(number)
    if not names:
        raise SceneError(f"{path} is empty: needs names of columns, and a line a row")
    return columns, lines


def _lines(path: pathlib.Path) -> Iterator[tuple[int, str]]:
    """Those with something in them, by number."""
    number = 0
    try:
        with open(path, encoding="utf-8-sig") as file:
            for number, line in enumerate(file, 1):
                if line.strip() and not line.lstrip().startswith("#"):
                    yield number, line
    except UnicodeDecodeError:
        raise SceneError(f"{path}, line {number + 1} or later: is not text in UTF-8") from None
    except (OSError, ValueError) as error:
        raise SceneError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}{near(path)}") from None


def _cells(path: pathlib.Path, number: int, line: str, delimiter: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=delimiter, strict=True, skipinitialspace=True))
    except csv.Error as error:
        raise SceneError(f"{path}, line {number}: is not a line of a table: {error}") from None


def _number(cell: str, what: str) -> float:
    text = cell.strip()
    try:
        value = math.nan if "_" in text else float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        hint = ", with a point before its decimals" if text.replace(",", "").isdecimal() else ""
        raise SceneError(f"{what} = {text[:40]!r}: must be a number{hint}")
    return value
