"""Fields that a closed simulation leaves for the next one of the same make, so that its kernels need not be compiled again.

Taichi compiles a kernel for the fields it reads, by identity. A simulation that ends gives its trees of fields to the pool instead of
to the system; the next `Fields` of the same make takes them, set to zero, as long as it declares the same fields in the same order.
What it declares otherwise it allocates anew. The pool is bounded in bytes; the oldest trees are given back first.
"""

from . import taichi_patches  # noqa: F401  (before Taichi)

# isort: split
import ctypes
import dataclasses
import math
import numbers
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti
from taichi.lang.snode import get_addr

from .rows import capacity

MOST_BYTES = 256 << 20  # that are kept; a sheet of 10,000 vertices with contact has some 250 MB


@dataclass(eq=False)
class Allocation:
    """Trees of fields, and what was declared in them.

    Attributes:
        make: what the fields were made for; None where nobody may have them after.
        declared: (what, field) in order; `what` says a field's room, type and width.
        trees: (Taichi's tree, the field that comes first in it).
        start: which start of Taichi they live in.
    """

    make: Hashable
    declared: list[tuple[Hashable, Any]] = field(default_factory=list)
    trees: list[tuple[Any, Any]] = field(default_factory=list)
    start: int = field(default_factory=lambda: _starts)

    @property
    def bytes(self) -> int:
        """Of all trees."""
        return sum(_size(first) for _, first in self.trees)


_kept: list[Allocation] = []  # the oldest first
_starts = 0  # of Taichi


def give(allocation: Allocation) -> None:
    """Nobody uses these fields any more. The garbage collector may call it in the middle of anything."""
    if allocation.trees and allocation.start == _starts:
        _kept.append(allocation)


def has(make: Hashable) -> bool:
    """Whether there are fields of a make."""
    return any(kept.make == make for kept in _kept if make is not None)


def take(make: Hashable) -> Allocation | None:
    """The newest fields of a make, all zero, or None."""
    found = next((kept for kept in reversed(_kept) if make is not None and kept.make == make), None)
    if found is None:
        return None
    _kept.remove(found)
    for _, first in found.trees:
        ctypes.memset(int(_address(_scalar(first))), 0, _size(first))
    return found


def trim(most: int = MOST_BYTES) -> None:
    """Gives memory back to the system: of fields without a make, and the oldest beyond `most` bytes. They are dead after it."""
    total = 0
    for kept in reversed(_kept.copy()):
        total += kept.bytes if kept.make is not None else 0
        if kept.make is None or total > most:
            _kept.remove(kept)
            for tree, _ in kept.trees:
                tree.destroy()


def forget() -> None:
    """Taichi was started anew: all fields are dead."""
    global _starts
    _kept.clear()
    _starts += 1


def outline(value: Any) -> Hashable:
    """What of a description decides which fields are made for it: types, names, what is zero, and arrays by about their size."""
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, numbers.Real):
        return "number", value == 0, math.isfinite(value)
    if isinstance(value, np.ndarray):
        return "array", capacity(len(value)) if value.ndim else 0, value.shape[1:]
    if isinstance(value, (list, tuple)):
        return tuple(outline(item) for item in value)
    if isinstance(value, dict):
        return tuple((key, outline(item)) for key, item in value.items())
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return type(value), tuple(outline(getattr(value, f.name)) for f in dataclasses.fields(value))
    return type(value)


def _scalar(of):
    return of.get_scalar_field(0) if isinstance(of, ti.MatrixField) else of


def _size(first) -> int:
    """Bytes of the tree of a field."""
    return _scalar(first).snode.ptr.parent.parent.cell_size_bytes


@ti.kernel
def _address(first: ti.template()) -> ti.u64:
    """Of the first row of a field, which is that of its tree where it was declared first."""
    return get_addr(first, [0])
