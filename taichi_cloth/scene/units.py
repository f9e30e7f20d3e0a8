"""Numbers that look like another unit's: said once, not refused. numpy only."""

import warnings

import numpy as np

from .cloth import Cloth
from .fabric import pair

# (least, largest) that cloth has; what is outside is seldom meant
SIZE, DENSITY, RIGIDITY, THICKNESS, GRAVITY = (0.005, 100.0), (0.003, 10.0), (1e-10, 0.1), (1e-6, 0.2), (0.0, 100.0)


def doubts(cloth: Cloth, gravity: np.ndarray) -> list[str]:
    """Sentences on what of a cloth looks like millimetres, grams or another unit."""
    out = []

    def look(what: str, value: float, unit: str, usual: tuple[float, float], hint: str) -> None:
        if not usual[0] <= value <= usual[1]:
            out.append(f"{cloth.name}: {what} = {value:,.4g} {unit} looks like another unit: cloth usually has {usual[0]:g} "
                       f"to {usual[1]:g} {unit}; {hint}")

    uv = cloth.mesh.corner_uv.reshape(-1, 2)
    look("size", float(np.ptp(uv, axis=0).max()), "m", SIZE, "lengths are in metres (a file in mm: tc.load(path, scale=1e-3))")
    look("density", cloth.fabric.density, "kg/m^2", DENSITY, "150 g/m^2 are .15")
    if cloth.fabric.bend is not None:
        look("bend D", max(pair(cloth.fabric.bend.D)), "N m", RIGIDITY, "20 uN m are 2e-5")
    if cloth.contact is not None:
        look("contact thickness", cloth.contact.thickness, "m", THICKNESS, "lengths are in metres: half a millimetre is 5e-4")
    strength = float(np.linalg.norm(gravity))
    if strength > GRAVITY[1]:
        out.append(f"gravity = {strength:,.4g} m/s^2 looks like another unit: 9.81 m/s^2 is usual")
    return out


def say(cloth: Cloth, gravity: np.ndarray) -> None:
    """Warns of them; Python shows each once, with the line that added the cloth."""
    for doubt in doubts(cloth, gravity):
        warnings.warn(doubt, stacklevel=3)
