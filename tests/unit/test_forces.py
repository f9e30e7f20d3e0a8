"""The force contract, over every force: energy, force, products, symmetry, momentum, invariance."""

import numpy as np
import pytest
from conftest import FULL

import taichi_cloth as tc
from taichi_cloth.backend.rows import read
from taichi_cloth.system.elements import flat_turns, hinge_angle, hinges, lumped_mass

PARTS = {
    "stretch": tc.Fabric(0.2, stretch=tc.Stretch((800, 600), (0.8, 0.6), (1.0, 0.98))),
    "shear": tc.Fabric(0.2, shear=tc.Shear(200, 0.2)),
    "limit": tc.Fabric(0.2, tc.Stretch((800, 600), (0.8, 0.6), limit=(1.15, 1.2)), tc.Shear(200, 0.2, limit=0.25)),
    "curve": tc.Fabric(0.2, tc.Stretch(k_d=0.5, b=(1.0, 0.95), curve=(
        ((0, 0), (0.02, 10), (0.1, 90)), ((0, 0), (0.05, 20), (1, 900))))),
    "bend": tc.Fabric(0.2, bend=tc.Bend((2e-2, 3e-2), 2e-4)),
    "curvature": tc.Fabric(0.2, bend=tc.Bend((2e-2, 3e-2), 2e-4, model="curvature")),
    "all": FULL,
}
SLIDES = {
    "friction": tc.Fabric(0.2, bend=tc.Bend((2e-2, 3e-2), friction=(0.05, 0.08), yield_=1.5)),
    "curvature_friction": tc.Fabric(0.2, bend=tc.Bend((2e-2, 3e-2), friction=(0.05, 0.08), yield_=1.5, model="curvature")),
}


def irregular(rng, n=4, rest="flat"):
    """A small crumpled sheet with a seam: (mesh, x, v)."""
    flat = tc.grid((1.0, 0.8), (n, n - 1))
    uv = flat.corner_uv + 0
    uv[::3] += [5.0, 1.0]  # panels apart: hinges across seams
    mesh = tc.TriMesh(flat.x + 0.05 * rng.normal(size=flat.x.shape), flat.faces, uv)
    x = flat.x + 0.06 * rng.normal(size=flat.x.shape)
    return mesh, x, rng.normal(size=x.shape)


def simulation(rng, part="all", K="projected", **kwargs):
    mesh, x, v = irregular(rng)
    scene = tc.Scene(gravity=kwargs.pop("gravity", None), air=kwargs.pop("air", None))
    scene.add_cloth(mesh, (PARTS | SLIDES)[part], x, v)
    return tc.Simulation(scene, K=K, **kwargs), x, v


def potential(sim):
    return sum(e for name, e in sim.energy().items() if name != "kinetic")


def products(sim, p):
    """(K p, D p)"""
    m = np.zeros((len(p), 1))
    m[sim.model.user, 0] = sim.model.mass
    first, second = m * p - sim.product(p, 1.0), m * p - sim.product(p, 2.0)
    return second / 2 - first, 2 * first - second / 2


def ladder(slope, f, scale):
    """Least relative error of a central difference of f along steps 1e-2 ... 1e-7."""
    errors = []
    for eps in 10.0 ** -np.arange(2, 7.5, 0.5):
        errors.append(np.abs((f(eps) - f(-eps)) / (2 * eps) - slope).max() / scale)
    return min(errors)


@pytest.mark.parametrize("part", [*PARTS, *SLIDES])
def test_force_is_minus_energy_gradient(rng, part):
    sim, x, v = simulation(rng, part)
    zero = np.zeros_like(v)
    p = rng.normal(size=x.shape)

    def energy(eps):
        sim.set_state(x + eps * p, zero)
        return potential(sim)

    sim.set_state(x, zero)
    power = np.sum(sim.forces() * p)
    assert ladder(-power, energy, abs(power)) < 1e-7


