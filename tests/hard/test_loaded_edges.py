"""Cloth that is pulled hard over edges of solids: pairs bear what they need to, at the step that was asked for."""

import numpy as np
import pytest
from reference.geometry import against_solids

import taichi_cloth as tc
from taichi_cloth.contact.solid.pairs import BORNE, FIRMEST, GIVE, SOFTER, TIMES, LoadStiffness

T, DEPTH, DOWN = 0.003, 0.04, 0.3


def over_a_ridge(layered: bool, lifted: float = 0.0) -> tc.Scene:
    """A sheet over a sharp ridge of triangles, which lies between its vertices; two of its sides go down by DEPTH until DOWN,
    and after half a second come up again with a speed [m/s]."""
    scene, z = tc.Scene(), np.linspace(-0.1, 0.1, 9)
    x = np.array([[a, b, c] for c in z for a, b in ((-0.1, -0.1), (0.0, 0.0), (0.1, -0.1))])
    faces = [(p, p + 3, p + 1, p + 1, p + 3, p + 4) for j in range(8) for p in (3 * j, 3 * j + 1)]
    scene.add_solid(tc.SolidMesh(x, np.array(faces).reshape(-1, 3)), 0.3, T, name="ridge")
    mesh = tc.grid(0.16, 10)
    flat = mesh.x - mesh.x.mean(axis=0) + [0.008, 0.004, 0]
    contact = tc.ClothContact(T, 0.3) if layered else None
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 0.5), tc.Shear(100, 0.05), tc.Bend(5e-5)), positions=flat,
                            contact=contact)
    sides = np.flatnonzero(np.abs(mesh.x[:, 0] - mesh.x[:, 0].mean()) > 0.0799)
    scene.move(cloth, sides, lambda t: (0, -DEPTH * min(1.0, t / DOWN) + lifted * max(0.0, t - 0.5), 0), relative=True)
    return scene


@pytest.mark.parametrize("layered", [False, True])
def test_a_sheet_pulled_over_a_sharp_edge(layered):
    """Its pairs bear many times what their law gives, and stay outside their least distance; two steps of 30 are cut. Those
    of BDF2 take two solves at least. A pair of the last linear solve may pull by 2 %, by 7 in those."""
    with tc.Simulation(over_a_ridge(layered), h=1 / 60) as sim:
        for _ in range(30):
            sim.step()
            height, crossed = against_solids(sim, sampled=True)["ridge"]
            assert crossed == 0 and height > 0.2
        assert len(sim.log) < 36 and sum(r.solves for r in sim.log) < (80 if layered else 120)
        assert sum(sum(r.rejections.values()) for r in sim.log) <= 2
        solids = sim.contacts.solids
        borne = np.einsum("ki,ki->k", solids.forces.pairs, solids.linearized.normal)
        assert borne.max() > 0.1 and borne.min() > (-0.02 if layered else -0.07) * borne.max()


def test_what_bore_a_load_is_let_go_without_a_push():
    """The sides come up: what was held against the ridge goes no faster than it is led, and is resumed bit for bit."""
    def made() -> tc.Simulation:
        return tc.Simulation(over_a_ridge(True, lifted=0.5), h=1 / 60)

    with made() as sim:
        for _ in range(30):
            sim.step()
        firm = sim.contacts.solids.adaptive_stiffness
        assert len(firm.accepted.key) > 3 and (firm.accepted.stiffness > 100).all()
        state = sim.checkpoint()
        given, had, before = 0.0, sim.log[-1].energies, len(sim.log)
        for _ in range(5):
            sim.step()
            assert np.abs(sim.velocities()).max() < 0.501
            given += sim.log[-1].ledger["solids"]
        assert not len(firm.accepted.key) and sum(sum(r.rejections.values()) for r in sim.log[before:]) < 4
        assert given < 0.01 * sum(v for k, v in had.items() if k not in ("kinetic", "gravity"))  # J
        x, v = sim.positions(), sim.velocities()
    with made() as again:
        again.resume(state)
        for _ in range(5):
            again.step()
        assert (again.positions() == x).all() and (again.velocities() == v).all()


def test_stiffness_by_load():
    """What ends too near some solves running gets what its load needs, then four times more each time; what pulls gets none;
    the rest fades."""
    firm, key = LoadStiffness(), np.array([3, 5, 9])
    load, reach, least, none = np.array([0.1, -0.1, 0.05]), np.full(3, 1e-3), np.full(3, 8.0), np.zeros(3, dtype=bool)
    for times in (TIMES - 1, TIMES):
        assert firm.update(none, key, load, reach, least) == 0 and not len(firm.trial.key)
        for _ in range(times):
            assert not len(firm.trial.key)
            assert firm.update(np.array([True, True, False]), key, load, reach, least) == 0
    assert firm.trial.of(key) == pytest.approx([0.1 / (GIVE * 1e-3), 4 * 8.0, 0])
    assert firm.update(np.array([True, False, False]), key, load, reach, least) == 1
    assert firm.trial.of(np.array([1, 3, 5])) == pytest.approx([0, 4 * 0.1 / (GIVE * 1e-3), 0])
    firm.commit(key, load, reach, least, 0.5)
    assert firm.accepted.key.tolist() == [3]
    assert firm.accepted.stiffness == pytest.approx(SOFTER**0.5 * 4 * 0.1 / (GIVE * 1e-3))
    for _ in range(100):  # what bears goes on to bear
        firm.begin()
        firm.commit(key, load, reach, least, 1.0)
    assert firm.accepted.of(key) == pytest.approx([0.1 / (BORNE * 1e-3), 0, 0])
    firm.begin()
    for _ in range(100):
        firm.commit(key, 0 * load, reach, least, 1.0)
        firm.begin()
    assert not len(firm.accepted.key)
    for _ in range(20):  # a load that its own stiffness makes, where something else holds the cloth
        load = load + firm.trial.of(key) * reach
        firm.update(np.array([True, False, False]), key, load, reach, least)
    assert firm.trial.of(key) == pytest.approx([FIRMEST * 8.0, 0, 0])
