"""A further simulation of the same make in a process compiles nothing, open or closed, and goes as it would alone."""

import gc
import os
import subprocess
import sys

import numpy as np
import pytest

from taichi_cloth.backend import compiler, field_pool, runtime, shared_kernels
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read, write

pytestmark = pytest.mark.restarts
[kernel_impl] = compiler.private("lang.kernel_impl")

CODE = """
import sys, numpy as np
import taichi_cloth as tc

def build(n, part, bend=True):
    mesh, air = tc.grid(0.5, n), tc.Air(0.1 * part, 0.02 * part, wind=(part, 0, 0))
    scene = tc.Scene(gravity=(0, -9.81 * part, 0), air=air)
    fabric = tc.Fabric(0.2 * part, tc.Stretch(1000 * part, part), tc.Shear(100 * part), tc.Bend(5e-5 * part) if bend else None)
    contact = tc.ClothContact(0.004 * part, 0.3 * part)
    cloth = scene.add_cloth(mesh, fabric, positions=mesh.x + [0, 0.01 * part, 0], contact=contact)
    scene.pin(cloth, "top_left")
    scene.add_solid(tc.Box((0.2 * part, 0.1, 0.2)), position=(0.25, -0.06, -0.25), friction=0.3 * part,
                    thickness=0.005 * part)
    return scene

def run(n, part, bend=True):
    sim = tc.Simulation(build(n, part, bend), h=part / 60, threads=1)
    for _ in range(6):
        sim.step()
    assert max(r.contacts for r in sim.log) > 0
    return sim
"""


class Compiled:
    """Names of the kernels of which Taichi reads the source."""

    def __init__(self, monkeypatch) -> None:
        self.names: list[str] = []
        read = kernel_impl._get_tree_and_ctx

        def noted(function, *args, **kwargs):
            if isinstance(function, kernel_impl.Kernel):
                self.names.append(function.func.__name__)
            return read(function, *args, **kwargs)

        monkeypatch.setattr(kernel_impl, "_get_tree_and_ctx", noted)

    def new(self) -> set[str]:
        """Names since the last call; without the one that finds the address of a tree of fields, once."""
        names, self.names = set(self.names), []
        return names - {"_address"}


def in_another_process(folder, n: int, part: float) -> tuple[np.ndarray, int]:
    """Positions at the end, with kernels as they are shipped, and how many of them are in Taichi's cache then."""
    (folder / "run.py").write_text(CODE + "np.save(sys.argv[3], run(int(sys.argv[1]), float(sys.argv[2])).positions())")
    shipped = {**os.environ, "TI_OPT_LEVEL": "1", "TI_OFFLINE_CACHE_FILE_PATH": str(folder / "cache")}  # tests have 0
    words = [sys.executable, folder / "run.py", n, part, folder / "x.npy"]
    subprocess.run([str(word) for word in words], check=True, env=shipped)
    return np.load(folder / "x.npy"), sum(1 for _ in (folder / "cache").rglob("*.tic"))


@pytest.mark.slow
def test_another_mesh_and_other_numbers_compile_nothing_and_go_as_alone(monkeypatch, tmp_path):
    """Another fabric, air, thickness and step too: in a further process, by Taichi's cache, and in the same."""
    _, compiled_once = in_another_process(tmp_path, 8, 1.0)
    alone, compiled_in_all = in_another_process(tmp_path, 11, 1.1)
    assert compiled_in_all == compiled_once > 20
    here: dict = {}
    exec(CODE, here)
    compiled = Compiled(monkeypatch)
    gc.collect()
    field_pool.trim(0)  # of what tests before this one left
    sim = here["run"](9, 1.0)
    assert len(compiled.new()) > 20
    sim.close()
    sim = here["run"](11, 1.1)
    assert not compiled.new()
    assert np.array_equal(sim.positions(), alone)
    sim = None  # not closed, and what it holds goes in a circle
    gc.collect()
    sim = here["run"](8, 0.9)
    assert not compiled.new()
    sim.close()
    with here["run"](9, 1.0), here["run"](8, 0.9, bend=False):  # of another make: what it has not in common is compiled
        assert "_together" in (new := compiled.new()) and len(new) < 5
    with here["run"](9, 1.0, bend=False), here["run"](9, 1.0):  # whichever is opened first
        assert not compiled.new()


