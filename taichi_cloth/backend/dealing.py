"""Loops of which some parts cost far more than others, in pieces that threads take one after the other.

Taichi gives each CPU thread of a loop a run of its iterations beforehand, all of the first half to one of two. Where the
costly ones are at one end, or a thread starts late or is put aside, the other waits: sums over the nodes of all levels took
as long on two threads as on one. Here a thread that is done with a piece takes the next. Which thread works on a piece makes
no difference to the result.

    dealer.begin()
    for t in range(dealer.tasks):
        if t % dealer.grain == 0:
            piece = dealer.next()
            while piece < pieces:
                ...
                piece = dealer.next()
"""

import taichi as ti

from .fields import Fields


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
        """Of a loop."""
        self.taken[0] = 0

    @ti.func
    def next(self):
        """A piece that nobody has taken; beyond the last where there is none."""
        return ti.atomic_add(self.taken[0], 1)
