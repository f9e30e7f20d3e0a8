"""A pool of fields: closed simulations leave them for the next, so that kernels need not be compiled again.

Taichi compiles a kernel for the fields it reads, by identity. A field is known by where it was declared (the lines of code
that led there, and how often they did before), by its type, its width and its room. A new simulation gets for each field the
one that was declared alike before, and a new one if there is none. It then compiles only kernels of fields that no other had.

Simulations that are open at a time share their fields, each with numbers of its own: those of one of them lie in the fields,
those of the others are swapped out to arrays. A launch, or a look at a field's memory, swaps in the numbers of the simulation
that it is for (`Lease.swap_in`). Simulations that take turns copy the rows that they use at each turn.

Fields are handed out zero, as new ones are. The pool is bounded: beyond that, trees of fields that nobody uses are given back
to the system, those used longest ago first.
"""

import copy
import ctypes
import itertools
import math
from collections import Counter
from collections.abc import Callable, Hashable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from . import compiler, launches, pages, taichi_patches
from .language import ti

get_addr, to_numpy_type = compiler.private("lang.snode:get_addr", "lang.util:to_numpy_type")
SEEN = None not in (get_addr, to_numpy_type)  # whether the compiler lets fields' memory be seen
MOST_BYTES = 256 << 20  # that are kept where nobody uses them; a sheet of 10,000 vertices with contact has some 250 MB
MOST_TREES = 200  # of Taichi's fields; it has room for 512


@dataclass(eq=False)
class Slot:
    """A field's place in memory.

    Attributes:
        key: the declaration that it is known by.
        shares: of simulations, each for one at a time; the first has the field as it was declared.
        holder: the share whose numbers lie in the field; None if nobody needs them.
        tree: in which it was allocated.
    """

    key: Hashable
    field: Any
    shares: list["Share"] = field(default_factory=list)
    holder: "Share | None" = None
    tree: "Tree | None" = None

    @property
    def used(self) -> bool:
        """Whether a simulation has a share of it."""
        return any(share.lease is not None for share in self.shares)

    def share(self, lease: "Lease") -> "Share":
        """A share that nobody has, for a lease."""
        free = next((share for share in self.shares if share.lease is None), None)
        if free is None:
            free = Share(self, copy.copy(self.field) if self.shares else self.field)
            free.field.share = free
            self.shares.append(free)
        free.lease, free.swapped_out = lease, None
        return free

    @cached_property
    def numbers(self) -> np.ndarray:
        """Its numbers (rows,), or vectors (rows, width), where they lie: on the CPU, where those of a row are side by side."""
        assert self.tree is not None
        shape = self.field.shape + ((self.field.n,) if isinstance(self.field, ti.MatrixField) else ())
        place = self.tree.address + _scalar(self.field).snode.ptr.parent.offset_bytes_in_parent_cell
        dtype = np.dtype(to_numpy_type(self.field.dtype))
        there = (ctypes.c_char * (math.prod(shape) * dtype.itemsize)).from_address(place)
        return np.frombuffer(there, dtype).reshape(shape)


@dataclass(eq=False)
class Share:
    """A simulation's share of a slot: a field object of its own, and its numbers while those of another lie in the slot.

    Attributes:
        lease: that has it, or None.
        swapped_out: the rows of `Slot.numbers` that are its own, where they do not lie in the slot.
    """

    slot: Slot
    field: Any
    lease: "Lease | None" = None
    swapped_out: np.ndarray | None = None

    def swap_in(self) -> None:
        """Puts its numbers into the slot from now on; those of the holder are copied out. Only used rows are copied."""
        holder, numbers = self.slot.holder, self.slot.numbers
        lease = None if holder is None else holder.lease
        if holder is not None and lease is not None:
            holder.swapped_out, lease.swapped_out = numbers[: holder.field.rows].copy(), True
            launches.SWAPS[0] += 1
        if self.swapped_out is not None:
            numbers[: len(self.swapped_out)] = self.swapped_out
        self.slot.holder, self.swapped_out = self, None


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
        """Address of its first byte."""
        if not self._address:
            self._address = int(_address(_scalar(self.slots[0].field)))
        return self._address


