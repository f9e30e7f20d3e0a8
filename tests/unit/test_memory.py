"""Fields go back when nobody has what they were made for, closed or not: simulations and pictures made again take no more."""

import ctypes
import gc
import mmap
import os
import pathlib
import subprocess
import sys
import weakref

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import compiler, field_pool, pages, rows, runtime
from taichi_cloth.backend import fields as fields_module
from taichi_cloth.backend.fields import Fields

pytestmark = pytest.mark.restarts
[impl] = compiler.private("lang.impl")


def trees() -> int:
    """How many of Taichi's trees of fields there are; a place that one left is taken by the next."""
    return impl.get_runtime().prog.get_snode_tree_size()


def held() -> list[int]:
    """Bytes of what somebody uses in the pool."""
    return [tree.bytes for tree in field_pool._trees if tree.used]


@pytest.fixture
def scene():
    gc.collect()
    field_pool.trim(0)
    made = tc.Scene()
    sheet = made.add_cloth(tc.grid(0.5, 5), tc.Fabric(0.2, tc.Stretch(100)))
    made.pin(sheet, "top")
    return made


@pytest.mark.slow
def test_a_simulation_that_nobody_names_gives_its_fields_back(scene):
    seen, made = [], []
    for _ in range(5):
        sim = tc.Simulation(scene, h=1 / 60, integrator="verlet")  # the one before lives until this one is there
        sim.run(0.1, fps=30)
        gc.collect()
        made.append(weakref.ref(sim))
        seen.append((trees(), held()))
    assert seen[1:] == [seen[1]] * 4 and len(seen[0][1]) >= 1
    assert [ref() is sim for ref in made] == [False] * 4 + [True]
    del sim
    gc.collect()
    assert made[-1]() is None and not held() and not len(scene.followers)


@pytest.mark.slow
def test_pictures_leave_nothing(scene):
    with tc.Simulation(scene, h=1 / 60, integrator="verlet") as sim:
        before = held()
        for quality in ("fast", "standard"):
            seen = []
            for _ in range(5):
                tc.render(sim, size=(48, 36), quality=quality)
                tc.passes(sim, size=(48, 36))
                gc.collect()  # what Taichi compiled a kernel for stays until then
                seen.append(trees())
            assert seen[2:] == [seen[1]] * 3 and held() == before


def test_fields_that_no_other_may_have_go_too():
    runtime.start("cpu", "f64")

    def make():
        fields = Fields(np.float32)
        fields.real(100, 3)
        fields.allocate()
        return fields, trees()

    keep, first = make()
    assert [make()[1] for _ in range(4)] == [first + 1] * 4
    assert len(field_pool._dropped) == 1
    field_pool.trim()
    assert not field_pool._dropped
    make()
    runtime.start("cpu", "f32")  # they are dead, and not given back a second time
    del keep
    assert not field_pool._dropped


RESTARTS = """
import ctypes
import gc
import mmap
import os
import pathlib
import subprocess
import sys
import threading
import taichi_cloth as tc

started = []
usual = threading.Thread.start
threading.Thread.start = lambda thread: (started.append(thread), usual(thread))

def status():
    rows = dict(line.split(":", 1) for line in open("/proc/self/status") if ":" in line)
    return int(rows["Threads"]), int(rows["VmRSS"].split()[0])

for k in range(8):
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.5, 2), tc.Fabric(0.2, tc.Stretch(500)))
    with tc.Simulation(scene, precision="f32" if k % 2 else "f64", integrator="verlet") as sim:
        sim.positions()
    del sim
    gc.collect()
    print(*status())
print(started)
"""


@pytest.mark.slow
def test_another_precision_leaves_no_threads_and_no_memory(tmp_path):
    """Each start of Taichi left six threads and 9 MB: what it was started for before was still known. One more, for some
    milliseconds or as long as a server does not answer, asked for a newer Taichi."""
    if not pathlib.Path("/proc/self/status").exists():
        pytest.skip("this system does not say how many threads a process has")
    script = tmp_path / "restarts.py"
    script.write_text(RESTARTS)
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=True, timeout=300)
    threads, kilobytes = np.array([row.split() for row in done.stdout.splitlines() if row[0].isdigit()], dtype=int).T
    assert done.stdout.splitlines()[-1] == "[]"  # threads of Python's
    assert len(threads) == 8 and (threads[1:] == threads[1]).all()
    assert kilobytes[-1] - kilobytes[2] < 5 * 2000


