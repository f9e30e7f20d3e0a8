"""Keywords that a public function does not take: its error suggests the nearest that it takes, or who takes this one.

Python itself suggests the nearest from 3.13 on.
"""

import functools
import inspect
import re
import sys
import types
from collections.abc import Callable
from typing import Any

from .attributes import guard
from .errors import nearest

REFUSED = re.compile(r"([\w.<>]+)\(\) got an unexpected keyword argument '(\w+)'$")
MARK = "__suggests__"
OWNERS = 3  # that a sentence names
LIKE = 0.6  # a keyword, to be suggested


def suggesting(found: Any) -> Any:
    """A public function with errors that suggest. A class gets such methods, with its bases and its subclasses so far, and
    one of a description refuses unknown attributes."""
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
    if one.__module__.startswith(f"{__package__}.scene."):
        guard(one)
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
            _name_as_called(error, function, args)
            raise

    setattr(inner, MARK, True)
    return inner


def _name_as_called(error: TypeError, function: Callable, args: tuple[Any, ...]) -> None:
    """Names a method in an error about its arguments by the object's class, not by the base that has it, and a class by its
    name alone."""
    where, call = function.__qualname__ + "()", f"{function.__name__}()"
    if args and "." in where and str(error).startswith(where):
        kind = args[0] if isinstance(args[0], type) else type(args[0])
        public = sys.modules[__package__]._WHERE
        name = next((k.__name__ for k in kind.__mro__ if k.__name__ in public), kind.__name__)
        called = f"{name}()" if call == "__init__()" else f"{name}.{call}"
        error.args = (called + str(error)[len(where):],)


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
    near = nearest(said[2], inspect.signature(refused).parameters, LIKE)
    owners = [] if near else _takers(said[2])
    if near:
        error.args = (f"{error}. Did you mean {near!r}?",)
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
