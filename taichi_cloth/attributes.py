"""Attributes that a description does not have, or that do not change: setting one is refused, with what would be right.

Python takes `scene.gravty = None` without a word, and the scene has its gravity still.
"""

import dataclasses
import sys
from typing import Any

from .errors import AttributeRefused, did_you_mean


def guard(one: type) -> None:
    """Objects of a class refuse attributes from outside of the package that they do not have; those of a class that does not
    change refuse all."""
    fixed = dataclasses.is_dataclass(one) and one.__dataclass_params__.frozen  # type: ignore[attr-defined]
    if fixed:
        one.__setattr__ = _refuse  # type: ignore[method-assign, assignment]
    elif one.__setattr__ is object.__setattr__:
        one.__setattr__ = _set  # type: ignore[method-assign, assignment]


def _set(self: Any, name: str, value: Any) -> None:
    """Sets an attribute that the object has, or that its own code gives it."""
    if not (name.startswith("_") or name in vars(self) or hasattr(type(self), name)) and _of_package(type(self).__module__):
        if not _of_package(sys._getframe(1).f_globals.get("__name__", "")):
            raise AttributeRefused(_unknown(self, name))
    object.__setattr__(self, name, value)


def _refuse(self: Any, name: str, value: Any) -> None:
    """Objects that do not change are made anew."""
    kind = type(self).__name__
    if name not in {f.name for f in dataclasses.fields(self)}:
        raise AttributeRefused(_unknown(self, name))
    raise AttributeRefused(f"{name} of {kind}: it does not change once it is made; dataclasses.replace(..., {name}=...) makes "
                           "another")


def _unknown(self: Any, name: str) -> str:
    """A sentence on an attribute that there is not."""
    known = {key for key in vars(self) if not key.startswith("_")}
    known |= {key for one in type(self).__mro__ for key, made in vars(one).items() if isinstance(made, property) and made.fset}
    return f"{type(self).__name__} has no attribute {name!r}; {did_you_mean(name, known)}"


def _of_package(module: str) -> bool:
    return module.partition(".")[0] == __package__