@pytest.mark.parametrize("part", [*PARTS, *SLIDES])
@pytest.mark.parametrize("K", ["paper", "gauss_newton", "projected"])
@pytest.mark.slow
def test_stiffness_against_differences(rng, part, K):
    if part == "curvature_friction" and K == "paper":
        with pytest.raises(tc.SceneError, match="no exact K"):
            simulation(rng, part, K)
        return
    sim, x, v = simulation(rng, part, K)
    zero, p = np.zeros_like(v), rng.normal(size=x.shape)
    sim.set_state(x, zero)
    K_p, D_p = products(sim, p)
    q = rng.normal(size=x.shape)
    assert np.sum(q * K_p) == pytest.approx(np.sum(p * products(sim, q)[0]), rel=1e-11)
    if K == "paper":  # the exact derivative of the force
        def force(eps):
            sim.set_state(x + eps * p, zero)
            return sim.forces()
        assert ladder(K_p, force, np.abs(K_p).max()) < 1e-7
    else:
        assert np.sum(p * K_p) <= 0


@pytest.mark.parametrize("part, air", [*((part, None) for part in PARTS), ("stretch", tc.Air(2.0, 0.5, (3.0, 1.0, -2.0)))])
def test_damping_against_differences(rng, part, air):
    sim, x, v = simulation(rng, part, air=air)
    p = rng.normal(size=x.shape)
    _, D_p = products(sim, p)

    def force(eps):
        sim.set_state(x, v + eps * p)
        return sim.forces()

    assert ladder(D_p, force, np.abs(D_p).max()) < 1e-7
    assert np.sum(p * D_p) < 0  # dissipates


@pytest.mark.parametrize("part, K", [("stretch", "projected"), ("shear", "projected"), ("limit", "projected"),
                                     ("curve", "projected"), ("bend", "paper"), ("friction", "paper"),
                                     ("curvature", "projected")])
@pytest.mark.slow
def test_damping_as_an_energy_of_a_step(rng, part, K):
    """Along x + c eps p, v + eps p the step's b is minus the gradient of Phi, and A is minus b's derivative; where curvatures
    are damped A is no less."""
    sim, x, v = simulation(rng, part, K)
    c, p, meter, system = 0.02, rng.normal(size=x.shape), sim.meter, sim.integrator.system
    sim._linearized = lambda h: system  # as it is
    sim.model.write(x - c * v, v)
    sim.model.save()
    system.linearize_first(c, None)  # at the step's start, as every step does

    def look(eps):
        sim.model.write(x + c * eps * p, v + eps * p)
        system.linearize(c, over=c)

    def imbalance(eps):
        look(eps)
        return sim.model.to_user(read(system.operator.b))

    def phi(eps):
        look(eps)
        measures = meter.measure(over=c)
        return measures.change + measures.potential + c * measures.dissipation

    downhill = np.sum(imbalance(0.0) * p)
    power = np.abs(imbalance(0.0) * p).sum()
    assert ladder(-downhill, phi, power) < 1e-7
    apart = meter.measure().dissipation - meter.measure(over=c).dissipation
    assert abs(apart) > 1e-3 * meter.measure().dissipation or part == "friction"
    look(0.0)
    A_p = sim.product(p, c)
    if part != "curvature":
        assert ladder(-A_p, imbalance, np.abs(A_p).max()) < 1e-7
    else:
        slope = (imbalance(1e-6) - imbalance(-1e-6)) / 2e-6
        assert np.sum(p * A_p) >= -np.sum(p * slope)
    if K == "projected":
        look(0.0)
        system._leave_out(True)
        meter.linearize(c, False, c)
        n = 3 * len(x)
        dense = np.stack([sim.product(e.reshape(-1, 3), c).ravel() for e in np.eye(n)])
        assert np.linalg.eigvalsh(dense).min() > 0 and np.sum(p * sim.product(p, c)) >= np.sum(p * A_p) * (1 - 1e-12)


