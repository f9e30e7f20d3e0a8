"""How much stiffer than their law pairs of cloth with cloth are: by factors of their particles. numpy only.

Pairs that a step leaves with little room get stiffer, from step to step, and within a step that would not pass else. Pairs
with much room get softer again.
"""

import numpy as np

from ...system.checkpoint import Checkpointed
from ..solid.firmness import SOFTER, STIFFER
from .contact_pairs import ContactPairs

CLOSE, WIDE = 0.3, 0.7  # of a pair's room: a pair that ends with less gets stiffer, with more softer again. With .3 for both a
# load that holds a crossing takes 72 solves for 55, and what is taut over a bar comes to .34 of the distance for .37
STIFFEST = 4096.0  # product of the factors at most


class Firmness(Checkpointed):
    """Firmness of n particles.

    Attributes:
        boost: (n,) factors from step to step; more: (n,) as many times as much within this attempt.
    """

    STATE = ("boost",)

    def __init__(self, n: int) -> None:
        self.boost, self.more = np.ones(n), np.ones(n)

    @property
    def factors(self) -> np.ndarray:
        """(n,) in this attempt."""
        return np.minimum(self.boost * self.more, STIFFEST)

    def begin(self) -> None:
        """A new attempt."""
        self.more[:] = 1.0

    def stiffen(self, p: ContactPairs) -> None:
        """Particles of pairs with little room left get stiffer within the attempt."""
        self.more[np.unique(p.vertices[p.room < CLOSE])] *= STIFFER

    def commit(self, p: ContactPairs, share: float) -> None:
        """A step, so much of a usual one, was accepted and ended with those pairs."""
        part, boost = np.full(len(self.boost), np.inf), self.factors
        np.minimum.at(part, p.vertices, np.broadcast_to(p.room[:, None], p.vertices.shape))
        self.boost = np.where(part < CLOSE, np.minimum(STIFFER**share * boost, STIFFEST),
                              np.where(part > WIDE, np.maximum(SOFTER**share * boost, 1.0), boost))
        self.begin()

    def clear(self) -> None:
        """The state was changed from outside."""
        self.boost[:] = 1.0
