"""A membrane law of one's own, Saint Venant and Kirchhoff's: written here in psi, P and dP, and held to closed forms."""

import numpy as np
import pytest
from test_forces import irregular, ladder, products

import taichi_cloth as tc
from taichi_cloth.backend.language import ti
from taichi_cloth.backend.rows import read
from taichi_cloth.forces.stress import Stress

LAM, MU = 300.0, 400.0  # N/m
YOUNG = 4 * MU * (LAM + MU) / (LAM + 2 * MU)  # of a strip that may narrow [N/m]
K_D = (0.8, 0.6, 0.3)


@ti.data_oriented
class SaintVenantKirchhoff(tc.MembraneLaw):
    """psi = lam/2 tr(E)^2 + mu tr(E E) of Green's strain E = (F^T F - 1)/2; P = F S with S = lam tr(E) + 2 mu E."""

    parameters = ("lam", "mu")

    def stiffest(self, lam, mu):
        """Of strains alike in all directions, or of shear."""
        return 2 * (mu + np.maximum(lam, 0.0))

    @ti.func
    def strain(self, w_u, w_v):
        """E_uu, E_vv, E_uv"""
        return 0.5 * (w_u.dot(w_u) - 1), 0.5 * (w_v.dot(w_v) - 1), 0.5 * w_u.dot(w_v)

    @ti.func
    def stress(self, k, w_u, w_v):
        """S_uu, S_vv, S_uv"""
        E_u, E_v, E = self.strain(w_u, w_v)
        return k[0] * (E_u + E_v) + 2 * k[1] * E_u, k[0] * (E_u + E_v) + 2 * k[1] * E_v, 2 * k[1] * E

    @ti.func
    def psi(self, k, w_u, w_v):
        """psi"""
        E_u, E_v, E = self.strain(w_u, w_v)
        return 0.5 * k[0] * (E_u + E_v) ** 2 + k[1] * (E_u * E_u + E_v * E_v + 2 * E * E)

    @ti.func
    def P(self, k, w_u, w_v):
        """F S"""
        S_u, S_v, S = self.stress(k, w_u, w_v)
        return S_u * w_u + S * w_v, S * w_u + S_v * w_v

    @ti.func
    def dP(self, k, w_u, w_v, exact):
        """dF S + F dS: the second part is semidefinite, the first as S is."""
        S_u, S_v, S = self.stress(k, w_u, w_v)
        if exact == 0:
            S_u, S_v, S = self.positive(S_u, S_v, S)
        I, stiff = ti.Matrix.identity(float, 3), k[0] + 2 * k[1]  # noqa: E741 (the identity's own letter)
        uu = stiff * w_u.outer_product(w_u) + k[1] * w_v.outer_product(w_v) + S_u * I
        uv = k[0] * w_u.outer_product(w_v) + k[1] * w_v.outer_product(w_u) + S * I
        vv = stiff * w_v.outer_product(w_v) + k[1] * w_u.outer_product(w_u) + S_v * I
        return uu, uv, vv


def simulation(mesh, x=None, v=None, lam=LAM, mu=MU, k_d=K_D, **options) -> tc.Simulation:
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2), x, v)
    scene.add_force(SaintVenantKirchhoff.on(cloth, lam=lam, mu=mu, k_d=k_d))
    return tc.Simulation(scene, **options)


def numbers(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(psi, P) of (..., 3, 2) F, by matrices."""
    E = (np.swapaxes(F, -1, -2) @ F - np.eye(2)) / 2
    trace = np.trace(E, axis1=-2, axis2=-1)
    S = LAM * trace[..., None, None] * np.eye(2) + 2 * MU * E
    return LAM / 2 * trace**2 + MU * np.einsum("...ij,...ij->...", E, E), F @ S


@pytest.fixture(scope="module")
def crumpled():
    """(mesh, x, v, the same simulation for each K asked for)"""
    mesh, x, v = irregular(np.random.default_rng(5))
    made: dict = {}

    def of(K):
        if K not in made:
            made[K] = simulation(mesh, x, v, K=K)
        made[K].set_state(x, v)
        return made[K]

    yield mesh, x, v, of
    for sim in made.values():
        sim.close()


@pytest.mark.slow
def test_force_is_minus_the_gradient_of_psi(crumpled, rng):
    """And psi is the closed form's, triangle by triangle."""
    mesh, x, v, of = crumpled
    sim, p, zero = of("projected"), rng.normal(size=x.shape), np.zeros_like(v)
    corner, at = mesh.corner_uv, x[mesh.faces]
    edges = np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], axis=2)
    F = np.stack([at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]], axis=2) @ np.linalg.inv(edges)
    assert sim.energy()["membrane"] == pytest.approx(np.sum(mesh.material_areas * numbers(F)[0]), rel=1e-12)

    def energy(eps):
        sim.set_state(x + eps * p, zero)
        return sim.energy()["membrane"]

    sim.set_state(x, zero)
    power = np.sum(sim.forces() * p)
    assert ladder(-power, energy, abs(power)) < 1e-7


