"""A kernel that is launched the short way does what Taichi's own launch does, and is told from others in the same way."""

import gc

import numpy as np
import pytest

from taichi_cloth.backend import launches, runtime, shared_kernels, taichi_patches
from taichi_cloth.backend.language import ti
from taichi_cloth.system.state import ParticleState

pytestmark = pytest.mark.restarts


@ti.data_oriented
class Sums:
    """Kernels with arguments of all kinds."""

    def __init__(self, factor: float) -> None:
        self.factor = factor

    @ti.kernel
    def add(self, a: ti.types.ndarray(), k: int, x: float, out: ti.types.ndarray()):
        for i in range(a.shape[0]):
            out[i] = self.factor * a[i] + k * x

    @ti.kernel
    def total(self, a: ti.types.ndarray(), k: int) -> float:
        out = 0.0
        for i in range(a.shape[0]):
            out += a[i]
        return out + k

    @ti.kernel
    def both(self, x: float) -> ti.types.vector(2, float):
        return ti.Vector([x, self.factor])

    @ti.kernel
    def turned(self, m: ti.types.matrix(2, 2, float)) -> float:
        return m[0, 1]


@pytest.fixture
def slow(monkeypatch):
    """Counts launches that went Taichi's way; a function that launches a kernel of `Sums` as our own are."""
    runtime.start("cpu", "f64", 1)
    count = [0]

    def taken(kernel, *args):
        count[0] += 1
        return original(kernel, *args)

    original = type(Sums.add._primal).__call__

    def launch(owner, name, *args):
        return launches.of(getattr(Sums, name)._primal).launch((owner, *args), taken)

    return count, launch


def test_results_are_taichis(slow):
    count, launch = slow
    a, twice, thrice, out = np.arange(5.0), Sums(2.0), Sums(3.0), np.zeros(5)
    for k in range(3):
        for owner in (twice, thrice):
            launch(owner, "add", a + k, k, 0.5, out)
            assert np.array_equal(out, owner.factor * (a + k) + k * 0.5)
            assert launch(owner, "total", a + k, k) == (a + k).sum() + k
            assert launch(owner, "both", 7.0 + k).to_list() == [7.0 + k, owner.factor]
    assert count[0] == 6  # once for each owner and kernel
    assert launch(twice, "total", np.float64([1.0, 2.0]), np.int64(3)) == 6.0 and count[0] == 6


def test_arrays_of_a_device_are_handed_over_as_they_are(slow):
    """Arrays of numpy beside them, others of another type, others of the same after them."""
    count, launch = slow
    owner, a, out = Sums(2.0), ti.ndarray(ti.f64, 5), ti.ndarray(ti.f64, 5)
    a.from_numpy(np.arange(5.0))
    for k in range(3):
        launch(owner, "add", a, k, 0.5, out)
        assert np.array_equal(out.to_numpy(), 2 * np.arange(5.0) + k * 0.5) and count[0] == 1
    on_host = np.zeros(5)
    for k in range(2):
        launch(owner, "add", a, k, 0.5, on_host)
        assert np.array_equal(on_host, 2 * np.arange(5.0) + k * 0.5) and count[0] == 2
    whole = ti.ndarray(ti.i32, 7)
    whole.from_numpy(np.arange(7, dtype=np.int32))
    for k in range(2):
        assert launch(owner, "total", whole, k) == 21 + k and launch(owner, "total", a, k) == 10 + k
    assert count[0] == 4


def test_what_differs_is_compiled_anew(slow):
    count, launch = slow
    owner, a, out = Sums(2.0), np.arange(6.0), np.zeros(6)
    launch(owner, "add", a, 0, 0.0, out)
    launch(owner, "add", a.astype(np.float32), 0, 0.0, out)  # another type
    assert count[0] == 2 and np.array_equal(out, 2 * a)
    launch(owner, "add", a.astype(np.float32) + 1, 0, 0.0, out)
    assert count[0] == 2 and np.array_equal(out, 2 * (a + 1))
    with pytest.raises(Exception, match="(?i)dim|index|argument"):
        launch(owner, "add", a.reshape(2, 3), 0, 0.0, out)


def test_what_is_not_plain_goes_taichis_way(slow):
    count, launch = slow
    owner, a, out = Sums(2.0), np.arange(12.0).reshape(2, 6), np.zeros(6)
    launch(owner, "total", np.zeros(3), 0)
    launch(owner, "total", np.zeros(3), 0)
    assert count[0] == 1
    with pytest.raises(ValueError, match="contiguous"):
        launch(owner, "total", a[0, ::2], 0)
    with pytest.raises((ti.TaichiRuntimeTypeError, AttributeError)):  # as Taichi says it
        launch(owner, "total", np.zeros(3), 0.5)
    with pytest.raises((ti.TaichiRuntimeTypeError, AttributeError)):  # as Taichi says it
        launch(owner, "add", np.zeros(3), 0, "x", out)
    with pytest.raises(Exception, match="(?i)argument|missing"):
        launch(owner, "total", np.zeros(3))
    for _ in range(2):
        assert launch(owner, "turned", ti.Matrix([[1.0, 5.0], [2.0, 3.0]])) == 5.0
    assert count[0] == 7


def test_nothing_is_launched_that_was_compiled_before_a_start_or_for_other_fields(slow):
    count, launch = slow
    owner, a = Sums(2.0), np.ones(3)
    launch(owner, "total", a, 0)
    ti.init(ti.cpu, default_fp=ti.f64, log_level=ti.ERROR)
    assert launch(owner, "total", a, 1) == 4.0 and count[0] == 2
    runtime.start("cpu", "f32", 1)
    assert launch(owner, "total", a, 2) == 5.0 and launch(owner, "total", a, 3) == 6.0 and count[0] == 3
    launches.of(Sums.total._primal).forget()
    assert launch(owner, "total", a, 2) == 5.0 and count[0] == 4


def test_an_owner_that_is_gone_is_not_mistaken(slow):
    count, launch = slow
    for k in range(12):  # new ones get addresses of old ones
        assert launch(Sums(float(k)), "both", 1.0).to_list() == [1.0, float(k)]
        gc.collect()
    assert count[0] == 12


def test_our_own_kernels_are_launched_so(monkeypatch):
    assert taichi_patches.WANTED
    made = []
    monkeypatch.setattr(launches.Launcher, "launch", lambda self, args, slow: made.append(self.kernel.func.__name__))
    ParticleState._save._primal(object())
    assert made == ["_save"]
    launcher = launches.of(ParticleState._save._primal)
    launcher._known[()] = ()
    shared_kernels.look_again()
    assert not launcher._known