@pytest.mark.parametrize("part", PARTS)
def test_internal_forces_keep_both_momenta(rng, part):
    sim, x, v = simulation(rng, part)
    f = sim.forces()
    size = np.abs(f).sum()
    assert np.abs(f.sum(axis=0)).max() < 1e-12 * size
    assert np.abs(np.cross(x, f).sum(axis=0)).max() < 1e-12 * size
    K_p, D_p = products(sim, rng.normal(size=x.shape))
    for product in (K_p, D_p):
        rounding = 1e-15 * np.abs(K_p).sum()  # D is what is left of a difference
        assert np.abs(product.sum(axis=0)).max() < 1e-11 * np.abs(product).sum() + rounding


def test_invariant_under_rigid_motion(rng):
    sim, x, v = simulation(rng)
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    Q *= np.sign(np.linalg.det(Q))
    f, energy = sim.forces(), potential(sim)
    sim.set_state(x @ Q.T + [1, 2, 3], v @ Q.T)
    assert potential(sim) == pytest.approx(energy, rel=1e-12)
    assert np.abs(sim.forces() - f @ Q.T).max() < 1e-11 * np.abs(f).max()


@pytest.mark.parametrize("K", ["paper", "gauss_newton", "projected"])
@pytest.mark.slow
def test_right_hand_side_and_diagonal(rng, K):
    sim, x, v = simulation(rng, K=K, gravity=(0, 0, -9.81))
    h = 0.01
    K_v, _ = products(sim, v)
    b = h * (sim.forces() + h * K_v)
    assert np.abs(sim.right_hand_side(h) - b).max() < 1e-11 * np.abs(b).max()
    n = len(x)
    dense = np.stack([sim.product(e.reshape(n, 3), h).ravel() for e in np.eye(3 * n)], axis=1)
    assert np.abs(dense - dense.T).max() < 1e-12 * np.abs(dense).max()
    P = read(sim.integrator.system.operator.P)[:n]
    for particle, vertex in enumerate(sim.model.user):
        block = dense[3 * vertex: 3 * vertex + 3, 3 * vertex: 3 * vertex + 3]
        assert np.abs(P[particle] - block[np.triu_indices(3)]).max() < 1e-12 * np.abs(dense).max()
    if K != "paper":
        assert np.linalg.eigvalsh(dense).min() > 0


def test_rest_shape_has_no_force():
    scene = tc.Scene(gravity=None)
    tube = tc.cylinder(0.3, 1, (12, 4))
    curved = tc.Fabric(0.2, bend=tc.Bend(1e-3, rest="given"))
    scene.add_cloth(tube, curved)
    flat = scene.add_cloth(tc.grid(1.0, 4), FULL.__class__(0.2, tc.Stretch(100), tc.Shear(100), tc.Bend(1e-3)))
    sim = tc.Simulation(scene)
    assert np.abs(sim.forces()).max() < 1e-12
    scene = tc.Scene(gravity=None)
    scene.add_cloth(tube, tc.Fabric(0.2, bend=tc.Bend(1e-3)))  # a flat panel, sewn round: it wants to open
    assert np.abs(tc.Simulation(scene).forces()).max() > 1e-4
    assert flat.start == tube.vertex_count


def test_seam_hinges_use_the_mean_of_their_sides(rng):
    x = np.array([[0, 0, 0], [0, 1, 0], [1, 0.5, 0], [-1, 0.5, 0.4]])
    faces = [[0, 2, 1], [0, 1, 3]]
    left, right = [[0, 0], [1, 0.5], [0, 1]], [[5, 0], [5, 1.2], [4, 0.6]]
    scene = tc.Scene(gravity=None)
    scene.add_cloth(tc.TriMesh(x, faces, [left, right]), tc.Fabric(1.0, bend=tc.Bend(2.0)))
    theta = np.arctan2(0.4, 1)
    areas = 0.5 + 0.6
    assert potential(tc.Simulation(scene)) == pytest.approx(2.0 * 1.1**2 / areas / 2 * theta**2, rel=1e-12)


