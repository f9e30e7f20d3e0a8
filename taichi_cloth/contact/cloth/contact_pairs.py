"""Pairs of cloth near cloth: as they are found, as a solve took them, as its end shows these, and how stiff they are."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...backend.rows import write
from ...system.checkpoint import Checkpointed
from ..points import ContactRows, rows_of, tangential
from ..solid.pairs import SOFTER, STIFFER
from .barrier import FLOOR, MOST_SHIFT
from .pair_kernels import AT, BEARS, CONE, DRAG, FORCE, GAP, OFFSET, SLOPE, TAKEN, WAY

CLOSE, WIDE = 0.3, 0.7  # of a pair's room: a pair that ends with less gets stiffer, with more softer again. With .3 for both a
# load that holds a crossing takes 72 solves for 55, and cloth that is taut over a bar comes to .34 of the distance for .37
STIFFEST = 4096.0  # product of the factors at most
GROWS = 0.15  # of what lacks to a pair's distance, by which its shift grows in a usual step. With .3 ten sheets swing longer:
# after .25 s their load on the floor is off by .9 % for .5
OFF = 0.015  # of that distance: what lacks less is left. With 0 and .02 a sheet under one that is drawn creeps by 1.1 and
# 8.3 um/s for .6


@dataclass(frozen=True)
class ContactPairs:
    """Pairs on a path.

    Attributes:
        pair: (k, 3) ids: vertex and face, or two edges; and which of the two it is.
        vertices: (k, 4) particles; weights: (k, 4), positive on one side, negative on the other: w . x is from the
            second to the first.
        start: (k,) distance where the path begins [m].
        end: (k,) the same at its end, along `normal`; negative has passed through.
        normal: (k, 3) from the second to the first.
        factor: (k,) part of a full pair that this one counts: less near the ends of edges and for parallel ones.
        radius: (k,) distance [m] that the two should keep.
    """

    pair: np.ndarray
    vertices: np.ndarray
    weights: np.ndarray
    start: np.ndarray
    end: np.ndarray
    normal: np.ndarray
    factor: np.ndarray
    radius: np.ndarray

    @staticmethod
    def none() -> "ContactPairs":
        """No pairs."""
        ids, nothing = np.zeros((0, 4), dtype=np.int64), np.zeros(0)
        return ContactPairs(ids[:, :3], ids, np.zeros((0, 4)), nothing, nothing, np.zeros((0, 3)), nothing, nothing)

    @cached_property
    def room(self) -> np.ndarray:
        """(k,) height of the distance above the floor, over that of the distance to keep; negative below the floor."""
        return (self.end / self.radius - FLOOR) / (1 - FLOOR)

    def least_room(self, n: int) -> np.ndarray:
        """(n,) the least of `room` of each particle's pairs; infinite without any."""
        out = np.full(n, np.inf)
        np.minimum.at(out, self.vertices, np.broadcast_to(self.room[:, None], self.vertices.shape))
        return out

    @property
    def stuck(self) -> np.ndarray:
        """(k,) which pairs are as good as tangled: nearer than half of the floor."""
        return self.end < FLOOR / 2 * self.radius

    @cached_property
    def key(self) -> np.ndarray:
        """(k,) one number each."""
        return (self.pair[:, 0] << 32) + self.pair[:, 1] * 2 + self.pair[:, 2]

    @cached_property
    def order(self) -> np.ndarray:
        """(k,) rows sorted by key."""
        return np.argsort(self.key)

    def rows_of(self, others: "ContactPairs") -> np.ndarray:
        """(k,) where each of other pairs is among these, or -1."""
        if others is self:
            return np.arange(len(self.key))
        row = rows_of(self.key[self.order], others.key)
        return np.where(row >= 0, self.order[row], -1) if len(self.order) else row

    def of(self, rows: np.ndarray) -> np.ndarray:
        """(k, 3) the same difference of other values (n, 3) of the particles."""
        return np.einsum("ka,kai->ki", self.weights, rows.take(self.vertices, axis=0))

    def along(self, rows: np.ndarray) -> np.ndarray:
        """(k,) its parts along the normals."""
        return np.einsum("ki,ki->k", self.normal, self.of(rows))


@dataclass(frozen=True)
class LinearizedPairs:
    """Pairs as a solve took them.

    Attributes:
        near: the pairs.
        points: of contact, by which they enter the solve.
        weighed, taken: (., k) numbers of theirs, see `pair_kernels`.
    """

    near: ContactPairs
    points: ContactRows
    weighed: np.ndarray
    taken: np.ndarray

    def repelled(self, gap: np.ndarray) -> np.ndarray:
        """(k,) normal forces [N] at distances (k,) [m] along the normals, as the solve takes them."""
        return self.taken[FORCE] + self.taken[SLOPE] * (self.taken[AT] - gap)

    def slip(self, moved: np.ndarray) -> np.ndarray:
        """(k, 3) how far [m] the two slip where the particles move by (n, 3) [m]."""
        return tangential(self.points.of(moved), self.near.normal)

    def friction(self, slip: np.ndarray) -> np.ndarray:
        """(k, 3) [N] at a slip (k, 3) [m/s], as the solve takes it."""
        way, slip = self.taken[WAY:OFFSET].T, slip + self.taken[OFFSET:TAKEN].T
        across = slip - np.einsum("ki,ki->k", slip, way)[:, None] * way
        return -self.taken[BEARS][:, None] * way - self.taken[DRAG][:, None] * across


