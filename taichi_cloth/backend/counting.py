"""Counts of a program's calls to the device: launches of kernels, and numbers that go to the host and back.

Nothing is counted, and nothing looked up, outside of `counted`. On the CPU arrays are handed over in place, and costs are
small; the counts say how the same steps would fare where each of these waits for a device.
"""

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

HANDED = ("_get", "_pick", "_put")  # kernels of rows.py


@dataclass
class Counts:
    """Numbers of calls and of numbers moved.

    Attributes:
        launches: of the package's kernels; with_arrays: those with numpy arrays as arguments; arrays: so many of these;
            returned: launches that give a number back.
        reads, writes: whole fields that the host read or wrote; singles: single numbers of fields that it read or wrote.
        size: bytes of all these arrays and fields, counted once each.
        kernels: launches by a kernel's name.
    """

    launches: int = 0
    with_arrays: int = 0
    returned: int = 0
    arrays: int = 0
    reads: int = 0
    writes: int = 0
    singles: int = 0
    size: int = 0
    kernels: Counter = field(default_factory=Counter)

    @property
    def waits(self) -> int:
        """Times that the host waits for a device: at numbers that come back, and twice at a launch with arrays."""
        return self.returned + 2 * self.with_arrays + self.reads + self.writes + self.singles

    def launch(self, name: str, args: tuple, returns: bool) -> None:
        """A kernel was launched; one that hands a field over is counted as a read or a write."""
        if name in HANDED:
            return
        sizes = [a.nbytes for a in args if isinstance(a, np.ndarray)]
        self.launches += 1
        self.with_arrays += bool(sizes)
        self.returned += returns
        self.arrays += len(sizes)
        self.size += sum(sizes)
        self.kernels[name] += 1

    def read(self, size: int) -> None:
        """The host read a field, of so many bytes."""
        self.reads += 1
        self.size += size

    def write(self, size: int) -> None:
        """The host wrote a field."""
        self.writes += 1
        self.size += size


now: Counts | None = None  # those that are being made


@contextlib.contextmanager
def counted() -> Iterator[Counts]:
    """Within it launches and transfers are counted."""
    global now
    before, now = now, Counts()
    try:
        yield now
    finally:
        now = before
