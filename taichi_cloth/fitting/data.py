"""Measurements: columns of numbers by name, from a CSV file or given as arrays."""

from collections.abc import Mapping, Sequence

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean
from ..io.table import read_table

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
    if isinstance(source, Mapping):
        columns, where = dict(source), "data"
    else:
        path = checks.path("fit: data", source)
        columns, where = read_table(path, MOST)[0], str(path)  # type: ignore[assignment]
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
    """Refuses a column (rows,) with a value that is not between `low` and `high`, both excluded.

    Raises:
        SceneError: with the row.
    """
    bad = np.flatnonzero(~((columns[name] > low) & (columns[name] < high)))
    if len(bad):
        what = f"more than {low:g}" + ("" if np.isinf(high) else f" and less than {high:g}")
        raise SceneError(f"{where}: {name} of row {bad[0]} is {columns[name][bad[0]]:g}: must be {what}{hint}")
