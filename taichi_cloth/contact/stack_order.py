"""The order in which layers of cloth lie between surfaces that close on them, and targets that keep it. numpy only.

Particles that solids pinch are led (`solid/pinch.py`), each to a share of the room by where it went in, and pairs of such
particles rest. Shares of two layers may be the same, or the wrong way round: they are not told of each other. So each pair of
a vertex and a face, or of two edges, all of them pinched, is remembered with the side on which one lies of the other, and
targets are moved across the room until it has GAP of its distance on that side. Where the room opens again, layers come out
in the order in which they went in.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..scene.boxes import near
from ..system.checkpoint import Checkpointed
from .points import rows_of, unit

if TYPE_CHECKING:  # solids alone import nothing of cloth against cloth
    from .cloth.collision_mesh import CollisionMesh

GAP = 0.5  # of the distance that two layers keep
REACH = 4.0  # of it: pairs that are further apart are forgotten
SWEEPS, FURTHER = 20, 1.5  # in which targets are moved; times as far as what lacks to each pair on average
BESIDE = 0.05  # of a face: a vertex that is beside it by less is over it
PARALLEL = 0.1  # sine of the angle between edges below which they have no side


@dataclass(frozen=True)
class _Candidates:
    """Pairs (k, 4) of particles, sorted by key (k,); is_face: (k,) whether of a vertex and a face, else of two edges."""

    key: np.ndarray
    vertices: np.ndarray
    is_face: np.ndarray

    def take(self, which: np.ndarray) -> "_Candidates":
        """Some of them."""
        return _Candidates(self.key[which], self.vertices[which], self.is_face[which])

    def normals(self, x: np.ndarray) -> np.ndarray:
        """(k, 3) of faces, and across both edges, with particles at x (n, 3); of no length where there is none."""
        p, q, r, s = (x[self.vertices[:, k]] for k in range(4))
        out = np.where(self.is_face[:, None], np.cross(r - q, s - q), np.cross(q - p, s - r))
        size = np.linalg.norm(q - p, axis=1) * np.linalg.norm(s - r, axis=1)
        flat = ~self.is_face & (np.linalg.norm(out, axis=1) < PARALLEL * size)
        return np.where(flat[:, None], 0.0, unit(out))

    def weights(self, x: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(k, 4) of the points that are one above the other along normals (k, 3): positive of the first thing."""
        p, q, r, s = (x[self.vertices[:, k]] for k in range(4))
        one = np.ones(len(p))

        def part(a: np.ndarray, b: np.ndarray, whole: np.ndarray) -> np.ndarray:
            return np.einsum("ki,ki->k", np.cross(a, b), normal) / np.where(whole > 0, whole, np.inf)

        area = np.einsum("ki,ki->k", np.cross(r - q, s - q), normal)
        u, v = part(p - q, s - q, area), part(r - q, p - q, area)
        both = np.einsum("ki,ki->k", np.cross(q - p, s - r), normal)
        a, b = part(r - p, s - r, both), part(r - p, q - p, both)
        return np.where(self.is_face[:, None], np.stack([one, u + v - 1, -u, -v], axis=1),
                        np.stack([1 - a, a, b - 1, -b], axis=1))


@dataclass(frozen=True)
class _Facing:
    """Pairs one above the other: candidates, weights (k, 4), normals (k, 3), gap (k,) along these [m]."""

    pairs: _Candidates
    weights: np.ndarray
    normal: np.ndarray
    gap: np.ndarray


