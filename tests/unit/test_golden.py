"""Forces, products and a step against numbers of an independent reference implementation."""

import json

import numpy as np
import pytest

import taichi_cloth as tc

pytestmark = pytest.mark.slow

TOLERANCE = 1e-9  # relative: both sides are float64, the reference by dense algebra


def scene_of(case: dict) -> tc.Scene:
    p = case["params"]
    fabric = tc.Fabric(p["density"], tc.Stretch(tuple(p["k_stretch"]), tuple(p["kd_stretch"])),
                       tc.Shear(p["k_shear"], p["kd_shear"]), tc.Bend(p["k_bend"], p["kd_bend"]))
    scene = tc.Scene(gravity=p["gravity"])
    scene.add_cloth(tc.TriMesh(case["x"], case["triangles"], case["uv"]), fabric, velocities=case["v"])
    return scene


def assert_close(ours: np.ndarray, theirs, tolerance: float = TOLERANCE) -> None:
    theirs = np.array(theirs)
    assert np.abs(ours - theirs).max() <= tolerance * np.abs(theirs).max()


@pytest.fixture(params=["grid_small", "grid_large", "delaunay_smooth"])
def case(request, shared) -> dict:
    return json.loads((shared / "validation" / "golden" / f"{request.param}.json").read_text())


def stiffness_product(sim: tc.Simulation, p) -> tuple[np.ndarray, np.ndarray]:
    """(K p, D p) from A p at two step sizes."""
    M_p, a, b = sim.model.mass[sim.model.particle][:, None] * p, sim.product(p, 1.0), sim.product(p, 2.0)
    first, second = M_p - a, M_p - b  # h D p + h^2 K p
    return second / 2 - first, 2 * first - second / 2


@pytest.mark.parametrize("K, name", [("paper", "exact"), ("gauss_newton", "gauss_newton")])
def test_against_reference(case, K, name):
    sim = tc.Simulation(scene_of(case), K=K, cg_tol=1e-13, adaptive=False)
    energy = sim.energy()
    for ours, theirs in (("stretch_u", "u"), ("stretch_v", "v"), ("shear", "shear"), ("bend", "bend")):
        assert energy[ours] == pytest.approx(case["energy"][theirs], rel=TOLERANCE)
    assert_close(sim.forces(), case["force"]["total_with_gravity"])
    p = np.array(case["p"])
    K_p, D_p = stiffness_product(sim, p)
    assert_close(K_p, case[f"K_{name}_p"])
    assert_close(D_p, case["D_p"])
    constraints = [tc.Constraint(c["vertex"], c["prohibited"], c["z"], c.get("y", (0, 0, 0)))
                   for c in case["constraints"]]
    step = case[f"step_{name}"]
    if step["A_min_eig"] > 0:
        assert_close(sim.solve(case["h"], constraints), step["dv"])
    else:  # no direction of descent: that is said, and no answer is given
        assert name == "exact"
        with pytest.raises(tc.SimulationError, match="BREAKDOWN"):
            sim.solve(case["h"], constraints)