@pytest.mark.slow
def test_simulations_that_are_open_at_a_time_compile_once_and_go_as_alone(monkeypatch):
    here: dict = {}
    exec(CODE, here)
    makes = [(9, 1.0), (10, 1.1), (8, 0.9), (11, 1.0)]
    alone = []
    for make in makes:
        with here["run"](*make) as sim:
            for _ in range(4):
                sim.run(1 / 60, fps=60)
            alone.append((sim.positions(), sim.velocities(), sim.energy(), sim.checkpoint()))
    compiled = Compiled(monkeypatch)
    sims = [here["run"](*make) for make in makes]
    first = sims[0].model, sims[0].contacts  # held while others go on
    before = [sim.positions() for sim in sims]
    for frame in range(1, 5):
        for sim in sims[::-1] if frame % 2 else sims:
            sim.run(1 / 60, fps=60)
    assert not compiled.new() and not any(np.array_equal(a, sim.positions()) for a, sim in zip(before, sims))
    for sim, (x, v, energy, state) in zip(sims, alone):
        assert np.array_equal(sim.positions(), x) and np.array_equal(sim.velocities(), v) and sim.energy() == energy
        there = sim.checkpoint()
        assert all(np.array_equal(there[name], value) for name, value in state.items() if name != "time")
    assert np.array_equal(first[0].checkpoint()["x"], alone[0][3]["particles.x"]) and first[1] is sims[0].contacts
    sims.pop(1).close()
    del sim, sims[1]  # one closed, one that nobody names
    gc.collect()
    with here["run"](9, 1.0) as again:
        sims[1].step()
        for _ in range(4):
            again.run(1 / 60, fps=60)
        assert np.array_equal(again.positions(), alone[0][0]) and not compiled.new()


@pytest.fixture
def fields():
    """Makes a few fields, the first with numbers; width of the last."""
    from taichi_cloth.backend.fields import Fields

    runtime.start("cpu", "f32", 1)
    runtime.start("cpu", "f64", 1)
    assert not field_pool.holds()

    def make(n, width=3, pooled=True):
        fields = Fields(np.float64, pooled=pooled)
        made = fields.real(n, 2, np.arange(2 * n)), fields.integer(n), fields.scratch(n, 4), fields.real(n, width)
        fields.allocate()
        return fields, made

    yield make
    field_pool.trim(0)
    assert not field_pool.holds()


def same(first, second) -> list[bool]:
    return [a is b for a, b in zip(first, second)]


def test_fields_come_again_and_are_zero(fields):
    held, first = fields(7)
    for field in first:
        field.fill(3)
    held.free()
    held, second = fields(9)
    assert same(first, second) == [True] * 4
    assert np.array_equal(second[0].to_numpy()[:9].ravel(), np.arange(18)) and second[0].rows == 9
    assert not any(field.to_numpy().any() for field in second[1:]) and not second[0].to_numpy()[9:].any()
    other, third = fields(9)  # while the others live
    assert same(second, third) == [False] * 4
    other.free()
    held.free()
    held, fourth = fields(9, width=2)  # the last is new
    assert same(second, fourth) == [True, True, True, False] and fourth[3].n == 2
    fourth[3].fill(5)
    held.free()
    held, fifth = fields(4, width=2)
    assert same(fourth, fifth) == [True] * 4 and not fifth[3].to_numpy().any()
    held.free()
    held, sixth = fields(9)  # what was left out by the fourth is still there
    assert same(second, sixth) == [True] * 4
    held.free()
    held, seventh = fields(9, pooled=False)
    assert not any(any(same(seventh, others)) for others in (third, fourth, sixth))
    held.free()


