"""Closed forms: free fall, hanging strip, weights, momenta; and orders of convergence."""

import re

import numpy as np
import pytest

import taichi_cloth as tc

G = 9.81


@pytest.mark.parametrize("integrator", ["backward_euler", "newton_euler", "safe", "verlet"])
@pytest.mark.parametrize("precision, tolerance", [("f64", 1e-13), ("f32", 2e-6)])
@pytest.mark.slow
def test_free_fall_is_exact(integrator, precision, tolerance):
    scene = tc.Scene()
    v_0 = np.array([0.3, 1.0, -0.2])
    fabric = tc.Fabric(0.2, tc.Stretch(1e4), tc.Shear(1e3), tc.Bend(1e-4))
    cloth = scene.add_cloth(tc.grid(1.0, 5), fabric, velocities=v_0)
    tolerance *= 200 if integrator == "verlet" else 1  # hundreds of substeps, each rounded
    sim = tc.Simulation(scene, h=1 / 50, integrator=integrator, precision=precision)
    n, h, g = 20, 1 / 50, np.array([0, -G, 0])
    for _ in range(n):
        sim.step()
    ahead = 1 if "euler" in integrator else 0  # backward Euler falls by g t h / 2 too far, second order not
    expected = cloth.mesh.x + n * h * v_0 + g * h * h * n * (n + ahead) / 2
    assert np.abs(sim.positions() - expected).max() < tolerance
    assert np.abs(sim.velocities() - (v_0 + n * h * g)).max() < 20 * tolerance


@pytest.mark.parametrize("cells", [5, 10, 20, 40])
def test_hanging_strip(cells):
    k, density, length = 500.0, 0.2, 1.0
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid((0.2, length), (max(1, cells // 5), cells), plane="xy"),
                            tc.Fabric(density, tc.Stretch(k), tc.Shear(100)))
    scene.pin(cloth, "top")
    sim = tc.Simulation(scene, h=0.5, cg_tol=1e-10, stretch_limit=1e9)
    for _ in range(12):  # steps far longer than any period: statics
        sim.step()
    bottom = cloth.mesh.select("bottom")
    sag = (cloth.mesh.x[bottom, 1] - sim.positions()[bottom, 1]).mean()
    assert sag == pytest.approx(density * G * length**2 / (2 * k), rel=1e-3)
    assert sim.stretch()[:, 0].max() == pytest.approx(1 + density * G * length / k * (1 - 0.5 / cells), abs=2e-4)
    weight = density * 0.2 * length * G
    assert sim.constraint_forces()[:, 1].sum() == pytest.approx(weight, rel=1e-5)


def test_momenta_are_conserved_through_steps(rng):
    mesh = tc.grid(1.0, 6)
    scene = tc.Scene(gravity=None)
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500, 0.5), tc.Shear(50, 0.05), tc.Bend(1e-3, 1e-5)),
                    mesh.x + 0.01 * rng.normal(size=mesh.x.shape), velocities=np.cross([0, 2.0, 1.0], mesh.x))
    # Gauss-Newton forces act along the conditions' gradients at the start of the step: no torque
    sim = tc.Simulation(scene, K="gauss_newton", cg_tol=1e-13, h=1 / 200, adaptive=False, integrator="backward_euler")
    m = np.zeros((mesh.vertex_count, 1))
    m[sim.model.user, 0] = sim.model.mass
    p_0, L_0 = (m * sim.velocities()).sum(axis=0), np.cross(sim.positions(), m * sim.velocities()).sum(axis=0)
    for _ in range(25):
        sim.step()
    assert all(r.solves == 1 for r in sim.log)
    p, L = (m * sim.velocities()).sum(axis=0), np.cross(sim.positions(), m * sim.velocities()).sum(axis=0)
    assert np.abs(p - p_0).max() < 1e-11 * np.abs(p_0).max()
    assert np.abs(L - L_0).max() < 1e-9 * np.abs(L_0).max()


