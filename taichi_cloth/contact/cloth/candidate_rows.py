"""Rows of candidates with their numbers: arrays of numpy, or on a device arrays in its memory, which never come to the host.

A kernel gets `arrays`, 16 bytes a row: ids (k, 2) of pairs, see `pair_of`; their distances (k,) [m]; the largest distances
(k,) [m] that they may have to keep. Both are in f32, the one rounded down and the other up: they only tell which pairs need
an exact look. On the host pairs are (k, 3), as `ContactPairs.pair`.
"""

from typing import Any

import numpy as np

from ...backend.device_arrays import array
from ...backend.device_lists import PrefixSums
from ...backend.language import ti
from ...backend.runtime import for_device
from ..geometry import EDGE_EDGE, VERTEX_FACE

PIECES = 2048  # of rows that are told apart on a device
SINGLE = 2.4e-7  # part by which f32 numbers are rounded down or up: twice its precision


@ti.func
def pair_of(ids: ti.template(), k):
    """(i, j, kind) of a row: i is stored as -1 - i for two edges."""
    i, kind = ids[k, 0], VERTEX_FACE
    if i < 0:
        i, kind = -1 - i, EDGE_EDGE
    return i, ids[k, 1], kind


def packed(pairs: np.ndarray) -> np.ndarray:
    """(k, 2) ids of pairs (k, 3)."""
    first = np.where(pairs[:, 2] == VERTEX_FACE, pairs[:, 0], -1 - pairs[:, 0])
    return np.column_stack([first, pairs[:, 1]]).astype(np.int32)


def unpacked(ids: np.ndarray) -> np.ndarray:
    """(k, 3) pairs of ids (k, 2)."""
    first, edges = ids[:, 0], ids[:, 0] < 0
    kind = np.where(edges, EDGE_EDGE, VERTEX_FACE)
    return np.column_stack([np.where(edges, -1 - first, first), ids[:, 1], kind]).astype(np.int32)


def _as_stored(k: int, values: np.ndarray) -> np.ndarray:
    """The k-th of pairs, distances and radii as rows have it. Earlier checkpoints have f64."""
    if k == 0:
        return packed(values)
    rounded = values if values.dtype == np.float32 else values * (1 - SINGLE if k == 1 else 1 + SINGLE)
    return rounded.astype(np.float32)


class HostRows:
    """Rows in arrays of numpy, which change in place: nobody keeps a view.

    Args:
        arrays: ids, distances, radii.
    """

    def __init__(self, *arrays: np.ndarray) -> None:
        self.arrays: tuple[np.ndarray, ...] = arrays

    def __len__(self) -> int:
        return len(self.arrays[0])

    @classmethod
    def of(cls, ids: list[np.ndarray]) -> "HostRows":
        """Rows whose numbers are still to be written; ids as `Lists.joined` gives them."""
        return cls(ids[0], *(np.empty(len(ids[0]), dtype=np.float32) for _ in range(2)))

    @classmethod
    def none(cls) -> "HostRows":
        """No rows."""
        return cls.of([np.zeros((0, 2), dtype=np.int32)])

    def numbers(self, kind: type = np.int8) -> np.ndarray:
        """(k,) for a kernel to write."""
        return np.empty(len(self), dtype=kind)

    def replace(self, stays: np.ndarray, found: "HostRows") -> None:
        """Rows that were found take the place of those that do not stay (k,)."""
        stays = stays.view(bool)
        before, kept = len(stays), int(np.count_nonzero(stays))
        count = kept + len(found)
        free = np.concatenate([np.flatnonzero(~stays[:count]), np.arange(before, count)])
        last = count + np.flatnonzero(stays[count:])  # go where there is room
        for rows, new in zip(self.arrays, found.arrays):
            new = np.concatenate([new, rows[last]])
            rows.resize((count, *rows.shape[1:]), refcheck=False)  # the system moves pages instead of copying them
            rows[free] = new

    def least(self, part: np.ndarray) -> tuple[float, np.ndarray]:
        """(the least of (k,) parts, pairs (j, 3) of rows whose part is less than 1)"""
        return float(part.min()), unpacked(self.arrays[0][part < 1])

    def read(self) -> tuple[np.ndarray, ...]:
        """pairs, distances, radii"""
        return unpacked(self.arrays[0]), *self.arrays[1:]

    def put(self, k: int, values: np.ndarray) -> None:
        """Sets the k-th of these; the others follow."""
        self.arrays = (*self.arrays[:k], _as_stored(k, values), *self.arrays[k + 1:])


