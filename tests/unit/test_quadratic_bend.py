"""Second derivatives over patches of four triangles: exact for quadratics on any triangulation."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.forces.quadratic_bend import patches


def jittered(rng, n=8, seam=False):
    """A square whose inner vertices are moved and whose diagonals are random; with `seam`, each triangle's material
    coordinates are turned and moved on their own."""
    grid = tc.grid(1.0, n)
    uv = np.array(grid.x[:, [0, 2]])
    inner = (uv > 1e-9).all(axis=1) & (uv < 1 - 1e-9).all(axis=1)
    uv[inner] += 0.25 / n * rng.uniform(-1, 1, (int(inner.sum()), 2))
    faces = np.array(grid.faces)
    corner = uv[faces]
    if seam:
        angle = rng.uniform(0, 6, len(faces))
        turn = np.stack([np.stack([np.cos(angle), -np.sin(angle)], 1), np.stack([np.sin(angle), np.cos(angle)], 1)], 1)
        corner = np.einsum("kij,kaj->kai", turn, corner) + rng.uniform(-3, 3, (len(faces), 1, 2))
    return uv, tc.TriMesh(np.column_stack([uv[:, 0], 0 * uv[:, 0], uv[:, 1]]), faces, corner)


@pytest.mark.parametrize("seam", [False, True])
def test_quadratics_are_exact(rng, seam):
    uv, mesh = jittered(rng, seam=seam)
    vertices, B, area = patches(mesh)
    field = 0.7 * uv[:, 0] ** 2 - 0.4 * uv[:, 0] * uv[:, 1] + 0.9 * uv[:, 1] ** 2 + uv @ [3.0, -2.0] + 5
    q = np.einsum("kma,ka->km", B, field[vertices])
    density = q[:, 0] ** 2 + 2 * q[:, 1] ** 2 + q[:, 2] ** 2  # the same in any frame
    whole = (vertices[:, 3:] != vertices[:, :1]).all(axis=1)
    exact = 1.4**2 + 2 * 0.4**2 + 1.8**2
    assert whole.sum() > 60 and np.abs(density[whole] / exact - 1).max() < 1e-9
    assert (density <= exact * (1 + 1e-9)).all()  # at borders the least energy that fits
    plane = np.einsum("kma,ka->km", B, (uv @ [3.0, -2.0] + 5)[vertices])
    assert np.abs(plane).max() < 1e-9
    if not seam:
        assert np.abs(q[whole] - [1.4, -0.4, 1.8]).max() < 1e-9


def test_rigidity_does_not_depend_on_the_triangulation(rng):
    """A cylinder of curvature 1: energy D/2 an area, on a jittered mesh, bent along any direction; hinges are off."""
    uv, mesh = jittered(rng, 16)
    found: dict[str, list[float]] = {"quadratic": [], "hinge": []}
    for angle in (0.0, 0.4, 0.8, 2.0):
        s = uv @ [np.cos(angle), np.sin(angle)] - 0.6
        across = uv @ [-np.sin(angle), np.cos(angle)]
        x = np.column_stack([np.sin(s), 1 - np.cos(s), across])
        for model, energies in found.items():
            scene = tc.Scene(gravity=None)
            scene.add_cloth(mesh, tc.Fabric(0.2, bend=tc.Bend(1e-3, model=model)), x)
            sim = tc.Simulation(scene, preconditioner="block_jacobi")
            energies.append(sim.energy()["bend"] / 0.5e-3)
            sim.close()
    assert min(found["quadratic"]) > 0.9 and max(found["quadratic"]) < 1.001, found  # free borders give way
    assert np.ptp(found["hinge"]) > 5 * np.ptp(found["quadratic"]), found


def test_a_given_rest_shape_is_refused():
    scene = tc.Scene()
    scene.add_cloth(tc.grid(1.0, 3), tc.Fabric(0.2, bend=tc.Bend(1e-3, rest="given", model="quadratic")), name="dress")
    with pytest.raises(tc.SceneError, match="dress.*flat rest shape.*hinge"):
        tc.Simulation(scene)
