"""A strip whose ends are led together beyond its buckling load is Euler's elastica: force and slope against its integrals."""

import math

import numpy as np
import pytest

import taichi_cloth as tc

D, CELLS = 1.0, 40  # N m
SLOPES, LOADS = (40, 60, 80), (1.063, 1.152, 1.293)  # degrees at the ends; P over P_cr [Timoshenko and Gere, 2.7]
LED = 5.0  # s for each of them, the last of them at rest


def grid_strip():
    """The mesh, its width [m], rigidity, model and stretch [N/m], of a strip 1 m long that bends by curvatures."""
    return tc.grid((1.0, 0.1), (CELLS, 1)), 0.1, D, "curvature", 1e5


def equilateral_strip():
    """The same with hinges, a plate with nu = -1/3: a strip that is free to bend across too has D (1 - nu^2); were it much
    harder to stretch, it could not."""
    return tc.equilateral_strip(1.0, 2, 3 * CELLS // 4), math.sqrt(3) / (3 * CELLS // 4), D * 8 / 9, "hinge", 1e4


def gap(slope):
    """Distance of the ends over the length, 2 E/K - 1 of the modulus sin(slope/2), by the midpoint rule."""
    t, m = (np.arange(2000) + 0.5) * math.pi / 4000, math.sin(math.radians(slope) / 2) ** 2
    root = np.sqrt(1 - m * np.sin(t) ** 2)
    return 2 * root.mean() / (1 / root).mean() - 1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*looks like another unit")
@pytest.mark.parametrize("strip", [grid_strip, equilateral_strip])
def test_a_buckled_strip_bears_what_the_elastica_does(strip):
    """P/P_cr = 1.063, 1.152, 1.293 where the ends slope by 40, 60, 80 degrees, 1 %; the slopes within .2 degrees."""
    mesh, width, rigidity, model, k = strip()
    s = mesh.x[:, 0] - mesh.x[:, 0].min()
    left, right = np.flatnonzero(s < 1e-9), np.flatnonzero(s > 1 - 1e-9)
    x = np.array(mesh.x)
    x[:, 1] = 0.05 * np.sin(math.pi * s)
    scene = tc.Scene(gravity=None)
    cloth = scene.add_cloth(mesh, tc.Fabric(0.1, tc.Stretch(k), tc.Shear(k / 10), tc.Bend(D, model=model)), x)
    scene.pin(cloth, left)
    times = LED * np.array([(j + 0.3, j + 1) for j in range(3)]).ravel()
    path = 1 - np.repeat([gap(a) for a in SLOPES], 2)
    scene.move(cloth, right, lambda t: (-np.interp(t, [0, *times], [0, *path]), 0, 0), relative=True)
    with tc.Simulation(scene, h=0.5, integrator="newton_euler", cg_tol=1e-9, newton_tol=1e-9, newton_max=60,
                       stretch_limit=1e9) as sim:
        for slope, load in zip(SLOPES, LOADS):
            for _ in range(round(LED / 0.5)):
                sim.step()
            force, x = sim.constraint_forces()[:, 0], sim.positions()
            assert np.abs(sim.velocities()).max() < 1e-5
            assert force[left].sum() == pytest.approx(-force[right].sum(), rel=1e-6)
            assert force[left].sum() / (math.pi**2 * rigidity * width) == pytest.approx(load, rel=0.01)
            near, far = (angle(x, s, side) for side in (1, -1))
            assert near == pytest.approx(slope, abs=0.2) and far == pytest.approx(slope, abs=0.2)


def angle(x, s, side):
    """Slope [degrees] at an end, from the chords of the two cells next to it: it falls as the square of the way."""
    columns = np.unique(np.round(s, 9))[::side][:5]
    if len(np.flatnonzero(np.abs(s - columns[0]) < 1e-8)) != len(np.flatnonzero(np.abs(s - columns[1]) < 1e-8)):
        columns = columns[::2]  # the middle row of equilateral triangles is half a cell further
    a, b, c = (x[np.abs(s - at) < 1e-8].mean(axis=0) for at in columns[:3])
    first, second = (math.degrees(math.atan2(q[1] - p[1], side * (q[0] - p[0]))) for p, q in ((a, b), (b, c)))
    return first + (first - second) / 6