_slots: dict[Hashable, Slot] = {}  # in the order in which they were made
_trees: list[Tree] = []
_dropped: list[Tree] = []  # that nobody has or may have
_starts = [0]  # how often Taichi was started
_clock = itertools.count(1)


@dataclass(eq=False)
class Lease:
    """The fields of one simulation.

    Args:
        pooled: whether it may take fields that others had, and leaves its own to others.

    Attributes:
        trees: that it made.
        swapped_out: whether the numbers of one of its fields are.
    """

    pooled: bool
    trees: list[Tree] = field(default_factory=list)
    swapped_out: bool = False
    _start: int = field(default_factory=lambda: _starts[0])
    _taken: list[Share] = field(default_factory=list)
    _new: list[Slot] = field(default_factory=list)
    _met: Counter[Hashable] = field(default_factory=Counter)

    def next(self, declared: Hashable, make: Callable[[], Any]) -> Any:
        """A field that was `declared` like this before, or the one that `make` does."""
        key = declared, self._met[declared]
        self._met[declared] += 1
        known = _slots.get(key) if self.pooled else None
        if known is None or (known.used and not taichi_patches.WANTED):  # without patches no launch swaps
            self._new.append(Slot(key, make()))
            return self._new[-1].share(self).field
        self._taken.append(known.share(self))
        return self._taken[-1].field

    def planted(self, handle: Any, alone: bool = False) -> None:
        """All fields declared since the last time are in a tree of Taichi's; with `alone` the last of them only."""
        slots = self._new[-1:] if alone else self._new
        self._new = self._new[:-1] if alone else []
        self.trees.append(Tree(handle, slots))
        for slot in slots:
            slot.tree, slot.holder = self.trees[-1], slot.shares[0]

    def keep(self) -> None:
        """All of it is allocated: fields that others had are zero, and new ones are in the pool from now on, in use."""
        for share in self._taken:
            share.swap_in()
            pages.clear(share.slot.numbers)
        if self.pooled:
            for tree in self.trees:
                _trees.append(tree)
                for slot in tree.slots:
                    _slots.setdefault(slot.key, slot)
                    self._taken.append(slot.shares[0])
            self.trees = []

    def swap_in(self) -> None:
        """All of its numbers lie in its fields."""
        for share in self._taken:
            if share.slot.holder is not share:
                share.swap_in()
        self.swapped_out = False

    def leave(self) -> None:
        """Others may have the fields; those that no other may have go when there is time, in `trim`. The garbage collector may
        call it in the middle of anything."""
        for share in self._taken:
            assert share.slot.tree is not None
            share.lease, share.swapped_out, share.slot.tree.last = None, None, next(_clock)
        self._taken = []
        if self._start == _starts[0]:
            _dropped.extend(self.trees)
        self.trees = []


def holds() -> bool:
    """Whether there are any fields."""
    return bool(_trees)


def trim(most: int = MOST_BYTES, trees: int = MOST_TREES) -> None:
    """Gives memory back to the system, until unused fields are at most so many bytes, and all trees so many."""
    while _dropped:
        _dropped.pop().handle.destroy()
    while True:
        free = [tree for tree in _trees if not tree.used]
        if not free or (sum(tree.bytes for tree in free) <= most and len(_trees) <= trees):
            return
        oldest = min(free, key=lambda tree: tree.last)
        _trees.remove(oldest)
        for slot in oldest.slots:
            if _slots.get(slot.key) is slot:
                del _slots[slot.key]
        oldest.handle.destroy()


def forget() -> None:
    """Taichi was started anew: all fields are dead. Kernels may still refer to them; the old threads and memory go."""
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
    """Address of the first row of a field; the same as that of its tree if it was declared first."""
    return get_addr(first, [0])
