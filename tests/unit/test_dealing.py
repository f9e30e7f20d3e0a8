"""Loops in pieces that threads take: every piece once, whichever thread, however long others take."""

from types import SimpleNamespace

import numpy as np
import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.dealing import Dealer
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import Lists

pytestmark = pytest.mark.restarts

PIECES = 300_000  # most so short that threads ask at the same time


@pytest.mark.parametrize("pieces, room", [(3, 7), (7, 3), (90, 4)])
def test_lists_are_joined_piece_after_piece(rng, pieces, room):
    """Few long ones, and many short ones."""
    lists = Lists(pieces, room, [(2, np.int32), (1, np.float64)])
    lists.count[:] = rng.integers(0, room + 1, size=pieces)
    for array in lists.arrays:
        array[:] = rng.integers(0, 99, size=array.shape)
    for array, made in zip(lists.arrays, lists.joined()):
        wanted = [row for piece, k in zip(array, lists.count) for row in piece[:k]]
        assert made.dtype == array.dtype and made.shape == (lists.count.sum(), array.shape[2]) and (made == wanted).all()


@ti.data_oriented
class Loop:
    """Piece k takes cost[k] additions; counts who was how often done."""

    def __init__(self, threads: int, grain: int) -> None:
        self.fields = Fields(np.float64)
        self.dealer = Dealer(self.fields, SimpleNamespace(count=threads, grain=grain), PIECES)
        self.cost = self.fields.integer(PIECES, data=np.where(np.arange(PIECES) % 30_000, 1, 200_000))
        self.times, self.sums = self.fields.integer(PIECES), self.fields.integer(PIECES)
        self.fields.allocate()

    @ti.kernel
    def run(self, pieces: int):
        self.dealer.begin()
        for t in range(self.dealer.tasks):
            if t % self.dealer.grain == 0:
                piece = self.dealer.next()
                while piece < pieces:
                    total = piece
                    for k in range(self.cost[piece]):
                        total = (total * 31 + k) % 1009
                    self.sums[piece] = total
                    self.times[piece] += 1
                    piece = self.dealer.next()

    @ti.kernel
    def cut(self, pieces: int, rows: int, out: ti.types.ndarray()):
        for k in range(pieces + 1):
            out[k] = self.dealer.first(k, pieces, rows)


def expected(piece: int, cost: int) -> int:
    total = piece
    for k in range(cost):
        total = (total * 31 + k) % 1009
    return total


@pytest.mark.parametrize("threads, grain", [(1, 512), (2, 512), (4, 512), (PIECES, 1)])
def test_every_piece_once_in_every_run(threads, grain):
    runtime.start(threads=min(threads, 4))
    loop = Loop(threads, grain)
    for runs in (1, 2, 3):
        loop.run(PIECES - 3)
        assert (loop.times.to_numpy()[:PIECES] == runs * (np.arange(PIECES) < PIECES - 3)).all()
    sums = loop.sums.to_numpy()
    assert [int(sums[k]) for k in (1, 50, 30_000)] == [expected(1, 1), expected(50, 1), expected(30_000, 200_000)]
    loop.fields.free()


@pytest.mark.parametrize("pieces, rows", [(16, 0), (16, 7), (16, 1000), (60_000, 2_000_000_000)])
def test_pieces_hold_all_rows_and_none_twice(pieces, rows):
    """Also where rows times pieces is no 32-bit integer."""
    runtime.start(threads=2)
    loop, first = Loop(2, 512), np.zeros(pieces + 1, dtype=np.int32)
    loop.cut(pieces, rows, first)
    sizes = np.diff(first)
    assert first[0] == 0 and first[-1] == rows and sizes.min() >= 0 and sizes.max() == -(-rows // pieces)
    loop.fields.free()
