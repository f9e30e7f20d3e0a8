"""Cloth that is pulled hard over edges of solids: pairs bear what they need to, at the step that was asked for."""

import numpy as np
import pytest
from reference.geometry import against_solids

import taichi_cloth as tc

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
    """Its pairs bear many times what their law gives, and stay outside their least distance; no step is cut."""
    with tc.Simulation(over_a_ridge(layered), h=1 / 60) as sim:
        for _ in range(30):
            sim.step()
            height, crossed = against_solids(sim, sampled=True)["ridge"]
            assert crossed == 0 and height > 0.2
        assert len(sim.log) == 30 and sum(r.solves for r in sim.log) < 75
        assert not any(r.rejections for r in sim.log)
        solids = sim.contacts.solids
        borne = np.einsum("ki,ki->k", solids.forces.pairs, solids.linearized.normal)
        assert borne.max() > 0.1 and borne.min() > -1e-3 * borne.max()


def test_what_bore_a_load_is_let_go_without_a_push():
    """The sides come up: cloth leaves the ridge no faster than it is led, and what bore the load is forgotten."""
    with tc.Simulation(over_a_ridge(True, lifted=0.5), h=1 / 60) as sim:
        for _ in range(45):
            sim.step()
            if sim.time > 0.5:
                print(round(sim.time, 3), np.abs(sim.velocities()).max(), sim.log[-1].rejections, sim.log[-1].ledger, len(sim.contacts.solids.firmness.accepted.key), sim.log[-1].contacts)
        assert len(sim.log) == 45
        assert 0
