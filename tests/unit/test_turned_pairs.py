"""Pairs that end a solve too near along another normal than it took: the further solves go by both."""

from dataclasses import replace

import numpy as np
import pytest

import taichi_cloth as tc
from taichi_cloth.contact.solid.solid_contacts import TURNED, TURNED_ROUND
from taichi_cloth.contact.step_start import StepStart

H, THICK = 1 / 60, 0.001


@pytest.fixture
def ridge():
    """A sheet .2 mm above a box's edge: its contacts with solids, of which the last solve took what is there."""
    scene, mesh = tc.Scene(), tc.grid(0.2, 30)
    scene.add_solid(tc.Box((0.1, 0.1, 0.1)), 0.3, THICK, name="box", rotation=(0.0, 0.0, np.pi / 4))
    scene.add_cloth(mesh, tc.Fabric(0.2, tc.Stretch(1000, 1)), mesh.x - mesh.x.mean(axis=0) + [0.003, 0.0709, 0])
    with tc.Simulation(scene, h=H, integrator="backward_euler") as sim:
        sim.model.save()
        solids, x = sim.contacts.solids, sim.model.read_particles()[0]
        solids.begin(StepStart(H, H, x, 0 * x))
        solids.linearized = solids.near.pairs
        assert len(solids.near.pairs.key) > 20
        yield solids


def end(solids, low, cosine) -> None:
    """The solve ended with some pairs (k,) low, along normals that make such an angle with those it took."""
    pairs, turn = solids.linearized, np.arccos(cosine)
    axis = np.array([0.0, 0.0, 1.0])  # along the box's edge
    normal = np.cos(turn) * pairs.normal + np.sin(turn) * np.cross(axis, pairs.normal)
    distance = np.where(low, 0.1, 0.8) * THICK / 2
    solids.near = replace(solids.near, pairs=replace(pairs, normal=normal, distance=distance))
    solids.remember_turned()


def taken(solids):
    """What the next solve takes of them."""
    x = solids.near.there
    solids.hold()
    solids.take_points((x, 0 * x))
    return solids.linearized.take(solids.linearized.key < 0)


def test_both_normals_hold(ridge, rng):
    before, low = ridge.linearized, np.arange(len(ridge.linearized.key)) % 2 == 0
    end(ridge, low, TURNED - 0.1)
    moved = rng.normal(0, 1e-5, ridge.near.there.shape)
    ridge.near = replace(ridge.near, there=ridge.near.there + moved)
    both = taken(ridge)
    was = before.take(low)
    order = np.argsort(-1 - was.key)
    was = was.take(order)
    assert (both.key == -1 - was.key).all() and (both.normal == was.normal).all()
    assert both.distance == pytest.approx(was.distance + np.einsum("ki,ki->k", was.normal, was.of(moved)), abs=1e-12)
    assert (ridge.scan.friction_of(both) == 0.3).all() and (np.diff(ridge.linearized.key) > 0).all()
    forces = ridge.pressing.forces(0 * moved, H)
    first = forces[: len(both.key)]
    assert (np.einsum("ki,ki->k", first, both.normal) > 0).all()  # they repel along the old normal
    ridge.near = replace(ridge.near, there=ridge.near.there + 1.0)
    assert not len(taken(ridge).key)  # out of range


def test_what_keeps_its_normal_or_its_distance_holds_once(ridge):
    none, every = (np.full(len(ridge.linearized.key), value) for value in (False, True))
    end(ridge, every, TURNED + 0.02)
    assert ridge.turned is None
    end(ridge, none, TURNED - 0.1)
    assert ridge.turned is None
    end(ridge, every, TURNED_ROUND - 0.05)  # both together might leave it no way
    assert ridge.turned is None
    passed = ridge.linearized
    ridge.linearized = replace(passed, distance=-passed.distance)  # what was through already had no such plane
    end(ridge, every, TURNED - 0.1)
    assert ridge.turned is None
    ridge.linearized = passed
    end(ridge, every, TURNED - 0.1)
    count = len(ridge.turned.key)
    assert count == len(every)
    ridge.linearized = ridge.linearized.take(ridge.linearized.key >= 0)
    end(ridge, every, TURNED - 0.1)  # again: what was taken last
    assert len(ridge.turned.key) == count
    x = ridge.near.there
    ridge.begin(StepStart(H, H, x, 0 * x))
    assert ridge.turned is None
