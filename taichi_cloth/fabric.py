"""What cloth is made of, in SI units. A part that is None is not modelled and costs nothing.

Differs from [BW98 §4.2]: the paper's a = area makes stiffness depend on the mesh. Here the energy of a
condition is area k/2 C^2 with C free of area, so that k is a modulus [N/m] and refinement changes nothing.
"""

import math
from dataclasses import dataclass

from .errors import SceneError, check_choice

Pair = float | tuple[float, float]


@dataclass(frozen=True)
class Stretch:
    """Stretch along warp (u) and weft (v): C_u = |w_u| - b_u, C_v = |w_v| - b_v (10).

    Args:
        k: stiffness [N/m]; a number or (warp, weft).
        k_d: damping [N s/m], likewise; 0 costs nothing.
        b: rest stretch, likewise; 1 is the pattern's own size.
    """

    k: Pair
    k_d: Pair = 0.0
    b: Pair = 1.0

    def __post_init__(self) -> None:
        _check("stretch", "k", self.k, "N/m", zero=False)
        _check("stretch", "k_d", self.k_d, "N s/m", zero=True)
        _check("stretch", "b", self.b, "", zero=False)


@dataclass(frozen=True)
class Shear:
    """Shear: C = w_u . w_v.

    Args:
        k: stiffness [N/m].
        k_d: damping [N s/m].
    """

    k: float
    k_d: float = 0.0

    def __post_init__(self) -> None:
        _check("shear", "k", self.k, "N/m", zero=False, pair=False)
        _check("shear", "k_d", self.k_d, "N s/m", zero=True, pair=False)


@dataclass(frozen=True)
class Bend:
    """Bending, over hinges (C = theta - theta_0, stiffness D |e|^2 / (A_1 + A_2)) or by curvatures.

    Args:
        D: bending rigidity [N m]; a number or (for curvature along warp, along weft).
        k_d: damping [N m s], weighted over the mesh like D.
        rest: "flat" (theta_0 = 0) or "given" (theta_0 from the mesh's given shape); None takes "given" where
            the mesh came without material coordinates and "flat" elsewhere.
        model: "hinge", or "curvature": its rigidity is D on any triangulation, its rest shape flat, its cost higher.
    """

    D: Pair
    k_d: Pair = 0.0
    rest: str | None = None
    model: str = "hinge"

    def __post_init__(self) -> None:
        check_choice("bend model", self.model, ("hinge", "curvature"))
        _check("bend", "D", self.D, "N m", zero=False)
        _check("bend", "k_d", self.k_d, "N m s", zero=True)
        if self.rest is not None:
            check_choice("bend rest", self.rest, ("flat", "given"))


@dataclass(frozen=True)
class ClothContact:
    """How a piece of cloth meets other cloth, and itself.

    Args:
        thickness: distance [m] that its middle surface keeps from that of a like cloth; two keep the mean of theirs.
        friction: Coulomb's coefficient; between two cloths it is the geometric mean of theirs.
        itself: whether it meets itself too.
    """

    thickness: float
    friction: float = 0.3
    itself: bool = True

    def __post_init__(self) -> None:
        _check("cloth contact", "thickness", self.thickness, "m", zero=False, pair=False)
        _check("cloth contact", "friction", self.friction, "", zero=True, pair=False)


@dataclass(frozen=True)
class Fabric:
    """A fabric.

    Args:
        density: mass per material area [kg/m^2].
        stretch, shear, bend: its conditions; None leaves one out.
    """

    density: float
    stretch: Stretch | None = None
    shear: Shear | None = None
    bend: Bend | None = None

    def __post_init__(self) -> None:
        _check("fabric", "density", self.density, "kg/m^2", zero=False, pair=False)
        for name, kind in (("stretch", Stretch), ("shear", Shear), ("bend", Bend)):
            part = getattr(self, name)
            if part is not None and not isinstance(part, kind):
                raise SceneError(f"fabric {name} must be a {kind.__name__} or None, not {part!r}")


def pair(value: Pair) -> tuple[float, float]:
    """(warp, weft) from a number or a pair."""
    if isinstance(value, (tuple, list)):
        return float(value[0]), float(value[1])
    return float(value), float(value)


def _check(part: str, name: str, value, unit: str, zero: bool, pair: bool = True) -> None:
    """Each number of `value` is finite and positive, or zero where `zero` allows it."""
    numbers = value if isinstance(value, (tuple, list)) else (value,)
    if len(numbers) not in ((1, 2) if pair else (1,)):
        raise SceneError(f"{part} {name} needs {'a number or a pair' if pair else 'one number'}, not {value!r}")
    for v in numbers:
        try:
            good = math.isfinite(v) and (v > 0 or (zero and v == 0))
        except TypeError:
            good = False
        if not good:
            bound = "at least 0" if zero else "positive (None leaves the part out)" if name != "density" else "positive"
            raise SceneError(f"{part} {name} = {v!r}{' ' + unit if unit else ''}: must be {bound}")
