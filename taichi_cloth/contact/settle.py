"""Starts nearer than the thickness: cloth is moved apart from solids before the first step, layers with it. numpy only.

Scans, and drapes of other programs, start nearer to a body than a scene's thickness, edges at micrometres from edges. To
throw such cloth out within a step takes speeds that no step passes. It is therefore moved out by small displacements,
vertices and pairs of edges alike, as far as both keep most of their distance. Layers that would come nearer to each other
than they should move as one, and particles that would pass through a solid stay. Sewn particles that are nearly together
are joined before. Pairs with solids that are left near have a part of their thickness, which grows (`growth`); layers that
are left as near as if they were tangled rest for a while. A start of which nothing is that near stays as it is, bit for bit.

Two cloths in one place have no order, and rounding would tangle them. The one with a higher `layer`, or the later one in the
scene, lies on the other: its vertices there begin a hair further along its normals, and those that scripts hold as far as they
should (`lay_on`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..system.quantities import vertex_normals
from ..system.state import ParticleState
from .geometry import VERTEX_FACE
from .growth import NEAR
from .solid.pairs import PAIR
from .solid.query import SolidCollisionDetector

if TYPE_CHECKING:
    from ..scene.cloth import Cloth
    from .cloth.contact_pairs import ContactPairs
    from .cloth.layers import Layers

SWEEPS = 30  # at most, each by a tenth of a thickness: with 60 two sheets near a mesh take 38 solves for 45 in .1 s
AIM, ENOUGH = 0.9, 0.05  # of the distance kept: to which cloth is moved apart; how much of that may lack in the end
NEAREST = 0.5  # of the thickness: sewn particles that are nearer to their mean are brought together
MOST = 0.1  # of the thickness: most by which a particle is moved in a sweep
ONE = 1e-3  # of the distance kept: cloths that are nearer are in one place; the later one is moved by twice as much
TOGETHER = 12  # times that layers which would come too near are moved as one, and those that would cross are left as they are


@dataclass(frozen=True)
class Moved:
    """The particles that were moved apart.

    Attributes:
        near: (k,) particles that started too near; left: (j,) those that still are.
        particle: that was moved furthest; by: how far [m].
    """

    near: np.ndarray
    left: np.ndarray
    particle: int = 0
    by: float = 0.0


def lay_on(model: ParticleState, layers: Layers, cloths: list[Cloth], fixed: np.ndarray) -> np.ndarray:
    """Moves the later of two cloths that start in one place along its normals; returns its particles (k,).

    Args:
        cloths: of the scene; one with a higher `layer` is later.
        fixed: (k,) particles that scripts hold: they go as far as they should, since nothing moves them apart later.
    """
    if sum(c.contact is not None for c in cloths) < 2:
        return np.zeros(0, dtype=np.int64)
    mesh, detector = layers.detector.mesh, layers.detector
    order = np.argsort([c.contact.layer if c.contact else 0 for c in cloths], kind="stable")
    model.save()
    detector.paths.begin()
    detector.cover()
    p = detector.look()
    owner = np.argsort(order)[mesh.owners[p.vertices]]  # its rank
    one = (p.pair[:, 2] == VERTEX_FACE) & (owner[:, 0] != owner[:, 3]) & (p.end < ONE * p.radius)
    if not one.any():
        return np.zeros(0, dtype=np.int64)
    (x, v), owner, four = model.read_particles(), owner[one], p.vertices[one]
    later = owner == owner.max(axis=1, keepdims=True)
    lower = np.broadcast_to(owner.min(axis=1, keepdims=True), owner.shape)
    moved, on = np.unique(np.unique(np.column_stack([four[later], lower[later]]), axis=0)[:, 0], return_counts=True)
    by = np.where(np.isin(moved, fixed), AIM, 2 * ONE) * on * 2 * mesh.half_thickness[moved]  # m, on so many others
    x[moved] += by[:, None] * vertex_normals(x, mesh.faces)[moved]
    model.write_particles(x, v)
    model.save()
    return moved


def move_apart(detector: SolidCollisionDetector, model: ParticleState, layers: Layers | None, fixed: np.ndarray) -> Moved:
    """Moves cloth apart from solids' edges and corners, and layers; the model is at rest where it starts.

    Args:
        detector: knows the solids.
        fixed: (k,) particles that scripts hold.
    """
    detector.set_time(detector.time, 0.0)
    model.save()
    work = _Start(detector, model, layers)
    near = work.too_near()
    if not len(near):
        return Moved(near, near)
    x = model.read_particles()[0]
    still = np.zeros(model.n, dtype=bool)
    still[fixed] = True
    there = work.sewn(x, still)
    for layered in (False, True):
        there = work.moved_apart(there, still.copy(), layered)
    model.save()
    far = np.linalg.norm(there - x, axis=1)
    return Moved(near, work.too_near(), int(far.argmax()), float(far.max()))


class _Start:
    """A model's cloth before its first step, between solids and layers of its own."""

    def __init__(self, detector: SolidCollisionDetector, model: ParticleState, layers: Layers | None) -> None:
        self.detector, self.model, self.layers, self.v = detector, model, layers, model.read_particles()[1]
        self.cluster_ids = np.arange(model.n) if model.sewn is None else model.sewn.representative
        self.most = float(detector.thickness.max(initial=0.0))  # m: the largest thickness
        if layers is not None:
            self.most = max(self.most, 2 * float(layers.intersections.half.max()))

    def too_near(self) -> np.ndarray:
        """(k,) particles of pairs that are too near where the model is."""
        pairs, between, rows = self.detector.find_pairs(), self.between(), []
        if between is not None:
            rows.append(between.vertices[between.stuck].ravel())
        if pairs is not None:
            part = self.detector.part_of(pairs)
            rows.append(pairs.own_vertices[(part > 0) & (part < NEAR)].ravel())
        return np.unique(np.concatenate(rows)) if rows else np.zeros(0, dtype=np.int64)

    def between(self) -> ContactPairs | None:
        """Pairs of layers where the model is."""
        if self.layers is None:
            return None
        self.layers.detector.paths.begin()
        self.layers.detector.cover()
        return self.layers.detector.look()

    def sewn(self, x: np.ndarray, still: np.ndarray) -> np.ndarray:
        """Positions with sewn particles near their mean put there, but for particles that are still (n,) or would cross."""
        cluster_ids = self.cluster_ids
        to_mean = as_one(x, cluster_ids, np.zeros(len(x), dtype=bool)) - x
        far = np.zeros(len(x))
        np.maximum.at(far, cluster_ids, np.where(still, np.inf, np.linalg.norm(to_mean, axis=1)))
        near = (far > 0) & (far < NEAREST * self.most)
        there = np.where(near[cluster_ids][:, None], x + to_mean, x)
        if self.layers is not None and near.any():
            tangles = self.layers.intersections
            for _ in range(TOGETHER):
                tangles.look(there)
                edges, rows = tangles.found
                at = cluster_ids[np.concatenate([edges.ravel(), tangles.faces[rows].ravel()])]
                if not near[at].any():
                    break
                near[at] = False
                there = np.where(near[cluster_ids][:, None], x + to_mean, x)
        self.model.write_particles(there, self.v)
        return there

    def moved_apart(self, x: np.ndarray, still: np.ndarray, layered: bool) -> np.ndarray:
        """Positions (n, 3) to which cloth can be moved apart from x, where the model then is; with `layered` layers too."""
        detector, model, layers = self.detector, self.model, self.layers
        model.save()
        crossed = len(detector.find_crossings())
        if layers is not None:
            layers.count_tangled()
            layers.intersections.commit()
            layers.detector.let_rest(layers.intersections.resting)
        for _ in range(SWEEPS):
            model.save()
            by, lacks = self.shift(layered)
            if lacks < ENOUGH:
                break
            by = self.free_of_layers(as_one(by, self.cluster_ids, still), x, still)
            for _ in range(TOGETHER):
                model.write_particles(x + by, self.v)
                through = detector.find_crossings()
                if len(through) <= crossed:
                    break
                still[through] = True
                by = as_one(by, self.cluster_ids, still)
            else:
                break
            x = x + by
        model.write_particles(x, self.v)
        return x

    def shift(self, layered: bool) -> tuple[np.ndarray, float]:
        """((n, 3) displacements [m] that bring near particles out, the largest lack, of the distance kept)."""
        n, found, pairs = self.model.n, self.detector.detect(), self.detector.find_pairs()
        by, count, most = np.zeros((n, 3)), np.zeros(n), [0.0]
        t = self.detector.thickness[found.solid]
        parts = [(found.index[:, None], np.ones((len(t), 1)), found.normal, found.gap + t, t)]
        if pairs is not None:
            keeps = PAIR * self.detector.thickness[pairs.solid]
            parts.append((pairs.vertices, pairs.weights, pairs.normal, pairs.distance, keeps))
        near = self.between() if layered else None
        if near is not None:
            parts.append((near.vertices, near.weights, near.normal, near.end, near.radius))
        for rows, w, normal, distance, keeps in parts:
            lack = np.where(distance > 0, AIM * keeps - distance, 0.0)
            some = np.flatnonzero(lack > 0)
            w, lack, rows = w[some], lack[some], rows[some]
            push = w * (lack / np.maximum((w**2).sum(axis=1), 1e-12))[:, None]
            np.add.at(by, rows, push[:, :, None] * normal[some, None, :])
            np.add.at(count, rows, np.abs(w))
            most.append(float((lack / keeps[some]).max(initial=0.0)))
        by /= np.maximum(count, 1)[:, None]
        size = np.linalg.norm(by, axis=1)
        return by * np.minimum(1, MOST * self.most / np.maximum(size, 1e-30))[:, None], max(most)

    def free_of_layers(self, by: np.ndarray, x: np.ndarray, still: np.ndarray) -> np.ndarray:
        """Displacements by which no layers come nearer than they should: those that would move as one."""
        if self.layers is None:
            return by
        detector, four = self.layers.detector, np.zeros((0, 4), dtype=np.int64)
        detector.paths.begin()
        for _ in range(TOGETHER):
            self.model.write_particles(x + by, self.v)
            detector.cover()
            part, blocking = detector.collision_free_step()
            if part == 1:
                return by
            four = np.concatenate([four, detector.particles_of(blocking)])
            by = as_one(by, _joined(four, self.cluster_ids), still)
        self.model.write_particles(x + by, self.v)
        detector.cover()
        return by * detector.collision_free_step()[0]


def as_one(by: np.ndarray, group: np.ndarray, still: np.ndarray) -> np.ndarray:
    """(n, 3) means of displacements over groups (n,); groups with a particle that is still (n,) do not move."""
    count, stays = np.maximum(np.bincount(group), 1), np.bincount(group, still) > 0
    mean = np.stack([np.bincount(group, by[:, k]) for k in range(3)], axis=1) / count[:, None]
    return np.where(stays[:, None], 0.0, mean)[group]


def _joined(four: np.ndarray, cluster_ids: np.ndarray) -> np.ndarray:
    """(n,) a number for each group of particles in rows (k, 4) with particles in common; particles sewn together are one."""
    group, before = cluster_ids.copy(), None
    while before is None or (group != before).any():
        before = group.copy()
        np.minimum.at(group, four, group[four].min(axis=1)[:, None])
        np.minimum.at(group, cluster_ids, group)
        group = np.minimum(group, group[cluster_ids])
    return group
