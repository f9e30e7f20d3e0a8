"""Taichi fields, declared one by one, allocated together, filled from numpy by a single kernel, freed together."""

import numpy as np
import taichi as ti


@ti.data_oriented
class Fields:
    """A tree of fields. Declare, then `allocate`; `free` gives the memory back.

    Args:
        exchange: numpy type of arrays handed to kernels.
    """

    def __init__(self, exchange: type) -> None:
        self.exchange = exchange
        self._builder = ti.FieldsBuilder()
        self._tree = None
        self._reals: list = []
        self._integers: list = []
        self._real_data: list[np.ndarray] = []
        self._integer_data: list[np.ndarray] = []

    def real(self, n: int, width: int = 1, data: np.ndarray | None = None, dtype=float):
        """A field of n numbers, or of n vectors of `width` numbers; filled with `data` at `allocate`."""
        field = ti.Vector.field(width, dtype) if width > 1 else ti.field(dtype)
        self._place(field, n)
        if data is not None:
            self._reals.append((field, n, width, sum(map(len, self._real_data))))
            self._real_data.append(_flat(data, n, width).astype(self.exchange))
        return field

    def integer(self, n: int, width: int = 1, data: np.ndarray | None = None):
        """The same for 32-bit integers."""
        field = ti.Vector.field(width, ti.i32) if width > 1 else ti.field(ti.i32)
        self._place(field, n)
        if data is not None:
            self._integers.append((field, n, width, sum(map(len, self._integer_data))))
            self._integer_data.append(_flat(data, n, width).astype(np.int32))
        return field

    def allocate(self) -> None:
        """Allocates and fills every field that was declared."""
        self._tree = self._builder.finalize()
        reals = np.concatenate([*self._real_data, np.zeros(1, dtype=self.exchange)])
        self._real_data = []
        integers = np.concatenate([*self._integer_data, np.zeros(1, dtype=np.int32)])
        self._integer_data = []
        self._fill(reals, integers)

    def free(self) -> None:
        """Gives the memory back, also of what was declared and never allocated; the fields are dead after it."""
        if self._builder is not None and self._tree is None:  # else Taichi compiles no further kernel
            self._tree = self._builder.finalize(raise_warning=False)
            ti.sync()  # Taichi looks at its new fields here, and would otherwise after they are gone
        if self._tree is not None:
            self._tree.destroy()
        self._builder, self._tree = None, None

    def _place(self, field, n: int) -> None:
        self._builder.dense(ti.i, max(n, 1)).place(field)

    @ti.kernel
    def _fill(self, reals: ti.types.ndarray(), integers: ti.types.ndarray()):
        for k in ti.static(range(len(self._reals))):
            for i in range(self._reals[k][1]):
                fill_row(self._reals[k][0], i, self._reals[k][2], self._reals[k][3], reals)
        for k in ti.static(range(len(self._integers))):
            for i in range(self._integers[k][1]):
                fill_row(self._integers[k][0], i, self._integers[k][2], self._integers[k][3], integers)


@ti.func
def fill_row(field: ti.template(), i, width: ti.template(), offset: ti.template(), data: ti.template()):
    """Row i of a field from its place in the packed array."""
    if ti.static(width == 1):
        field[i] = data[offset + i]
    else:
        for c in range(width):
            field[i][c] = data[offset + i * width + c]


def _flat(data: np.ndarray, n: int, width: int) -> np.ndarray:
    data = np.asarray(data)
    if data.size != n * width:
        raise ValueError(f"field of {n} x {width} cannot be filled from shape {data.shape}")
    return data.ravel()
