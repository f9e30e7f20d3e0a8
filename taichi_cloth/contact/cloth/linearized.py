"""Pairs of cloth as a solve took them, and as its end shows them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..points import Points
from ..rows import tangential
from .contact_pairs import ContactPairs
from .pair_kernels import AT, BEARS, DRAG, FORCE, GAP, SLOPE, WAY


@dataclass(frozen=True)
class LinearizedPairs:
    """Pairs as a solve took them.

    Attributes:
        near: the pairs.
        points: what the solve is given of them.
        weighed, taken: (., k) numbers of theirs, see `pressing`.
    """

    near: ContactPairs
    points: Points
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
        way = self.taken[WAY:].T
        across = slip - np.einsum("ki,ki->k", slip, way)[:, None] * way
        return -self.taken[BEARS][:, None] * way - self.taken[DRAG][:, None] * across


@dataclass(frozen=True)
class Comparison:
    """Pairs that a solve took, where the model is, next to those that are there.

    Attributes:
        took: the former; near: the latter.
        led: (., j) numbers of the former there, see `pressing`.
    """

    took: LinearizedPairs
    near: ContactPairs
    led: np.ndarray

    @cached_property
    def rows(self) -> np.ndarray:
        """(k,) where each that is there is among those that the solve took, or -1."""
        return self.took.near.rows_of(self.near)

    @cached_property
    def repelled(self) -> np.ndarray:
        """(j,) normal forces [N] that the solve took them to have there."""
        return self.took.repelled(self.led[GAP])