def test_fields_that_are_open_at_a_time_keep_their_numbers(fields):
    """Read from memory, by Taichi's own kernels and by the package's, while others with the same memory change theirs."""
    sets = [fields(6 + k) for k in range(4)]
    assert len({made[0].share.slot for _, made in sets}) == 1
    for k, (_, made) in enumerate(sets):
        made[3].fill(k + 1)
        write(made[1], np.arange(3) + 10 * k)
    for k in (2, 0, 3, 1, 0):
        made = sets[k][1]
        assert np.array_equal(made[0].to_numpy()[:6 + k].ravel(), np.arange(12 + 2 * k))
        assert (made[3].to_numpy()[:6 + k] == k + 1).all() and np.array_equal(read(made[1])[:3], np.arange(3) + 10 * k)
        assert total(made[3], 6 + k) == (6 + k) * (k + 1)
        assert sets[k - 1][1][3][2].x == (k - 1) % 4 + 1 and made[1][2] == 10 * k + 2  # one row, from Python
        made[1][3] = k
    sets[1][0].free()
    sets.pop(1)
    for k, (held, made) in zip((0, 2, 3), sets):
        assert (read(made[3]) == k + 1).all() and read(made[1])[3] == k and len(read(made[1])) == 6 + k
        held.free()
    assert not any(slot.used for slot in field_pool._slots.values())


@ti.data_oriented
class Others:
    """A class of a user's, with fields where the package does not look for them."""

    def __init__(self, held, made) -> None:
        self.inner, self.some, self.named, self.held = Inner(made[3]), [made[1]], {"pairs": made[0]}, held

    @ti.kernel
    def sum(self) -> float:
        out = 0.0
        for j in self.some[0]:
            out += self.some[0][j]
        for j in range(4):
            out += self.inner.value[j].y + self.named["pairs"][j].x
        return out


def test_kernels_of_users_see_the_numbers_of_their_own_simulation(fields):
    owners = []
    for k in range(3):
        held, made = fields(9)
        write(made[1], np.array([k]))
        made[3].fill(10.0 * k)
        owners.append(Others(held, made))
    assert [owner.sum() for owner in owners] == [2 * (0 + 1 + 2 + 3) + 41.0 * k for k in range(3)]
    assert [owner.sum() for owner in owners[::-1]] == [2 * (0 + 1 + 2 + 3) + 41.0 * k for k in (2, 1, 0)]
    by_closure = [around(owner.some[0]) for owner in owners]
    assert [read_first() for read_first in by_closure] == [0, 1, 2] and by_closure[0]() == 0
    for owner in owners:
        owner.held.free()


def around(field):
    """A kernel that finds a field outside of itself."""

    @ti.kernel
    def first() -> int:
        return field[0]

    return first


@ti.kernel
def total(of: ti.template(), rows: int) -> float:
    out = 0.0
    for j in range(rows):
        out += of[j].x
    return out


def test_memory_is_filled_as_kernels_fill_it(fields, monkeypatch):
    """As on a device: reals and integers, vectors and numbers, in both precisions."""
    from taichi_cloth.backend.fields import Fields
    numbers, whole = np.random.default_rng(3).normal(size=(50, 3)), np.arange(40)
    for precision in ("f64", "f32"):
        runtime.start("cpu", precision, 1)
        made = []
        for straight in (True, False):
            monkeypatch.setattr(runtime, "on_cpu", lambda straight=straight: straight)
            monkeypatch.setattr(runtime, "direct", straight)
            held = Fields(np.float64)
            some = (held.real(50, 3, numbers), held.integer(40, 1, whole), held.real(150, 1, numbers),
                    held.integer(20, 2, whole), held.real(7, 2))
            held.allocate()
            made.append([field.to_numpy() for field in some])
            write(some[0], 2 * numbers[:20])  # the first rows alone
            write(some[1], whole[::-1])
            rows, there = read(some[0]), read(some[1], np.array([3, 0, 39]))
            assert np.array_equal(rows, np.concatenate([2 * numbers[:20], numbers[20:]]).astype(rows.dtype))
            assert np.array_equal(there, [36, 39, 0]) and read(some[2]).shape == (150,) and read(some[3]).shape == (20, 2)
            rows[:] = 0  # a copy
            assert read(some[0]).any() and not some[0].to_numpy()[50:].any()
            held.free()
        assert all(np.array_equal(a, b) for a, b in zip(*made)) and not made[0][4].any()
        assert np.array_equal(made[0][0][:50], numbers.astype(made[0][0].dtype)) and np.array_equal(made[0][1][:40], whole)
        assert np.array_equal(made[0][2][:150], made[0][0][:50].ravel()) and np.array_equal(made[0][3][:20].ravel(), whole)


