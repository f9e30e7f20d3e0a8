"""Taichi fields, declared one by one, allocated together, filled from numpy by a single kernel, freed together."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import taichi as ti

from . import runtime

CHUNK = 1 << 22  # numbers that are handed to a kernel at once


@dataclass
class Filled:
    """A field of rows and what they are filled with, (n, width)."""

    field: object
    width: int
    data: np.ndarray


@ti.data_oriented
class Fields:
    """A tree of fields. Declare, then `allocate`; `free` gives the memory back.

    Args:
        exchange: numpy type of arrays handed to kernels.
    """

    def __init__(self, exchange: type) -> None:
        self.exchange = exchange
        runtime.hold(self)
        self._builder = ti.FieldsBuilder()
        self._tree = None
        self._reals: list[Filled] = []
        self._integers: list[Filled] = []

    def real(self, n: int, width: int = 1, data: np.ndarray | None = None, dtype=float):
        """A field of n numbers, or of n vectors of `width` numbers; filled with `data` at `allocate`."""
        field = ti.Vector.field(width, dtype) if width > 1 else ti.field(dtype)
        return self._place(field, n, width, data, self._reals)

    def integer(self, n: int, width: int = 1, data: np.ndarray | None = None):
        """The same for 32-bit integers."""
        field = ti.Vector.field(width, ti.i32) if width > 1 else ti.field(ti.i32)
        return self._place(field, n, width, data, self._integers)

    def allocate(self) -> None:
        """Allocates and fills every field that was declared."""
        self._tree = self._builder.finalize()
        for numbers, rows in _parts(self._reals, self.exchange):
            self._fill_reals(numbers, rows)
        for numbers, rows in _parts(self._integers, np.int32):
            self._fill_integers(numbers, rows)
        self._reals, self._integers = [], []

    def free(self) -> None:
        """Gives the memory back, also of what was declared and never allocated; the fields are dead after it."""
        if self._builder is not None and self._tree is None:  # else Taichi compiles no further kernel
            self._tree = self._builder.finalize(raise_warning=False)
            ti.sync()  # Taichi looks at its new fields here, and would otherwise after they are gone
        if self._tree is not None:
            self._tree.destroy()
        self._builder, self._tree = None, None
        runtime.let_go(self)

    def _place(self, field, n: int, width: int, data: np.ndarray | None, filled: list[Filled]):
        self._builder.dense(ti.i, max(n, 1)).place(field)
        if data is not None:
            data = np.asarray(data)
            if data.size != n * width:
                raise ValueError(f"field of {n} x {width} cannot be filled from shape {data.shape}")
            filled.append(Filled(field, width, data.reshape(n, width)))
        return field

    @ti.kernel
    def _fill_reals(self, numbers: ti.types.ndarray(), rows: ti.types.ndarray()):
        for _ in range(1):  # one task compiles sooner than one for each field
            for k in ti.static(range(len(self._reals))):
                for i in range(rows[k, 0], rows[k, 1]):
                    fill_row(self._reals[k].field, i, self._reals[k].width, rows[k, 2] + i * self._reals[k].width, numbers)

    @ti.kernel
    def _fill_integers(self, numbers: ti.types.ndarray(), rows: ti.types.ndarray()):
        for _ in range(1):
            for k in ti.static(range(len(self._integers))):
                for i in range(rows[k, 0], rows[k, 1]):
                    fill_row(self._integers[k].field, i, self._integers[k].width,
                             rows[k, 2] + i * self._integers[k].width, numbers)


def _parts(filled: list[Filled], dtype: type) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows of all fields in turn, at most a chunk of numbers at once: (numbers, (fields, 3) of each field the first row,
    the end row, and where row 0 would be among the numbers)."""
    cuts: list[np.ndarray] = []
    rows, room = np.zeros((len(filled), 3), dtype=np.int32), CHUNK
    for k, f in enumerate(filled):
        first = 0
        while first < len(f.data):
            end = min(first + max(room // f.width, 1), len(f.data))
            rows[k] = first, end, CHUNK - room - first * f.width
            cuts.append(f.data[first:end].ravel())
            room -= cuts[-1].size
            first = end
            if room < f.width:
                yield np.concatenate(cuts, dtype=dtype, casting="unsafe"), rows
                cuts, rows, room = [], np.zeros_like(rows), CHUNK
    if cuts:
        yield np.concatenate(cuts, dtype=dtype, casting="unsafe"), rows


@ti.func
def fill_row(field: ti.template(), i, width: ti.template(), start, numbers: ti.template()):
    """Row i of a field from packed numbers."""
    if ti.static(width == 1):
        field[i] = numbers[start]
    else:
        for c in range(width):
            field[i][c] = numbers[start + c]
