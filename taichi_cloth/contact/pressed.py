"""Pairs of cloth as a solve took them, and as its end shows them. numpy only."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .near import Near


@dataclass(frozen=True)
class Pressed:
    """Pairs as a solve took them.

    Attributes:
        near: the pairs.
        own: (k,) mass that the pair's distance has [kg].
        force: (k,) [N] and slope: (k,) [N/m] where they were linearised, at distance `at` [m].
        limit: (k,) distance [m] below which its approach is stopped.
        bears: (k,) the most that friction can be [N].
        way: (k, 3) direction of the slip of what slides, 0 for what sticks.
        drag: (k,) friction over slip [N s/m], of what slides across its way.
    """

    near: Near
    own: np.ndarray
    force: np.ndarray
    slope: np.ndarray
    at: np.ndarray
    limit: np.ndarray
    bears: np.ndarray
    way: np.ndarray
    drag: np.ndarray

    def friction(self, slip: np.ndarray) -> np.ndarray:
        """(k, 3) [N] at a slip (k, 3) [m/s], as the solve takes it."""
        across = slip - np.einsum("ki,ki->k", slip, self.way)[:, None] * self.way
        return -self.bears[:, None] * self.way - self.drag[:, None] * across


@dataclass(frozen=True)
class Met:
    """Pairs that a solve took, where it led to, next to those that are there.

    Attributes:
        took: the former; near: the latter.
        x: (n, 3) positions there, and x_0: where the step began [m].
        h: the step [s].
    """

    took: Pressed
    near: Near
    x: np.ndarray
    x_0: np.ndarray
    h: float

    @cached_property
    def rows(self) -> np.ndarray:
        """(k,) where each that is there is among those that the solve took, or -1."""
        return self.took.near.rows_of(self.near)

    @cached_property
    def gap(self) -> np.ndarray:
        """(j,) distances of those that the solve took, along their normals [m]."""
        return self.took.near.along(self.x)

    @cached_property
    def slip(self) -> np.ndarray:
        """(j, 3) their slip over the step [m/s]."""
        return self.took.near.slip(self.x - self.x_0, self.h)
