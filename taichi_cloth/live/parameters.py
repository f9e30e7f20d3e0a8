"""Parameters of a scene's build function, as a page shows them: by their defaults, and by RANGES of the scene's file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .. import checks
from ..errors import SceneError, did_you_mean, shown

WIDE = {int: 2, float: 4}  # times the default value, to which a range goes where the scene's file names none
STEPS = 200  # of a slider for numbers, at least


@dataclass(frozen=True)
class Parameter:
    """One that can be changed.

    Attributes:
        value: where it begins; its type is the parameter's: bool, int, float or str.
        range: (low, high) of a slider; None where nothing says how far it goes.
        meaning: with its unit, in a line that is shown beside it.
        every: whether it is one of `scene.every.EVERY`, whose words are known before a scene is built.
    """

    name: str
    value: bool | int | float | str
    range: tuple[float, float] | None = None
    meaning: str = ""
    every: bool = False

    @property
    def step(self) -> float:
        """From one place of the slider to the next: 1, 2 or 5 times a power of ten."""
        if self.range is None or isinstance(self.value, int):
            return 1
        finest = (self.range[1] - self.range[0]) / STEPS
        power = 10.0 ** math.floor(math.log10(finest))
        return next(power * k for k in (5, 2, 1) if power * k <= finest)


def parameters(options: Mapping[str, inspect.Parameter], ranges: object, given: Mapping[str, object] | None = None
               ) -> tuple[Parameter, ...]:
    """Those with a default that a page can show, in order.

    Args:
        options: of the build function; ranges: the scene file's RANGES.
        given: values in place of the defaults.

    Raises:
        SceneError: RANGES is no table of pairs, or names an option that build() does not have.
    """
    table: dict[str, object] = checks.instance("RANGES", ranges, dict)
    for name in table:
        if name not in options:
            raise SceneError(f"RANGES has {shown(name)}, which build() does not take; {did_you_mean(name, options)}")
    out = []
    for name, option in options.items():
        default: Any = option.default
        value: Any = (given or {}).get(name, default)
        if type(default) in (int, float):
            pair = _pair(name, table[name]) if name in table else _usual(default)
            kind = type(default)
            out.append(Parameter(name, value, pair and (min(kind(pair[0]), value), max(kind(pair[1]), value))))
        elif type(default) in (bool, str):
            out.append(Parameter(name, value))
    return tuple(out)


def _pair(name: str, pair: Any) -> tuple[float, float]:
    """A range as the file has it."""
    if not checks.is_sequence(pair) or len(pair) != 2:
        raise SceneError(f"RANGES[{name!r}] = {shown(pair)}: must be a pair of numbers")
    low, high = (checks.number(f"RANGES[{name!r}]", end) for end in pair)
    if not low < high:
        raise SceneError(f"RANGES[{name!r}] = ({low:g}, {high:g}): the first must be less")
    return low, high


def _usual(default: int | float) -> tuple[float, float] | None:
    """From 0 (1 for whole numbers) to some times the default, on its side of 0; None if that is 0."""
    if not default:
        return None
    ends = math.copysign(1 if isinstance(default, int) else 0, default), WIDE[type(default)] * default
    return min(ends), max(ends)