@pytest.mark.parametrize("K", ["paper", "projected"])
@pytest.mark.slow
def test_stiffness_and_damping_are_derivatives_of_the_force(crumpled, rng, K):
    """Exact with "paper", else nowhere negative, and no less than the exact one where that is positive."""
    mesh, x, v, of = crumpled
    sim, p, q = of(K), rng.normal(size=x.shape), rng.normal(size=x.shape)

    def by_speed(eps):
        sim.set_state(x, v + eps * p)
        return sim.forces()

    D_p = products(sim, p)[1]
    assert ladder(D_p, by_speed, np.abs(D_p).max()) < 1e-7 and np.sum(p * D_p) < 0
    sim.set_state(x, 0 * v)
    K_p = products(sim, p)[0]
    assert np.sum(q * K_p) == pytest.approx(np.sum(p * products(sim, q)[0]), rel=1e-11)
    if K == "paper":
        def by_place(eps):
            sim.set_state(x + eps * p, 0 * v)
            return sim.forces()
        assert ladder(K_p, by_place, np.abs(K_p).max()) < 1e-7
    else:
        dense = np.stack([products(sim, e.reshape(-1, 3))[0].ravel() for e in np.eye(x.size)])
        assert np.linalg.eigvalsh(dense).max() < 1e-9 * np.abs(dense).max()


@pytest.mark.slow
def test_damping_as_an_energy_of_a_step(crumpled, rng):
    """b is minus the gradient of Phi along x + c eps p, v + eps p, and A minus the derivative of b."""
    mesh, x, v, of = crumpled
    sim, c, p = of("projected"), 0.02, rng.normal(size=x.shape)
    meter, system = sim.meter, sim.integrator.system
    sim.model.write(x - c * v, v)
    sim.model.save()
    system.linearize_first(c, None)
    held, sim._linearized = sim._linearized, lambda h: system

    def imbalance(eps):
        sim.model.write(x + c * eps * p, v + eps * p)
        system.linearize(c, over=c)
        return sim.model.to_user(read(system.operator.b))

    def phi(eps):
        sim.model.write(x + c * eps * p, v + eps * p)
        measures = meter.measure(over=c)
        return measures.change + measures.potential + c * measures.dissipation

    b = imbalance(0.0)
    assert ladder(-np.sum(b * p), phi, np.abs(b * p).sum()) < 1e-7
    imbalance(0.0)
    A_p = sim.product(p, c)
    assert ladder(-A_p, imbalance, np.abs(A_p).max()) < 1e-7
    sim._linearized = held
    meter.measure()


@pytest.mark.slow
def test_gauss_newton_has_no_negative_part_in_further_solves(crumpled):
    """Nothing takes it out of the matrix there, as "projected" has it done where CG breaks down."""
    mesh, x, v, of = crumpled
    sim, c = of("gauss_newton"), 0.1
    system, held = sim.integrator.system, sim._linearized
    sim.model.write(x, 0 * v)
    sim.model.save()
    system.linearize_first(c, None)
    system.linearize(c, over=c)
    sim._linearized = lambda h: system
    dense = np.stack([sim.product(e.reshape(-1, 3), c).ravel() for e in np.eye(x.size)])
    sim._linearized = held
    sim.meter.measure()
    assert np.linalg.eigvalsh(dense).min() > 0 and not sim.force_terms[0].indefinite


@pytest.mark.slow
def test_uniform_strain_is_uniform_stress(rng):
    """Patch test, on an uneven mesh: nothing pulls within, the border is pulled by P, and stresses are the closed form's."""
    flat = tc.grid((0.6, 0.4), (6, 4))
    uv, inner = flat.uv.copy(), np.ones(len(flat.uv), dtype=bool)
    for name in ("left", "right", "top", "bottom"):
        inner[flat.select(name)] = False
    uv[inner] += rng.uniform(-0.02, 0.02, (inner.sum(), 2))
    mesh = tc.TriMesh(np.column_stack([uv, 0 * uv[:, 0]]), flat.faces, uv)
    F = np.array([[1.2, 0.1], [-0.05, 0.9], [0.3, 0.2]])
    psi, P = numbers(F)
    with simulation(mesh, uv @ F.T) as sim:
        f, T = sim.forces(), Stress(sim.force_terms[0]).now()
        assert sim.energy()["membrane"] == pytest.approx(0.24 * psi, rel=1e-12)
    assert np.abs(f[inner]).max() < 1e-11 * np.abs(f).max()
    right = np.isclose(uv[:, 0], uv[:, 0].max())
    corners = right & (np.isclose(uv[:, 1], uv[:, 1].max()) | np.isclose(uv[:, 1], uv[:, 1].min()))
    edge = 0.1 * np.where(corners, 0.5, 1.0)[:, None] * P[:, 0]  # what a vertex of the right border bears
    assert f[right & ~corners] == pytest.approx(-edge[right & ~corners], rel=1e-9)
    R, U = polar(F)
    assert T == pytest.approx(np.broadcast_to((R.T @ P + P.T @ R) / 2, T.shape), rel=1e-9)


