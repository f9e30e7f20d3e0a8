"""Interpolation between two scenes: cloth of a fabric, and air, that become others bit by bit. numpy only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from .air import Air
from .fabric import Bend, Curve, Fabric, Pair, Shear, Stretch, pair
from .scene import Scene

NUMBERS = ("normal", "tangential", "drag", "lift", "density")  # of air
Part = TypeVar("Part", Stretch, Shear, Bend)


def blend(scene: Scene, was: Scene, becomes: Scene, share: float) -> Scene:
    """`scene`, with fabrics and air between those of two scenes: `share` 0 is those of `was`, 1 those of `becomes`.

    Cloths are told apart by their names; one that is not in all of them stays as it is.
    """
    first, last = ({cloth.name: cloth for cloth in s.cloths} for s in (was, becomes))
    for cloth in scene.cloths:
        if cloth.name in first and cloth.name in last:
            a, b = first[cloth.name], last[cloth.name]
            panels = b.panels
            if len(a.panels) == len(panels):
                panels = tuple((rows, fabric_between(p, q, share)) for (_, p), (rows, q) in zip(a.panels, panels))
            cloth.of_fabric(fabric_between(a.fabric, b.fabric, share), panels)
    scene.air = air_between(was.air, becomes.air, share)
    return scene


def fabric_between(a: Fabric, b: Fabric, share: float) -> Fabric:
    """Every number of a fabric so far from a to b; parts that only one of them has are as b has them."""
    if a == b or share == 1:
        return b
    parts = {name: _between(getattr(a, name), getattr(b, name), share) for name in ("stretch", "shear", "bend")}
    return Fabric(_number(a.density, b.density, share), **parts)


def air_between(a: Air | None, b: Air | None, share: float) -> Air | None:
    """Air whose coefficients and wind are so far from a to b; none is air that neither drags nor lifts."""
    if a is b or share == 1:
        return b
    if share == 0:
        return a
    some = b or a
    assert some is not None
    first, last = ({name: 0.0 if air is None and name != "density" else getattr(air or some, name) for name in NUMBERS}
                   for air in (a, b))
    return Air(wind=_wind(a or some, b or some, share), **{name: _number(first[name], last[name], share) for name in NUMBERS})


def _wind(a: Air, b: Air, share: float) -> Callable:
    """A wind between those of two airs, which varies in space where one of them does."""
    if a.varies_in_space or b.varies_in_space:
        return lambda x, t: _number(a.wind_at(t, x), b.wind_at(t, x), share)
    return lambda t: _number(a.wind_at(t), b.wind_at(t), share)


def _between(a: Part | None, b: Part | None, share: float) -> Part | None:
    """A part of a fabric between two; b where one of them has none, or another model of bending."""
    if a is None or b is None or a == b or getattr(a, "model", "") != getattr(b, "model", ""):
        return b
    values = {f.name: getattr(b, f.name) for f in fields(Bend if isinstance(b, Bend) else type(b))}
    for name, last in values.items():
        first = getattr(a, name)
        if _is_pair(first) and _is_pair(last):
            values[name] = _pair(first, last, share)
    if isinstance(a, Stretch) and isinstance(b, Stretch) and (a.curve or b.curve):
        values |= {"k": None, "curve": tuple(_curve(a, b, axis, share) for axis in (0, 1))}
    return (Bend if isinstance(b, Bend) else type(b))(**values)  # type: ignore[return-value]


def _is_pair(value: object) -> bool:
    """Whether a value is a number or a pair of numbers."""
    return all(isinstance(v, float) for v in (value if isinstance(value, tuple) and len(value) == 2 else (value,)))


def _pair(a: Pair, b: Pair, share: float) -> Pair:
    if isinstance(a, float) and isinstance(b, float):
        return _number(a, b, share)
    (u, v), (p, q) = pair(a), pair(b)
    return _number(u, p, share), _number(v, q, share)


def _curve(a: Stretch, b: Stretch, axis: int, share: float) -> Curve:
    """Tension between those of two laws, at the strains at which one of them bends."""
    laws = [s.curve_of(axis) if s.curve else ((0.0, 0.0), (1.0, s.k_of(axis))) for s in (a, b)]
    strains = np.unique([strain for law in laws for strain, _ in law])
    first, last = (_along(law, strains) for law in laws)
    return tuple(zip(strains.tolist(), _number(first, last, share).tolist()))


def _along(law: Curve, strains: np.ndarray) -> np.ndarray:
    """Tensions at strains, beyond the last point as its last piece goes."""
    (e, f), (g, h) = law[-2:]
    return np.where(strains > g, h + (strains - g) * (h - f) / (g - e), np.interp(strains, *np.transpose(law)))


def _number(a: Any, b: Any, share: float) -> Any:
    return a + share * (b - a)