def swing(h, integrator="backward_euler", t=0.2, parts=(1.0,)):
    """End state of a small, soft, damped sheet, in steps that are parts of h."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 4), tc.Fabric(0.3, tc.Stretch(20, 0.3), tc.Shear(5, 0.1), tc.Bend(1e-2, 1e-3)))
    scene.pin(cloth, "left")
    K = "gauss_newton" if integrator == "backward_euler" else "projected"
    sim = tc.Simulation(scene, h=h, integrator=integrator, cg_tol=1e-12, adaptive=False, K=K, newton_tol=1e-8,
                        newton_max=300)
    for _ in range(round(t / h)):
        for part in parts:
            sim.step(part * h)
    assert sim.time == pytest.approx(t)
    x = sim.positions()
    sim.close()
    return x


@pytest.fixture(scope="module")
def limit() -> np.ndarray:
    """Positions at the end of the swing as steps of one method go to zero."""
    fine, finer = swing(0.2 / 1280, "verlet"), swing(0.2 / 2560, "verlet")
    return (4 * finer - fine) / 3


@pytest.mark.parametrize("integrator, order", [("backward_euler", 1), ("newton_euler", 1), ("tr_bdf2", 2), ("verlet", 2)])
@pytest.mark.slow
def test_methods_converge_to_one_limit(limit, integrator, order):
    """Halving the step halves or quarters the error against Richardson's extrapolation of another method."""
    steps = [0.2 / n for n in ((80, 160, 320) if order == 1 or integrator == "verlet" else (20, 40, 80))]
    error = [np.sqrt(np.mean((swing(h, integrator) - limit) ** 2)) for h in steps]
    rates = np.log2(np.array(error[:-1]) / error[1:])
    assert abs(rates[-1] - order) < (0.05 if order == 1 else 0.1), (rates, error)
    if integrator == "tr_bdf2":
        error = [np.sqrt(np.mean((swing(h, integrator, parts=(0.5, 0.15, 0.35)) - limit) ** 2)) for h in steps]
        assert abs(np.log2(error[-2] / error[-1]) - 2) < 0.1, error


@pytest.mark.slow
def test_the_pitch_of_a_string_is_of_second_order_in_the_mesh():
    """A strip stretched by 5 % swings as a string, f = sqrt(k (l - 1) / (sigma l)) / 2 m; seen after 5 1/4 swings."""
    k, stretch, size = 500.0, 1.05, 1e-4
    exact, error = np.sqrt(k * (stretch - 1) / (0.2 * stretch)) / 2, []
    for n in (8, 16, 32):
        mesh = tc.grid((1.0, 0.1), (n, 1))
        start = mesh.x * [stretch, 1, 1]
        start[:, 1] = size * np.sin(np.pi * mesh.x[:, 0])
        scene = tc.Scene(gravity=None)
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(k)), start)
        scene.pin(cloth, "left")
        scene.pin(cloth, "right")
        sim = tc.Simulation(scene, h=1 / 2000, integrator="verlet")
        sim.run(5.25 / exact, exact / 5.25)
        phase = np.arcsin(sim.positions()[np.argmin(np.abs(mesh.x[:, 0] - 0.5)), 1] / size)
        error.append(abs(phase) / (10.5 * np.pi))
        sim.close()
    assert error[-1] < 1e-3 and np.abs(np.log2(np.array(error[:-1]) / error[1:]) - 2).max() < 0.1, error


def test_explicit_steps_are_stable_and_not_needlessly_small():
    """The bound is safe, and not by much: ten times it blows up, and is told."""
    scene = tc.Scene()
    cloth = scene.add_cloth(tc.grid(1.0, 10), tc.Fabric(0.2, tc.Stretch(1000), tc.Shear(100), tc.Bend(1e-5)))
    scene.pin(cloth, "left")
    sim = tc.Simulation(scene, h=1 / 60, integrator="verlet")
    limit = sim.integrator.stable_step
    assert 0.25 < limit / (0.81 * 0.1 * np.sqrt(0.2 / 1000)) < 1.5  # measured limit of a uniform sheet
    sim.run(0.3, 10)
    assert max(r.stretch for r in sim.log) < 1.3 and not any(r.rejections for r in sim.log)
    assert sum(r.evaluations for r in sim.log) > 0.3 / limit
    wild = tc.Simulation(scene, h=10 * limit, integrator="verlet", adaptive=False)
    with pytest.raises(tc.SimulationError, match="NOT_FINITE"):
        wild.run(0.3, 10)


