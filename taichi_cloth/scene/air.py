"""Air that cloth moves in: drag, lift and wind. numpy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError
from .winds import velocity

GUSTY = 0.3  # root mean square of gusts, of the mean wind: some .2 along it, as in open country, and less across
Wind = str | ArrayLike | Callable[[float], ArrayLike] | Callable[[np.ndarray, float], ArrayLike]


@dataclass(frozen=True)
class Air:
    """Forces of the air on a triangle that moves through it, with u = velocity - wind, n its normal and c = |n.u| / |u|.

    Viscous: f/A = -normal (n.u) n - tangential (u - (n.u) n). Besides, for a thin plate with `drag` and `lift`:
    f/A = -density/2 |u|^2 (drag c e + lift ((n.e) n - c^2 e)) with e = u/|u|: lift is normal to u.

    Args:
        normal, tangential: viscous coefficients [N s/m^3].
        wind: velocity of the air [m/s]: (3,), or a function of time [s] that returns it. Or a function of positions (n, 3) [m]
            and time that returns (n, 3), or (3,) for all of them. In words, "breeze" blows along x and "gale -z" along -z;
            "gusty breeze" blows in gusts. `taichi-cloth winds` lists them.
        drag, lift: coefficients C_D and C_L of a plate; lift at most drag.
        density: of the air [kg/m^3].
    """

    normal: float = 0.0
    tangential: float = 0.0
    wind: Wind = (0.0, 0.0, 0.0)
    drag: float = 0.0
    lift: float = 0.0
    density: float = 1.2

    def __post_init__(self) -> None:
        for name, unit in (("normal", "N s/m^3"), ("tangential", "N s/m^3"), ("drag", ""), ("lift", "")):
            object.__setattr__(self, name, checks.number(f"air {name}", getattr(self, name), unit, least=0.0))
        object.__setattr__(self, "density", checks.number("air density", self.density, "kg/m^3", positive=True))
        if isinstance(self.wind, str):
            object.__setattr__(self, "wind", _in_words(self.wind))
        elif not callable(self.wind):
            object.__setattr__(self, "wind", checks.vector("air wind", self.wind))
        elif checks.takes(self.wind, 1) is False and checks.takes(self.wind, 2) is False:
            raise SceneError(f"air wind = {checks.shown(self.wind)}: must be a function of time, or of positions and time")
        if self.normal == self.tangential == self.drag == 0:
            raise SceneError("air that neither drags nor lifts does nothing: give it both, as Air(drag=1.2, lift=0.8, "
                             "wind=...), or leave it out")
        if self.lift > self.drag:
            raise SceneError(f"air lift = {self.lift:g}: must be at most drag = {self.drag:g}, as a plate's is")
        self.wind_at(0.0, np.zeros((1, 3)))

    @property
    def varies_in_space(self) -> bool:
        """Whether the wind is a function of positions too."""
        return callable(self.wind) and checks.takes(self.wind, 1) is False

    @property
    def local(self) -> bool:
        """Whether triangles feel different air, or feel it by how fast it is."""
        return self.varies_in_space or self.drag > 0

    def wind_at(self, t: float, x: np.ndarray | None = None) -> np.ndarray:
        """Wind [m/s] at time t [s]: (3,), or (n, 3) at positions x (n, 3) [m] where it varies in space.

        Raises:
            SceneError: a wrong shape or a number that is not finite.
        """
        t = checks.number("t", t, "s")
        x = checks.maybe(x, checks.array, "x", ("n", 3))
        what = f"the wind at t = {t:g} s"
        if not callable(self.wind):
            return checks.vector(what, self.wind, "m/s")
        if not self.varies_in_space:
            return checks.vector(what, self.wind(t), "m/s")  # type: ignore[call-arg, arg-type]
        at = np.zeros((1, 3)) if x is None else x
        blows = self.wind(at, t)  # type: ignore[call-arg, arg-type]
        if np.shape(blows) == (3,):
            return np.broadcast_to(checks.vector(what, blows, "m/s"), at.shape)
        return checks.array(what, blows, at.shape, row="position")


def _in_words(text: str) -> Wind:
    """The wind of a name and an axis, in gusts where "gusty" comes first."""
    first, _, rest = text.strip().partition(" ")
    if first.lower() != "gusty":
        return velocity("air wind", text)
    mean = velocity("air wind", rest)
    if not mean.any():
        raise SceneError(f"air wind = {checks.shown(text)}: calm air has no gusts; draught is the weakest wind that has")
    return Gusts(mean, GUSTY * float(np.linalg.norm(mean)))


@dataclass(frozen=True)
class Gusts:
    """A wind that varies in space and time: a mean, which carries gusts along.

    Gusts are a sum of waves a cos(k.(x - mean t) + omega t + phi) with a normal to k, so that no air is lost. Wave
    lengths go from `length` down to a tenth of it, squared amplitudes as a decade of k^(-5/3), and omega = |a| |k|.

    Args:
        mean: (3,) [m/s].
        strength: root of the mean square of the gusts' speed [m/s].
        length: of the longest waves [m].
        seed: of the waves' directions and phases; the same seed gives the same wind.
        waves: how many.
    """

    mean: ArrayLike
    strength: float
    length: float = 2.0
    seed: int = 0
    waves: int = 24
    _modes: tuple = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        mean = checks.vector("gusts mean", self.mean, "m/s")
        object.__setattr__(self, "mean", tuple(mean.tolist()))
        object.__setattr__(self, "strength", checks.number("gusts strength", self.strength, "m/s", positive=True))
        object.__setattr__(self, "length", checks.number("gusts length", self.length, "m", positive=True))
        object.__setattr__(self, "seed", checks.integer("gusts seed", self.seed, least=0))
        object.__setattr__(self, "waves", checks.integer("gusts waves", self.waves, least=1, most=10_000))
        rng = np.random.default_rng(self.seed)
        size = 2 * np.pi / self.length * np.geomspace(1, 10, self.waves)
        towards, across = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in rng.normal(size=(2, self.waves, 3)))
        across = np.cross(towards, across)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        amplitude = size ** (-1 / 3)  # wave numbers at equal ratios: the energy of each is k E(k)
        amplitude *= self.strength * np.sqrt(2 / np.sum(amplitude**2))
        object.__setattr__(self, "_modes", (size[:, None] * towards, amplitude[:, None] * across, amplitude * size,
                                            rng.uniform(0, 2 * np.pi, self.waves)))

    def __call__(self, x: np.ndarray, t: float) -> np.ndarray:
        """(n, 3) [m/s] at positions x (n, 3) [m] and time t [s]."""
        k, a, omega, phase = self._modes
        mean = np.array(self.mean)
        return mean + np.cos((np.asarray(x) - mean * t) @ k.T + omega * t + phase) @ a
