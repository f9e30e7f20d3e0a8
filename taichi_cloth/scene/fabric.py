"""Materials of cloth, in SI units. A part that is None is not modelled and costs nothing.

Differs from [BW98 §4.2]: the paper's a = area makes stiffness depend on the mesh. Here the energy of a
condition is area k/2 C^2 with C free of area, so that k is a modulus [N/m] and refinement changes nothing.
"""

from dataclasses import dataclass, replace

import numpy as np

from .. import checks
from ..errors import SceneError

Pair = float | tuple[float, float]
Curve = tuple[tuple[float, float], ...]

STIFFER = 1000.0  # tension beyond a limit over k (s - L)^2 / (L - b): ten times the load that reaches it goes a tenth further


@dataclass(frozen=True)
class Stretch:
    """Stretch along warp (u) and weft (v): C_u = |w_u| - b_u, C_v = |w_v| - b_v (10).

    Tension beyond a limit L: T = k C + 1000 k (|w| - L)^2 / (L - b). Along a curve: from point to point, as the first piece
    below 0, as the last beyond its end.

    Args:
        k: stiffness [N/m]; a number or (warp, weft). With a curve it is the curve's first slope.
        k_d: damping [N s/m], likewise; 0 costs nothing.
        b: rest stretch, likewise; 1 is the pattern's own size.
        limit: stretch |w| beyond which the fabric hardly goes, likewise; more than b and 1. None leaves it out.
        curve: points (strain C, tension [N/m]), convex and from (0, 0) on, kept as tuples; or (warp's, weft's).
    """

    k: Pair | None = None
    k_d: Pair = 0.0
    b: Pair = 1.0
    limit: Pair | None = None
    curve: Curve | tuple[Curve, Curve] | None = None

    def __post_init__(self) -> None:
        _check(self, "stretch", "b", "", zero=False, pair=True)
        if self.curve is not None:
            self._take_curve()
        _check(self, "stretch", "k", "N/m", zero=False, pair=True)
        _check(self, "stretch", "k_d", "N s/m", zero=True, pair=True)
        if self.limit is not None:
            _check(self, "stretch", "limit", "", zero=False, pair=True)
            for limit, b in zip(pair(self.limit), pair(self.b)):
                if not limit > max(b, 1.0):
                    raise SceneError(f"stretch limit = {limit:g}: must be more than 1, and than the rest stretch b = {b:g}")

    def scaled(self, factor: float) -> "Stretch":
        """With all its tensions times a factor: k and its damping, or the curve's."""
        if self.curve is None:
            return replace(self, k=_times(self.k, factor), k_d=_times(self.k_d, factor))
        two = isinstance(self.curve[0][0], tuple)
        parts = [tuple((strain, tension * factor) for strain, tension in self.curve_of(axis)) for axis in range(1 + two)]
        return replace(self, k=None, k_d=_times(self.k_d, factor), curve=tuple(parts) if two else parts[0])  # type: ignore[arg-type]

    def k_of(self, axis: int) -> float:
        """k [N/m] of warp (0) or weft (1)."""
        assert self.k is not None
        return pair(self.k)[axis]

    def curve_of(self, axis: int) -> Curve:
        """The curve of warp (0) or weft (1)."""
        assert self.curve is not None
        first = self.curve[0]
        return self.curve[axis] if isinstance(first[0], tuple) else self.curve  # type: ignore[return-value]

    def _take_curve(self) -> None:
        """Checks the curve; k is its first slope."""
        if self.k is not None:
            raise SceneError(f"stretch k = {checks.shown(self.k)}: the curve gives k already; give one of them")
        given = self.curve
        two = checks.is_sequence(given) and len(given) == 2 and all(  # type: ignore[arg-type]
            checks.is_sequence(g) and len(g) and checks.is_sequence(g[0]) for g in given)  # type: ignore[union-attr, arg-type]
        names = ("stretch curve of the warp", "stretch curve of the weft") if two else ("stretch curve",)
        parts = [_curve(name, c) for name, c in zip(names, given if two else (given,))]  # type: ignore[arg-type]
        object.__setattr__(self, "curve", tuple(parts) if two else parts[0])
        slopes = [c[1][1] / c[1][0] for c in parts]
        object.__setattr__(self, "k", tuple(slopes) if two else slopes[0])


