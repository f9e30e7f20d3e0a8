"""Measurements: columns of numbers by name, from a CSV file or given as arrays."""

import csv
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean, near

SIGMA = "sigma"  # standard deviation of each measurement, where it is known
MOST = 1_000_000  # rows


def read(source: object, needed: Sequence[str], either: Sequence[str] = (),
         optional: Sequence[str] = ()) -> dict[str, np.ndarray]:
    """Columns (m,) by name.

    Args:
        source: path of a CSV file with names in its first line, or a mapping of arrays.
        needed: names that must be there; either: one of which must be; optional: names that may be, besides `sigma`.

    Raises:
        SceneError: a column that is missing, unknown or of another length, or a value that is no finite number, by its line.
    """
    columns, where = _of_file(source) if not isinstance(source, Mapping) else (dict(source), "data")
    known = [*needed, *either, *optional, SIGMA]
    for name in needed:
        if name not in columns:
            raise SceneError(f"{where}: no column {name!r}; there are: {', '.join(map(str, columns)) or 'none'}")
    if either and not any(name in columns for name in either):
        there = ", ".join(map(str, columns))
        raise SceneError(f"{where}: needs a column {' or '.join(map(repr, either))}; there are: {there}")
    for name in columns:
        if name not in known:
            raise SceneError(f"{where}: unknown column {name!r}; {did_you_mean(name, known)}")
    out = {name: checks.array(f"{where}: {name}", values, ("m",), row="row") for name, values in columns.items()}
    lengths = {len(values) for values in out.values()}
    if len(lengths) != 1 or not 1 <= max(lengths) <= MOST:
        raise SceneError(f"{where}: columns must have the same number of rows, at least one, not {sorted(lengths)}")
    if SIGMA in out:
        within(out, SIGMA, where, 0.0)
    return out


def within(columns: Mapping[str, np.ndarray], name: str, where: str, low: float, high: float = np.inf, hint: str = "") -> None:
    """Refuses a column with a value that is not between two, both excluded.

    Raises:
        SceneError: with the row.
    """
    bad = np.flatnonzero(~((columns[name] > low) & (columns[name] < high)))
    if len(bad):
        what = f"more than {low:g}" + ("" if np.isinf(high) else f" and less than {high:g}")
        raise SceneError(f"{where}: {name} of row {bad[0]} is {columns[name][bad[0]]:g}: must be {what}{hint}")


def _of_file(source: object) -> tuple[dict[str, list[float]], str]:
    path = checks.path("fit: data", source)
    try:
        text = pathlib.Path(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        raise SceneError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}{near(path)}") from None
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip() and not line.lstrip().startswith("#")]
    if not lines:
        raise SceneError(f"{path} is empty: needs names of columns, and a line a measurement")
    delimiter = ";" if ";" in lines[0][1] else "\t" if "\t" in lines[0][1] else ","
    names = [cell.strip() for cell in next(csv.reader([lines[0][1]], delimiter=delimiter))]
    if len(set(names)) < len(names) or not all(names):
        raise SceneError(f"{path}, line {lines[0][0]}: needs a name for each column, each once, not {lines[0][1]!r}")
    columns: dict[str, list[float]] = {name: [] for name in names}
    for number, line in lines[1:]:
        cells = next(csv.reader([line], delimiter=delimiter))
        if len(cells) != len(names):
            raise SceneError(f"{path}, line {number}: has {len(cells)} values, not {len(names)}")
        for name, cell in zip(names, cells):
            columns[name].append(_number(cell, f"{path}, line {number}: {name}"))
    return columns, str(path)


def _number(cell: str, what: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise SceneError(f"{what} = {cell.strip()!r}: must be a number")
    return value
