"""Taichi's threads on cores of their own, while nobody else wants these."""

import json
import os
import subprocess
import sys

import pytest

from taichi_cloth.backend import placement
from taichi_cloth.backend.placement import LONGEST, LOOK, REST, Placement, in_order

SECOND = 1_000_000_000  # ns

WHO_WORKS = '''
import os
from taichi_cloth.backend.language import ti
from taichi_cloth.backend import placement, runtime

os.sched_setaffinity(0, set(range(os.cpu_count())))
runtime.start(threads={threads})


@ti.kernel
def work(m: int) -> float:
    total = 0.0
    for t in range(64 * 512):
        if t % 512 == 0:
            for k in range(m):
                total += ti.sin(k * 1.0)
    return total


def used():
    return {{t: int(open(f"/proc/self/task/{{t}}/stat").read().rsplit(")", 1)[1].split()[11]) for t in placement.running()}}


work(1)
before = used()
work(2_000_000)
after = used()
busy = [t for t in after if t != os.getpid() and after[t] - before.get(t, 0) > 5]
print(len(os.sched_getaffinity(0)), [sorted(os.sched_getaffinity(t)) for t in busy])
'''

on_linux = pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or not placement.running() or (os.cpu_count() or 1) < 2,
                              reason="threads are bound on Linux, where there are two cores or more")


@on_linux
@pytest.mark.parametrize("fewer", [0, 1])
def test_threads_that_work_are_bound_where_there_are_as_many_as_cores(tmp_path, fewer):
    there = os.cpu_count() or 1
    script = tmp_path / "who_works.py"
    script.write_text(WHO_WORKS.format(threads=there - fewer))
    out = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    cores, bound = int(out.split()[0]), json.loads(out.split(" ", 1)[1])
    if cores != there:
        pytest.skip("not all cores may be used here")
    assert bound
    if fewer:
        assert all(len(one) == cores for one in bound)
    else:
        assert all(len(one) == 1 for one in bound) and len({one[0] for one in bound}) == len(bound)


def test_threads_started_in_turn_are_told_in_turn_where_numbers_begin_anew():
    assert in_order({7, 5, 6}) == [5, 6, 7]
    assert in_order({32766, 300, 32767, 301}) == [32766, 32767, 300, 301]
    assert in_order([]) == [] and in_order([4]) == [4]


class Watched(Placement):
    """Threads that run and wait as a test says."""

    def __init__(self) -> None:
        super().__init__([11, 12], [0, 3])
        self.ran = self.waited = 0

    def _times(self) -> tuple[int, int]:
        return self.ran, self.waited

    def after(self, now: float, share: float, run: float = LOOK) -> bool:
        """Whether they are bound after a look, when they ran for so long [s] and waited for a share of that and the wait."""
        self.ran += int(run * SECOND)
        self.waited += int(run * SECOND * share / (1 - share))
        self.mind(now)
        return self.bound


def test_who_waits_is_let_go_and_bound_again_for_a_try(monkeypatch):
    bound: dict[int, set[int]] = {}
    monkeypatch.setattr(placement, "running", lambda: {11, 12})
    monkeypatch.setattr(os, "sched_setaffinity", bound.__setitem__, raising=False)
    place, now = Watched(), 100.0
    place.mind(now)
    assert place.bound and bound == {11: {0}, 12: {3}}
    assert place.after(now + LOOK, 0.1)
    assert place.after(now + LOOK + 0.01, 0.9, 1.0), "it was looked at a moment ago"
    assert not place.after(now + 2 * LOOK, 0.0), "what they waited since then counts"
    assert bound == {11: {0, 3}, 12: {0, 3}}
    now, rest = now + 2 * LOOK, REST
    for _ in range(9):  # a neighbour that stays
        assert not place.after(now + 0.9 * rest, 0.5)
        now += rest
        assert place.after(now, 0.5)
        assert place.after(now + 0.4 * LOOK, 0.5), "too soon to say"
        now += LOOK
        assert not place.after(now, 0.5)
        rest = min(2 * rest, LONGEST)
    assert rest == LONGEST
    now += rest
    assert place.after(now, 0.5) and place.after(now + LOOK, 0.0)  # it has gone
    assert not place.after(now + 2 * LOOK, 0.9)
    assert place.after(now + 2 * LOOK + REST, 0.0)


def test_threads_that_hardly_ran_say_nothing(monkeypatch):
    monkeypatch.setattr(os, "sched_setaffinity", lambda thread, cores: None, raising=False)
    place = Watched()
    place.mind(1.0)
    assert place.after(2.0, 0.9, 0.01) and place.after(3.0, 0.5, 0.02)
    assert not place.after(4.0, 0.5, 0.2), "little by little it is enough"


def test_threads_that_ended_are_left_alone(monkeypatch):
    """Their numbers may be those of another program's by now."""
    were: list[int] = []
    monkeypatch.setattr(os, "sched_setaffinity", lambda thread, cores: were.append(thread), raising=False)
    monkeypatch.setattr(placement, "running", lambda: {1, 11})
    place = Placement([11, 12], [0, 1])
    place.mind(1.0)
    place.mind(10.0)
    assert were == [] and place.threads == []


@pytest.mark.parametrize("cores, count, bound", [(4, 4, [13, 14, 15, 16]), (4, 2, []), (2, 4, []), (1, 1, []), (8, 8, [])])
def test_only_as_many_as_there_are_cores_are_bound(monkeypatch, cores, count, bound):
    """Six threads are new: two that compile, four that work."""
    were: list[int] = []
    monkeypatch.setattr(placement, "_current", None)
    monkeypatch.setattr(placement, "running", lambda: {1, 2, 11, 12, 13, 14, 15, 16})
    monkeypatch.setattr(os, "sched_getaffinity", lambda thread: set(range(cores)), raising=False)
    monkeypatch.setattr(os, "sched_setaffinity", lambda thread, to: were.append(thread), raising=False)
    placement.place({1, 2}, count)
    assert were == bound
