"""A law of bending of one's own, over hinges: against `tc.Bend` where it is linear, against differences where it stiffens."""

import numpy as np
import pytest
from test_forces import irregular, ladder, products

import taichi_cloth as tc
from taichi_cloth.backend.language import ti

D, B = 2e-2, 3e-5  # N m, N m^3
K_D = 2e-4


@ti.data_oriented
class Stiffening(tc.BendLaw):
    """psi = D/2 kappa^2 + B/4 kappa^4."""

    parameters = ("D", "B")

    def stiffest(self, D, B):
        """At rest."""
        return D

    @ti.func
    def psi(self, k, kappa):
        """psi"""
        return 0.5 * k[0] * kappa**2 + 0.25 * k[1] * kappa**4

    @ti.func
    def M(self, k, kappa):
        """M"""
        return k[0] * kappa + k[1] * kappa**3

    @ti.func
    def dM(self, k, kappa):
        """dM"""
        return k[0] + 3 * k[1] * kappa**2


def simulation(mesh, x, v, fabric=None, K="projected", **values) -> tc.Simulation:
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, fabric or tc.Fabric(0.2), x, v)
    if values:
        scene.add_force(Stiffening.on(cloth, k_d=K_D, **values))
    return tc.Simulation(scene, K=K)


def test_a_hinge_has_the_moment_of_its_curvature():
    """Two triangles over an edge of 1 m: what turns a tip is |e| M(theta |e| / (A_1 + A_2)) over its arm."""
    arm, angle = 0.6, 0.7
    mesh = tc.TriMesh([[0, 0, 0], [0, 1, 0], [arm, 0.5, 0], [-arm, 0.5, 0]], [[0, 2, 1], [0, 1, 3]],
                      [[0, 0], [0, 1], [arm, 0.5], [-arm, 0.5]])
    x = mesh.x.copy()
    x[3] = [-arm * np.cos(angle), 0.5, arm * np.sin(angle)]
    kappa = angle / arm
    with simulation(mesh, x, 0 * x, D=D, B=B) as sim:
        f, energy = sim.forces()[3], sim.energy()["bend"]
    assert energy == pytest.approx(arm * (D / 2 * kappa**2 + B / 4 * kappa**4), rel=1e-12)
    assert f @ [np.sin(angle), 0, np.cos(angle)] == pytest.approx(-(D * kappa + B * kappa**3) / arm, rel=1e-12)


@pytest.mark.slow
def test_the_linear_law_is_that_of_bend(rng):
    mesh, x, v = irregular(rng)
    p = rng.normal(size=x.shape)
    seen = []
    for fabric, values in ((None, {"D": D, "B": 0.0}), (tc.Fabric(0.2, bend=tc.Bend(D, K_D)), {})):
        with simulation(mesh, x, v, fabric, **values) as sim:
            seen.append([sim.energy()["bend"], sim.forces(), *products(sim, p), sim.force_terms[0].rates])
    for mine, theirs in zip(*seen):
        assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize("K", ["paper", "projected"])
@pytest.mark.slow
def test_a_law_that_stiffens(rng, K):
    """Force and energy by differences; K is exact with "paper", and else no less and nowhere negative."""
    mesh, x, v = irregular(rng)
    p, zero = rng.normal(size=x.shape), 0 * v
    with simulation(mesh, x, v, K=K, D=D, B=B) as sim:
        def energy(eps):
            sim.set_state(x + eps * p, zero)
            return sim.energy()["bend"]

        def force(eps):
            sim.set_state(x + eps * p, zero)
            return sim.forces()

        f = force(0.0)
        assert ladder(-np.sum(f * p), energy, abs(np.sum(f * p))) < 1e-7
        force(0.0)
        K_p = products(sim, p)[0]
        if K == "paper":
            assert ladder(K_p, force, np.abs(K_p).max()) < 1e-7
        else:
            dense = np.stack([products(sim, e.reshape(-1, 3))[0].ravel() for e in np.eye(x.size)])
            assert np.linalg.eigvalsh(dense).max() < 1e-9 * np.abs(dense).max()


def test_what_cannot_be_is_said_by_name():
    cloth = tc.Scene().add_cloth(tc.grid(0.3, 2), tc.Fabric(0.2))
    for what, given in (("lacks B", {"D": 1.0}), ("k_d = -1", {"D": 1.0, "B": 0.0, "k_d": -1}),
                        ("k_d", {"D": 1.0, "B": 0.0, "k_d": (1.0, 2.0, 3.0)})):
        with pytest.raises(tc.SceneError, match=what):
            Stiffening.on(cloth, **given)
