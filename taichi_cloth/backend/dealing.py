"""Dynamic scheduling of loops with costly parts: threads take pieces one after the other.

Taichi gives each CPU thread of a loop a run of its iterations beforehand, all of the first half to one of two. If the
costly ones are at one end, or a thread starts late or is put aside, the other waits. Sums over the nodes of all levels then
took as long on two threads as on one. Here a thread that is done with a piece takes the next. The result does not depend on
the thread that works on a piece.

    dealer.begin()
    for t in range(dealer.tasks):
        if t % dealer.grain == 0:
            piece = dealer.next()
            while piece < pieces:
                ...
                piece = dealer.next()
"""

import numpy as np

from .fields import Fields
from .language import ti

GROWTH = 1.5  # times the number that a piece turned out to write down, where that is more than there was room for


@ti.data_oriented
class Dealer:
    """Deals out pieces of a loop.

    Args:
        blocks: of the model; on a CPU as many threads as these take pieces.
        takers: threads that do on a GPU.
    """

    def __init__(self, fields: Fields, blocks, takers: int) -> None:
        self.grain = blocks.grain
        self.tasks = blocks.count * blocks.grain if blocks.grain > 1 else takers
        self.taken = fields.integer(1)  # pieces that threads asked for

    @ti.func
    def begin(self):
        """Begins a loop: no piece is taken yet."""
        self.taken[0] = 0

    @ti.func
    def next(self):
        """A piece that nobody has taken; beyond the last if there is none."""
        return ti.atomic_add(self.taken[0], 1)

    @ti.func
    def first(self, piece, pieces, rows):
        """The first of a piece's rows, where rows are cut into pieces; all numbers on the way stay below rows + 2 pieces."""
        return ti.min(piece * ((rows + pieces - 1) // pieces), rows)


class Lists:
    """Rows that each piece of a loop writes down in a list of its own.

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