def polar(F: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and U of F = R U."""
    a, s, b = np.linalg.svd(F, full_matrices=False)
    return a @ b, b.T @ np.diag(s) @ b


@pytest.mark.slow
def test_a_strip_that_is_pulled_narrows():
    """Held at stretch s between ends that slide: Y s (s^2 - 1)/2 a width, and its width by lam/(lam + 2 mu)."""
    length, width, s = 0.4, 0.1, 1.3
    mesh = tc.strip(length, width, (8, 2), plane="xy")
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2), mesh.x * [s, 1, 1])
    scene.add_force(SaintVenantKirchhoff.on(cloth, lam=LAM, mu=MU, k_d=2.0))
    for end in ("left", "right"):
        scene.pin(cloth, end, directions="xz")
    scene.pin(cloth, "bottom_left")
    with tc.Simulation(scene, h=0.05, integrator="backward_euler", cg_tol=1e-10) as sim:
        sim.run(3.0, fps=1)
        x, pull = sim.positions(), sim.forces()[mesh.select("left"), 0].sum()
    E = (s * s - 1) / 2
    assert pull / width == pytest.approx(YOUNG * s * E, rel=1e-5)
    narrow = np.sqrt(1 - 2 * E * LAM / (LAM + 2 * MU))
    assert np.ptp(x[:, 1]) == pytest.approx(width * narrow, rel=1e-5)


@pytest.mark.slow
def test_a_strip_that_hangs_and_explicit_steps():
    """With lam = 0 a section bears 2 mu s E, and the end comes down by the sum of s - 1; Verlet's own step is stable there."""
    length, density, cells = 1.0, 0.2, 32
    mesh = tc.strip(length, 2 / cells, (cells, 2), plane="xy")
    scene = tc.Scene(gravity=(9.81, 0, 0))
    cloth = scene.add_cloth(mesh, tc.Fabric(density))
    scene.add_force(SaintVenantKirchhoff.on(cloth, lam=0.0, mu=10.0, k_d=2.0))
    scene.pin(cloth, "left")
    bears = density * 9.81 * length * (1 - (np.arange(cells) + 0.5) / cells)  # N/m, in the middle of each row of cells
    roots = [np.roots([10.0, 0, -10.0, -T]).real.max() for T in bears]
    with tc.Simulation(scene, h=0.05, integrator="backward_euler", cg_tol=1e-9) as sim:
        sim.run(4.0, fps=1)
        end = sim.positions()[mesh.select("right"), 0].mean()
        state = sim.positions()
    assert end - length == pytest.approx(length * (np.mean(roots) - 1), rel=2e-3)
    with tc.Simulation(scene, integrator="verlet") as sim:
        sim.set_state(state, 0 * state)
        sim.run(0.2, fps=5)
        assert np.abs(sim.positions() - state).max() < 1e-4


@pytest.mark.slow
def test_the_bound_for_explicit_steps_is_above_the_fastest_mode():
    mesh = tc.grid(1.0, 6)
    with simulation(mesh, k_d=0.0, preconditioner="none") as sim:
        A = np.array([sim.product(e.reshape(-1, 3), 1.0).ravel() for e in np.eye(3 * sim.vertex_count)])
        mass = np.zeros(sim.vertex_count)
        mass[sim.model.user] = sim.model.mass
        mass = np.repeat(mass, 3)
        fastest = np.linalg.eigvalsh((A - np.diag(mass)) / np.sqrt(np.outer(mass, mass)))[-1]
        assert fastest * (1 - 1e-9) < sim.force_terms[0].rates[0] < 3 * fastest


def test_what_cannot_be_is_said_by_name():
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(0.3, 2), tc.Fabric(0.2))
    other = tc.Scene().add_cloth(tc.grid(0.3, 2), tc.Fabric(0.2))
    law = SaintVenantKirchhoff
    for what, given in (("lacks mu", {"lam": 1.0}), ("has no nu", {"lam": 1.0, "mu": 1.0, "nu": 0.3}),
                        ("mu = nan", {"lam": 1.0, "mu": np.nan}), ("needs shape", {"lam": 1.0, "mu": np.ones(3)}),
                        ("k_d = -1", {"lam": 1.0, "mu": 1.0, "k_d": -1})):
        with pytest.raises(tc.SceneError, match=what):
            law.on(cloth, **given)
    with pytest.raises(tc.SceneError, match="on which cloth"):
        law.on(lam=1.0, mu=1.0)
    with pytest.raises(tc.SceneError, match="must be a Cloth"):
        law.on("cloth0", lam=1.0, mu=1.0)

    class Half(tc.MembraneLaw):
        def psi(self, k, w_u, w_v):
            """Alone."""

    with pytest.raises(tc.SceneError, match="Half: the law lacks P, dP, stiffest"):
        Half.on(cloth)
    for what, force in (("on which cloth", law), ("is not a cloth of this scene", law.on(other, lam=1.0, mu=1.0)),
                        ("must be positive", law.on(cloth, lam=1.0, mu=-5.0))):
        wrong = tc.Scene()
        wrong.cloths = scene.cloths
        wrong.add_force(force)
        with pytest.raises(tc.SceneError, match=what):
            tc.Simulation(wrong)
