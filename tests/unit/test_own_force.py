"""A force with a state of its own, written here: the package rolls it back, resumes it and preconditions it, unchanged."""

import math

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read, write
from taichi_cloth.forces.bend import Bend
from taichi_cloth.forces.force import Force
from taichi_cloth.step.ledger import totals
from taichi_cloth.system.checkpoint import Checkpointed

FABRIC = tc.Fabric(0.2, tc.Stretch(500.0, k_d=0.5), tc.Shear(50.0), tc.Bend(3e-3))
CREEP = 3.0  # 1/s, at which a hinge's rest angle goes to the angle that it has
CELLS = 23  # 576 particles: enough for the multilevel preconditioner


@ti.data_oriented
class CreepingHinges(Bend):
    """Hinges whose rest angle goes to their angle: theta_0' = CREEP (theta - theta_0), after every accepted step."""

    def __init__(self, fields, model, scene, mode) -> None:
        super().__init__(fields, model, scene, mode)
        self.drift = model.remember("hinge_drift", self.elements.count)

    @ti.func
    def strain(self, e):
        C, C_dot, g_e, g_a, g_b = Bend.strain(self, e)
        return C - self.drift.now[e], C_dot, g_e, g_a, g_b

    @ti.kernel
    def creep(self, part: float):
        for e in range(self.elements.count):
            C, C_dot, g_e, g_a, g_b = self.strain(e)
            self.drift.now[e] += part * C

    def accept(self, h: float) -> bool:
        """The rest angle follows."""
        self.creep(1 - math.exp(-CREEP * h))
        return True


@ti.data_oriented
class Counter(Force, Checkpointed):
    """Does nothing, with a state of its own."""

    STATE = ("count",)

    def __init__(self, fields, model, scene, mode) -> None:
        self.count = 0

    def rounding_energy(self, d):
        return 0.0

    def build_stiffness(self):
        self.stiff = True

    @ti.func
    def add_force(self, block, f: ti.template()):
        pass

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        report[block, base] = 0
        report[block, base + 1] = 0

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        pass

    def build_levels(self, levels):
        pass

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        return D


class Other(Counter):
    """Another kind of the same."""


def test_names_of_the_last_release_are_read_with_a_warning():
    with pytest.warns(DeprecationWarning) as told:
        class Old(Counter):
            coupled = True

            def add_coupled(self, block, q):
                """A part of low rank."""

    assert [str(w.message).split(",")[0] for w in told] == ["Old: `coupled` is called `low_rank` now",
                                                             "Old: `add_coupled` is called `add_low_rank` now"]
    assert Old.low_rank and Old.does("add_low_rank") and not Counter.low_rank


def counting(*kinds) -> tc.Simulation:
    scene = tc.Scene()
    scene.add_cloth(tc.grid(0.3, 2), tc.Fabric(FABRIC.density, FABRIC.stretch))
    for kind in kinds:
        scene.add_force(kind)
    return tc.Simulation(scene, 1 / 60, integrator="verlet")


def test_each_force_keeps_a_state_of_its_own():
    """By its name and its place among those of the same: none takes the place of another, and none is lost."""
    with counting(Counter, Other, Counter) as sim:
        for force, count in zip(sim.force_terms[-3:], (3, 13, 23)):
            force.count = count
        state = {name: np.array(array) for name, array in sim.checkpoint().items()}
    with counting(Counter, Other, Counter) as sim:
        sim.resume(state)
        assert [force.count for force in sim.force_terms[-3:]] == [3, 13, 23]
        old = {k: a for k, a in state.items() if not k.startswith("force.")} | {"gas.count": np.array(3)}
        with pytest.raises(tc.SceneError, match="state of one force only, and this scene has 3"):
            sim.resume({**old, "version": np.array(11)})
    with counting(Counter) as sim:
        with pytest.raises(tc.SceneError, match="has force.Other.0.count, force.Counter.1.count, of which this scene"):
            sim.resume(state)
        sim.resume({**old, "version": np.array(11)})
        assert sim.force_terms[-1].count == 3


def make(**options) -> tc.Simulation:
    """A strip held at one end that sags; its hinges creep."""
    scene, mesh = tc.Scene(), tc.grid((0.3, 0.3), CELLS)
    cloth = scene.add_cloth(mesh, tc.Fabric(FABRIC.density, FABRIC.stretch, FABRIC.shear))
    scene.pin(cloth, "left")
    scene.add_force(lambda fields, model, scene, K: CreepingHinges(fields, model, bent(scene), K))
    return tc.Simulation(scene, 1 / 60, threads=1, **options)