def in_memory(numbers: np.ndarray) -> int:
    """Bytes of the pages of numbers that are in memory."""
    first = numbers.ctypes.data // mmap.PAGESIZE * mmap.PAGESIZE
    size = numbers.ctypes.data + numbers.nbytes - first
    flags = (ctypes.c_ubyte * (size // mmap.PAGESIZE + 1))()
    assert ctypes.CDLL(None).mincore(ctypes.c_void_p(first), ctypes.c_size_t(size), flags) == 0
    return sum(flag & 1 for flag in flags) * mmap.PAGESIZE


@pytest.mark.skipif(not pages.GIVES_BACK, reason="pages are given back on Linux")
def test_rows_without_numbers_take_no_memory():
    runtime.start("cpu", "f64")
    fields, n = Fields(np.float64), (1 << 18) + 1
    few, none = fields.real(n, 6, np.ones((n, 6))), fields.real(n, 6)
    fields.allocate()
    used, edges = n * 6 * 8, 4 * mmap.PAGESIZE
    assert fields.room(n) * 6 * 8 > 1.9 * used
    assert used <= in_memory(rows.numbers(few)) <= used + edges and in_memory(rows.numbers(none)) <= edges
    assert (rows.numbers(few)[:n] == 1).all() and not rows.numbers(few)[n:].any() and not rows.numbers(none).any()
    rows.numbers(none)[...] = 2
    assert in_memory(rows.numbers(none)) >= rows.numbers(none).nbytes and (rows.numbers(none) == 2).all()
    fields.free()


@pytest.mark.skipif(not pages.GIVES_BACK, reason="pages are given back on Linux")
def test_lists_that_rest_take_no_memory():
    """Where they are long; short ones stay as they are."""
    width = rows.RESTING // 8 // (1 << 16)
    long, short = rows.Lists(2, 1 << 16, [(width, np.float64)]), rows.Lists(2, 8, [(width, np.float64)])
    for lists in (long, short):
        lists.count[:] = lists.arrays[0].shape[1]
        lists.arrays[0][...] = 3.0
        lists.rest()
    assert in_memory(long.arrays[0]) <= 4 * mmap.PAGESIZE and not long.arrays[0].any()
    assert (short.arrays[0] == 3).all()


SPARE = """
import numpy as np
from taichi_cloth.backend import pages
print(int(pages.map_large_arrays()))
resident = lambda: int(open("/proc/self/statm").read().split()[1]) * pages.mmap.PAGESIZE
before, rows = resident(), [np.ones(1 << 19) for _ in range(12)]  # 4 MB each
last = rows[-1]
del rows
print((resident() - before) >> 20)
"""


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt") or not pages.GIVES_BACK, reason="glibc alone has the option")
def test_memory_of_large_arrays_goes_back_with_them():
    """One of twelve is left; where the environment says how memory is kept, all of it stays."""
    for more, told, least, most in (({}, 1, 3, 8), ({"MALLOC_MMAP_THRESHOLD_": str(1 << 25)}, 0, 40, 60)):
        done = subprocess.run([sys.executable, "-c", SPARE], capture_output=True, text=True, check=True,
                              env={k: v for k, v in os.environ.items() if k not in pages.SET_BY_USER} | more)  # Dask sets one
        set_here, megabytes = map(int, done.stdout.split())
        assert set_here == told and least <= megabytes <= most


def test_numbers_are_cleared_to_their_ends():
    numbers = np.ones((1 << 15) + 5)
    assert pages.clear(numbers[3:-2]) == 0 if not pages.GIVES_BACK else 0 < pages.clear(numbers[3:-2]) < 8 * (1 << 15)
    assert (numbers[:3] == 1).all() and (numbers[-2:] == 1).all() and not numbers[3:-2].any()


def test_many_fields_are_allocated_and_filled_before_the_last_is_declared(monkeypatch):
    runtime.start("cpu", "f64")
    monkeypatch.setattr(fields_module, "TREE", 60_000)
    fields = Fields(np.float64, pooled=True)
    data = np.random.default_rng(5).normal(size=(1000, 3))
    made = [fields.real(1000, 3, k + data) for k in range(5)] + [fields.integer(1000, 3, 10 * data + k) for k in range(4)]
    assert len(fields._lease.trees) == 4 and len(fields._reals + fields._integers) == 1
    fields.allocate()
    for k in range(5):
        assert (rows.read(made[k]) == k + data).all()
    for k in range(4):
        assert (rows.read(made[5 + k]) == (10 * data + k).astype(np.int32)).all()
    fields.free()
