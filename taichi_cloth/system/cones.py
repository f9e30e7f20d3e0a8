"""Cones of friction, as a solver takes them. numpy only."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Cones:
    """Contacts of particles that have one each, and their friction.

    Attributes:
        index: (k,) particles; normal: (k, 3).
        size: (k,) largest friction [N s].
        way: (k, 3) from their dv to that with which they neither slip nor open [m/s].
        stays: (n,) particles whose dv stays.
        block: (n, 6) [kg], push: (n, 3) [N s] of friction in the system as it is linearized.
    """

    index: np.ndarray
    normal: np.ndarray
    size: np.ndarray
    way: np.ndarray
    stays: np.ndarray
    block: np.ndarray
    push: np.ndarray