def bent(scene: tc.Scene) -> tc.Scene:
    """The same cloth with bending, of which the simulation itself makes no hinges."""
    copy = tc.Scene()
    for cloth in scene.cloths:
        copy.add_cloth(cloth.mesh, FABRIC)
    return copy


@pytest.fixture(scope="module")
def sim():
    made = make()
    yield made
    made.close()


def drift(sim: tc.Simulation) -> np.ndarray:
    return read(sim.model.remembered["hinge_drift"].now)


@pytest.mark.slow
def test_it_acts_and_its_part_of_the_levels_is_there(sim):
    """The block of a node is s^T A s, summed over what its hat meets, hinges included."""
    before = drift(sim)
    assert not before.any()
    for _ in range(4):
        sim.step()
    assert np.abs(drift(sim)).max() > 1e-3 and sim.energy()["bend"] > 0
    levels = sim.integrator.system.preconditioner
    force = next(f for f in levels.forces if isinstance(f, CreepingHinges))
    assert read(force.bent)[:, 0].min() > 0
    h = 1 / 60
    sim._linearized(h)
    levels.make(h, None)
    whole = np.trace(np.linalg.inv(six(read(levels.inverse_l))), axis1=1, axis2=2)
    k = read(force.bent).copy()
    force.bent.fill(0)
    levels.make(h, None)
    without = np.trace(np.linalg.inv(six(read(levels.inverse_l))), axis1=1, axis2=2)
    write(force.bent, k)
    assert whole - without == pytest.approx(3 * h * h * k[:, 0] + 3 * h * k[:, 1], rel=1e-3)


def six(rows: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of rows xx xy xz yy yz zz."""
    return rows[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def test_a_rejected_step_leaves_it_as_it_was(sim, monkeypatch):
    """Even where the force changes while a step is tried."""
    before, attempt = drift(sim), sim.integrator.attempt
    tried = []

    def meddling(h, held_at, start):
        out = attempt(h, held_at, start)
        tried.append(drift(sim).copy())
        if len(tried) == 1:
            next(f for f in sim.force_terms if isinstance(f, CreepingHinges)).creep(0.5)
            return type(out)("ENERGY", "made up", out.measures, out.solutions, out.seconds)
        return out

    monkeypatch.setattr(sim.integrator, "attempt", meddling)
    record = sim.stepper.step(sim.time, 1 / 60, sim.prescribed.at)
    assert record.rejections == {"ENERGY": 1} and len(tried) == 2
    assert (tried[0] == before).all() and (tried[1] == before).all() and (drift(sim) != before).any()


@pytest.mark.slow
def test_it_is_resumed_bit_for_bit(sim):
    state = {name: np.array(array) for name, array in sim.checkpoint().items()}
    other = make()
    other.resume(state)
    for _ in range(3):
        sim.step()
        other.step()
    assert (sim.positions() == other.positions()).all() and (drift(sim) == drift(other)).all()
    with pytest.raises(tc.SceneError, match="hinge_drift"):
        other.resume({name: array for name, array in state.items() if "drift" not in name})
    state["particles.state_hinge_drift"] = state["particles.state_hinge_drift"] * np.nan
    with pytest.raises(tc.SceneError, match="hinge_drift is not finite"):
        other.resume(state)
    other.close()


def test_a_force_that_lacks_a_part_is_not_made():
    """Every part of the system asks for what the contract names; a force without it cannot be built, by name."""
    wanted = {"rounding_energy", "build_stiffness", "add_force", "evaluate", "add_product", "build_levels", "add_level_block"}
    assert Force.__abstractmethods__ == wanted
    for name in wanted:
        parts = {other: (lambda self, *_: None) for other in wanted - {name}}
        with pytest.raises(TypeError, match=name):
            type("Half", (Force,), parts)()


def test_energy_gone_by_creep_is_the_forces_own(sim):
    """What is stored is measured after the rest angles moved; what they took stands in the ledger by itself."""
    for _ in range(3):
        before, first = sum(sim.energy().values()), len(sim.log)
        record = sim.step()  # in smaller ones, where another test had one rejected
        row, after = totals([r.ledger for r in sim.log[first:]]), sum(sim.energy().values())
        assert abs(row["unaccounted"]) < 0.05 * sum(abs(e) for e in record.energies.values())
        assert row["kinetic"] + row["potential"] == pytest.approx(after - before, abs=1e-12) and row["plastic"] > 0
        assert sum(record.energies.values()) == pytest.approx(after, abs=1e-14)
