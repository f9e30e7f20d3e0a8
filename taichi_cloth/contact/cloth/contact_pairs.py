"""Pairs of cloth near cloth, as a solve takes them. numpy only."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..rows import rows_of


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
