"""Binding of Taichi's CPU threads to cores of their own, while no other program wants these. Linux only.

The system likes to wake a thread on its last core, or on that of the thread that wakes it. Two threads then often share a core
while another is idle, for the milliseconds that most kernels take, and do no more than one would. Each is therefore bound to a
core. But a bound thread cannot leave a core that another program keeps busy, and all wait for it. The time that threads wait
for their cores is therefore measured now and then. If it is long they are let go, and bound again after a while, for a try.
"""

import os
import time
from collections.abc import Iterable

LOOK = 0.5  # s from look to look, at least
ENOUGH = 200_000_000  # ns that threads ran, or could have, from which on a look says something
WAITED = 0.2  # part of the time in which bound threads could run, that they may wait for a core
REST, LONGEST = 2.0, 64.0  # s until they are bound again: at first, and at most; twice as long each time that it was no use
JUMP = 10_000  # between numbers of threads that were started together: the system's numbers began anew from small ones


def running() -> set[int]:
    """Numbers of the process's threads; none where the system does not tell."""
    try:
        return {int(name) for name in os.listdir("/proc/self/task")}
    except OSError:
        return set()


def in_order(started: Iterable[int]) -> list[int]:
    """Numbers of threads that were started one after the other, in that order."""
    numbers = sorted(started)
    jump, first = max(((b - a, k) for k, (a, b) in enumerate(zip(numbers, numbers[1:]), 1)), default=(0, 0))
    return numbers[first:] + numbers[:first] if jump > JUMP else numbers


class Placement:
    """Threads, as many as cores, each bound to one of these.

    Args:
        threads: their numbers.
        cores: that they may use.
    """

    def __init__(self, threads: list[int], cores: list[int]) -> None:
        self.threads, self.cores, self.bound = threads, cores, False
        self._rest, self._next, self._ran, self._waited = REST, 0.0, 0, 0

    def mind(self, now: float) -> None:
        """Looks, if it is time to, whether threads wait for their cores, and binds them or lets them go."""
        if now < self._next:
            return
        self._next = now + LOOK
        ran, waited = self._times()
        if not self.bound:
            self._bind(True)
            self._ran, self._waited = ran, waited
            return
        did, lost = ran - self._ran, waited - self._waited
        if did + lost < ENOUGH:
            return
        self._ran, self._waited = ran, waited
        if lost > WAITED * (did + lost):
            self._bind(False)
            self._next, self._rest = now + self._rest, min(2 * self._rest, LONGEST)
        else:
            self._rest = REST

    def _bind(self, bound: bool) -> None:
        """Binds each thread to its core, or lets all go to any."""
        self.bound = bound
        if not set(self.threads) <= running():  # Taichi was started anew by others: their numbers may be anybody's
            self.threads = []
        for thread, core in zip(self.threads, self.cores):
            try:
                os.sched_setaffinity(thread, {core} if bound else set(self.cores))
            except OSError:  # the core is no longer there
                self.threads = []

    def _times(self) -> tuple[int, int]:
        """[ns] that threads ran, and that they waited for a core while they could have; 0 where the system does not tell."""
        ran = waited = 0
        for thread in self.threads:
            try:
                with open(f"/proc/self/task/{thread}/schedstat", encoding="ascii") as file:
                    one, other = file.read().split()[:2]
                ran, waited = ran + int(one), waited + int(other)
            except (OSError, ValueError):
                pass
        return ran, waited


_current: Placement | None = None


def place(before: set[int], count: int) -> None:
    """Binds the last `count` threads that were started, of those that were not there before, where there are as many cores."""
    global _current
    _current = None
    if not before or count < 2 or not hasattr(os, "sched_setaffinity"):
        return
    cores, new = sorted(os.sched_getaffinity(0)), in_order(running() - before)
    if len(cores) == count <= len(new):
        _current = Placement(new[-count:], cores)
        mind()


def mind() -> None:
    """See `Placement.mind`: between steps, and pictures."""
    if _current is not None:
        _current.mind(time.monotonic())
