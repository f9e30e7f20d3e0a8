"""Names of the last release: read and set still, with a warning, until the next release drops them.

`RENAMED` is all of them. docs/reference/deprecations.md lists it.
"""

import warnings
from typing import Any, ClassVar, TypeVar

UNTIL = "0.3"  # the release that knows them no more
RENAMED: dict[str, dict[str, str]] = {  # class -> old name -> new name
    "Force": {"slow": "multirate", "gusty": "time_dependent", "uniform": "interpolated_wind", "abrupt": "stiffens_sharply",
              "driven": "time_dependent_energy", "dead": "dead_load", "coupled": "low_rank", "add_coupled": "add_low_rank"},
    "StepRecord": {"unsettled": "unconverged_contacts", "crossings": "solid_intersections", "least": "min_gap_ratio",
                   "tangled": "known_intersections", "fell_back": "fallback_reason"},
    "Ledger": {"lifted": "pushed_out", "lowered": "pulled_down", "braked": "kinetic_correction"},
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
        _warn(owner.__name__, self.old, self.new)
        return getattr(made, self.new)

    def __set__(self, made: object, value: object) -> None:
        _warn(type(made).__name__, self.old, self.new)
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
            _warn(cls.__name__, old, new, 5)  # the class statement, behind this, `__init_subclass__` and `abc`
            setattr(cls, new, vars(cls)[old])
            delattr(cls, old)


class _WithOldKeys(dict):
    """Numbers by name, that are read by their old names too."""

    of: ClassVar[str]

    def __missing__(self, name: str) -> Any:
        new = RENAMED[self.of].get(name)
        if new is None or new not in self:
            raise KeyError(name)
        _warn(self.of, name, new)
        return self[new]

    def get(self, name: str, default: Any = None) -> Any:
        """See `dict.get`."""
        new = RENAMED[self.of].get(name, name)
        if new != name:
            _warn(self.of, name, new)
        return super().get(new, default)

    @classmethod
    def of_any_version(cls, written: dict[str, Any]) -> "_WithOldKeys":
        """Numbers as they were written, by today's names."""
        return cls({RENAMED[cls.of].get(name, name): value for name, value in written.items()})


class LedgerTerms(_WithOldKeys):
    """Energies of `step.ledger.Ledger` by name [J]."""

    of = "Ledger"


class StepNumbers(_WithOldKeys):
    """A step as telemetry has it."""

    of = "StepRecord"

    @classmethod
    def of_any_version(cls, written: dict[str, Any]) -> "_WithOldKeys":
        """The same, its ledger too."""
        out = super().of_any_version(written)
        if "ledger" in out:
            out["ledger"] = LedgerTerms.of_any_version(out["ledger"])
        return out


def _warn(owner: str, old: str, new: str, level: int = 3) -> None:
    warnings.warn(f"{owner}: `{old}` is called `{new}` now, and is no longer read from {UNTIL} on", DeprecationWarning,
                  stacklevel=level)
