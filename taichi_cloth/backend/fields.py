"""Taichi fields, declared one by one, allocated together, filled from numpy, freed together."""

import sys
import weakref
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import FrameType
from typing import Any

import numpy as np

from . import field_pool, pages, runtime
from .language import ti
from .rows import capacity, fill, in_reach, write

CHUNK = 1 << 22  # numbers that are handed to a kernel at once
TREE = 1 << 24  # numbers of a tree of fields: one that is new is all in memory for a moment


@dataclass
class Filled:
    """A field of rows and the values (n, width) that fill them."""

    field: Any
    width: int
    data: np.ndarray


@ti.data_oriented
class Fields:
    """Fields. Declare, then `allocate`; `free` gives them back.

    Numbers that differ from mesh to mesh belong into fields, where kernels read them: attributes are compiled in.

    Args:
        exchange: numpy type of arrays handed to kernels.
        exact: whether fields have no more rows than are asked for, so that checks of bounds see reads beyond them.
        pooled: whether they may be fields that others had before, and are left to others: see `field_pool`.
    """

    def __init__(self, exchange: type, exact: bool = False, pooled: bool = False) -> None:
        self.exchange, self.exact = exchange, exact
        runtime.hold(self)
        field_pool.trim()
        self._lease = field_pool.Lease(pooled and in_reach() and not exact)
        self._maker = sys._getframe(1).f_code  # places of declarations are told from there on
        self._builder = None  # of new fields
        self._waiting = 0  # numbers of these
        self._reals: list[Filled] = []
        self._integers: list[Filled] = []
        self._later: list[Fields] = []

    def more(self) -> "Fields":
        """Others like these, for data that turn out to need more room; they are freed with these."""
        out = Fields(self.exchange, self.exact, self._lease.pooled)
        out._maker = sys._getframe(1).f_code
        self._later.append(out)
        return out

    def real(self, n: int, width: int = 1, data: np.ndarray | None = None, dtype=float):
        """A field of n numbers, or of n vectors of `width` numbers; filled with `data` (n,) or (n, width) at `allocate`."""
        return self._declare(n, width, dtype, data, self._reals)

    def integer(self, n: int, width: int = 1, data: np.ndarray | None = None):
        """A field like that of `real`, of 32-bit integers."""
        return self._declare(n, width, ti.i32, data, self._integers)

    def scratch(self, n: int, width: int):
        """A field of n rows in a tree of its own: the compiler sees that writes to it change nothing else."""

        def make():
            field, builder = ti.Vector.field(width, float), ti.FieldsBuilder()
            builder.dense(ti.i, self.room(n)).place(field)
            alone.append(builder.finalize())
            return field

        alone: list = []
        field = self._next(n, ("scratch", width), make)
        if alone:
            self._lease.planted(alone[0], alone=True)
        return field

    def room(self, n: int) -> int:
        """Rows that a field of n rows gets."""
        return max(n, 1) if self.exact else capacity(n)

    def allocate(self) -> None:
        """Allocates and fills every field that was declared."""
        self._plant()
        self._lease.keep()
        weakref.finalize(self, self._lease.leave).atexit = False
        if in_reach():
            self._write(self._reals + self._integers)
        else:
            self._fill()
        self._reals, self._integers = [], []

    def _plant(self) -> list:
        """Allocates those that are new so far; returns their slots. Their pages take no memory until something is written."""
        if self._builder is None:
            return []
        self._finalize()
        slots = self._lease.trees[-1].slots
        if in_reach():
            for slot in slots:
                pages.clear(slot.numbers)
        return slots

    def _write(self, those: list[Filled]) -> None:
        """Fills fields where they lie: a kernel for it would be compiled for each set of fields."""
        for filled in those:
            write(filled.field, filled.data)

    def _plant_and_fill(self) -> None:
        """Allocates those that are new so far and fills them, so that their data can go."""
        new = self._plant()
        self._write([filled for filled in self._reals + self._integers if filled.field.share.slot in new])
        self._reals, self._integers = ([filled for filled in waiting if filled.field.share.slot not in new]
                                       for waiting in (self._reals, self._integers))

    def free(self) -> None:
        """Gives the fields to the pool or their memory to the system, also of fields that were declared and never
        allocated; they are dead after it."""
        for later in self._later:
            later.free()
        if self._builder is not None:  # else Taichi compiles no further kernel
            self._finalize()
            ti.sync()  # Taichi looks at its new fields here, and would otherwise after they are gone
        self._lease.leave()
        field_pool.trim()
        runtime.let_go(self)

    def _finalize(self) -> None:
        if self._builder is not None:
            self._lease.planted(self._builder.finalize(raise_warning=False))
            self._builder, self._waiting = None, 0

    def _declare(self, n: int, width: int, dtype, data: np.ndarray | None, filled: list[Filled]):
        def make():
            field = ti.Vector.field(width, dtype) if width > 1 else ti.field(dtype)
            if self._builder is None:
                self._builder = ti.FieldsBuilder()
            self._builder.dense(ti.i, self.room(n)).place(field)
            self._waiting += self.room(n) * width
            return field

        field = self._next(n, (str(dtype), width), make)
        if data is not None:
            data = np.asarray(data)
            if data.size != n * width:
                raise ValueError(f"field of {n} x {width} cannot be filled from shape {data.shape}")
            filled.append(Filled(field, width, data.reshape(n, width)))
        if self._waiting > TREE and in_reach():
            self._plant_and_fill()
        return field

    def _next(self, n: int, kind: tuple[str, int], make: Callable):
        field = self._lease.next((self.room(n), *kind, *self._place()), make)
        field.rows = n
        return field

    def _place(self) -> Iterator[tuple[str, int]]:
        """The lines of code that led to a declaration, from where these fields were made."""
        frame: FrameType | None = sys._getframe(1)
        while frame is not None and frame.f_code is not self._maker:
            yield frame.f_code.co_filename, frame.f_lineno
            frame = frame.f_back
        if frame is not None:
            yield frame.f_code.co_filename, frame.f_lineno

    def _fill(self) -> None:
        """Fills them on a device, whose memory is out of reach."""
        for k, filled in enumerate(self._reals):
            for first, numbers in _parts(filled, self.exchange):
                self._fill_reals(k, first, numbers)
        for k, filled in enumerate(self._integers):
            for first, numbers in _parts(filled, np.int32):
                self._fill_integers(k, first, numbers)

    @ti.kernel
    def _fill_reals(self, k: int, first: int, numbers: ti.types.ndarray()):
        """Numbers of the k-th field from the first on. One loop for all fields compiles far sooner than one for each."""
        for j in range(numbers.shape[0]):
            for s in ti.static(range(len(self._reals))):
                if s == k:
                    fill(self._reals[s].field, self._reals[s].width, first + j, numbers[j])

    @ti.kernel
    def _fill_integers(self, k: int, first: int, numbers: ti.types.ndarray()):
        for j in range(numbers.shape[0]):
            for s in ti.static(range(len(self._integers))):
                if s == k:
                    fill(self._integers[s].field, self._integers[s].width, first + j, numbers[j])


def _parts(filled: Filled, dtype: type) -> Iterator[tuple[int, np.ndarray]]:
    """A field's numbers, at most a chunk at once, and which is the first of them."""
    flat = filled.data.reshape(-1)
    for first in range(0, len(flat), CHUNK):
        yield first, np.ascontiguousarray(flat[first:first + CHUNK], dtype=dtype)
