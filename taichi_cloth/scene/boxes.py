"""Pairs of boxes that meet, by cells as large as the boxes themselves. numpy only.

A box belongs to the level of its longest side, and cells of level l are 2^l wide: a fine patch beside a floor of two
triangles has as many cells as boxes. Pairs come in parts of bounded size, each pair once.
"""

from collections.abc import Iterator

import numpy as np

PART = 100_000  # pairs that are looked at together
DIGITS = 50  # a box is held to be at least 2^-50 of its coordinates wide: numbers of cells stay exact
LEVELS = (-1000, 1020)


def near(a: np.ndarray, b: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (i, j), in parts, of all items a (n, k, 3) and b (m, l, 3) of finite points whose bounding boxes meet."""
    low_a, high_a, low_b, high_b = a.min(axis=1), a.max(axis=1), b.min(axis=1), b.max(axis=1)
    if not (len(a) and len(b)):
        return
    ia = np.flatnonzero(((low_a <= high_b.max(axis=0)) & (high_a >= low_b.min(axis=0))).all(axis=1))
    ib = np.flatnonzero(((low_b <= high_a.max(axis=0)) & (high_b >= low_a.min(axis=0))).all(axis=1))
    level_a, level_b = _levels(low_a[ia], high_a[ia]), _levels(low_b[ib], high_b[ib])
    for la in np.unique(level_a):
        for lb in np.unique(level_b):
            i, j = ia[level_a == la], ib[level_b == lb]
            for p, q in _meeting(low_a[i], high_a[i], low_b[j], high_b[j], np.ldexp(1.0, max(la, lb))):
                yield i[p], j[q]


def _levels(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """(n,) smallest l with 2^l at least a box's longest side."""
    with np.errstate(over="ignore", divide="ignore"):
        side = np.maximum((high - low).max(axis=1), np.maximum(np.abs(low), np.abs(high)).max(axis=1) * 2.0**-DIGITS)
        return np.ceil(np.clip(np.log2(side), *LEVELS)).astype(np.int64)


def _meeting(low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray,
             cell: float) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The same for boxes of which none is wider than a cell."""
    cells_a, item_a = _cells(low_a, high_a, cell)
    cells_b, item_b = _cells(low_b, high_b, cell)
    code_a, code_b = _code(cells_a), _code(cells_b)
    order = np.argsort(code_b, kind="stable")
    code_b = code_b[order]
    first, count = np.searchsorted(code_b, code_a, "left"), np.searchsorted(code_b, code_a, "right")
    count -= first
    ends = np.cumsum(count)
    start = 0
    while start < len(count):  # as many rows as have PART pairs, or one
        before = ends[start] - count[start]
        stop = max(start + 1, int(np.searchsorted(ends, before + PART, "right")))
        rows, n = slice(start, stop), count[start:stop]
        entry_a = np.repeat(np.arange(start, stop), n)
        entry_b = order[np.repeat(first[rows], n) + np.arange(n.sum()) - np.repeat(ends[rows] - n - before, n)]
        i, j = item_a[entry_a], item_b[entry_b]
        meet = np.ones(len(i), dtype=bool)
        for c in range(3):  # an axis at a time: most pairs are gone after the first
            p, q = i[meet], j[meet]
            low = np.maximum(low_a[p, c], low_b[q, c])
            # counted in the one cell where the boxes' overlap begins; different cells may have one code
            at = np.floor(low / cell).astype(np.int64)
            meet[meet] = ((low <= np.minimum(high_a[p, c], high_b[q, c])) & (at == cells_a[entry_a[meet], c])
                          & (at == cells_b[entry_b[meet], c]))
        yield i[meet], j[meet]
        start = stop


def _cells(low: np.ndarray, high: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """(cell (k, 3), item (k,)) for every cell that a box meets."""
    first = np.floor(low / cell).astype(np.int64)
    span = np.floor(high / cell).astype(np.int64) - first + 1
    count = span.prod(axis=1)
    item = np.repeat(np.arange(len(low)), count)
    k = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    s = span[item]
    return first[item] + np.column_stack([k // (s[:, 1] * s[:, 2]), k // s[:, 2] % s[:, 1], k % s[:, 2]]), item


def _code(cells: np.ndarray) -> np.ndarray:
    return (cells[:, 0] * 73856093) ^ (cells[:, 1] * 19349663) ^ (cells[:, 2] * 83492791)
