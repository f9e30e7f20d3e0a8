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

from .fields import Fields
from .language import ti


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
