"""Where an attempt at a step begins, as contact sees it. numpy only."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..options import usual
from ..system.held import Held

SMALLER = 64  # times smaller than the usual, a step is taken though cloth ends inside or across, where there is no room
SMALLEST = 2048  # times smaller than the usual, layers that allow no collision-free step are pinched, however fast


@dataclass(frozen=True)
class StepStart:
    """An attempt at a step.

    Attributes:
        h: its size; h_usual: the largest one's [s].
        x, v: (n, 3) saved positions [m] and velocities [m/s].
        pins: what a script holds.
        together: whether layers of cloth are part of its problem from the first solve on.
    """

    h: float
    h_usual: float
    x: np.ndarray
    v: np.ndarray
    pins: Held | None = None
    together: bool = False

    @cached_property
    def share(self) -> float:
        """Of a usual step."""
        return min(1.0, self.h / self.h_usual)

    @cached_property
    def small(self) -> bool:
        """Whether the step is so small that smaller ones do not help where there is no room."""
        return self.h <= usual(self.h_usual) / SMALLER

    @cached_property
    def smallest(self) -> bool:
        """Whether there is hardly a smaller step to try."""
        return self.h <= usual(self.h_usual) / SMALLEST