@pytest.mark.parametrize("K", ["projected", "gauss_newton", "paper"])
@pytest.mark.slow
def test_collapsed_and_folded_states_are_defined(rng, K):
    mesh, scene = tc.grid(1.0, 2), tc.Scene()
    scene.add_cloth(mesh, FULL)
    sim = tc.Simulation(scene, K=K)
    for x in (np.zeros_like(mesh.x), mesh.x * [1, 1, 0], np.where(mesh.x[:, :1] > 0.5, 1 - mesh.x, mesh.x) * [1, 0, 1],
              mesh.x * [0, 1, 1]):
        sim.set_state(x, 0 * x)
        assert np.isfinite(sim.forces()).all()
        p = rng.normal(size=x.shape)
        product = sim.product(p, 0.01)
        assert np.isfinite(product).all()
        if K != "paper":
            assert np.sum(p * product) > 0
    sim.close()


def hinge(theta, rest=0.0, **kwargs):
    """A simulation of two triangles, and the positions of a fold by theta; at rest by `rest`."""
    def fold(angle):
        return np.array([[0, 0, 0], [0, 1, 0], [1, 0.5, 0], [-np.cos(angle), 0.5, np.sin(angle)]])
    scene = tc.Scene(gravity=None)
    flat = [[0, 0], [0, 1], [1, 0.5], [-1, 0.5]]
    mesh = tc.TriMesh(fold(rest), [[0, 2, 1], [0, 1, 3]], np.array(flat)[[[0, 2, 1], [0, 1, 3]]])
    scene.add_cloth(mesh, tc.Fabric(1.0, bend=tc.Bend(1.0, rest="given")), fold(theta))
    return tc.Simulation(scene, **kwargs), fold


@pytest.mark.parametrize("rest", [0.0, -0.9, 0.9])
@pytest.mark.slow
def test_a_fold_that_passes_through_itself_has_no_jump(rest):
    """Energy and force change by no more than the step of the angle says, all the way round."""
    sim, fold = hinge(0.5, rest, threads=1)
    angles = np.linspace(0.3, 0.3 + 2 * np.pi, 1257)
    energies, moments = [], []
    for angle in angles:
        x = fold(angle)
        sim.set_state(x, 0 * x)
        energies.append(potential(sim))
        moments.append(sim.forces()[3] @ [np.sin(angle), 0, np.cos(angle)])  # arm 1 m
    energies, moments = np.array(energies), np.array(moments)
    step = angles[1] - angles[0]
    assert np.abs(np.diff(energies)).max() < 3.2 * step
    assert np.abs(np.diff(moments)).max() < 17 * step  # falls from 2.9 to -2.9 within 0.4
    away = (angles - rest + np.pi) % (2 * np.pi) - np.pi
    plain = np.abs(away) < np.pi - 0.2
    assert plain.sum() > 1100
    assert np.abs(energies - away**2 / 2)[plain].max() < 1e-12
    assert np.abs(np.abs(moments) - np.abs(away))[plain].max() < 1e-12
    assert np.abs(-np.gradient(energies, step) / np.where(moments == 0, 1, moments) - np.sign(1.0))[plain].min() < 1e-3


def test_a_fold_of_exactly_pi_is_pushed_to_one_side():
    sim, fold = hinge(np.pi)
    x = fold(np.pi)
    x[3] = x[2]
    sim.set_state(x, 0 * x)
    assert potential(sim) == pytest.approx(0.5 * (np.pi - 0.1) ** 2, rel=1e-12)
    assert np.isfinite(sim.forces()).all() and np.abs(sim.forces()).max() > 1


