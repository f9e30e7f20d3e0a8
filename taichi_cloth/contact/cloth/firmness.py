"""How firmly the approach of cloth to cloth is stopped within a step: by what a pair bears in it. numpy only.

A pair that would lose more than half of its room in a step is stopped more firmly in the next solve of the same step, by its
own load, where else all of the cloth would have to be moved in a smaller step. It is a stop and not a spring: it acts on what
comes nearer, within the step alone, and gives no speed back.
"""

import numpy as np

from .barrier import SHALLOW, room
from .contact_pairs import ContactPairs

ENOUGH = 0.1  # of a pair's room: what keeps that is let be
KEPT, ROOMY = 0.7, 0.15  # of the room it began with, and at most of all of it: what a pair that lost more than half is to keep
LEAST, FIRMER, FIRMEST = 1.5, 8.0, 4096.0  # factors from solve to solve, and their product at most


class Firmness:
    """Of an attempt at a step.

    Attributes:
        factor: (n,) of each particle's, by which its pairs are stopped more firmly than usual.
    """

    def __init__(self, n: int) -> None:
        self.factor = np.ones(n)

    def reset(self) -> None:
        """A new attempt."""
        self.factor[:] = 1.0

    def rise(self, p: ContactPairs, began: np.ndarray) -> bool:
        """Stops what lost too much of its room more firmly; whether anything did.

        Args:
            p: pairs where a solve led.
            began: (k,) their distances where the step began [m], along their normals.
        """
        left, was = room(p.end, p.radius), room(np.minimum(began, p.radius), p.radius)
        lost = left < np.minimum(ENOUGH, np.minimum(was / 2, 2 * was))
        if not lost.any():
            return False
        left, was = left[lost], np.clip(was[lost], 2 * SHALLOW, 1.0)  # where the stop begins
        by = np.clip((was - left) / (was - np.minimum(ROOMY, KEPT * was)), LEAST, FIRMER)
        which = p.vertices[lost]
        now = np.minimum(by * self.factor[which].max(axis=1), FIRMEST)
        np.maximum.at(self.factor, which, now[:, None])
        return True
