"""Base state of an implicit step: M (v - v_base) = c f(x_base + c v, v). numpy only.

Backward Euler starts from the saved state with c = h; a multistep method from an extrapolated state, with a c of its own.
"""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Base:
    """Base state of a step of h [s].

    Attributes:
        h: size of the step; c: the effective step of the formula [s].
        x_offset: (n, 3) x_base less the saved positions [m]; v: (n, 3) v_base [m/s].
        guess: (n, 3) velocities [m/s] of the end, where the first solve is linearized.
    """

    h: float
    c: float
    x_offset: np.ndarray
    v: np.ndarray
    guess: np.ndarray