def test_the_pool_is_bounded(fields):
    sets = [fields(300_000 * (k + 1)) for k in range(3)]
    sizes = [tree.bytes for tree in field_pool._trees]  # two each: what is aside has one of its own
    assert len(sizes) == 6 and sizes[0] + sizes[1] > 300_000 * (2 + 4 + 3) * 8
    for held, _ in sets:
        held.free()
    field_pool.trim(sum(sizes[2:]))
    assert len(field_pool._trees) == 4
    held, made = fields(300_000)
    assert not any(same(made, sets[0][1]))  # the oldest is gone
    held, made = fields(600_000)
    assert all(same(made, sets[1][1]))
    field_pool.trim(0)
    assert field_pool.holds() and np.array_equal(made[0].to_numpy()[:2], [[0, 1], [2, 3]])  # what is used stays
    held.free()
    gc.collect()
    field_pool.trim(0)
    for width in range(3, 8):
        held, _ = fields(5, width=width)
        held.free()
    assert len(field_pool._trees) == 2 + 4  # the first whole, of the others the last field
    field_pool.trim(trees=3)
    assert len(field_pool._trees) == 3


def test_what_was_declared_and_not_allocated_leaves_nothing(fields):
    from taichi_cloth.backend.fields import Fields

    held, first = fields(5)
    held.free()
    for extra in (False, True):
        broken = Fields(np.float64, pooled=True)
        broken.real(5, 2)
        if extra:
            broken.real(5, 3)
        broken.free()
    held, second = fields(5)
    assert same(first, second) == [True] * 4
    held.free()


def test_fields_from_before_a_new_start_are_not_used_again(fields):
    held, _ = fields(5)
    runtime.start("cpu", "f32", 1)
    del held
    gc.collect()
    assert not field_pool.holds()


@ti.data_oriented
class Inner:
    def __init__(self, value) -> None:
        self.value = value

    def plain(self):
        return self.value


def peek(inner) -> float:
    return inner.value


@ti.data_oriented
class Outer:
    def __init__(self, value=2, terms=(1, 2), unread=0, field=None) -> None:
        self.inner, self.terms, self.unread, self.out = Inner(value), terms, unread, field
        self.again, self.array = self.inner, np.array([value])

    @ti.kernel
    def sum(self) -> float:
        total = 0.0
        for k in ti.static(range(len(self.terms))):
            total += self.terms[k] * self.inner.value
        self.out[0] = total
        return total + self.again.value

    @ti.kernel
    def opaque(self) -> float:
        return ti.static(self.array[0])

    @ti.kernel
    def method(self) -> float:
        return ti.static(self.inner.plain())

    @ti.kernel
    def function(self) -> float:
        return ti.static(peek(self.inner))


def test_kernels_are_shared_where_they_read_the_same_and_only_there(monkeypatch):
    runtime.start("cpu", "f64", 1)
    monkeypatch.setattr(shared_kernels, "PACKAGE", __name__.split(".")[0])
    compiled = Compiled(monkeypatch)
    a, b = ti.field(float, 3), ti.field(float, 3)

    def added(thing, kernel="sum") -> tuple[int, float]:
        value = getattr(thing, kernel)()
        return len(compiled.new()), value

    assert added(Outer(field=a)) == (1, 8)
    assert added(Outer(field=a, unread=5)) == (0, 8)
    assert added(Outer(field=b)) == (1, 8) and b[0] == 6
    assert added(Outer(3, field=a)) == (1, 12)
    assert added(Outer(field=a, terms=(1, 3))) == (1, 10)
    assert added(Outer(field=a, terms=(1, 2, 0))) == (1, 8)
    assert added(Outer(2.0, field=a)) == (1, 8)  # another type
    thing = Outer(field=a)
    thing.again = Inner(2)  # two that were one: a kernel may have read either by the other's name
    assert added(thing) == (1, 8)
    assert added(Outer(field=a)) == (0, 8)
    for kernel in ("opaque", "method", "function"):  # what is read cannot be seen
        assert added(Outer(2), kernel) == (1, 2) and added(Outer(4), kernel) == (1, 4)
        assert added(Outer(2), kernel) == (1, 2)
