"""Cloths that fly flat in the wind of their scene, where gusts show little. numpy only."""

from typing import TYPE_CHECKING

import numpy as np

from .air import Gusts
from .fabrics import fabrics
from .winds import flat_from

if TYPE_CHECKING:
    from .scene import Scene


def fliers(scene: "Scene") -> list[str]:
    """A sentence for each fabric that flies flat in the scene's wind, which does not change but for gusts."""
    air = scene.air
    if air is None or not (air.drag or air.normal) or (callable(air.wind) and not isinstance(air.wind, Gusts)):
        return []
    gusts = isinstance(air.wind, Gusts)
    speed = float(np.linalg.norm(air.wind.mean if isinstance(air.wind, Gusts) else air.wind_at(0.0)))
    names = {id(fabric): name for name, fabric in fabrics.items()}
    found: dict[str, float] = {}
    for cloth in scene.cloths:
        for fabric in cloth.fabrics:
            flat = flat_from(fabric.density, air.drag, air.lift, air.density, air.normal)
            found[names.get(id(fabric), repr(cloth.name))] = flat
    more = ": its gusts show little (`taichi-cloth winds`)" if gusts else " (`taichi-cloth winds`)"
    return [f"{name} flies flat from {flat:.1f} m/s on, and this wind has {speed:.1f}{more}"
            for name, flat in found.items() if speed >= flat]
