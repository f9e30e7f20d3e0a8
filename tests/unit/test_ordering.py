"""Vertex order and partition."""

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.backend import ordering
from taichi_cloth.backend.ordering import block_bounds, cuthill_mckee
from taichi_cloth.system.state import partition


def test_order_is_a_permutation_with_small_bandwidth(rng):
    grid = tc.grid(1.0, 30)
    shuffle = rng.permutation(grid.vertex_count)
    pieces = np.concatenate([shuffle[grid.faces], shuffle[grid.faces] + grid.vertex_count])  # two of them
    n = 2 * grid.vertex_count
    order = cuthill_mckee(n, pieces)
    assert sorted(order) == list(range(n))
    place = np.argsort(order)
    spread = np.ptp(place[pieces], axis=1)
    assert spread.max() < 100 and np.ptp(pieces, axis=1).mean() > 300


def test_every_block_has_the_elements_that_touch_it(rng):
    vertices = np.sort(rng.integers(0, 40, size=(70, 3)), axis=1)
    bounds = block_bounds(40, 4)
    entries = partition(vertices, bounds)
    for b in range(4):
        mine = entries.element[entries.first[b]: entries.first[b + 1]]
        whole = ((vertices[mine] >= bounds[b]) & (vertices[mine] < bounds[b + 1])).all(axis=1)
        assert (whole == (np.arange(len(mine)) < entries.shared[b] - entries.first[b])).all()
        touches = ((vertices >= bounds[b]) & (vertices < bounds[b + 1])).any(axis=1)
        assert sorted(mine) == np.flatnonzero(touches).tolist()
    assert sorted(entries.element[entries.primary]) == list(range(70))


@pytest.mark.restarts
@pytest.mark.slow
def test_results_do_not_depend_on_vertex_order_or_threads(rng):
    grid = tc.grid(1.0, 8)
    shuffle = rng.permutation(grid.vertex_count)
    x = np.empty_like(grid.x)
    x[shuffle] = grid.x
    uv = np.empty_like(grid.uv)
    uv[shuffle] = grid.uv
    results = []
    for mesh, back, threads in ((grid, np.arange(grid.vertex_count), 1), (tc.TriMesh(x, shuffle[grid.faces], uv), shuffle, 1),
                                (grid, np.arange(grid.vertex_count), 3)):
        scene = tc.Scene()
        cloth = scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(500), tc.Shear(50), tc.Bend(1e-4)))
        scene.pin(cloth, back[[0, 8]])
        sim = tc.Simulation(scene, threads=threads, cg_tol=1e-12)
        for _ in range(5):
            sim.step()
        results.append(sim.positions()[back])
    assert np.abs(results[0] - results[1]).max() < 1e-9
    assert np.abs(results[0] - results[2]).max() < 1e-9


def test_what_lies_on_each_other_is_in_one_block(monkeypatch):
    """Three sheets: a vertex and those above it share a block of four but at its ends; each slab keeps the order it had."""
    monkeypatch.setattr(ordering, "SLAB", 200)
    mesh = tc.grid(1.0, 29)
    n = mesh.vertex_count
    points = np.concatenate([mesh.x + [0, 0.01 * k, 0] for k in range(3)])
    given = ordering.cuthill_mckee(3 * n, np.concatenate([mesh.faces + k * n for k in range(3)]))
    order = ordering.by_slabs(given, points)
    assert sorted(order) == list(range(3 * n))

    def together(order):
        block = np.empty(3 * n, dtype=int)
        block[order] = np.searchsorted(ordering.block_bounds(3 * n, 4), np.arange(3 * n), side="right")
        return np.mean(np.ptp(block.reshape(3, n), axis=0) == 0)

    assert together(order) > 0.8 and together(given) < 0.1
    scene = tc.Scene()
    for k in range(3):
        scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(100)), mesh.x + [0, 0.01 * k, 0], contact=tc.ClothContact(0.005))
    with tc.Simulation(scene) as sim:
        assert together(sim.model.user) > 0.8
    where = np.argsort(given)[order]  # of each vertex in the order that was
    runs = np.split(where, np.arange(200, 3 * n, 200))
    assert all((np.diff(run) > 0).all() for run in runs)
    ends = [np.sort(points[order[a:a + 200], 0])[[0, -1]] for a in range(0, 3 * n, 200)]
    assert (np.diff(np.concatenate(ends)) >= 0).all()