class StackOrder(Checkpointed):
    """The sides of pinched pairs of a model's cloth.

    Attributes:
        key: (k,) of pairs at the end of the last accepted step, sorted; side: (k,) 1, or -1 where the first thing lies
            below the face, or the other edge, of the second.
    """

    STATE = ("key", "side")

    def __init__(self, mesh: "CollisionMesh", n: int) -> None:
        self.mesh, self.n = mesh, n
        self.key, self.side = np.zeros(0, dtype=np.int64), np.zeros(0)
        self.began = np.zeros((n, 3))

    @cached_property
    def distance(self) -> float:
        """The largest distance [m] that two layers keep."""
        return 2 * float(self.mesh.half_thickness.max())

    def clear(self) -> None:
        """Nothing is remembered: the state was changed from outside."""
        self.key, self.side = np.zeros(0, dtype=np.int64), np.zeros(0)

    def shift(self, x: np.ndarray, index: np.ndarray, target: np.ndarray, across: np.ndarray) -> np.ndarray:
        """(k,) [m] by which targets go on across the room, so that layers keep their order.

        Args:
            x: (n, 3) where the step begins [m].
            index: (k,) pinched particles; target, across: (k, 3) where they are led [m], and unit vectors across the room.
        """
        self.began, there, way = x, x.copy(), np.zeros_like(x)
        there[index], way[index] = target, across
        found, by = self._candidates(there, index), np.zeros(self.n)
        for _ in range(SWEEPS if len(found.key) else 0):
            f = self._facing(found, there + by[:, None] * way)
            side, four = self._sides(f), f.pairs.vertices
            keeps = GAP * (self.mesh.half_thickness[four[:, 0]] + self.mesh.half_thickness[four[:, 3]])
            lack = keeps - side * f.gap
            slope = side[:, None] * f.weights * np.einsum("ki,kai->ka", f.normal, way[four])
            steep = (slope**2).sum(axis=1)
            on = (lack > 1e-3 * keeps) & (steep > 1e-3)
            if not on.any():
                break
            wanted = slope[on] * (lack[on] / steep[on])[:, None]
            total, count = np.zeros(self.n), np.zeros(self.n)
            np.add.at(total, four[on], wanted)
            np.add.at(count, four[on], 1.0 * (wanted != 0))
            by += FURTHER * total / np.maximum(count, 1)
        return by[index]

    def commit(self, x: np.ndarray, index: np.ndarray) -> None:
        """A step was accepted that ended at x (n, 3) with particles (k,) pinched."""
        if not len(index):
            self.clear()
            return
        f = self._facing(self._candidates(x, index), x)
        self.key, self.side = f.pairs.key, self._sides(f)

    def _candidates(self, x: np.ndarray, index: np.ndarray) -> _Candidates:
        """Pairs of pinched particles (k,) whose boxes are in reach of each other."""
        mesh, reach, pinched = self.mesh, REACH * self.distance, np.zeros(self.n, dtype=bool)
        pinched[index] = mesh.half_thickness[index] > 0
        v = np.flatnonzero(pinched)
        f, e = (np.flatnonzero(pinched[rows].all(axis=1)) for rows in (mesh.faces, mesh.edges))
        ball = np.stack([x[v] - reach, x[v] + reach], axis=1)
        ends = x[mesh.edges[e]]
        grown = np.stack([ends.min(axis=1) - reach, ends.max(axis=1) + reach], axis=1)
        faces = [np.stack(rows, axis=1) for rows in near(ball, x[mesh.faces[f]])]
        edges = [np.stack(rows, axis=1) for rows in near(grown, ends)]
        one = np.concatenate([np.zeros((0, 2), dtype=np.int64), *faces])
        two = np.concatenate([np.zeros((0, 2), dtype=np.int64), *edges])
        two = two[two[:, 0] < two[:, 1]]
        i, j, k, m = v[one[:, 0]], f[one[:, 1]], e[two[:, 0]], e[two[:, 1]]
        key = np.concatenate([i * len(mesh.faces) + j, self.n * len(mesh.faces) + k * len(mesh.edges) + m])
        vertices = np.concatenate([np.column_stack([i, mesh.faces[j]]),
                                   np.concatenate([mesh.edges[k], mesh.edges[m]], axis=1)])
        found = _Candidates(key, vertices, np.arange(len(key)) < len(i))
        cluster = mesh.cluster_ids[vertices]
        split = np.where(found.is_face, 1, 2)[:, None] > np.arange(4)
        joined = (cluster[:, :, None] == cluster[:, None, :]) & split[:, :, None] & ~split[:, None, :]
        meet = mesh.particles_may_meet(vertices[:, 0], vertices[:, 3]) & ~joined.any(axis=(1, 2))
        found = found.take(meet)
        return found.take(np.argsort(found.key, kind="stable"))

    def _facing(self, found: _Candidates, x: np.ndarray) -> _Facing:
        """Those pairs that are one above the other, in reach, with particles at x (n, 3)."""
        normal = found.normals(x)
        weights = found.weights(x, normal)
        gap = np.einsum("ki,ka,kai->k", normal, weights, x[found.vertices])
        beside = np.where(found.is_face, BESIDE, 0.0)
        own = np.where(found.is_face, 1.0, np.minimum(weights[:, 0], weights[:, 1]))
        other = np.where(found.is_face, -weights[:, 1:].max(axis=1), -weights[:, 2:].max(axis=1))
        over = normal.any(axis=1) & (own > 0) & (other > -beside) & (np.abs(gap) < REACH * self.distance)
        return _Facing(found.take(over), weights[over], normal[over], gap[over])

    def _sides(self, f: _Facing) -> np.ndarray:
        """(k,) of pairs: what is remembered, else where the step began, but for edges that were parallel there."""
        normal = f.pairs.normals(self.began)
        first = np.einsum("ki,ka,kai->k", normal, f.weights, self.began[f.pairs.vertices])
        out = np.where(np.where(normal.any(axis=1), first, f.gap) < 0, -1.0, 1.0)
        if not len(self.key):
            return out
        row = rows_of(self.key, f.pairs.key)
        return np.where(row >= 0, self.side[row], out)
