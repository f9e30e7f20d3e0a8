"""Fields that closed simulations leave for the next, so that kernels need not be compiled again.

Taichi compiles a kernel for the fields it reads, by identity. A field is known by where it was declared (the lines of code
that led there, and how often they did before), by its type, its width and its room. A new simulation gets for each field one
that was declared alike and that nobody uses, and a new one where there is none. So it compiles what reads fields that others
did not have, whatever else differs. Of two simulations at a time, each has fields of its own.

Fields are handed out zero, as new ones are. The pool is bounded: beyond that, trees of fields that nobody uses are given back
to the system, those used longest ago first.
"""

from . import taichi_patches  # noqa: F401  (before Taichi)

# isort: split
import ctypes
import itertools
import math
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.snode import get_addr
from taichi.lang.util import to_numpy_type

MOST_BYTES = 256 << 20  # that are kept where nobody uses them; a sheet of 10,000 vertices with contact has some 250 MB
MOST_TREES = 200  # of Taichi's fields; it has room for 512


@dataclass(eq=False)
class Slot:
    """A field that is handed out.

    Attributes:
        key: what it is known by.
        used: by a simulation.
        tree: in which it was allocated.
    """

    key: Hashable
    field: Any
    used: bool = True
    tree: "Tree | None" = None

    @cached_property
    def memory(self) -> np.ndarray:
        """Its numbers (rows,), or vectors (rows, width), where they lie: on the CPU, where those of a row are side by side."""
        assert self.tree is not None
        shape = self.field.shape + ((self.field.n,) if isinstance(self.field, ti.MatrixField) else ())
        place = self.tree.address + _scalar(self.field).snode.ptr.parent.offset_bytes_in_parent_cell
        dtype = np.dtype(to_numpy_type(self.field.dtype))
        there = (ctypes.c_char * (math.prod(shape) * dtype.itemsize)).from_address(place)
        return np.frombuffer(there, dtype).reshape(shape)


@dataclass(eq=False)
class Tree:
    """Fields that were allocated together, as a tree of Taichi's.

    Attributes:
        last: when one of them was left, as a number that grows.
    """

    handle: Any
    slots: list[Slot]
    last: int = 0
    _address: int = 0

    @property
    def bytes(self) -> int:
        """All of it."""
        return _scalar(self.slots[0].field).snode.ptr.parent.parent.cell_size_bytes

    @property
    def used(self) -> bool:
        """Whether a simulation has any of its fields."""
        return any(slot.used for slot in self.slots)

    @property
    def address(self) -> int:
        """Of its first byte."""
        if not self._address:
            self._address = int(_address(_scalar(self.slots[0].field)))
        return self._address


_slots: dict[Hashable, list[Slot]] = {}  # in the order in which they were made
_trees: list[Tree] = []
_dropped: list[Tree] = []  # that nobody has or may have
_starts = [0]  # how often Taichi was started
_clock = itertools.count(1)


@dataclass(eq=False)
class Lease:
    """The fields of one simulation.

    Args:
        pooled: whether it may take what others had, and leaves what it had.

    Attributes:
        trees: that it made.
    """

    pooled: bool
    trees: list[Tree] = field(default_factory=list)
    _start: int = field(default_factory=lambda: _starts[0])
    _taken: list[Slot] = field(default_factory=list)
    _new: list[Slot] = field(default_factory=list)
    _met: Counter[Hashable] = field(default_factory=Counter)

    def next(self, declared: Hashable, make: Callable[[], Any]) -> Any:
        """A field that was `declared` like this before, or the one that `make` does."""
        key = declared, self._met[declared]
        self._met[declared] += 1
        known = next((slot for slot in _slots.get(key, ()) if not slot.used), None) if self.pooled else None
        if known is None:
            self._new.append(Slot(key, make()))
            return self._new[-1].field
        known.used = True
        self._taken.append(known)
        return known.field

    def planted(self, handle: Any, alone: bool = False) -> None:
        """What was declared since the last time is in a tree of Taichi's; with `alone` the last of it only."""
        slots = self._new[-1:] if alone else self._new
        self._new = self._new[:-1] if alone else []
        self.trees.append(Tree(handle, slots))
        for slot in slots:
            slot.tree, slot.field.slot = self.trees[-1], slot

    def keep(self) -> None:
        """All of it is allocated: what others had is zero, and what is new is in the pool from now on, in use."""
        for slot in self._taken:
            slot.memory[:] = 0
        if self.pooled:
            for tree in self.trees:
                _trees.append(tree)
                for slot in tree.slots:
                    _slots.setdefault(slot.key, []).append(slot)
                    self._taken.append(slot)
            self.trees = []

    def leave(self) -> None:
        """Others may have the fields; those that no other may have go when there is time, in `trim`. The garbage collector may
        call it in the middle of anything."""
        for slot in self._taken:
            assert slot.tree is not None
            slot.used, slot.tree.last = False, next(_clock)
        self._taken = []
        if self._start == _starts[0]:
            _dropped.extend(self.trees)
        self.trees = []


def holds() -> bool:
    """Whether there are any fields."""
    return bool(_trees)


def trim(most: int = MOST_BYTES, trees: int = MOST_TREES) -> None:
    """Gives memory back to the system, until what nobody uses is at most so many bytes, and all trees so many."""
    while _dropped:
        _dropped.pop().handle.destroy()
    while True:
        free = [tree for tree in _trees if not tree.used]
        if not free or (sum(tree.bytes for tree in free) <= most and len(_trees) <= trees):
            return
        oldest = min(free, key=lambda tree: tree.last)
        _trees.remove(oldest)
        for slot in oldest.slots:
            _slots[slot.key].remove(slot)
        oldest.handle.destroy()


def forget() -> None:
    """Taichi was started anew: all fields are dead. Kernels may still have them; what they are of, its threads and its memory,
    goes."""
    for tree in (*_trees, *_dropped):
        tree.handle = None
    _slots.clear()
    _trees.clear()
    _dropped.clear()
    _starts[0] += 1


def _scalar(of):
    return of.get_scalar_field(0) if isinstance(of, ti.MatrixField) else of


@ti.kernel
def _address(first: ti.template()) -> ti.u64:
    """Of the first row of a field, which is that of its tree where it was declared first."""
    return get_addr(first, [0])
