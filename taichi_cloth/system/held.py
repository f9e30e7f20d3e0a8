"""Held particles of a step: I - S, the projector on their held directions, and their targets. [BW98 §5.1]"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Held:
    """The held particles of a step.

    Attributes:
        index: (k,) particles.
        projector: (k, 3, 3) I - S.
        target: (k, 3) positions [m] that the held directions must have at the end of the step.
        moving: whether any of them is led along a path, or by a solid.
        y: (k, 3) part of the way there [m] that is an alteration of position, not motion; 0 for pins.
    """

    index: np.ndarray
    projector: np.ndarray
    target: np.ndarray
    moving: bool
    y: np.ndarray

    @classmethod
    def of(cls, index: ArrayLike, projector: ArrayLike, target: ArrayLike, moving: bool, y: ArrayLike, dtype: type) -> "Held":
        """From arrays of any type; `dtype` is that of the compiled kernels."""
        P, goal, shift = (kernel_array(rows, dtype) for rows in (projector, target, y))
        return cls(kernel_array(index, np.int32), P, goal, moving, shift)


def kernel_array(values: ArrayLike, dtype: type) -> np.ndarray:
    """An array of any shape as kernels take it: contiguous, of the type they were compiled for."""
    return np.ascontiguousarray(values, dtype=dtype)
