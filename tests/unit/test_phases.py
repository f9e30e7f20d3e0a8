"""Threads that go through phases together: every block once a phase, in order, also where a thread is late."""

import numpy as np
import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.phases import APART, END, PATIENT, TASK, PhaseScheduler

pytestmark = pytest.mark.restarts

WORK = 1


@ti.data_oriented
class Sums:
    """Each phase adds what the blocks' neighbours had after the phase before."""

    def __init__(self, blocks: int, lazy: int, late: int = 0, rows: int = 1) -> None:
        self.fields, self.blocks, self.lazy, self.late = Fields(np.float64), blocks, lazy, late
        self.phases = PhaseScheduler(self.fields, blocks, rows)
        self.x, self.y, self.times = self.fields.integer(blocks), self.fields.integer(blocks), self.fields.integer(blocks)
        self.away, self.left = self.fields.integer(1), self.fields.integer(1)
        self.fields.allocate()

    @ti.kernel
    def run(self, phases: int):
        for _ in range(1):
            self.phases.start(WORK)
            for b in range(self.blocks):
                self.x[b], self.y[b], self.times[b] = b + 1, 0, 0
            self.away[0], self.left[0] = 0, 0
        for t in range(self.phases.tasks):
            if t % TASK == 0:
                phase, kind, block, waited = 0, WORK, 0, 0
                if t // TASK < self.lazy:
                    kind = END  # this thread never comes
                while kind != END:
                    phase, kind = self.phases.phase(), self.phases.kind(waited)
                    if kind == END and phase == 0:
                        self.left[0] += 1
                    if kind != END:
                        block, waited = self.phases.claim(t // TASK, phase, waited)
                        if block >= 0:
                            if phase == 0 and block == 0:
                                for _ in range(self.late):  # its thread is put aside
                                    ti.atomic_add(self.away[0], 1)
                            if phase % 2 == 0:
                                self.y[block] = (self.x[(block + 1) % self.blocks] * 3 + self.x[block]) % 1009
                            else:
                                self.x[block] = (self.y[(block + 1) % self.blocks] * 5 + self.y[block]) % 1009
                            self.times[block] += 1
                            if self.phases.last(phase):
                                following = WORK
                                if phase + 1 == phases:
                                    following = END
                                self.phases.turn(following)


def expected(blocks: int, phases: int) -> np.ndarray:
    x = np.arange(1, blocks + 1)
    for _ in range(phases // 2):
        y = (np.roll(x, -1) * 3 + x) % 1009
        x = (np.roll(y, -1) * 5 + y) % 1009
    return x


@pytest.mark.parametrize("threads, lazy", [(1, 0), (2, 0), (2, 1), (4, 0), (4, 3)])
def test_every_block_once_a_phase_in_order(threads, lazy):
    runtime.start("cpu", "f64", threads)
    sums = Sums(threads, lazy)
    phases = 5 * PATIENT if lazy == 0 else 400
    sums.run(phases)
    assert (sums.times.to_numpy()[:threads] == phases).all()
    assert (sums.x.to_numpy()[:threads] == expected(threads, phases)).all()
    sums.fields.free()


@pytest.mark.parametrize("threads", [2, 4])
def test_who_waits_too_long_leaves_and_the_others_do_its_work(threads):
    """A thread is put aside within its block: who waits for it gives its core away, one after the other, and all is done."""
    runtime.start("cpu", "f64", threads)
    sums, phases = Sums(threads, 0, late=20_000_000), 400
    sums.run(phases)
    assert 1 <= sums.left[0] < threads
    assert (sums.times.to_numpy()[:threads] == phases).all()
    assert (sums.x.to_numpy()[:threads] == expected(threads, phases)).all()
    sums.fields.free()


def test_who_waits_no_longer_than_a_large_block_takes_stays():
    """The more rows a block has, the longer it may take: that its thread is at work for long does not mean that it was put
    aside."""
    runtime.start("cpu", "f64", 2)
    sums = Sums(2, 0, late=2_000_000, rows=100_000_000)
    sums.run(400)
    assert sums.phases.shared[3 * APART] == 0  # that left
    assert (sums.x.to_numpy()[:2] == expected(2, 400)).all()
    sums.fields.free()
