"""Sums in a fixed order: pieces side by side, then groups of pieces, then the groups.

On a CPU pieces are few and are added up one after the other. On a device they are thousands: one thread for all of them would
take longer than the loop that made them.

    ti.loop_config(serialize=blocks.serial)
    for piece in range(blocks.pieces):
        total = 0.0
        for i in range(blocks.first(piece), blocks.first(piece + 1)):
            total += ...
        sums.of_piece[piece] = total
    sums.finish(1)
    ...  # sums.all[0] is there for all that follows
"""

from .fields import Fields
from .language import ti

GROUPS = 128  # of pieces on a device, one thread each


@ti.data_oriented
class Sums:
    """Sums of a few numbers over the pieces of a loop; several such sums where a kernel makes them together.

    Args:
        pieces: of each sum.
        width: numbers that are summed up.
        device: whether data and loops are laid out for one.
        most: so many sums.

    Attributes:
        of_piece: (most * pieces, width) written by the loop, sum after sum.
        all: (most, width) the sums, after `finish`.
    """

    def __init__(self, fields: Fields, pieces: int, width: int, device: bool, most: int = 1, dtype=float) -> None:
        self.pieces, self.width, self.dtype = pieces, width, dtype
        self.groups, self.serial = min(GROUPS, pieces) if device else 1, not device
        self.of_piece = fields.real(most * pieces, width, dtype=dtype)
        self.of_group = fields.real(most * self.groups, width, dtype=dtype)
        self.all = fields.real(most, width, dtype=dtype)

    @ti.func
    def finish(self, count):
        """Adds up so many sums, at the top of a kernel."""
        ti.loop_config(serialize=self.serial)
        for at in range(count * self.groups):
            first, group = at // self.groups * self.pieces, at % self.groups
            self.of_group[at] = self.added(self.of_piece, first + self.pieces * group // self.groups,
                                           first + self.pieces * (group + 1) // self.groups)
        ti.loop_config(serialize=self.serial)
        for k in range(count):
            self.all[k] = self.added(self.of_group, k * self.groups, (k + 1) * self.groups)

    @ti.func
    def zero(self):
        """One number, or as many as are summed up."""
        if ti.static(self.width == 1):
            return ti.cast(0, self.dtype)
        else:
            return ti.Vector.zero(self.dtype, self.width)

    @ti.func
    def added(self, rows: ti.template(), first, end):
        """Sum of the rows from the first to that before the end."""
        total = self.zero()
        for row in range(first, end):
            total += rows[row]
        return total
