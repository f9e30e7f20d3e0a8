"""Fields go back when nobody has what they were made for, closed or not: simulations and pictures made again take no more."""

import gc
import pathlib
import subprocess
import sys
import weakref

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import compiler, field_pool, runtime
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
import gc
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
