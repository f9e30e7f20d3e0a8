"""Rows of fields: those that are used, and numpy arrays of them; lists of rows that kernels write.

On the CPU arrays come straight from memory: a copy of 10,000 rows takes 5 us, with a kernel's launch it took .15 ms. On a
device a kernel hands over the rows that are asked for, not all that a field has room for.
"""

import numpy as np

from . import counting, field_pool, launches, pages, runtime
from .language import ti

KINDS = {"f32": np.float32, "f64": np.float64, "i32": np.int32}  # of fields
GROWTH = 1.5  # times the number that a piece turned out to write down, where that is more than there was room for
RESTING = 1 << 22  # bytes of rows that lists keep while nobody needs these
SMALL, MIDDLE, LARGE = 1 << 10, 1 << 14, 1 << 18  # rows: two sizes, then twice as many each, then multiples


def capacity(n: int) -> int:
    """Rows that a field of n rows gets: kernels are compiled for fields, and so serve all meshes of about a size."""
    size = SMALL if n <= SMALL else MIDDLE
    while size < min(n, LARGE):
        size *= 2
    return size if n <= LARGE else -(-n // LARGE) * LARGE


def in_reach() -> bool:
    """Whether numbers of fields can be read and written where they lie: on the CPU, by a compiler that says where."""
    return field_pool.SEEN and runtime.on_cpu()


def by_kernels() -> bool:
    """Whether they are handed over by kernels, as on a device."""
    return not runtime.direct


def numbers(field) -> np.ndarray:
    """All numbers of a field where they lie, those of its own simulation: see `field_pool.Slot.numbers`."""
    launches.swap_in((field.share,))
    return field.share.slot.numbers


def read(field, which: np.ndarray | None = None) -> np.ndarray:
    """A copy of the rows of a field that `Fields` made, or of those that `which` (k,) names."""
    if by_kernels():
        out = _handed_over(field, which)
    elif which is None:
        out = numbers(field)[: field.rows].copy()
    else:
        out = numbers(field).take(which, axis=0)
    if counting.now is not None:
        counting.now.read(out.nbytes)
    return out


def _handed_over(field, which: np.ndarray | None) -> np.ndarray:
    """The same by a kernel: only rows that are asked for cross over."""
    width, n = getattr(field, "n", 1), field.rows if which is None else len(which)
    out: np.ndarray = np.empty((n, width), dtype=KINDS[str(field.dtype)])
    if which is None:
        _get(field, width, out)
    else:
        _pick(field, width, np.ascontiguousarray(which, dtype=np.int32), out)
    return out if width > 1 else out[:, 0]


def write(field, data: np.ndarray) -> None:
    """Sets the first rows of a field, as many as there are in data. A single number goes with a launch."""
    if by_kernels() and data.size == 1:
        (_set_integer if data.dtype.kind in "iu" else _set_real)(field, data.item())
        return
    if counting.now is not None:
        counting.now.write(data.nbytes)
    if not by_kernels():
        rows = numbers(field)[: len(data)]
        rows[...] = data.reshape(rows.shape)
    else:
        _put(field, getattr(field, "n", 1), np.ascontiguousarray(data).reshape(-1))


@ti.kernel
def _get(field: ti.template(), width: ti.template(), out: ti.types.ndarray()):
    for j in range(out.shape[0]):
        hand_over(field, width, j, out, j)


@ti.kernel
def _pick(field: ti.template(), width: ti.template(), which: ti.types.ndarray(), out: ti.types.ndarray()):
    for j in range(which.shape[0]):
        hand_over(field, width, which[j], out, j)


@ti.func
def hand_over(field: ti.template(), width: ti.template(), row, out: ti.template(), j):
    """A row of a field into row j of an array (k, width)."""
    if ti.static(width == 1):
        out[j, 0] = field[row]
    else:
        for c in ti.static(range(width)):
            out[j, c] = field[row][c]


@ti.kernel
def _put(into: ti.template(), width: ti.template(), numbers: ti.types.ndarray()):
    for j in range(numbers.shape[0]):
        fill(into, width, j, numbers[j])


@ti.kernel
def _set_real(field: ti.template(), number: float):
    field[0] = number


@ti.kernel
def _set_integer(field: ti.template(), number: int):
    field[0] = number


@ti.func
def fill(field: ti.template(), width: ti.template(), j, number):
    """The j-th number of a field of rows."""
    if ti.static(width == 1):
        field[j] = number
    else:
        field[j // width][j % width] = number


class Lists:
    """Rows that each piece of a loop (see `dealing`) writes down in a list of its own.

    A kernel gets `arrays` and writes how many rows each piece has, or would have if there were room, to `count`.

    Args:
        pieces: of the loop.
        room: rows of each to begin with.
        kinds: widths and types of its columns.
    """

    def __init__(self, pieces: int, room: int, kinds: list[tuple[int, type]]) -> None:
        self._kinds = kinds
        self.count: np.ndarray = np.zeros(pieces, dtype=np.int32)
        self._make(room)

    def _make(self, room: int) -> None:
        shape = len(self.count), room
        self.arrays: list[np.ndarray] = [np.zeros((*shape, width), dtype=kind) for width, kind in self._kinds]

    def grow(self) -> bool:
        """Makes room for entries that did not fit; False if all did."""
        most, room = int(self.count.max(initial=0)), self.arrays[0].shape[1]
        if most > room:
            self._make(int(GROWTH * most))
        return most > room

    def joined(self) -> list[np.ndarray]:
        """The columns of all pieces, one after the other: arrays (rows, width)."""
        room = self.arrays[0].shape[1]
        if len(self.count) > room:  # as on a device: a slice of each piece would take longer than a look at all rows
            used = np.flatnonzero(np.arange(room) < self.count[:, None])
            return [array.reshape(-1, array.shape[2]).take(used, axis=0) for array in self.arrays]
        count = self.count.tolist()
        return [np.concatenate([rows[:k] for rows, k in zip(array, count)]) for array in self.arrays]

    def handed_over(self) -> list[np.ndarray]:
        """The same, on the host in any layout."""
        return self.joined()

    def rest(self) -> None:
        """Nobody needs the rows any more: where they take much memory it is given back, until some are written again."""
        row = sum(array.itemsize * array.shape[2] for array in self.arrays)  # bytes
        if pages.GIVES_BACK and row * int(self.count.sum()) > RESTING:
            for array in self.arrays:
                pages.clear(array)

    def owned(self) -> tuple[np.ndarray, np.ndarray]:
        """(the piece of each row (k,), the rows (k, width) of the first column), where all fit."""
        piece = np.flatnonzero(self.count)
        count = self.count[piece]
        owner, first = np.repeat(piece, count), np.cumsum(count) - count
        return owner, self.arrays[0][owner, np.arange(len(owner)) - np.repeat(first, count)]