@dataclass(frozen=True)
class Shear:
    """Shear: C = w_u . w_v, the sine of the angle by which unstretched cloth shears.

    Args:
        k: stiffness [N/m].
        k_d: damping [N s/m].
        limit: |C| beyond which the fabric hardly goes, with the law of `Stretch`; None leaves it out.
    """

    k: float
    k_d: float = 0.0
    limit: float | None = None

    def __post_init__(self) -> None:
        _check(self, "shear", "k", "N/m", zero=False)
        _check(self, "shear", "k_d", "N s/m", zero=True)
        if self.limit is not None:
            _check(self, "shear", "limit", "", zero=False)

    def scaled(self, factor: float) -> "Shear":
        """With stiffness and damping times a factor."""
        return replace(self, k=self.k * factor, k_d=self.k_d * factor)


@dataclass(frozen=True)
class Bend:
    """Bending, over hinges (C = theta - theta_0, stiffness D |e|^2 / (A_1 + A_2)) or by curvatures.

    Args:
        D: bending rigidity [N m]; a number or (for curvature along warp, along weft).
        k_d: damping [N m s], weighted over the mesh like D.
        rest: "flat" (theta_0 = 0), "given" (theta_0 from the mesh's given shape), or (k,) angles theta_0 [rad] of the mesh's
            `inner_edges`, kept as a tuple. None takes "given" for a mesh without material coordinates, else "flat".
        model: "hinge", or "curvature": its rigidity is D on any triangulation, its rest shape flat, its cost higher.
        friction: HB [N], half the width of the loop of moment over curvature, M = D kappa +- HB (tables give 2HB); a number or
            (warp, weft).
        yield_: curvature [1/m] beyond which cloth stays bent: from kappa it comes back to
            (1 - hardening) (kappa - yield_); None never.
        hardening: part of D that does not yield, between 0 and 1.
        recovery: rate [1/s] at which creases go back while they are pulled back, or (rate, curvature [1/m] that stays).
    """

    D: Pair
    k_d: Pair = 0.0
    rest: str | tuple[float, ...] | None = None
    model: str = "hinge"
    friction: Pair = 0.0
    yield_: float | None = None
    hardening: float = 0.2
    recovery: Pair = 0.0

    def __post_init__(self) -> None:
        checks.choice("bend model", self.model, ("hinge", "curvature"))
        _check(self, "bend", "D", "N m", zero=False, pair=True)
        _check(self, "bend", "k_d", "N m s", zero=True, pair=True)
        _check(self, "bend", "friction", "N", zero=True, pair=True)
        if self.yield_ is not None:
            _check(self, "bend", "yield_", "1/m", zero=False)
        number = checks.number("bend hardening", self.hardening, positive=True)
        if number >= 1:
            raise SceneError(f"bend hardening = {number:g}: must be less than 1")
        object.__setattr__(self, "hardening", number)
        recovery = checks.number_or_pair("bend recovery", self.recovery, "", least=0.0)
        object.__setattr__(self, "recovery", recovery if isinstance(recovery, tuple) else (recovery, 0.0))
        if self.recovery != (0.0, 0.0) and self.yield_ is None:
            raise SceneError("bend recovery: nothing stays bent without yield_")
        if checks.is_sequence(self.rest):
            angles = checks.array("bend rest", self.rest, ("k",), row="edge")
            if np.abs(angles).max(initial=0.0) > np.pi:
                raise SceneError(f"bend rest = {np.abs(angles).max():g} rad: must be from -pi to pi")
            object.__setattr__(self, "rest", tuple(angles.tolist()))
        else:
            checks.maybe(self.rest, checks.choice, "bend rest", ("flat", "given"))

    def scaled(self, factor: float) -> "Bend":
        """With all its moments times a factor: rigidity, damping and friction."""
        return replace(self, D=_times(self.D, factor), k_d=_times(self.k_d, factor), friction=_times(self.friction, factor))