@pytest.mark.parametrize("damping", [0.0, 0.5])
@pytest.mark.slow
def test_a_substep_is_kept_and_softens_only_what_it_must(damping):
    mesh = tc.grid(1.0, 10)
    uv = mesh.uv.copy()
    uv[60] = uv[61] + [-0.001, 0]  # triangles a hundredth as high as the others
    mesh = tc.TriMesh(np.column_stack([uv, 0 * uv[:, 0]]), mesh.faces, uv)
    scene = tc.Scene(gravity=None)
    x = mesh.x * [1.001, 1, 1]
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, damping), tc.Shear(100)), x)
    as_it_is = tc.Simulation(scene, integrator="verlet")
    plain, stable = as_it_is.forces(), as_it_is.integrator.stable_step
    step = 3 * stable
    sim = tc.Simulation(scene, integrator="verlet", substep=step)
    assert 0.9 * sim.integrator.stable_step == pytest.approx(step)
    near = np.unique(mesh.faces[(mesh.faces[:, :, None] == [60, 61]).any(axis=(1, 2))])
    touched = np.unique(mesh.faces[np.isin(mesh.faces, near).any(axis=1)])
    far = np.setdiff1d(np.arange(len(x)), touched)
    assert len(far) > 80 and np.array_equal(sim.forces()[far], plain[far])
    left = sim.energy()["stretch_u"] / as_it_is.energy()["stretch_u"]  # of what the few softened triangles hold, little
    assert 0.9 < left < 1
    softened, of = (int(word) for word in re.findall(r"(\d+) of (\d+) triangles", sim.notes[0])[0])
    assert 0 < softened < 20 and of == len(mesh.faces)
    sim.run(0.2, 10)
    assert sum(r.evaluations for r in sim.log) < 2.2 * 0.2 / step + 20 and sim.log[-1].stretch < 1.002


def test_a_substep_finer_than_the_stable_one_softens_nothing():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 4), tc.Fabric(0.2, tc.Stretch(1000)))
    sim = tc.Simulation(scene, integrator="verlet", substep=1e-4)
    assert sim.notes == []
    sim.run(0.1, 10)
    assert 1000 <= sum(r.evaluations for r in sim.log) <= 1002
    with pytest.raises(tc.SceneError, match="substep.*'verlet', not 'safe'"):
        tc.Simulation(scene, substep=1e-4)
    with pytest.raises(tc.SceneError, match="substep = -1"):
        tc.Simulation(scene, integrator="verlet", substep=-1)


def test_drag_brings_cloth_to_the_wind():
    scene = tc.Scene(gravity=None, air=tc.Air(4.0, 4.0, lambda t: (3.0, 1.0, 0.0)))
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, tc.Stretch(100)))
    sim = tc.Simulation(scene, h=1 / 100, cg_tol=1e-12, integrator="backward_euler")
    n, h = 10, 1 / 100
    for _ in range(n):
        sim.step()
    left = (1 + h * 4.0 / 0.2) ** -n  # backward Euler of v' = -(c/sigma) (v - w)
    assert np.abs(sim.velocities().mean(axis=0) - np.array([3.0, 1.0, 0]) * (1 - left)).max() < 1e-9


@pytest.mark.restarts
@pytest.mark.slow
def test_far_from_the_origin_in_f32():
    ends = []
    for shift in (0.0, 1e4):
        mesh = tc.grid(1.0, 8)
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500, 1), tc.Shear(50)), mesh.x + [shift, 0, 0])
        scene.pin(cloth, "left")
        sim = tc.Simulation(scene, precision="f32", cg_tol=1e-5)
        sim.run(0.3, 10)
        ends.append(sim.positions() - [shift, 0, 0])
        sim.close()
    assert np.abs(ends[0] - ends[1]).max() < 1e-3
