"""Gas in closed pieces of cloth: its description. numpy only."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .cloth import Cloth

GASES = ("constant", "isothermal", "volume")
ATMOSPHERE = 101_325.0  # Pa
FAR = 0.01  # part of the pressure outside, about 1 kPa: cloth that gas starts with so much more or less of is thrown
Drive = float | Callable[[float], float]


@dataclass(frozen=True, eq=False)
class Inflation:
    """Gas in a piece of cloth; made by `Scene.inflate`.

    Attributes:
        part: vertices of the piece, or None for all of the cloth; name: its name in records.
        pressure: over that outside [Pa], a number or a function of time [s]; None is the pressure there is when it begins.
        gas: "constant", "isothermal" or "volume".
        volume: [m^3] at which the gas has that pressure, or the volume that is held, which may be a function of time [s]. None
            is the volume when it begins.
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
    def time_dependent(self) -> bool:
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


    def begins_at(self, now: float, t: float) -> float | None:
        """Pressure [Pa] over that outside with which a gas of given volume begins at t [s] in `now` m^3; None if its volume is
        the present one."""
        if self.gas == "constant" or self.volume is None:
            return None
        volume = self.volume_at(t)
        assert volume is not None
        if self.gas == "volume":
            return self.bulk * (1 - now / volume)
        return ((self.pressure_at(t) or 0.0) + self.ambient) * volume / now - self.ambient if now > 0 else np.inf

    def check_begin(self, room: str, now: float, t: float = 0.0) -> str:
        """A warning about a gas that begins far from the pressure asked for, since its room has `now` m^3 at t [s]; else
        ""."""
        p, asked = self.begins_at(now, t), 0.0 if self.gas == "volume" else self.pressure_at(t) or 0.0
        if p is None or abs(p - asked) <= FAR * self.ambient:
            return ""
        way = f"a suction of {-p:.3g} Pa" if p < 0 else f"{p:.3g} Pa"
        return (f"{room!r} encloses {now:.4g} m^3 where its gas begins, and volume = {self.volume_at(t):.4g} m^3: it begins "
                f"with {way} and not with the {asked:.3g} Pa that are asked for, which pulls or throws the cloth; volume=None "
                "takes the present volume, a function of time goes on from it")


def make(cloth: Cloth, pressure: object, gas: object, volume: object, part: object, ambient: object, bulk: object,
         key: int) -> Inflation:
    """The inflation of `Scene.inflate`."""
    name = cloth.name if part is None else f"{cloth.name}.{part}" if isinstance(part, str) else f"{cloth.name}.part{key}"
    checks.choice("gas", gas, GASES)
    if gas == "constant" and pressure is None:
        raise SceneError(f"inflate: gas of constant pressure in {name!r} needs its pressure [Pa]")
    if gas == "constant" and volume is not None:
        raise SceneError(f"inflate: volume = {shown(volume)}: `volume` cannot be set for gas=\"constant\"; "
                         "give `pressure` alone, or use gas=\"isothermal\" or gas=\"volume\"")
    if gas == "volume" and pressure is not None:
        raise SceneError(f"inflate: pressure = {shown(pressure)}: if the volume is given, the pressure follows from it; "
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