@dataclass(frozen=True)
class ClothContact:
    """How a piece of cloth meets other cloth, and itself.

    Args:
        thickness: distance [m] that its middle surface keeps from that of a like cloth; two keep the mean of theirs.
        friction: Coulomb's coefficient; between two cloths it is the geometric mean of theirs.
        itself: whether it meets itself too.
        layer: of two cloths, the one with the higher number lies outside, further from solids. If it starts on the wrong
            side, it is moved out before the first step. Two with the same number have no order.
    """

    thickness: float
    friction: float = 0.3
    itself: bool = True
    layer: int = 0

    def __post_init__(self) -> None:
        _check(self, "cloth contact", "thickness", "m", zero=False)
        _check(self, "cloth contact", "friction", "", zero=True)
        object.__setattr__(self, "itself", checks.flag("cloth contact itself", self.itself))
        object.__setattr__(self, "layer", checks.integer("cloth contact layer", self.layer, 0))


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

    @property
    def damped(self) -> bool:
        """Whether any of its conditions is."""
        parts = [part.k_d for part in (self.stretch, self.shear, self.bend) if part is not None]
        return any(max(pair(k_d)) > 0 for k_d in parts)

    def elastic(self, rest: Pair) -> "Fabric":
        """The fabric as an elastic band that is sewn on stretched: its rest stretch b, along warp and weft.

        Args:
            rest: length at rest over the pattern's, a number or (warp, weft); .8 pulls a waist in by a fifth.

        Raises:
            SceneError: a fabric without stretch, or rest stretches that are not positive.
        """
        if self.stretch is None:
            raise SceneError("elastic: the fabric has no stretch")
        return replace(self, stretch=replace(self.stretch, b=rest))

    def scaled(self, density: float = 1.0, stretch: float = 1.0, shear: float = 1.0, bend: float = 1.0) -> "Fabric":
        """The fabric with its numbers times factors: `scaled(density=2, stretch=.5)` is twice as heavy, half as stiff.

        A factor is for stiffness and damping alike, and for friction of bending. Limits, rest shapes and the curvature
        beyond which it yields stay.

        Raises:
            SceneError: a factor that is not positive, or one for a part that the fabric does not have.
        """
        factors = {"stretch": stretch, "shear": shear, "bend": bend}
        changes: dict = {"density": self.density * checks.number("scaled: density", density, positive=True)}
        for name, factor in factors.items():
            factor, part = checks.number(f"scaled: {name}", factor, positive=True), getattr(self, name)
            if factor != 1 and part is None:
                raise SceneError(f"scaled: {name} = {factor:g}: the fabric has no {name}")
            if factor != 1:
                changes[name] = part.scaled(factor)
        return replace(self, **changes)


def pair(value: Pair) -> tuple[float, float]:
    """(warp, weft) from a number or a pair."""
    return value if isinstance(value, tuple) else (value, value)


def _times(value: Pair | None, factor: float) -> Pair:
    assert value is not None
    return (value[0] * factor, value[1] * factor) if isinstance(value, tuple) else value * factor


def remembers(bend: Bend) -> bool:
    """Whether a fabric's bending has friction or creases."""
    return bool(max(pair(bend.friction)) or bend.yield_ is not None)


def _curve(what: str, given: object) -> Curve:
    """Points (strain, tension) as tuples of float."""
    points = checks.array(what, given, ("p", 2), row="point")
    if len(points) < 2 or (points[0] != 0).any():
        raise SceneError(f"{what}: needs two points or more, the first of them (0, 0)")
    steps = np.diff(points, axis=0)
    if (steps[:, 0] <= 0).any():
        raise SceneError(f"{what}: strains must grow from point to point")
    slopes = steps[:, 1] / steps[:, 0]
    if slopes[0] <= 0 or (np.diff(slopes) < -1e-9 * slopes[-1]).any():
        k = int(np.argmax(np.diff(slopes, prepend=0.0) < 0)) if slopes[0] > 0 else 0
        raise SceneError(f"{what}: must be convex and grow; from point {k} on it is less steep than before")
    return tuple((float(strain), float(tension)) for strain, tension in points)


def _check(part: object, word: str, name: str, unit: str, zero: bool, pair: bool = False) -> None:
    """A frozen part's number (or pair of them), checked and made float: positive, or at least 0 where `zero` allows it."""
    check = checks.number_or_pair if pair else checks.number
    value = check(f"{word} {name}", getattr(part, name), unit, positive=not zero, least=0.0 if zero else None)
    object.__setattr__(part, name, value)
