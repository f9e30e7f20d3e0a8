"""Rows of fields: those that are used, and numpy arrays of them.

On the CPU arrays come straight from memory: a copy of 10,000 rows takes 5 us, with a kernel's launch it took .15 ms.
"""

import numpy as np

from . import counting, field_pool, runtime
from .language import ti

SMALL, MIDDLE, LARGE = 1 << 10, 1 << 14, 1 << 18  # rows: two sizes, then twice as many each, then multiples


def capacity(n: int) -> int:
    """Rows that a field of n rows gets: kernels are compiled for fields, and so serve all meshes of about a size."""
    size = SMALL if n <= SMALL else MIDDLE
    while size < min(n, LARGE):
        size *= 2
    return size if n <= LARGE else -(-n // LARGE) * LARGE


def in_reach() -> bool:
    """Whether numbers of fields are read and written where they lie: on the CPU, by a compiler that says where."""
    return field_pool.SEEN and runtime.on_cpu()


def read(field, which: np.ndarray | None = None) -> np.ndarray:
    """A copy of the rows of a field that `Fields` made, or of those that `which` (k,) names."""
    if in_reach():
        rows = field.share.memory
    else:
        rows = field.to_numpy()
    if counting.now is not None:
        counting.now.read(rows.nbytes)
    return rows[: field.rows].copy() if which is None else rows.take(which, axis=0)


def write(field, data: np.ndarray) -> None:
    """Sets the first rows of a field, as many as there are in data."""
    if counting.now is not None:
        counting.now.write(data.nbytes)
    if in_reach():
        rows = field.share.memory[: len(data)]
        rows[...] = data.reshape(rows.shape)
    else:
        _put(field, getattr(field, "n", 1), np.ascontiguousarray(data).reshape(-1))


@ti.kernel
def _put(into: ti.template(), width: ti.template(), numbers: ti.types.ndarray()):
    for j in range(numbers.shape[0]):
        fill(into, width, j, numbers[j])


@ti.func
def fill(field: ti.template(), width: ti.template(), j, number):
    """The j-th number of a field of rows."""
    if ti.static(width == 1):
        field[j] = number
    else:
        field[j // width][j % width] = number