@ti.data_oriented
class DeviceRows:
    """The same in a device's memory.

    Args:
        arrays: ids, distances, radii; none where there is no row.
    """

    def __init__(self, *arrays) -> None:
        self.arrays: tuple = arrays
        self._sums = PrefixSums(PIECES)
        self._parts: list[np.ndarray] = []  # of those that are being put

    def __len__(self) -> int:
        return self.arrays[0].shape[0] if self.arrays else 0

    @classmethod
    def of(cls, ids: list) -> "DeviceRows":
        """Rows whose numbers are still to be written; ids as `DeviceLists.joined` gives them."""
        return cls(ids[0], *(array(np.float32, ids[0].shape[0]) for _ in range(2))) if ids else cls()

    @classmethod
    def none(cls) -> "DeviceRows":
        """No rows."""
        return cls.of([])

    def numbers(self, kind: type = np.int8):
        """See `HostRows`."""
        return array(kind, len(self))

    def replace(self, stays, found: "DeviceRows") -> None:
        """Rows that stay (k,), in their order, and then those that were found. The host waits once."""
        kept, old = self._count(stays), self.arrays
        count = kept + len(found)
        if not count:
            self.arrays = ()
            return
        self.arrays = array(np.int32, count, 2), array(np.float32, count), array(np.float32, count)
        self._keep(stays, self._sums.first, *old, *self.arrays)
        if len(found):
            self._append(kept, *found.arrays, *self.arrays)

    def least(self, part) -> tuple[float, np.ndarray]:
        """See `HostRows`; the host waits once where nothing is less than 1."""
        ids: np.ndarray = np.zeros((0, 2), dtype=np.int32)
        below, told = self.numbers(), array(np.float32 if part.dtype == ti.f32 else np.float64, 1)
        least = float(self._least(part, below, told))
        if least < 1:
            ids = np.zeros((self._count(below), 2), dtype=np.int32)
            self._pick(below, self._sums.first, self.arrays[0], ids)
        return least, unpacked(ids)

    def read(self) -> tuple[np.ndarray, ...]:
        """See `HostRows`; copies."""
        some = [rows.to_numpy() for rows in self.arrays]
        return (unpacked(some[0]), *some[1:]) if some else HostRows.none().read()

    def put(self, k: int, values: np.ndarray) -> None:
        """See `HostRows`; they go there when all are of a length."""
        self._parts = self._parts or list(self.read())
        self._parts[k] = values
        if len({len(part) for part in self._parts}) == 1:
            self.arrays = tuple(_moved(_as_stored(n, part)) for n, part in enumerate(self._parts)) if len(values) else ()
            self._parts = []

    def _count(self, flags) -> int:
        """How many flags are set; sums before each piece of the rows."""
        self._count_pieces(flags, self._sums.count)
        return self._sums.make()[1]

    @ti.func
    def begin(self, piece, flags: ti.template()):
        """The first row of a piece."""
        each = (flags.shape[0] + ti.static(PIECES) - 1) // ti.static(PIECES)
        return ti.min(piece * each, flags.shape[0])

    @ti.kernel
    def _count_pieces(self, flags: ti.types.ndarray(), count: ti.types.ndarray()):
        for piece in range(ti.static(PIECES)):
            total = 0
            for k in range(self.begin(piece, flags), self.begin(piece + 1, flags)):
                total += ti.cast(flags[k] != 0, ti.i32)
            count[piece] = total

    @ti.kernel
    def _keep(self, flags: ti.types.ndarray(), first: ti.types.ndarray(), ids: ti.types.ndarray(),
              distances: ti.types.ndarray(), radii: ti.types.ndarray(), to_ids: ti.types.ndarray(),
              to_distances: ti.types.ndarray(), to_radii: ti.types.ndarray()):
        for piece in range(ti.static(PIECES)):
            row = first[piece]
            for k in range(self.begin(piece, flags), self.begin(piece + 1, flags)):
                if flags[k] != 0:
                    for c in ti.static(range(2)):
                        to_ids[row, c] = ids[k, c]
                    to_distances[row], to_radii[row] = distances[k], radii[k]
                    row += 1

    @ti.kernel
    def _append(self, at: int, ids: ti.types.ndarray(), distances: ti.types.ndarray(), radii: ti.types.ndarray(),
                to_ids: ti.types.ndarray(), to_distances: ti.types.ndarray(), to_radii: ti.types.ndarray()):
        for k in range(ids.shape[0]):
            for c in ti.static(range(2)):
                to_ids[at + k, c] = ids[k, c]
            to_distances[at + k], to_radii[at + k] = distances[k], radii[k]

    @ti.kernel
    def _least(self, part: ti.types.ndarray(), below: ti.types.ndarray(), told: ti.types.ndarray()) -> float:
        told[0] = 1.0
        for k in range(part.shape[0]):
            below[k] = ti.cast(part[k] < 1, ti.i8)
            ti.atomic_min(told[0], part[k])  # the same in any order
        return told[0]

    @ti.kernel
    def _pick(self, flags: ti.types.ndarray(), first: ti.types.ndarray(), ids: ti.types.ndarray(), out: ti.types.ndarray()):
        for piece in range(ti.static(PIECES)):
            row = first[piece]
            for k in range(self.begin(piece, flags), self.begin(piece + 1, flags)):
                if flags[k] != 0:
                    for c in ti.static(range(2)):
                        out[row, c] = ids[k, c]
                    row += 1


def _moved(values: np.ndarray):
    """An array in the device's memory."""
    out = array(values.dtype.type, *values.shape)
    out.from_numpy(values)
    return out


def known_part(k: int) -> property:
    """The k-th array of an object's `known` rows, as checkpoints have it."""
    return property(lambda self: self.known.read()[k], lambda self, values: self.known.put(k, values))


def rows_kind() -> Any:
    """The kind that suits the layout."""
    return DeviceRows if for_device() else HostRows