@pytest.mark.slow
def test_a_triangle_that_turns_inside_out_has_no_jump():
    """Its tip goes through the edge: the angle jumps by pi there, energy and force do not."""
    sim, _ = hinge(0.5, threads=1)
    energies, forces = [], []
    ways = np.linspace(0.3, -0.3, 2401)
    for way in ways:
        x = np.array([[0, 0, 0], [0, 1, 0], [1, 0.5, 0], [-way, 0.5, 0.001]])
        sim.set_state(x, 0 * x)
        energies.append(potential(sim))
        forces.append(sim.forces())
    energies, forces = np.array(energies), np.array(forces)
    assert energies[-1] > 1  # folded over, as it then is
    assert np.abs(forces).max() < 100  # an angle's own gradient there is 1000 [1/m]
    assert np.abs(np.diff(energies)).max() < 100 * (ways[0] - ways[1])
    work = np.sum(forces[:, 3, 0]) * (ways[0] - ways[1])
    assert energies[0] - energies[-1] == pytest.approx(work, rel=2e-2)


@pytest.mark.slow
def test_what_is_not_named_does_not_exist():
    scene = tc.Scene(gravity=None)
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, tc.Stretch(100)))
    sim = tc.Simulation(scene, integrator="verlet")
    assert [type(f).__name__ for f in sim.force_terms] == ["Membrane"]
    assert set(sim.energy()) == {"stretch_u", "stretch_v", "kinetic"}
    assert not hasattr(sim.force_terms[0], "A") and sim.integrator.system is None
    with pytest.raises(tc.SceneError, match="solves no system"):
        sim.solve(0.01)
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2))
    sim = tc.Simulation(scene)
    sim.step()
    assert [type(f).__name__ for f in sim.force_terms] == ["Gravity"]


def test_turns_of_flat_hinges_are_the_change_of_their_angles(rng):
    """d theta / d height by central differences, on an uneven mesh whose hinges' edges run either way."""
    flat = tc.grid(1.0, 4)
    uv = flat.uv + rng.uniform(-0.06, 0.06, flat.uv.shape)
    mesh = tc.TriMesh(np.column_stack([uv[:, 0], 0 * uv[:, 0], -uv[:, 1]]), flat.faces, uv)
    h, d = hinges(mesh), 1e-6
    turns = np.zeros((len(h.vertices), 4))
    for k in range(4):
        lift = np.zeros((4, 3))
        lift[k, 1] = d
        turns[:, k] = (hinge_angle(mesh.x[h.vertices] + lift) - hinge_angle(mesh.x[h.vertices] - lift)) / (2 * d)
    assert np.abs(turns).max() > 5
    assert np.abs(flat_turns(h) - turns).max() < 1e-6 * np.abs(turns).max()


@pytest.mark.parametrize("bend", ["hinge", "curvature"])
@pytest.mark.parametrize("jitter", [0.0, 0.02])
@pytest.mark.slow
def test_rates_bound_the_fastest_mode_of_flat_cloth(bend, jitter, rng):
    mesh = tc.grid(1.0, 9)
    uv = mesh.uv + rng.uniform(-jitter, jitter, mesh.uv.shape)
    mesh = tc.TriMesh(np.column_stack([uv[:, 0], 0 * uv[:, 0], uv[:, 1]]), mesh.faces, uv)
    for parts in ({"stretch": tc.Stretch((1000, 600)), "shear": tc.Shear(100)}, {"shear": tc.Shear(100)},
                  {"bend": tc.Bend((1e-3, 2e-3), model=bend)}):
        scene = tc.Scene(gravity=None)
        scene.add_cloth(mesh, tc.Fabric(0.2, **parts))
        sim, h = tc.Simulation(scene, preconditioner="none"), 1.0
        n = 3 * sim.vertex_count
        A = np.array([sim.product(e.reshape(-1, 3), h).ravel() for e in np.eye(n)])
        mass = np.repeat(lumped_mass(mesh, 0.2), 3)
        fastest = np.linalg.eigvalsh((A - np.diag(mass)) / np.sqrt(np.outer(mass, mass)) / h**2)[-1]
        bound = sum(force.rates[0] for force in sim.force_terms)
        assert fastest * (1 - 1e-9) < bound < 3 * fastest
        sim.close()


