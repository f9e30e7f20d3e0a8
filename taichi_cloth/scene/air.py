"""The air that cloth moves in. numpy only."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError


@dataclass(frozen=True)
class Air:
    """Viscous air drag per area, f/A = -normal (n.u) n - tangential (u - (n.u) n), u = velocity - wind.

    Args:
        normal, tangential: coefficients [N s/m^3], at least 0 and not both 0.
        wind: velocity of the air [m/s], (3,) or a function of time [s] that returns it.
    """

    normal: float
    tangential: float = 0.0
    wind: ArrayLike | Callable[[float], ArrayLike] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("normal", "tangential"):
            value = checks.number(f"air {name}", getattr(self, name), "N s/m^3", least=0.0)
            object.__setattr__(self, name, value)
        wind = checks.function("air wind", self.wind, "time") if callable(self.wind) else checks.vector("air wind", self.wind)
        object.__setattr__(self, "wind", wind)
        if self.normal == self.tangential == 0:
            raise SceneError("air with both coefficients 0 does nothing: leave it out")
        self.wind_at(0.0)

    def wind_at(self, t: float) -> np.ndarray:
        """(3,) wind [m/s] at time t [s].

        Raises:
            SceneError: a wrong shape or a number that is not finite.
        """
        t = checks.number("t", t, "s")
        return checks.vector(f"the wind at t = {t:g} s", self.wind(t) if callable(self.wind) else self.wind, "m/s")
