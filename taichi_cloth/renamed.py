"""Names of the last release: read and set still, with a warning, until the next release drops them.

`RENAMED` is all of them. docs/reference/deprecations.md lists it.
"""

import warnings
from typing import Any, TypeVar

UNTIL = "0.3"  # the release that knows them no more
RENAMED: dict[str, dict[str, str]] = {  # class -> old name -> new name
    "Force": {"slow": "multirate", "gusty": "time_dependent", "uniform": "interpolated_wind", "abrupt": "stiffens_sharply",
              "driven": "time_dependent_energy", "dead": "dead_load", "coupled": "low_rank", "add_coupled": "add_low_rank"},
    "StepRecord": {"unsettled": "unconverged_contacts", "crossings": "solid_intersections", "least": "min_gap_ratio",
                   "tangled": "known_intersections", "fell_back": "fallback_reason"},
    "Tally": {"crossings": "solid_intersections", "least": "min_gap_ratio", "tangled": "known_intersections",
              "fell_back": "fallbacks"},
    "Row": {"fell_back": "fallbacks"},
}
C = TypeVar("C", bound=type)


class _OldName:
    """An attribute by its old name. Reading it from the class warns of nothing: `help` and `inspect` read all there are."""

    def __init__(self, old: str, new: str) -> None:
        self.old, self.new = old, new

    def __get__(self, made: object, owner: type) -> Any:
        if made is None:
            return getattr(owner, self.new, None)
        _warn(owner, self.old, self.new)
        return getattr(made, self.new)

    def __set__(self, made: object, value: object) -> None:
        _warn(type(made), self.old, self.new)
        setattr(made, self.new, value)


def old_names(cls: C) -> C:
    """Gives a class its attributes by their old names, too."""
    for old, new in RENAMED[cls.__name__].items():
        setattr(cls, old, _OldName(old, new))
    return cls


def take_over(cls: type, base: str) -> None:
    """A subclass of `base` that declares old names has them by the new ones from here on."""
    for old, new in RENAMED[base].items():
        if old in vars(cls):
            _warn(cls, old, new, 5)  # the class statement, behind this, `__init_subclass__` and `abc`
            setattr(cls, new, vars(cls)[old])
            delattr(cls, old)


def up_to_date(record: dict[str, Any], cls: str) -> dict[str, Any]:
    """A record as it was written, by today's names."""
    names = RENAMED[cls]
    return {names.get(name, name): value for name, value in record.items()}


def _warn(cls: type, old: str, new: str, level: int = 3) -> None:
    warnings.warn(f"{cls.__name__}: `{old}` is called `{new}` now, and is no longer read from {UNTIL} on", DeprecationWarning,
                  stacklevel=level)
