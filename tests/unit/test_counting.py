"""Launches, transfers and waits as they are counted, and sums as a device makes them."""

import math

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import counting, launches, runtime
from taichi_cloth.backend.counting import counted
from taichi_cloth.backend.fields import Fields
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read, write
from taichi_cloth.backend.sums import Sums
from taichi_cloth.solver.pcg import LONGEST, LOOK


@ti.data_oriented
class Table:
    """A few fields, and sums of some of their rows."""

    def __init__(self, n: int, count: int, width: int, device: bool) -> None:
        self.n, self.count, self.width = n, count, width
        self.fields = Fields(np.float64)
        self.sums = Sums(self.fields, n, width, device, count)
        self.reals, self.pairs = self.fields.real(n, data=np.arange(n) / 3), self.fields.real(n, 2)
        self.whole = self.fields.integer(n, data=np.arange(n))
        self.fields.allocate()

    @ti.kernel
    def add_up(self, given: ti.types.ndarray()) -> int:
        for at in range(self.count * self.n):
            if ti.static(self.width == 1):
                self.sums.of_piece[at] = given[at, 0]
            else:
                for c in ti.static(range(self.width)):
                    self.sums.of_piece[at][c] = given[at, c]
        self.sums.finish(self.count)
        return self.count


@pytest.mark.parametrize("n, width", [(1, 1), (5, 3), (1000, 2)])
def test_sums_of_groups_are_those_of_all(rng, n, width):
    runtime.start("cpu", "f64", 1)
    given = rng.integers(-99, 99, size=(2 * n, width)).astype(float)  # exact in any order
    for device in (False, True):
        table = Table(n, 2, width, device)
        assert table.sums.groups == (min(n, 128) if device else 1)
        table.add_up(given)
        assert (read(table.sums.all).reshape(2, width) == given.reshape(2, n, width).sum(axis=1)).all()
        table.fields.free()


def test_rows_are_handed_over_by_kernels_as_they_lie_in_memory(rng, monkeypatch):
    runtime.start("cpu", "f64", 1)
    table, some, out = Table(9, 1, 1, False), np.array([7, 0, 7]), {}
    pairs = rng.normal(size=(6, 2))
    for layout in ("cpu", "device"):
        monkeypatch.setattr(runtime, "direct", layout == "cpu")
        write(table.pairs, pairs if layout == "cpu" else -pairs)
        with counted() as counts:
            out[layout] = [read(f, which) for f in (table.reals, table.pairs, table.whole) for which in (None, some)]
        assert (counts.reads, counts.launches, counts.waits) == (6, 0, 6)
        assert counts.size == sum(a.nbytes for a in out[layout]) == 8 * 36 + 4 * 12
    for a, b, of_pairs in zip(out["cpu"], out["device"], [False, False, True, True, False, False]):
        assert a.dtype == b.dtype and a.shape == b.shape and (a == (-b if of_pairs else b)).all()
    table.fields.free()


def test_launches_are_counted_where_somebody_asks():
    runtime.start("cpu", "f64", 1)
    table, given, kernel = Table(5, 1, 1, False), np.ones((5, 1)), Table.add_up._primal

    def launch() -> None:
        """As kernels of the package are launched."""
        assert launches.of(kernel).launch((table, given), type(kernel).__call__) == 1

    launch()
    assert counting.now is None
    with counted() as outer:
        launch()
        with counted() as counts:
            for _ in range(3):
                launch()
            write(table.reals, np.zeros(2))
            assert table.reals[3] == 1.0
    assert counting.now is None and outer.launches == 1
    assert (counts.launches, counts.with_arrays, counts.arrays, counts.returned) == (3, 3, 3, 3)
    assert (counts.reads, counts.writes, counts.singles, counts.size) == (0, 1, 1, 3 * 40 + 16)
    assert counts.waits == 3 + 2 * 3 + 1 + 1 and counts.kernels == {"Table.add_up": 3}
    table.fields.free()


@pytest.mark.slow
def test_a_solve_on_a_device_waits_for_groups_of_iterations(monkeypatch):
    """Once where it takes as many as the solve before, every eighth where that took none; it takes as many iterations as
    one of a single launch. The residual of its answer comes with the last of these waits."""
    took, left = {}, []
    for layout in ("cpu", "device"):
        monkeypatch.setenv(runtime.LAYOUT, layout)
        scene = tc.Scene()
        cloth = scene.add_cloth(tc.grid(1.0, 9), tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100, 0.1), tc.Bend(5e-5)))
        scene.pin(cloth, ["top_left", "top_right"])
        sim = tc.Simulation(scene, h=1 / 100, cg_tol=1e-6, preconditioner="multilevel", integrator="backward_euler")
        sim.step()
        solver = sim.integrator.system.solver
        looks, steps = [], []
        for last in (0, None, 2 * LONGEST):
            solver.last = solver.last if last is None else last
            with counted() as counts:
                solution = solver.solve(1e-6, zero=True)
            looks.append(counts.kernels["PCG._went_f64"])
            steps.append(counts.kernels["PCG._step"])
            assert layout == "cpu" or (counts.with_arrays == 0 and counts.waits == looks[-1])
        took[layout], left = solution.iterations, left + [solution.residual]
        assert solution.status == "CONVERGED" and len(solver.residual_history()) == solution.iterations > 9
        sim.close()
    assert left[1] == pytest.approx(left[0], rel=1e-6)
    assert took["device"] == took["cpu"] and took["cpu"] % 8  # so that some that are launched have nothing to do
    eights = math.ceil(took["cpu"] / LOOK)
    assert looks[:2] == [eights + (took["cpu"] == LOOK * eights), 1] and took["cpu"] < LONGEST
    assert steps == [LOOK * eights, took["cpu"], LONGEST] and counts.kernels["PCG._check"] == 1


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["cpu", "device"])
def test_what_a_solve_leaves_is_summed_up_by_a_kernel(monkeypatch, layout):
    """The host gets one number. NumPy's norm of all of it would wake threads of BLAS, which go on spinning."""
    monkeypatch.setenv(runtime.LAYOUT, layout)
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 9), tc.Fabric(0.2, tc.Stretch(1000, 1.0), tc.Shear(100, 0.1), tc.Bend(5e-5)))
    scene.pin(cloth, ["top_left", "top_right"])
    sim = tc.Simulation(scene, h=1 / 100, cg_tol=1e-3, integrator="backward_euler")
    sim.step()
    system = sim.integrator.system
    with counted() as counts:
        left = system.left_undone()
    assert (counts.reads, counts.with_arrays, counts.waits) == (0, 0, 1)
    assert left == pytest.approx(math.sqrt(np.sum(read(system.solver.r) ** 2)), rel=1e-12) and left > 0
    some, mass, P = np.array([3, 40, 7]), sim.model.mass, read(system.operator.P)
    with counted() as counts:
        inertia = system.inertia(some)
    assert (counts.reads, counts.waits, counts.size) == (1, 1, 3 * 6 * 8)
    assert (inertia[some] == P[some][:, [0, 3, 5]].sum(axis=1) / 3).all() and (inertia[some] > 1.1 * mass[some]).all()
    assert (np.delete(inertia, some) == np.delete(mass, some)).all() and (system.inertia(some[:0]) == mass).all()
    sim.close()
