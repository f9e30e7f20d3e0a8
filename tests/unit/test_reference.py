"""Energies, forces, matrices, solutions and a step against the dense NumPy of tests/reference, on irregular meshes."""

import numpy as np
import pytest
from reference import system
from reference.conditions import deformation, membrane, theta
from reference.jet import variables
from reference.rest import area, hinges
from reference.sheet import Sheet

import taichi_cloth as tc
from taichi_cloth.backend.rows import read

pytestmark = pytest.mark.restarts

TOLERANCE = 1e-10  # relative: both sides are float64; directions of small triangles lose a few digits
MODES = ("projected", "gauss_newton", "paper")
STATES = ("wavy", "compressed", "folded", "collapsed", "crumpled")


def sheet_mesh(rng, cells, seam=False):
    """A jittered rectangle whose diagonals go either way; with `seam`, panels apart and turned in the material plane."""
    grid = tc.grid((1.0, 0.7), cells)
    uv = np.array(grid.uv)
    inner = (uv > uv.min(axis=0) + 1e-9).all(axis=1) & (uv < uv.max(axis=0) - 1e-9).all(axis=1)
    uv[inner] += rng.uniform(-0.06, 0.06, (int(inner.sum()), 2))
    faces = []
    for i, j in np.ndindex(*cells):
        a, b = j * (cells[0] + 1) + i, (j + 1) * (cells[0] + 1) + i
        quad = [a, a + 1, b + 1, b]
        turned = quad[1:] + quad[:1] if rng.uniform() < 0.5 else quad
        faces += [turned[:3], [turned[0], turned[2], turned[3]]]
    corner = uv[np.array(faces)]
    if seam:
        angle = rng.uniform(0, 6, (len(faces) // 4 + 1, 1, 1)).repeat(4, axis=0)[:len(faces)]
        u, v = corner[..., :1], corner[..., 1:]
        corner = np.concatenate([np.cos(angle) * u - np.sin(angle) * v, np.sin(angle) * u + np.cos(angle) * v], axis=2)
    return tc.TriMesh(np.column_stack([uv, 0.05 * rng.normal(size=len(uv))]), faces, corner)


def make_scene(rng):
    """Three fabrics: hinges with a seam, curvatures, and a mesh without a pattern, bent at rest; wind and a point mass."""
    scene = tc.Scene(gravity=(0.3, -9.81, 0.2), air=tc.Air(1.7, 0.4, (2.0, -1.0, 3.0)))
    fabrics = (tc.Fabric(0.2, tc.Stretch((80, 60), (0.8, 0.5), (1.05, 0.96)), tc.Shear(20, 0.3),
                         tc.Bend((0.02, 0.05), (2e-3, 1e-3))),
               tc.Fabric(0.3, tc.Stretch(50, 0.2), None, tc.Bend((0.03, 0.01), (1e-3, 4e-3), model="curvature")),
               tc.Fabric(0.1, None, tc.Shear(30), tc.Bend(0.04, 3e-3)))
    meshes = [sheet_mesh(rng, (3, 2), seam=True), sheet_mesh(rng, (3, 3)), sheet_mesh(rng, (2, 3))]
    meshes[2] = tc.TriMesh(meshes[2].x * [1, 1, 4], meshes[2].faces)
    assert meshes[2].flattened
    cloths = [scene.add_cloth(mesh, fabric) for mesh, fabric in zip(meshes, fabrics)]
    scene.add_mass(cloths[1], 5, 0.07)
    return scene


def state(name, scene, rng):
    """(x, v) of a named kind."""
    x = np.concatenate([c.mesh.x for c in scene.cloths])
    noise = rng.normal(size=x.shape)
    if name == "wavy":
        x = x * 1.08 + 0.03 * noise
    elif name == "compressed":
        x = x * [0.55, 0.8, 1] + 0.02 * noise
    elif name == "folded":  # every third hinge, onto itself and some beyond
        x = x + 0.03 * noise
        for cloth in scene.cloths:
            for hinge in hinges(cloth.mesh)[::3]:
                *_, a, b = np.array(hinge["vertices"]) + cloth.start
                x[b] = x[a] + 0.02 * noise[b]
    elif name == "collapsed":  # to a hundredth in one direction: most triangles have less than a tenth of their area
        x = x @ np.array([[1, 0.2, 0.1], [0.02, 0.01, 0.01], [0.1, 0.1, 0.02]]) + 0.004 * noise
    else:
        x = x + 0.3 * noise
    return x, rng.normal(size=x.shape)


@pytest.fixture(scope="module", params=MODES)
def case(request):
    """(scene, simulation, K), one for all states."""
    scene = make_scene(np.random.default_rng(7193))
    sim = tc.Simulation(scene, K=request.param, cg_tol=1e-14, preconditioner="block_jacobi", threads=2)
    yield scene, sim, request.param
    sim.close()


def assert_close(ours, theirs, tolerance=TOLERANCE):
    assert np.abs(ours - theirs).max() <= tolerance * np.abs(theirs).max()


def particles(sim, values):
    """Rows of per-vertex data in the simulation's order."""
    return values[sim.model.user]


@pytest.mark.parametrize("name", STATES)
@pytest.mark.slow
def test_energies_forces_and_matrices(case, name):
    scene, sim, K = case
    rng = np.random.default_rng(811 + STATES.index(name))
    x, v = state(name, scene, rng)
    sheet = Sheet(scene, x, v, K)
    sim.set_state(x, v)
    energy = sim.energy()
    assert energy.pop("kinetic") == pytest.approx(np.sum(sheet.mass[:, None] * v**2) / 2, rel=TOLERANCE)
    assert energy.keys() == sheet.energy.keys()
    for term, value in energy.items():
        assert value == pytest.approx(sheet.energy[term], rel=TOLERANCE), term
    assert sim.meter.measure().dissipation == pytest.approx(sheet.rayleigh, rel=TOLERANCE)
    assert_close(sim.forces(), sheet.force)
    n, h = len(x), 0.05
    for p in rng.normal(size=(3, n, 3)):
        moved = sheet.mass[:, None] * p
        first, second = moved - sim.product(p, 1.0), moved - sim.product(p, 2.0)
        assert_close(second / 2 - first, (sheet.K @ p.ravel()).reshape(n, 3))
        assert_close(2 * first - second / 2, (sheet.D @ p.ravel()).reshape(n, 3), 1e-9)
    assert_close(sim.right_hand_side(h), system.right_hand_side(sheet, h).reshape(n, 3))
    A = system.matrix(sheet, h)
    blocks = np.array([A[3 * i:3 * i + 3, 3 * i:3 * i + 3][np.triu_indices(3)] for i in range(n)])
    assert_close(read(sim.integrator.system.operator.P), particles(sim, blocks))
    dense = np.stack([sim.product(e.reshape(n, 3), h).ravel() for e in np.eye(3 * n)[::7]])
    assert_close(dense, A[::7])


def test_the_states_reach_what_they_are_for():
    """Folds past the crest, triangles that fade, and shear either way with eigenvalues to clamp."""
    scene = make_scene(np.random.default_rng(7193))
    steepest, least, shears = {}, {}, {}
    for name in STATES:
        x, _ = state(name, scene, np.random.default_rng(811 + STATES.index(name)))
        angles, parts, shears[name] = [], [], []
        for cloth in (scene.cloths[0], scene.cloths[2]):
            for hinge in hinges(cloth.mesh):
                angles.append(abs(theta(variables(x[np.array(hinge["vertices"]) + cloth.start])).value))
            for face, uv in zip(cloth.mesh.faces + cloth.start, cloth.mesh.corner_uv):
                *_, shear, _ = membrane(x[face], uv, (1, 1))
                shears[name].append(shear.value)
                parts.append(np.linalg.norm(np.cross(x[face[1]] - x[face[0]], x[face[2]] - x[face[0]])) / 2 / area(uv))
        steepest[name], least[name] = max(angles), min(parts)
    assert steepest["folded"] > np.pi - 0.2 and steepest["wavy"] < 2
    assert least["collapsed"] < 0.05 and least["wavy"] > 0.5
    assert all(min(s) < -0.03 and max(s) > 0.03 for s in shears.values())


@pytest.mark.parametrize("name", STATES)
def test_solutions_with_held_directions(case, name):
    """Delta v of eq. (18) with nothing held, then 0 to 3 directions of half of the vertices, z and y; constraint forces."""
    scene, sim, K = case
    rng = np.random.default_rng(3301 + STATES.index(name))
    x, v = state(name, scene, rng)
    sheet, h = Sheet(scene, x, v, K), 0.02
    sim.set_state(x, v)
    if np.linalg.eigvalsh(system.matrix(sheet, h))[0] <= 0:
        assert K == "paper" and name != "wavy"
        with pytest.raises(tc.SimulationError, match="BREAKDOWN"):
            sim.solve(h, [])
        return
    assert_close(sim.solve(h, []), system.solve(sheet, h)[0], 1e-9)
    constraints = [tc.Constraint(int(i), rng.normal(size=(1 + k % 3, 3)), rng.normal(size=3), 0.01 * rng.normal(size=3))
                   for k, i in enumerate(rng.permutation(len(x))[:len(x) // 3])]
    dv, impulse = system.solve(sheet, h, [(c.vertex, c.basis, c.z, c.y) for c in constraints])
    assert_close(sim.solve(h, constraints), dv, 1e-9)
    assert_close(sim.constraint_forces(), impulse / h, 1e-8)


@pytest.mark.slow
def test_a_step_of_backward_euler():
    """With a pin and a vertex that is led."""
    rng = np.random.default_rng(523)
    scene = make_scene(rng)
    x, v = state("wavy", scene, rng)
    first = scene.cloths[0]
    scene.pin(first, 0, "y")
    scene.move(first, 7, lambda t: (3 * t, -t, t * t), relative=True)
    sim = tc.Simulation(scene, integrator="backward_euler", adaptive=False, cg_tol=1e-14, h=0.01)
    sim.set_state(x, 0.1 * v)
    h = 0.01
    target = x[7] + [3 * h, -h, h * h]
    up = np.array([[0.0, 1.0, 0.0]])
    held = [(0, up, -0.1 * v[0], np.zeros(3)), (7, np.eye(3), (target - x[7]) / h - 0.1 * v[7], np.zeros(3))]
    x_1, v_1 = system.backward_euler(Sheet(scene, x, 0.1 * v, "projected"), h, held)
    record = sim.step(h)
    assert record.solves == 1 and not record.rejections
    assert_close(sim.positions(), x_1, 1e-11)
    assert_close(sim.velocities(), v_1, 1e-9)
    sim.close()


def test_measures_of_stretch():
    """The largest |w|/b, its change away from rest in a step, the change of velocity, and what is not finite."""
    rng = np.random.default_rng(77)
    mesh = sheet_mesh(rng, (3, 2))
    fabric = tc.Fabric(0.2, tc.Stretch((80, 60), b=(1.1, 0.9)), tc.Shear(20))
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, fabric, velocities=rng.normal(size=mesh.x.shape))
    sim = tc.Simulation(scene)

    def stretches(x):
        return np.array([[np.linalg.norm(w) / b for w, b in zip(deformation(x[face], uv), (1.1, 0.9))]
                         for face, uv in zip(mesh.faces, mesh.corner_uv)])

    for size in (1.3, 0.4, 1.02, np.array([0.3, 1, 1]), np.array([1, 1, 0.3])):  # stretches, shortens, along u or v alone
        x_0, v_0 = sim.model.read_particles()
        x_1, v_1 = size * x_0 + 0.01 * rng.normal(size=x_0.shape), v_0 + rng.normal(size=v_0.shape)
        sim.model.save()
        sim.model.write_particles(x_1, v_1)
        measures = sim.meter.measure()
        first, second = (stretches(sim.model.to_user(x)) for x in (x_0, x_1))
        assert measures.stretch == pytest.approx(second.max(), rel=1e-12)
        beside = np.sign(first - 1) == np.sign(second - 1)  # of rest, before and after: what springs back does not count
        away = np.abs(second - 1) - np.where(beside, np.abs(first - 1), 0.0)
        assert measures.stretch_change == pytest.approx(away.max(), rel=1e-12)
        for vertex in mesh.faces[away.max(axis=1).argmax()]:
            led = sim.model.user == vertex
            beside = (mesh.faces != vertex).all(axis=1)
            assert sim.meter.change_beside(led) == pytest.approx(away[beside].max(), rel=1e-12)
        assert measures.change == pytest.approx(np.sum(sim.model.mass[:, None] * (v_1 - v_0) ** 2) / 2, rel=1e-12)
        assert measures.finite
        sim.model.restore()
        assert all((a == b).all() for a, b in zip(sim.model.read_particles(), (x_0, v_0)))
    for k in (0, 1):
        state = [np.array(a) for a in (x_1, v_1)]
        state[k][3, 1] = np.nan
        sim.model.write_particles(*state)
        assert not sim.meter.measure().finite
    sim.close()


def test_rates_of_drag():
    """The rate of the fastest decay is the larger coefficient over the density."""
    for normal, tangential in ((2.0, 0.5), (0.5, 2.0)):
        scene = tc.Scene(gravity=None, air=tc.Air(normal, tangential))
        scene.add_cloth(tc.grid(1.0, 2), tc.Fabric(0.2))
        sim = tc.Simulation(scene)
        sheet = Sheet(scene, sim.positions(), sim.velocities(), "projected")
        root = np.repeat(sheet.mass, 3) ** -0.5
        fastest = -np.linalg.eigvalsh(root[:, None] * sheet.D * root)[0]
        assert fastest * (1 - 1e-12) <= sum(force.rates[1] for force in sim.force_terms) < 2 * fastest
        sim.close()
