"""Gas in closed pieces of cloth: what is asked of it. numpy only."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .cloth import Cloth

GASES = ("constant", "isothermal", "volume")
ATMOSPHERE = 101_325.0  # Pa
Drive = float | Callable[[float], float]


@dataclass(frozen=True, eq=False)
class Inflation:
    """Gas in a piece of cloth; made by `Scene.inflate`.

    Attributes:
        part: vertices of the piece, or None for all of the cloth; name: what records call it.
        pressure: over that outside [Pa], a number or a function of time [s]; None is what there is when it begins.
        gas: "constant", "isothermal" or "volume".
        volume: [m^3] where the gas has that pressure, or the volume that is held, which may be a function of time [s]; None is
            what there is when it begins.
        ambient: pressure outside [Pa].
        bulk: modulus [Pa] by which "volume" is held.
        key: rises with every inflation that is made.
    """

    cloth: Cloth
    part: np.ndarray | None
    name: str
    pressure: Drive | None
    gas: str
    volume: Drive | None
    ambient: float
    bulk: float
    key: int

    def __repr__(self) -> str:
        return f"<Inflation of {self.name!r}, gas {self.gas!r}>"

    @property
    def driven(self) -> bool:
        """Whether it changes with time by itself."""
        return callable(self.pressure) or callable(self.volume)

    def of(self, cloth: Cloth, part: np.ndarray | None) -> bool:
        """Whether it is in that piece."""
        return self.cloth is cloth and (self.part is part is None or
                                        (self.part is not None and part is not None and np.array_equal(self.part, part)))

    def pressure_at(self, t: float) -> float | None:
        """[Pa] at time t [s], checked."""
        return _at(f"pressure in {self.name!r}", self.pressure, t, "Pa",
                   least=-self.ambient if self.gas == "isothermal" else None)

    def volume_at(self, t: float) -> float | None:
        """[m^3] at time t [s], checked."""
        return _at(f"volume of {self.name!r}", self.volume, t, "m^3", positive=True)


def make(cloth: Cloth, pressure: object, gas: object, volume: object, part: object, ambient: object, bulk: object,
         key: int) -> Inflation:
    """As `Scene.inflate`."""
    name = cloth.name if part is None else f"{cloth.name}.{part}" if isinstance(part, str) else f"{cloth.name}.part{key}"
    checks.choice("gas", gas, GASES)
    if gas == "constant" and pressure is None:
        raise SceneError(f"inflate: gas of constant pressure in {name!r} needs its pressure [Pa]")
    if gas == "constant" and volume is not None:
        raise SceneError(f"inflate: volume = {shown(volume)}: gas of constant pressure takes what volume it finds; "
                         "use gas=\"isothermal\" or gas=\"volume\"")
    if gas == "volume" and pressure is not None:
        raise SceneError(f"inflate: pressure = {shown(pressure)}: where the volume is given, the pressure is what comes out; "
                         "see sim.gas()")
    if gas == "isothermal" and callable(volume):
        raise SceneError("inflate: the volume at which isothermal gas has its pressure must be a number; pressures may change")
    made = Inflation(cloth, _vertices(cloth, part), name, _drive("pressure", pressure),  # type: ignore[arg-type]
                     gas, _drive("volume", volume),  # type: ignore[arg-type]
                     checks.number("inflate: ambient", ambient, "Pa", least=0.0),
                     checks.number("inflate: bulk", bulk, "Pa", positive=True), key)
    made.pressure_at(0.0)
    made.volume_at(0.0)
    return made


def _vertices(cloth: Cloth, part: object) -> np.ndarray | None:
    if part is None:
        return None
    index = np.unique(cloth.mesh.select(part))
    if not np.isin(cloth.mesh.faces, index).all(axis=1).any():
        raise SceneError(f"inflate: no triangle of {cloth.name!r} has all of its corners in part = {shown(part)}")
    return index


def _drive(what: str, value: object) -> object:
    return checks.function(f"inflate: {what}", value, "time") if callable(value) else value


def _at(what: str, value: object, t: float, unit: str, **bounds) -> float | None:
    if value is None:
        return None
    if callable(value):
        return checks.number(f"{what} at t = {t:g} s", value(t), unit, **bounds)
    return checks.number(what, value, unit, **bounds)
