"""Starts nearer than the thickness: each particle has a part of it, which grows from the first distance to all. numpy only.

Scans, and drapes of other programs, start nearer to a body, or to themselves, than a scene's thickness. To throw such cloth
out within a step takes speeds that no step passes. Particles near at the start therefore keep the distance they have, and more
by and by: no faster than the cloth really gets away.
"""

import numpy as np

from ..system.checkpoint import Checkpointed

NEAR = 0.5  # of its distance: a particle that starts nearer has a part of its thickness only
LEAST = 0.005  # part of its thickness that any particle has
FURTHER = 1.3  # times the distance that there is, to which thickness may grow in a step; without it two sheets on a mesh 1/20
# of the thickness away (`test_near_starts`) take 28 steps for 8, and 27 where thickness does not grow at all


class ThicknessRamp(Checkpointed):
    """Growth of the thickness of n particles.

    Attributes:
        part: (n,) that each has; active: whether any has not all of it.
    """

    STATE = ("part",)

    def __init__(self, n: int) -> None:
        self.part, self.active = np.ones(n), False

    def resumed(self) -> None:
        """See `Checkpointed`."""
        self.active = bool((self.part < 1).any())

    def begin(self, particles: np.ndarray, measured: np.ndarray) -> int:
        """Cloth starts, with distances measured (k,) between particles (k, .), in thicknesses; how many start near."""
        self.part[:] = 1.0
        self.add(particles, measured)
        return int(np.sum(self.part < 1))

    def add(self, particles: np.ndarray, measured: np.ndarray) -> None:
        """Pairs begin to act between particles, arguments as in `begin`."""
        near = (measured < NEAR) & (measured > 0)
        rows, part = particles[near], np.maximum(measured[near, None], LEAST)
        np.minimum.at(self.part, rows, np.broadcast_to(part, rows.shape))
        self.resumed()

    def grow(self, particles: np.ndarray, measured: np.ndarray) -> None:
        """After a step, with distances as in `begin` where it ended."""
        there = self.part.copy()
        np.minimum.at(there, particles, np.broadcast_to(measured[:, None], particles.shape))
        self.part = np.clip(FURTHER * there, self.part, 1.0)
        self.resumed()

    def of(self, particles: np.ndarray) -> np.ndarray:
        """(k,) the least part of particles (k, .)."""
        return self.part[particles].min(axis=1)
