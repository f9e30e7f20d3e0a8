"""Lists of rows that kernels write, in a device's memory: counted, and joined by prefix sums, there.

Arrays of numpy would be copied to the device and back at each launch, with all the room that they have.
"""

from typing import Any

import numpy as np

from . import rows
from .device_arrays import array
from .language import ti
from .runtime import for_device
from .sums import GROUPS

LEAST = 64  # rows that are handed over at first


def lists(pieces: int, room: int, kinds: list[tuple[int, type]], stay: bool = False) -> Any:
    """`rows.Lists`, or on a device `DeviceLists`."""
    return DeviceLists(pieces, room, kinds, stay) if for_device() else rows.Lists(pieces, room, kinds)


@ti.data_oriented
class PrefixSums:
    """Sums of the counts of all pieces before each.

    Attributes:
        count: (pieces,) that a kernel writes; first: (pieces,) these sums; told: (2,) the largest count, the sum of all.
    """

    def __init__(self, pieces: int) -> None:
        self.count, self.first = array(np.int32, pieces), array(np.int32, pieces)
        self._of_group, self.told = array(np.int32, GROUPS), array(np.int32, 2)

    def run(self) -> None:
        """Makes them."""
        self._make(self.count, self.first, self._of_group, self.told)

    def make(self) -> tuple[int, int]:
        """Makes them. (largest count, sum of all); the host waits for these."""
        self.run()
        most, total = self._tell(self.told)
        return int(most), int(total)

    @ti.kernel
    def _tell(self, told: ti.types.ndarray()) -> ti.types.vector(2, ti.i32):
        return ti.Vector([told[0], told[1]])

    @ti.kernel
    def _make(self, count: ti.types.ndarray(), first: ti.types.ndarray(), of_group: ti.types.ndarray(),
              told: ti.types.ndarray()):
        told[0], told[1] = 0, 0
        for group in range(ti.static(GROUPS)):
            total, most = 0, 0
            for piece in range(self.begin(group, count), self.begin(group + 1, count)):
                total += count[piece]
                most = ti.max(most, count[piece])
            of_group[group] = total
            ti.atomic_max(told[0], most)
        for group in range(ti.static(GROUPS)):
            before = 0
            for other in range(group):
                before += of_group[other]
            for piece in range(self.begin(group, count), self.begin(group + 1, count)):
                first[piece] = before
                before += count[piece]
            ti.atomic_max(told[1], before)

    @ti.func
    def begin(self, group, count: ti.template()):
        """The first piece of a group."""
        each = (count.shape[0] + ti.static(GROUPS) - 1) // ti.static(GROUPS)
        return ti.min(group * each, count.shape[0])


@ti.data_oriented
class DeviceLists:
    """`rows.Lists` on a device.

    Args:
        stay: whether `joined` columns are for kernels; else `handed_over` gives them to the host.

    Attributes:
        arrays: (pieces, room, width) each; count: (pieces,); total: rows of all pieces, after `grow`.
    """

    def __init__(self, pieces: int, room: int, kinds: list[tuple[int, type]], stay: bool = False) -> None:
        self._kinds, self._stay, self._sums, self.total = kinds, stay, PrefixSums(pieces), 0
        self.count = self._sums.count
        self._whole = [np.dtype(kind).kind != "f" for _, kind in kinds]
        self._real = next((kind for _, kind in kinds if np.dtype(kind).kind == "f"), np.float32)
        self._make(room)
        self._widths = [max(sum(w for (w, _), whole in zip(kinds, self._whole) if whole == integer) + integer, 1 + integer)
                        for integer in (False, True)]  # of all reals; of the piece of a row and all integers
        self._expect(LEAST)

    def _make(self, room: int) -> None:
        self.arrays = [array(kind, self.count.shape[0], room, width) for width, kind in self._kinds]

    def _expect(self, total: int) -> None:
        """So many rows are handed over next."""
        self._expected = total
        self._reals, self._integers = array(self._real, total, self._widths[0]), array(np.int32, total, self._widths[1])

    def grow(self) -> bool:
        """Makes room for entries that did not fit; False if all did. The host waits for the rows that it gets."""
        if self._stay:
            most, self.total = self._sums.make()
        else:
            most = self._fetch()
        if most > self.arrays[0].shape[1]:
            self._make(int(rows.GROWTH * most))
            return True
        if not self._stay and self.total > self._expected:
            self._expect(int(rows.GROWTH * self.total))
            self._fetch()
        return False

    def joined(self) -> list:
        """The columns of all pieces, one after the other: arrays (total, width) on the device; none where there is no row."""
        out = [array(kind, self.total, width) for width, kind in self._kinds] if self.total else []
        for column, joined in zip(self.arrays, out):
            self._join(column, self.count, self._sums.first, joined, 0)
        return out

    def handed_over(self) -> list[np.ndarray]:
        """Columns (total, width) on the host."""
        out, ends = [], [0, 1]
        for (width, _), whole in zip(self._kinds, self._whole):
            out.append((self._fetched[whole])[: self.total, ends[whole]: ends[whole] + width])
            ends[whole] += width
        return out

    def rest(self) -> None:
        """See `rows.Lists`: a device has no pages to give back."""

    def owned(self) -> tuple[np.ndarray, np.ndarray]:
        """See `rows.Lists`."""
        self.grow()
        return self._fetched[1][: self.total, 0], self.handed_over()[0]

    def _fetch(self) -> int:
        """The host gets as many rows as are expected, and their number, by one launch. Returns the largest count."""
        count = self._expected
        reals: np.ndarray = np.empty((count, self._widths[0]), dtype=self._real)
        integers: np.ndarray = np.empty((count + 1, self._widths[1]), dtype=np.int32)
        self._sums.run()
        self._name(self.count, self._sums.first, self._integers)
        ends = [0, 1]
        for column, (width, _), whole in zip(self.arrays, self._kinds, self._whole):
            self._join(column, self.count, self._sums.first, (self._reals, self._integers)[whole], ends[whole])
            ends[whole] += width
        self._hand(self._reals, self._integers, self._sums.told, reals, integers)
        self.total, self._fetched = int(integers[count, 1]), (reals, integers)
        return int(integers[count, 0])

    @ti.kernel
    def _join(self, column: ti.types.ndarray(), count: ti.types.ndarray(), first: ti.types.ndarray(), out: ti.types.ndarray(),
              at: int):
        """Rows of a column that are there, and for which there is room, one after the other."""
        for k in range(column.shape[0] * column.shape[1]):
            piece, row = k // column.shape[1], k % column.shape[1]
            if row < count[piece] and first[piece] + row < out.shape[0]:
                for c in range(column.shape[2]):
                    out[first[piece] + row, at + c] = column[piece, row, c]

    @ti.kernel
    def _name(self, count: ti.types.ndarray(), first: ti.types.ndarray(), out: ti.types.ndarray()):
        """The piece of each of them."""
        for piece in range(count.shape[0]):
            for row in range(count[piece]):
                if first[piece] + row < out.shape[0]:
                    out[first[piece] + row, 0] = piece

    @ti.kernel
    def _hand(self, reals: ti.types.ndarray(), integers: ti.types.ndarray(), told: ti.types.ndarray(),
              to_reals: ti.types.ndarray(), to_integers: ti.types.ndarray()):
        for k in range(reals.shape[0]):
            for c in range(reals.shape[1]):
                to_reals[k, c] = reals[k, c]
            for c in range(integers.shape[1]):
                to_integers[k, c] = integers[k, c]
        for c in range(2):
            to_integers[integers.shape[0], c] = told[c]
