"""Check of units: numbers that look like another unit's are told of once, not refused. numpy only."""

import math

import numpy as np

from ..errors import warn
from .cloth import Cloth
from .fabric import pair
from .solids import Solid, SolidMesh

# (least, largest) that cloth has; other values are seldom meant
SIZE, DENSITY, RIGIDITY, THICKNESS, GRAVITY = (0.005, 50.0), (0.003, 10.0), (1e-10, 0.1), (1e-6, 0.2), (0.0, 100.0)
BODY = (0.003, 50.0)  # m, of a closed mesh, or of one that deforms
TYPICAL = 1.5  # m, of a garment and of a body
UNITS = {1e-3: "millimetres", 1e-2: "centimetres", 0.0254: "inches"}  # by their metres
TIMES = ", times any scale it was read with"
FITS = 3.0  # times the typical size, and a part of it, that a value in a unit is taken to be


def doubts(cloth: Cloth, gravity: np.ndarray) -> list[str]:
    """Sentences on values of a cloth that look like millimetres, grams or another unit."""
    out = []

    def look(what: str, value: float, unit: str, usual: tuple[float, float], hint: str) -> None:
        if not usual[0] <= value <= usual[1]:
            out.append(f"{cloth.name}: {what} = {value:,.4g} {unit} looks like another unit: cloth usually has {usual[0]:g} "
                       f"to {usual[1]:g} {unit}; {hint}")

    mesh = cloth.mesh
    places = mesh.x if mesh.flattened else mesh.corner_uv.reshape(-1, 2)  # flattened, it has no pattern
    size = float(np.ptp(places, axis=0).max())
    look("size", size, "m", SIZE, f"lengths are in metres; {fitting(size, 'tc.load')}")
    look("density", cloth.fabric.density, "kg/m^2", DENSITY, "150 g/m^2 are .15")
    if cloth.fabric.bend is not None:
        look("bend D", max(pair(cloth.fabric.bend.D)), "N m", RIGIDITY, "20 uN m are 2e-5")
    if cloth.contact is not None:
        look("contact thickness", cloth.contact.thickness, "m", THICKNESS, "lengths are in metres: half a millimetre is 5e-4")
    strength = float(np.linalg.norm(gravity))
    if strength > GRAVITY[1]:
        out.append(f"gravity = {strength:,.4g} m/s^2 looks like another unit: 9.81 m/s^2 is usual")
    return out


def doubts_of_solid(solid: Solid) -> list[str]:
    """A sentence on a body that is too large, or too small, to wear cloth. Open meshes that do not deform are passed over:
    they may be hills, which are larger than bodies."""
    if not isinstance(solid.shape, SolidMesh) or not (solid.shape.closed or solid.deforms):
        return []
    size = float(np.ptp(solid.shape.x[0], axis=0).max())
    if BODY[0] <= size <= BODY[1]:
        return []
    return [f"{solid.name}: size = {size:,.4g} m looks like another unit: a body usually has {BODY[0]:g} to {BODY[1]:g} m; "
            f"lengths are in metres; {fitting(size, 'tc.load_solid')}"]


def fitting(size: float, reader: str) -> str:
    """Advice on the `scale` of a reader for a shape of a wrong size [m].

    The scales are of usual units that give a usual size, the likeliest first; else the power of ten that comes nearest. If
    the shape was read with a scale, they multiply it.
    """
    def off(scale: float) -> float:
        return abs(math.log(size * scale / TYPICAL))

    fits = sorted((scale for scale in UNITS if off(scale) < math.log(FITS)), key=off)
    if not fits:
        scale = 10.0 ** round(math.log10(TYPICAL / size))
        return f"{reader}(path, scale={scale:g}) makes it a usual size{TIMES}"
    first, *others = (f"if those are {UNITS[scale]} ({size * scale:.3g} m)" for scale in fits)
    more = "".join(f", scale={s:g} {o}" for s, o in zip(fits[1:], others))
    return f"{reader}(path, scale={fits[0]:g}) {first}{more}{TIMES}"


def say(sentences: list[str]) -> None:
    """Warns of them; Python shows each once, with the line that added the cloth or the solid."""
    for sentence in sentences:
        warn(sentence)
