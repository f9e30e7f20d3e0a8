"""Lists of rows that kernels write, in a device's memory: counted, and joined by prefix sums, there.

Arrays of numpy would be copied to the device and back at each launch, with all the room that they have.
"""

import numpy as np

from . import rows
from .language import ti
from .runtime import for_device
from .sums import GROUPS


def lists(pieces: int, room: int, kinds: list[tuple[int, type]]) -> "rows.Lists | DeviceLists":
    """`rows.Lists`, or on a device these."""
    return (DeviceLists if for_device() else rows.Lists)(pieces, room, kinds)


def array(kind: type, *shape: int):
    """An array in the device's memory."""
    return ti.ndarray({np.int8: ti.i8, np.int32: ti.i32, np.float32: ti.f32, np.float64: ti.f64}[np.dtype(kind).type], shape)


@ti.data_oriented
class PrefixSums:
    """Sums of the counts of all pieces before each.

    Attributes:
        count: (pieces,) that a kernel writes; first: (pieces,) these sums.
    """

    def __init__(self, pieces: int) -> None:
        self.count, self.first = array(np.int32, pieces), array(np.int32, pieces)
        self._of_group, self._told = array(np.int32, GROUPS), array(np.int32, 2)

    def make(self) -> tuple[int, int]:
        """(largest count, sum of all); the host waits for these."""
        most, total = self._make(self.count, self.first, self._of_group, self._told)
        return int(most), int(total)

    @ti.kernel
    def _make(self, count: ti.types.ndarray(), first: ti.types.ndarray(), of_group: ti.types.ndarray(),
              told: ti.types.ndarray()) -> ti.types.vector(2, ti.i32):
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
        return ti.Vector([told[0], told[1]])

    @ti.func
    def begin(self, group, count: ti.template()):
        """The first piece of a group."""
        each = (count.shape[0] + ti.static(GROUPS) - 1) // ti.static(GROUPS)
        return ti.min(group * each, count.shape[0])


@ti.data_oriented
class DeviceLists:
    """`rows.Lists` on a device.

    Attributes:
        arrays: (pieces, room, width) each; count: (pieces,); total: rows of all pieces, after `grow`.
    """

    def __init__(self, pieces: int, room: int, kinds: list[tuple[int, type]]) -> None:
        self._kinds, self._sums, self.total = kinds, PrefixSums(pieces), 0
        self.count = self._sums.count
        self._make(room)

    def _make(self, room: int) -> None:
        self.arrays = [array(kind, self.count.shape[0], room, width) for width, kind in self._kinds]

    def grow(self) -> bool:
        """Makes room for entries that did not fit; False if all did. The host waits once."""
        most, self.total = self._sums.make()
        if most > self.arrays[0].shape[1]:
            self._make(int(rows.GROWTH * most))
            return True
        return False

    def joined(self) -> list:
        """The columns of all pieces, one after the other: arrays (total, width) on the device; none where there is no row."""
        out = [array(kind, self.total, width) for width, kind in self._kinds] if self.total else []
        for column, joined in zip(self.arrays, out):
            self._join(column, self.count, self._sums.first, joined, 0)
        return out

    def handed_over(self) -> list[np.ndarray]:
        """Columns (total, width) on the host: rows that are there cross over, by one launch."""
        return self._packed()[1]

    def owned(self) -> tuple[np.ndarray, np.ndarray]:
        """See `rows.Lists`."""
        self.grow()
        piece, columns = self._packed()
        return piece, columns[0]

    def _packed(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """(piece of each row (total,), columns (total, width))"""
        kinds = [np.dtype(kind) for _, kind in self._kinds]
        real = next((kind for kind in kinds if kind.kind == "f"), np.dtype(np.float32))
        width = {whole: sum(w for w, kind in self._kinds if (np.dtype(kind).kind != "f") == whole) for whole in (False, True)}
        reals: np.ndarray = np.empty((self.total, max(width[False], 1)), dtype=real)
        integers: np.ndarray = np.empty((self.total, 1 + width[True]), dtype=np.int32)
        ends, places = {False: 0, True: 1}, []
        for (w, _), kind in zip(self._kinds, kinds):
            whole = kind.kind != "f"
            places.append((whole, ends[whole], ends[whole] + w))
            ends[whole] += w
        if self.total:
            there = {False: array(real.type, *reals.shape), True: array(np.int32, *integers.shape)}
            self._name(self.count, self._sums.first, there[True])
            for column, (whole, begin, _) in zip(self.arrays, places):
                self._join(column, self.count, self._sums.first, there[whole], begin)
            self._hand(there[False], there[True], reals, integers)
        return integers[:, 0], [(integers if whole else reals)[:, begin:end] for whole, begin, end in places]

    @ti.kernel
    def _join(self, column: ti.types.ndarray(), count: ti.types.ndarray(), first: ti.types.ndarray(), out: ti.types.ndarray(),
              at: int):
        for k in range(column.shape[0] * column.shape[1]):
            piece, row = k // column.shape[1], k % column.shape[1]
            if row < count[piece]:
                for c in range(column.shape[2]):
                    out[first[piece] + row, at + c] = column[piece, row, c]

    @ti.kernel
    def _name(self, count: ti.types.ndarray(), first: ti.types.ndarray(), out: ti.types.ndarray()):
        for piece in range(count.shape[0]):
            for row in range(count[piece]):
                out[first[piece] + row, 0] = piece

    @ti.kernel
    def _hand(self, reals: ti.types.ndarray(), integers: ti.types.ndarray(), to_reals: ti.types.ndarray(),
              to_integers: ti.types.ndarray()):
        for k in range(integers.shape[0]):
            for c in range(reals.shape[1]):
                to_reals[k, c] = reals[k, c]
            for c in range(integers.shape[1]):
                to_integers[k, c] = integers[k, c]
