"""Phases of a parallel algorithm inside one kernel: CPU threads go through them together.

A launch costs some 75 us and a hand-over to other threads 45 us, a phase here .2 us. In each phase every block of rows is
claimed once and worked on; whoever ends the last one decides on the next phase. Threads spin while they wait, and after a
while take over blocks that nobody has claimed: a thread that the system has put aside between two blocks holds nobody up.
If all blocks are claimed and one is not done for long, the system has taken the core of its thread for another program. Then a
thread that waits leaves for good, so that the late one has a core, and the others do its blocks.
The result does not depend on the thread that works on a block.

    phases.start(FIRST)  # in a loop of its own before
    for t in range(phases.tasks):
        if t % TASK == 0:
            phase, kind, block, waited = 0, 0, 0, 0
            while kind != END:
                phase, kind = phases.phase(), phases.kind(waited)  # in this order
                if kind != END:
                    block, waited = phases.claim(t // TASK, phase, waited)
                    if block >= 0:
                        ...  # the block's part of this kind of phase
                        if phases.last(phase):
                            phases.turn(...)  # the next phase
"""

import numpy as np

from .fields import Fields
from .language import ti
from .runtime import TASK

END = 0  # kind of phase after which there is none
APART = 32  # integers between two that different threads write to
PATIENT = 2000  # looks at a phase before a thread does the work of others
LEAVES = 5 * PATIENT  # looks after which the first one leaves, the next after as many more; or, where that is more,
A_ROW = 8  # so many looks for each row of a block: a look costs some 60 ns, a row in a phase up to 300


@ti.data_oriented
class PhaseScheduler:
    """Threads for a number of blocks, at most one each.

    Args:
        rows: of the largest block.
    """

    def __init__(self, fields: Fields, blocks: int, rows: int) -> None:
        self.blocks, self.tasks = blocks, blocks * TASK
        self.leaves = fields.integer(1, data=np.array([max(LEAVES, A_ROW * rows)]))  # looks, as kernels read them
        self.claimed = fields.integer(blocks * APART)  # phases in which each block was
        self.shared = fields.integer(4 * APART)  # phases done, kind of the next, blocks done in all phases, threads that left

    @ti.func
    def start(self, kind):
        """Makes ready for a first phase."""
        ti.loop_config(serialize=True)
        for k in range(self.blocks):
            self.claimed[k * APART] = 0
        self.shared[0] = 0
        self.shared[APART] = kind
        self.shared[2 * APART] = 0
        self.shared[3 * APART] = 0

    @ti.func
    def phase(self):
        """Phases done. Read before their kind, so that a block that is claimed next is of that kind."""
        return ti.atomic_add(self.shared[0], 0)

    @ti.func
    def kind(self, waited):
        """Kind of the current phase; `END` for a thread that has to leave, after `waited` looks without work."""
        kind = ti.atomic_add(self.shared[APART], 0)
        if waited > LEAVES:  # all blocks are claimed, so somebody is at work
            left = ti.atomic_add(self.shared[3 * APART], 0)
            if waited > self.leaves[0] * (left + 1):
                if ti.atomic_max(self.shared[3 * APART], left + 1) <= left:  # nobody else just now
                    kind = END
        return kind

    @ti.func
    def claim(self, own, phase, waited):
        """(block to work on or -1, looks since this thread had one; -1 if it takes blocks at once that others leave)."""
        block, helps = -1, waited < 0
        if ti.atomic_max(self.claimed[own * APART], phase + 1) <= phase:
            block, waited = own, ti.min(waited, 0)
        else:
            waited = ti.max(waited, 0) + 1
            if helps or waited % PATIENT == 0:
                for b in range(self.blocks):
                    if block < 0:
                        if ti.atomic_max(self.claimed[b * APART], phase + 1) <= phase:
                            block, waited = b, -1
        return block, waited

    @ti.func
    def last(self, phase):
        """A block was done: whether it was the last one of its phase."""
        return ti.atomic_add(self.shared[2 * APART], 1) == (phase + 1) * self.blocks - 1

    @ti.func
    def turn(self, kind):
        """The phase is over, the next one is of a kind."""
        self.shared[APART] = kind
        ti.atomic_add(self.shared[0], 1)
