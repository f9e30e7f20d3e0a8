"""What cloth is made of, in SI units. A part that is None is not modelled and costs nothing.

Differs from [BW98 §4.2]: the paper's a = area makes stiffness depend on the mesh. Here the energy of a
condition is area k/2 C^2 with C free of area, so that k is a modulus [N/m] and refinement changes nothing.
"""

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError

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
        _check(self, "stretch", "k", "N/m", zero=False, pair=True)
        _check(self, "stretch", "k_d", "N s/m", zero=True, pair=True)
        _check(self, "stretch", "b", "", zero=False, pair=True)


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
        _check(self, "shear", "k", "N/m", zero=False)
        _check(self, "shear", "k_d", "N s/m", zero=True)


@dataclass(frozen=True)
class Bend:
    """Bending, over hinges (C = theta - theta_0, stiffness D |e|^2 / (A_1 + A_2)) or by curvatures.

    Args:
        D: bending rigidity [N m]; a number or (for curvature along warp, along weft).
        k_d: damping [N m s], weighted over the mesh like D.
        rest: "flat" (theta_0 = 0), "given" (theta_0 from the mesh's given shape), or (k,) angles theta_0 [rad] of the mesh's
            `inner_edges`, kept as a tuple; None takes "given" where the mesh came without material coordinates and "flat"
            elsewhere.
        model: "hinge", or "curvature": its rigidity is D on any triangulation, its rest shape flat, its cost higher.
    """

    D: Pair
    k_d: Pair = 0.0
    rest: str | tuple[float, ...] | None = None
    model: str = "hinge"

    def __post_init__(self) -> None:
        checks.choice("bend model", self.model, ("hinge", "curvature"))
        _check(self, "bend", "D", "N m", zero=False, pair=True)
        _check(self, "bend", "k_d", "N m s", zero=True, pair=True)
        if checks.is_sequence(self.rest):
            angles = checks.array("bend rest", self.rest, ("k",), row="edge")
            if np.abs(angles).max(initial=0.0) > np.pi:
                raise SceneError(f"bend rest = {np.abs(angles).max():g} rad: must be from -pi to pi")
            object.__setattr__(self, "rest", tuple(angles.tolist()))
        else:
            checks.maybe(self.rest, checks.choice, "bend rest", ("flat", "given"))


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
        _check(self, "cloth contact", "thickness", "m", zero=False)
        _check(self, "cloth contact", "friction", "", zero=True)
        object.__setattr__(self, "itself", checks.flag("cloth contact itself", self.itself))


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
        _check(self, "fabric", "density", "kg/m^2", zero=False)
        for name, kind in (("stretch", Stretch), ("shear", Shear), ("bend", Bend)):
            checks.maybe(getattr(self, name), checks.instance, f"fabric {name}", kind)


def pair(value: Pair) -> tuple[float, float]:
    """(warp, weft) from a number or a pair."""
    return value if isinstance(value, tuple) else (value, value)


def _check(part: object, word: str, name: str, unit: str, zero: bool, pair: bool = False) -> None:
    """A frozen part's number (or pair of them), checked and made float: positive, or at least 0 where `zero` allows it."""
    check = checks.number_or_pair if pair else checks.number
    value = check(f"{word} {name}", getattr(part, name), unit, positive=not zero, least=0.0 if zero else None)
    object.__setattr__(part, name, value)
