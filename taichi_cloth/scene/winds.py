"""Winds by name: the speed of each, its effects out of doors, and the angle to which it lifts hanging cloth. numpy only.

The names and speeds are those of Beaufort's scale, each in the middle of its range, with two everyday words: a draught in a
room, and a breeze.
"""

import re
from typing import NamedTuple

import numpy as np

from ..errors import SceneError, did_you_mean, shown

GRAVITY, AIR = 9.81, 1.2  # m/s^2, kg/m^3
DRAG, LIFT = 1.2, 0.8  # of a thin plate that air meets broadside, for a scene that says nothing of its air
FLAT = 80.0  # degrees from the vertical beyond which hanging cloth is said to fly flat
AXIS = re.compile(r"([+-]?)([xyz])")


class Named(NamedTuple):
    """A wind's speed [m/s], its number on Beaufort's scale, and the sign by which it is known."""

    speed: float
    force: int
    sign: str


WINDS = {
    "calm": Named(0.0, 0, "smoke rises straight up"),
    "draught": Named(0.5, 1, "a candle's flame leans, a thin curtain stirs"),
    "light_air": Named(1.0, 1, "smoke drifts, a thin curtain swings out"),
    "light_breeze": Named(2.5, 2, "felt on the face, leaves rustle"),
    "breeze": Named(3.0, 2, "leaves rustle, a thin curtain flies"),
    "gentle_breeze": Named(4.5, 3, "twigs move, a light flag stands out"),
    "moderate_breeze": Named(6.5, 4, "dust and paper fly, small branches move"),
    "fresh_breeze": Named(9.5, 5, "small trees sway"),
    "strong_breeze": Named(12.5, 6, "large branches move, umbrellas turn over"),
    "near_gale": Named(15.5, 7, "whole trees move"),
    "gale": Named(19.0, 8, "twigs break off"),
    "strong_gale": Named(22.5, 9, "tiles come off roofs"),
    "storm": Named(26.5, 10, "trees are uprooted"),
}


def velocity(what: str, text: str) -> np.ndarray:
    """(3,) [m/s] of a wind in words: "breeze" along +x, "gale -z" along -z.

    Raises:
        SceneError: an unknown name, or no axis after it.
    """
    words = text.lower().split()
    axis = AXIS.fullmatch(words[-1]) if len(words) > 1 else None
    name = "_".join(words[:-1] if axis else words)
    if name not in WINDS:
        raise SceneError(f"{what} = {shown(text)}: needs a wind's name, and an axis unless it is +x, such as 'breeze -z'; "
                         f"{did_you_mean(name, WINDS)}; 'gusty' before one, as in 'gusty breeze -z', adds gusts")
    out = np.zeros(3)
    out["xyz".index(axis[2]) if axis else 0] = WINDS[name].speed * (-1.0 if axis and axis[1] == "-" else 1.0)
    return out


def lifted(speed: float, density: float, drag: float = DRAG, lift: float = LIFT, air: float = AIR) -> float:
    """Angle [degrees] from the vertical at which cloth hangs that is held at its upper edge in a steady wind.

    It hangs straight, at the angle a of its weight and the air's force: with s = sin a, c = cos a, q = air speed^2 / 2,
    density g s = q c (drag c + lift s^2).

    Args:
        speed: [m/s]; density: of the cloth [kg/m^2]; drag, lift, air: as in `Air`, and its density.
    """
    q, low, high = air * speed**2 / 2, 0.0, np.pi / 2
    while high - low > 1e-9:
        a = (low + high) / 2
        s, c = np.sin(a), np.cos(a)
        low, high = (a, high) if density * GRAVITY * s < q * c * (drag * c + lift * s**2) else (low, a)
    return float(np.degrees(low))


def flat_from(density: float, drag: float = DRAG, lift: float = LIFT, air: float = AIR, normal: float = 0.0) -> float:
    """Speed [m/s] of the wind in which cloth of a density [kg/m^2] flies flat, by the balance of `lifted`.

    Args:
        drag, lift, air, normal: as in `Air`, whose viscous force along the normal is part of the balance.
    """
    s, c = np.sin(np.radians(FLAT)), np.cos(np.radians(FLAT))
    weight, square, linear = density * GRAVITY * s, air / 2 * c * (drag * c + lift * s**2), normal * c
    return float(2 * weight / (linear + np.sqrt(linear**2 + 4 * square * weight)))


def table(fabrics: dict[str, float]) -> str:
    """The winds, with how far each lifts fabrics of densities [kg/m^2], as lines of text."""
    names = "".join(f"{name:>18}" for name in fabrics)
    kilos = "".join(f"{density:>12.3f} kg/m2" for density in fabrics.values())
    lines = [f"{'wind':17}{'m/s':>6}{'Beaufort':>10}{names}  sign", f"{'':17}{'':6}{'':10}{kilos}"]
    for name, (speed, force, sign) in WINDS.items():
        angles = "".join(f"{lifted(speed, density):>16.0f} °" for density in fabrics.values())
        lines.append(f"{name:17}{speed:6.1f}{force:10}{angles}  {sign}")
    flat = "".join(f"{flat_from(density):>14.1f} m/s" for density in fabrics.values())
    return "\n".join([*lines, f"{f'flat ({FLAT:.0f} °) from':33}{flat}", "",
                      "Angles from the vertical, of cloth that hangs from its upper edge in a steady wind.",
                      "'gusty' before a name adds gusts: 'gusty breeze -z'."])