@pytest.mark.slow
def test_panels_of_other_fabrics(rng):
    """Energies, masses and hinges of a mesh in two fabrics: those of its parts, and the mean where they meet."""
    mesh = tc.grid(1.0, 4)
    left, right = np.flatnonzero(mesh.uv[:, 0] < 0.51), np.flatnonzero(mesh.uv[:, 0] > 0.49)
    mesh = tc.TriMesh(mesh.x, mesh.faces, mesh.uv, {"right": right})
    one = tc.Fabric(0.1, tc.Stretch((500, 300), 1), tc.Shear(50), tc.Bend((1e-3, 2e-3)))
    other = tc.Fabric(0.4, tc.Stretch(2000, 3), bend=tc.Bend(5e-3))
    x = mesh.x + 0.05 * rng.normal(size=mesh.x.shape)

    def energies(fabric, panels=None, faces=None):
        scene = tc.Scene(gravity=None)
        part = mesh if faces is None else tc.TriMesh(mesh.x, mesh.faces[faces], mesh.uv)
        scene.add_cloth(part, fabric, positions=x, panels=panels)
        return tc.Simulation(scene)

    of_right = np.isin(mesh.faces, right).all(axis=1)
    both = energies(one, {"right": other})
    parts = [energies(one, faces=~of_right), energies(other, faces=of_right)]
    assert (both.scene.cloths[0].fabric_of == of_right).all() and 0 < of_right.sum() < len(of_right) and len(left)
    for term in ("stretch_u", "stretch_v", "shear"):
        assert both.energy()[term] == pytest.approx(sum(p.energy().get(term, 0.0) for p in parts), rel=1e-12)
    h = hinges(mesh)
    D = np.where(of_right[h.faces][:, :, None], [5e-3, 5e-3], [1e-3, 2e-3]).mean(axis=1)
    k = h.length2 / h.areas.sum(axis=1) * (h.across * D).sum(axis=1)
    theta = hinge_angle(x[h.vertices])
    assert both.energy()["bend"] == pytest.approx(0.5 * np.sum(k * theta**2), rel=1e-9)
    mass = lumped_mass(mesh, np.where(of_right, 0.4, 0.1))
    assert np.abs(both.model.mass - mass[both.model.user]).max() < 1e-15 and mass.sum() == pytest.approx(0.25)
    for fabric, panels, what in ((one, {"right": tc.Fabric(1.0, bend=tc.Bend(1e-3, model="curvature"))}, "bend over hinges"),
                                 (one, {"left": other}, "left"), (one, {"right": 3}, "right"), (one, [other], "panels")):
        with pytest.raises((tc.SceneError, tc.MeshError), match=what):
            energies(fabric, panels)


@pytest.mark.parametrize("angle", [0.7, -0.4])
def test_a_crease_comes_to_its_angle(angle):
    """By a line over the pattern; positive where the side that normals point to opens. Beside it the cloth is flat."""
    mesh = tc.grid((0.4, 0.2), (4, 2))
    scene = tc.Scene(gravity=None)
    stiff = tc.Fabric(0.2, tc.Stretch(1000, 10), tc.Shear(1000, 10), tc.Bend(1e-2, 1e-2))
    cloth = scene.add_cloth(mesh, stiff, velocities=[0.0, 0.01, 0.0])
    crease = scene.crease(cloth, 1.0, edges=[[7, 12], [7, 2]])
    assert crease.edges.tolist() == [[7, 12], [2, 7]]
    assert scene.crease(cloth, angle, line=[(0.2, 0.0), (0.2, 0.2)], stiffness=2.0).edges.tolist() == [[2, 7], [7, 12]]
    sim = tc.Simulation(scene, h=0.05, integrator="backward_euler", cg_tol=1e-10)
    sim.run(30.0, fps=1)
    x = sim.positions()
    sim.close()
    normals = np.cross(x[mesh.faces[:, 1]] - x[mesh.faces[:, 0]], x[mesh.faces[:, 2]] - x[mesh.faces[:, 0]])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    right = mesh.corner_uv.mean(axis=1)[:, 0] > 0.2
    for side in (right, ~right):
        assert normals[side] == pytest.approx(np.broadcast_to(normals[side][0], normals[side].shape), abs=1e-6)
    a, b = normals[~right][0], normals[right][0]
    outwards = x[[4, 9, 14]].mean(axis=0) - x[[0, 5, 10]].mean(axis=0)
    assert np.arccos(a @ b) == pytest.approx(abs(angle), abs=1e-4) and np.sign((b - a) @ outwards) == np.sign(angle)


