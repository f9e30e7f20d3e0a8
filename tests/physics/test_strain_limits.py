"""Fabrics that stiffen: limits of strain and measured curves, against closed forms of a hanging strip."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc

G, DENSITY, LENGTH, CELLS = 9.81, 0.15, 0.5, 10
STATICS = {"h": 0.5, "integrator": "newton_euler", "newton_tol": 1e-9, "newton_max": 40, "cg_tol": 1e-10, "stretch_limit": 1e9}
KNIT = ((0.0, 0.0), (0.17, 5.6), (0.4, 27.0))  # 33 N/m at rest, 93 from 17 % on


def strip(stretch, load=1.0, shear=None, cells=CELLS, bend=None):
    """A strip that hangs from its upper end, `load` times as heavy as cotton."""
    mesh = tc.grid((0.2, LENGTH), (4, cells), plane="xy")
    scene = tc.Scene(gravity=(0, -G * load, 0))
    cloth = scene.add_cloth(mesh, tc.Fabric(DENSITY, stretch, shear, bend))
    scene.pin(cloth, "top")
    return scene, cloth


def rows(sim, cells=CELLS):
    """(cells,) stretch along the weft of each row of triangles, from positions, the lowest first."""
    y = sim.positions()[:, 1].reshape(cells + 1, -1).mean(axis=1)
    return np.abs(np.diff(np.sort(y))) / (LENGTH / cells)


def hung(sim, load, cells=CELLS):
    """(cells,) tension [N/m] in each row, the lowest first: the weight of the vertices below it over its width."""
    mass = np.zeros(sim.vertex_count)
    mass[sim.model.user] = sim.model.mass
    level = sim.scene.cloths[0].mesh.x[:, 1]
    lowest = np.sort(np.unique(np.round(level, 9)))[:cells]
    return np.array([mass[level < y + 1e-6].sum() for y in lowest]) * G * load / 0.2


def inverse(law, tension):
    """Stretch at which an increasing law has a tension."""
    low, high = np.full(len(tension), 0.5), np.full(len(tension), 3.0)
    for _ in range(80):
        middle = (low + high) / 2
        low, high = np.where(law(middle) < tension, middle, low), np.where(law(middle) < tension, high, middle)
    return low


@pytest.mark.parametrize("load", [1, 3, 10])
@pytest.mark.slow
def test_a_strip_hangs_as_far_as_its_limit_lets_it(load):
    """T = k C + 1000 k (s - L)^2 / (L - b), row by row; at ten times its weight it is a tenth beyond its limit at most."""
    k, limit = 50.0, 1.02
    scene, _ = strip(tc.Stretch(k, limit=limit), load, tc.Shear(20))
    sim = tc.Simulation(scene, **STATICS)
    for _ in range(14):
        sim.step()
    expected = inverse(lambda s: k * (s - 1) + 1000 * k * np.maximum(s - limit, 0) ** 2 / (limit - 1), hung(sim, load))
    sag = rows(sim).mean() - 1
    assert sag == pytest.approx(expected.mean() - 1, rel=1e-3) and np.abs(rows(sim) - expected).max() < 0.03 * (limit - 1)
    assert (expected.max() > limit) == (load > 1) and expected.max() - 1 < 1.13 * (limit - 1) * max(1, load / 10)
    energy = sim.energy()
    over = np.maximum(rows(sim) - limit, 0)
    stored = (k / 2 * (rows(sim) - 1) ** 2 + 1000 * k / 3 * over**3 / (limit - 1)).sum() * 0.2 * LENGTH / CELLS
    assert energy["stretch_u"] + energy["stretch_v"] == pytest.approx(stored, rel=3e-3)
    sim.close()


@pytest.mark.parametrize("load", [2, 12])
@pytest.mark.slow
def test_a_knit_follows_its_curve(load):
    scene, _ = strip(tc.Stretch(curve=KNIT), load, tc.Shear(5))
    sim = tc.Simulation(scene, **STATICS)
    for _ in range(14):
        sim.step()
    strain, tension = np.array(KNIT).T
    expected = 1 + np.interp(hung(sim, load), tension, strain)
    assert rows(sim).mean() - 1 == pytest.approx(expected.mean() - 1, rel=1e-3)
    assert np.abs(rows(sim) - expected).max() < 0.02 * (expected.max() - 1)
    assert (expected > 1.17).any() == (load == 12)
    sim.close()


@pytest.mark.parametrize("integrator", ["safe", "backward_euler", "newton_euler"])
@pytest.mark.slow
def test_cloth_that_falls_into_its_limit_takes_no_smaller_steps(integrator):
    """Ten times its weight let go at once, at h = 1/60: no step is rejected, CG takes at most 1.5 times the iterations that
    cloth as stiff as the limit needs."""
    ends = []
    for stretch in (tc.Stretch(100, 0.02, limit=1.05), tc.Stretch(2000, 0.02)):
        scene, _ = strip(stretch, 10, tc.Shear(20, 0.002), 20, tc.Bend(1e-5))
        with tc.Simulation(scene, h=1 / 60, integrator=integrator) as sim:
            sim.run(1.0, 30)
            assert len(sim.log) == 60 and not any(r.rejections for r in sim.log)
            total = sum(r.iterations for r in sim.log)
            ends.append((rows(sim, 20).max(), total, total / sum(r.solves for r in sim.log)))
    (stretched, total, iterations), (_, most, stiff) = ends
    assert stretched < 1.056 and total < 1.5 * most and iterations < 1.5 * stiff, ends


@pytest.mark.parametrize("integrator", ["safe", "backward_euler", "newton_euler"])
@pytest.mark.slow
def test_cotton_with_a_limit_takes_hardly_more_iterations(integrator):
    """Shirting of cotton under ten times its weight, held at two corners, h = 1/60: with a limit of 5 % no step is rejected,
    and CG takes at most 1.25 times the iterations of the same cloth without one."""
    mesh, cotton, ends = tc.grid(1, 30, plane="xy"), tc.fabrics["shirting"], []
    for limit in (None, 1.05):
        scene = tc.Scene(gravity=(0, -10 * G, 0))
        cloth = scene.add_cloth(mesh, replace(cotton, stretch=replace(cotton.stretch, limit=limit)))
        scene.pin(cloth, ["top_left", "top_right"])
        with tc.Simulation(scene, h=1 / 60, integrator=integrator) as sim:
            sim.run(1.0, 30)
            assert len(sim.log) == 60 and not any(r.rejections for r in sim.log)
            ends.append((sum(r.iterations for r in sim.log), max(r.stretch for r in sim.log)))
    (without, free), (iterations, limited) = ends
    assert free > 1.065 and limited < 1.055, ends
    assert iterations < 1.25 * without, ends


def test_what_does_not_come_to_its_limit_is_as_without(rng):
    """Compression, shear and bending are not stiffer, and no digit differs."""
    def run(limit, shear):
        mesh = tc.grid(0.5, 6)
        scene = tc.Scene()
        fabric = tc.Fabric(0.2, tc.Stretch(300, 0.1, limit=limit), tc.Shear(30, limit=shear), tc.Bend(1e-4))
        cloth = scene.add_cloth(mesh, fabric,
                                mesh.x * 0.9 + 0.002 * np.random.default_rng(3).normal(size=mesh.x.shape))
        scene.pin(cloth, "corners")
        with tc.Simulation(scene, h=1 / 60, integrator="backward_euler") as sim:
            f = sim.forces()
            assert sim.stretch().max() < 1.2
            for _ in range(5):
                sim.step()
            return f, sim.positions()

    (f, x), (f_limit, x_limit) = run(None, None), run(1.5, 0.9)
    assert np.abs(f - f_limit).max() < 1e-13 * np.abs(f).max() and np.abs(x - x_limit).max() < 1e-12


@pytest.mark.slow
def test_shear_has_a_limit():
    """A square that is pulled askew at its corners by dead weights comes to where T(C) holds them, far short of k C alone."""
    mesh = tc.grid(0.2, 4, plane="xy")
    ends = []
    for limit in (None, 0.1):
        scene = tc.Scene(gravity=(4.0, 0, 0))
        cloth = scene.add_cloth(mesh, tc.Fabric(0.5, tc.Stretch(3000, 10), tc.Shear(1.0, limit=limit)))
        scene.pin(cloth, "top")
        with tc.Simulation(scene, h=0.5, stretch_limit=1e9) as sim:
            for _ in range(10):
                sim.step()
            x = sim.positions().reshape(5, 5, 3)
            lean = (x[0, :, 0] - x[-1, :, 0]).mean() / 0.2
            ends.append(abs(lean))
    assert ends[0] > 0.18 and 0.05 < ends[1] < 0.125, ends


def test_explicit_steps_are_bounded_by_what_a_limit_can_be():
    rates = []
    for limit in (None, 1.05):
        scene, _ = strip(tc.Stretch(100, limit=limit))
        with tc.Simulation(scene, integrator="verlet") as sim:
            rates.append(sim.force_terms[0].rates[0])
    assert 150 < rates[1] / rates[0] < 250


@pytest.mark.parametrize("make, words", [
    (lambda: tc.Stretch(100, limit=0.9), "stretch limit = 0.9: must be more than 1"),
    (lambda: tc.Stretch(100, b=1.2, limit=1.1), "more than 1, and than the rest stretch b = 1.2"),
    (lambda: tc.Stretch(100, limit=(1.1, 1.0)), "stretch limit = 1: must"),
    (lambda: tc.Shear(10, limit=0), "shear limit = 0"),
    (lambda: tc.Stretch(100, curve=KNIT), "give one of them"),
    (lambda: tc.Stretch(), "stretch k"),
    (lambda: tc.Stretch(curve=((0.1, 0), (0.2, 3))), r"first of them \(0, 0\)"),
    (lambda: tc.Stretch(curve=((0, 0), (0.2, 3), (0.1, 9))), "strains must grow"),
    (lambda: tc.Stretch(curve=((0, 0), (0.1, 3), (0.2, 4))), "must be convex and grow; from point 1 on"),
    (lambda: tc.Stretch(curve=((0, 0), (0.1, -3))), "must be convex and grow; from point 0 on"),
    (lambda: tc.Stretch(curve=(KNIT, ((0, 0),))), "stretch curve of the weft: needs two points"),
    (lambda: tc.Stretch(curve=5), "stretch curve: needs shape"),
    (lambda: tc.Stretch(curve="knit"), "stretch curve"),
])
def test_impossible_laws_are_refused(make, words):
    with pytest.raises(tc.SceneError, match=words):
        make()


def test_curves_are_kept_as_tuples_and_give_k():
    s = tc.Stretch(curve=np.array(KNIT))
    assert s.k == pytest.approx(5.6 / 0.17) and s.curve == KNIT and hash(s) == hash(tc.Stretch(curve=KNIT))
    both = tc.Stretch(curve=[KNIT, [(0, 0), (0.1, 10)]])
    assert both.k == pytest.approx((5.6 / 0.17, 100)) and both.curve_of(1) == ((0, 0), (0.1, 10))