@dataclass(frozen=True)
class EndedPairs:
    """Pairs as the last accepted step ended, sorted by key.

    Attributes:
        key: (k,) see `ContactPairs.key`.
        force: (k,) normal forces [N]; friction: (k, 3) [N].
        slip: (k,) [m/s] of those that stuck, see `pair_kernels.PairKernels.slip_direction`; infinite for others.
    """

    key: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    friction: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    slip: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, q: LinearizedPairs, force: np.ndarray, slip: np.ndarray) -> "EndedPairs":
        """Those of a last solve, by their normal forces (k,) [N] and slips (k, 3) [m/s]."""
        friction, counted = q.friction(slip), np.linalg.norm(slip + q.taken[OFFSET:TAKEN].T, axis=1)
        slides = np.any(q.taken[WAY:OFFSET] != 0, axis=0) | (CONE * np.linalg.norm(friction, axis=1) > q.taken[BEARS])
        order = q.near.order
        return cls(q.near.key[order], force[order], friction[order], np.where(slides, np.inf, counted)[order])

    def forces(self, p: ContactPairs) -> np.ndarray:
        """(k,) normal forces [N] of pairs; -1 for new ones."""
        where = rows_of(self.key, p.key)
        return np.where(where >= 0, self.force[where], -1.0) if len(self.key) else np.full(len(where), -1.0)

    def rubbed(self, p: ContactPairs) -> tuple[np.ndarray, np.ndarray]:
        """(friction (k, 3) [N], slip (k,) [m/s]) of pairs; 0 and infinite for new ones."""
        where = rows_of(self.key, p.key)
        if not len(self.key):
            return np.zeros((len(where), 3)), np.full(len(where), np.inf)
        return np.where((where >= 0)[:, None], self.friction[where], 0.0), np.where(where >= 0, self.slip[where], np.inf)


@dataclass(frozen=True)
class Comparison:
    """Pairs that a solve took, where the model is, next to those that are there.

    Attributes:
        took: the former; near: the latter.
        measured: (., j) numbers of the former there, see `pair_kernels`; none where their solve has led nowhere yet.
    """

    took: LinearizedPairs
    near: ContactPairs
    measured: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @cached_property
    def rows(self) -> np.ndarray:
        """(k,) where each that is there is among those that the solve took, or -1."""
        return self.took.near.rows_of(self.near)

    @cached_property
    def repelled(self) -> np.ndarray:
        """(j,) normal forces [N] that the solve took them to have there."""
        return self.took.repelled(self.measured[GAP])


class AdaptiveStiffness(Checkpointed):
    """How much stiffer than their law pairs are: by factors of their n particles.

    Pairs that a step leaves with little room get stiffer, from step to step, and within a step that would not pass else. Pairs
    with much room get softer again.

    Attributes:
        scale: (n,) factors from step to step; more: (n,) as many times as much within this attempt.
    """

    STATE = ("scale",)

    def __init__(self, n: int) -> None:
        self.scale, self.more = np.ones(n), np.ones(n)

    @property
    def factors(self) -> np.ndarray:
        """(n,) in this attempt."""
        return np.minimum(self.scale * self.more, STIFFEST)

    def begin(self) -> None:
        """A new attempt."""
        self.more[:] = 1.0

    def stiffen(self, p: ContactPairs) -> None:
        """Particles of pairs with little room left get stiffer within the attempt."""
        self.more[np.unique(p.vertices[p.room < CLOSE])] *= STIFFER

    def commit(self, room: np.ndarray, share: float) -> None:
        """A step, so much of a usual one, was accepted and ended with that `ContactPairs.least_room` (n,)."""
        boost = self.factors
        self.scale = np.where(room < CLOSE, np.minimum(STIFFER**share * boost, STIFFEST),
                              np.where(room > WIDE, np.maximum(SOFTER**share * boost, 1.0), boost))
        self.begin()

    def clear(self) -> None:
        """The state was changed from outside."""
        self.scale[:] = 1.0


class PenaltyShift(Checkpointed):
    """How much further away than their distance pairs begin to repel, so that a load that rests holds them at it.

    Repulsion k (r + s - d) with a shift s that grows by a part of r - d from step to step is the method of multipliers:
    k s tends to the load, and d to r [Hestenes 1969; Powell 1969]. s is bounded: where solids leave no room, d stays less.

    Args:
        field: of a number for each of n particles, that kernels read; exchange: type of arrays for it.

    Attributes:
        parts: (n,) of the distance that pairs keep.
    """

    STATE = ("parts",)

    def __init__(self, field: Any, n: int, exchange: type) -> None:
        self.field, self.exchange, self.parts = field, exchange, np.zeros(n)

    def commit(self, room: np.ndarray, share: float) -> None:
        """A step, so much of a usual one, was accepted and ended with that `ContactPairs.least_room` (n,)."""
        short = (1 - FLOOR) * (1 - room)
        short = np.where(np.isfinite(room), np.where(np.abs(short) > OFF, short, 0.0), -MOST_SHIFT)
        self._set(np.clip(self.parts + share * GROWS * short, 0.0, MOST_SHIFT))

    def clear(self) -> None:
        """The state was changed from outside."""
        self._set(np.zeros(len(self.parts)))

    def resumed(self) -> None:
        """See `Checkpointed`."""
        write(self.field, self.parts.astype(self.exchange))

    def _set(self, parts: np.ndarray) -> None:
        """Nothing is handed over where nothing changes."""
        if not np.array_equal(parts, self.parts):
            self.parts = parts
            self.resumed()
