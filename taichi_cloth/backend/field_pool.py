"""Fields that closed simulations leave for the next, so that kernels need not be compiled again.

Taichi compiles a kernel for the fields it reads, by identity. Simulations declare their fields one after the other, and most
begin alike. So the pool keeps runs of fields, `Segment`s, as a tree. A new simulation walks it from a root and takes each
field as long as they are what it declares; where they are not, it goes on in a segment of its own. What it ends with stays for
others. A segment is used by one simulation at a time; one that starts meanwhile makes a root of its own.

Fields are handed out zero, as new ones are. The pool is bounded: beyond that, segments that nobody uses and none follows are
given back to the system, those used longest ago first.
"""

from . import taichi_patches  # noqa: F401  (before Taichi)

# isort: split
import ctypes
import itertools
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from typing import Any

import taichi as ti
from taichi.lang.snode import get_addr

MOST_BYTES = 256 << 20  # that are kept where nobody uses them; a sheet of 10,000 vertices with contact has some 250 MB
MOST_TREES = 200  # of Taichi's fields; it has room for 512


@dataclass(eq=False)
class Segment:
    """Fields that were declared one after the other.

    Attributes:
        declared: (what, field): a field, and what it is: room, type and width.
        follow: segments that go on where `at` of the fields before were taken.
        trees: (Taichi's tree, the field that comes first in it).
        used: by a simulation; last: when somebody took it, as a number that grows.
    """

    before: "Segment | None" = None
    at: int = 0
    declared: list[tuple[Hashable, Any]] = field(default_factory=list)
    follow: list["Segment"] = field(default_factory=list)
    trees: list[tuple[Any, Any]] = field(default_factory=list)
    used: bool = True
    last: int = 0

    @property
    def bytes(self) -> int:
        """Of its trees."""
        return sum(_size(first) for _, first in self.trees)

    def destroy(self) -> None:
        """Gives the memory back to the system; its fields are dead after it."""
        for tree, _ in self.trees:
            tree.destroy()
        self.trees, self.declared = [], []
        if self.before is not None:
            self.before.follow.remove(self)


class Walk:
    """One simulation's way through the segments.

    Args:
        pooled: whether it may take what others had, and leaves what it had.
    """

    def __init__(self, pooled: bool) -> None:
        self.pooled, self._at, self._roots = pooled, 0, _roots if pooled else []
        self._start = _starts[0]
        self.path: list[Segment] = []

    @property
    def segment(self) -> Segment:
        """Where it is."""
        return self.path[-1]

    def next(self, what: Hashable, make: Callable[[], Any]) -> Any:
        """The next field: one that there is, or a new one that `make` declares."""
        if self.path and self._at < len(self.segment.declared) and self.segment.declared[self._at][0] == what:
            self._at += 1
            return self.segment.declared[self._at - 1][1]
        ways = [s for s in (self.segment.follow if self.path else self._roots) if s.at == (self._at if self.path else 0)]
        known = next((s for s in ways if not s.used and s.declared and s.declared[0][0] == what), None)
        if known is not None:
            self._enter(known)
            return self.next(what, make)
        if not (self.path and self.segment.last == 0 and self._at == len(self.segment.declared)):
            self._begin()
        made = make()
        self.segment.declared.append((what, made))
        self._at += 1
        return made

    def new(self) -> Segment | None:
        """The segment that it began, if it did."""
        return self.path[-1] if self.path and self.path[-1].last == 0 else None

    def end(self) -> None:
        """All fields are declared."""
        for segment in self.path:
            segment.last = next(_clock)

    def leave(self) -> None:
        """Others may have the fields; those that no other may have go when there is time, in `trim`. The garbage collector may
        call it in the middle of anything."""
        for segment in self.path:
            segment.used = False
        if not self.pooled and self._start == _starts[0]:
            _dropped.extend(self.path)
            self.path = []

    def _enter(self, segment: Segment) -> None:
        self.path.append(segment)
        self._at, segment.used = 0, True
        for _, first in segment.trees:
            ctypes.memset(int(_address(_scalar(first))), 0, _size(first))

    def _begin(self) -> None:
        before = self.path[-1] if self.path else None
        segment = Segment(before, self._at)
        (self._roots if before is None else before.follow).append(segment)
        self.path.append(segment)
        self._at = 0


_roots: list[Segment] = []
_dropped: list[Segment] = []  # that nobody has or may have
_starts = [0]  # how often Taichi was started
_clock = itertools.count(1)


def holds() -> bool:
    """Whether there are any fields."""
    return bool(_roots)


def _segments(roots: list[Segment]) -> Iterator[Segment]:
    for segment in roots:
        yield segment
        yield from _segments(segment.follow)


def trim(most: int = MOST_BYTES, trees: int = MOST_TREES) -> None:
    """Gives memory back to the system, until what nobody uses is at most so many bytes, and all trees so many."""
    while _dropped:
        _dropped.pop().destroy()
    while True:
        segments = list(_segments(_roots))
        free = [s for s in segments if not s.used]
        ends = [s for s in free if not s.follow]
        if not ends or (sum(s.bytes for s in free) <= most and sum(len(s.trees) for s in segments) <= trees):
            return
        oldest = min(ends, key=lambda s: s.last)
        oldest.destroy()
        if oldest.before is None:
            _roots.remove(oldest)


def forget() -> None:
    """Taichi was started anew: all fields are dead."""
    _roots.clear()
    _dropped.clear()
    _starts[0] += 1


def _scalar(of):
    return of.get_scalar_field(0) if isinstance(of, ti.MatrixField) else of


def _size(first) -> int:
    """Bytes of the tree of a field."""
    return _scalar(first).snode.ptr.parent.parent.cell_size_bytes


@ti.kernel
def _address(first: ti.template()) -> ti.u64:
    """Of the first row of a field, which is that of its tree where it was declared first."""
    return get_addr(first, [0])
