"""Keywords that a public function does not take: its error suggests the nearest that it takes, or who takes this one.

Python itself suggests the nearest from 3.13 on.
"""

import difflib
import functools
import inspect
import re
import sys
import types
from collections.abc import Callable
from typing import Any

REFUSED = re.compile(r"([\w.<>]+)\(\) got an unexpected keyword argument '(\w+)'$")
MARK = "__suggests__"
OWNERS = 3  # that a sentence names


def suggesting(found: Any) -> Any:
    """A public function with errors that suggest. A class gets such methods, with its bases and its subclasses so far."""
    if isinstance(found, types.FunctionType):
        return _wrapped(found)
    if isinstance(found, type) and not issubclass(found, Exception):
        for one in {*found.__mro__, *type.__subclasses__(found)}:
            if one.__module__.startswith(f"{__package__}.") and MARK not in vars(one):
                _change(one)
    return found


def _change(one: type) -> None:
    """Wraps the public methods of a class."""
    setattr(one, MARK, True)
    for name, made in list(vars(one).items()):
        inner = made.__func__ if isinstance(made, classmethod) else made
        if isinstance(inner, types.FunctionType) and (name == "__init__" or not name.startswith("_")):
            wrapped = _wrapped(inner)
            setattr(one, name, classmethod(wrapped) if isinstance(made, classmethod) else wrapped)


def _wrapped(function: types.FunctionType) -> Callable:
    """The function with errors that suggest. It stays as it is if it takes no keywords, or is Taichi's."""
    if hasattr(function, MARK):
        return function
    named = [p for p in inspect.signature(function).parameters.values() if p.kind is not p.POSITIONAL_ONLY]
    if len(named) < 2 or any(key.startswith("_is_") for key in vars(function)):
        return function

    @functools.wraps(function)
    def inner(*args: Any, **options: Any) -> Any:
        try:
            return function(*args, **options)
        except TypeError as error:
            if options:
                _suggest(error, function, options)
            raise

    setattr(inner, MARK, True)
    return inner


def _suggest(error: TypeError, function: Callable, options: dict[str, Any]) -> None:
    """Adds the nearest keyword of the function that refused an option. It may be one that `function` has called."""
    said = REFUSED.match(str(error))
    if not said or said[2] not in options:
        return
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    seen = {} if last is None else last.tb_frame.f_globals | last.tb_frame.f_locals
    refused = function if said[1] == function.__qualname__ else seen.get(said[1].removesuffix(".__init__"))
    if not callable(refused):
        return
    near = difflib.get_close_matches(said[2], list(inspect.signature(refused).parameters), n=1)
    owners = [] if near else _takers(said[2])
    if near:
        error.args = (f"{error}. Did you mean {near[0]!r}?",)
    elif owners:
        error.args = (f"{error}. It is one of {', '.join(f'tc.{name}' for name in owners)}",)


def _takers(keyword: str) -> list[str]:
    """Public classes and functions that take a keyword, of those whose modules are loaded."""
    package = sys.modules[__package__]
    out = []
    for name, where in package._WHERE.items():
        found = getattr(sys.modules.get(f"{__package__}.{where}"), name, None)
        if callable(found) and not (isinstance(found, type) and issubclass(found, Exception)):
            if keyword in inspect.signature(found).parameters:
                out.append(name)
    return out[:OWNERS]