def test_angles_of_all_inner_edges_are_a_rest_shape(rng):
    """Those of a crumpled shape: there no hinge has a moment, in any order of the mesh's own."""
    mesh = tc.grid((0.4, 0.3), (4, 3))
    x = mesh.x + rng.normal(scale=0.01, size=mesh.x.shape)
    angles = []
    for i, j in mesh.inner_edges:
        (s, a), (t, b) = [(f, k) for f in mesh.faces for k in f if i in f and j in f and k not in (i, j)]
        e = x[j] - x[i]
        first = s if list(s).index(j) == (list(s).index(i) + 1) % 3 else t  # the triangle in which the edge runs from i to j
        arms = (x[a] - x[i], x[b] - x[i]) if first is s else (x[b] - x[i], x[a] - x[i])
        n, m = np.cross(e, arms[0]), np.cross(arms[1], e)
        angles.append(np.arctan2(np.cross(n, m) @ e / np.linalg.norm(e), n @ m))
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1e-9), tc.Shear(1e-9), tc.Bend(1e-3, rest=np.array(angles))), positions=x)
    sim = tc.Simulation(scene, h=1 / 60)
    assert sim.energy()["bend"] < 1e-20 and np.abs(sim.forces()).max() < 1e-8
    sim.close()
    for rest, what in ((angles[:-1], "angles, but its mesh has"), ([4.0] * len(angles), "-pi to pi"), ([[0.1]], "shape")):
        with pytest.raises(tc.SceneError, match=what):
            tc.Scene().add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1), bend=tc.Bend(1e-3, rest=rest)))
    named = tc.TriMesh(mesh.x, mesh.faces, mesh.uv, groups={"all": range(mesh.vertex_count)})
    with pytest.raises(tc.SceneError, match="angles, but its mesh has"):
        tc.Scene().add_cloth(named, tc.Fabric(0.2, tc.Stretch(1)),
                             panels={"all": tc.Fabric(0.2, tc.Stretch(1), bend=tc.Bend(1e-3, rest=angles[:-1]))})


def test_creases_that_cannot_be(rng):
    mesh = tc.grid((0.4, 0.2), (4, 2))
    scene = tc.Scene()
    cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-5)))
    curved = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-5, model="curvature")))
    other = tc.Scene().add_cloth(mesh, cloth.fabric, name="other")
    for what, given in (("line over the pattern, or edges", {}), ("line over", {"line": [(0, 0), (1, 1)], "edges": [[2, 7]]}),
                        ("no edge between two", {"line": [(0.15, 0), (0.15, 0.2)]}), ("two points", {"line": [(0.2, 0)]}),
                        ("needs shape", {"line": [0.2, 0]}), ("vertices 0 and 1", {"edges": [[0, 1]]}),
                        ("out of range", {"edges": [[2, 70]]}), ("twice", {"edges": [[2, 7], [7, 2]]}),
                        ("no edges", {"edges": np.zeros((0, 2), dtype=int)})):
        with pytest.raises(tc.SceneError, match=what):
            scene.crease(cloth, 0.5, **given)
    for what, target, angle, factor in (("from -3.14159 to 3.14159", cloth, 4.0, 1.0),
                                        ("-pi to pi", cloth, [4.0], 1.0), ("shape", cloth, [0.1, 0.2], 1.0),
                                        ("stiffness", cloth, 0.1, -1.0), ("over hinges", curved, 0.1, 1.0),
                                        ("not a cloth of this scene", other, 0.1, 1.0)):
        with pytest.raises(tc.SceneError, match=what):
            scene.crease(target, angle, edges=[[2, 7]], stiffness=factor)
    assert not scene.creases
