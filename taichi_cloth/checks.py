"""Values from callers, checked before anything is computed: numbers, vectors, arrays, indices, names, functions.

Every function here returns the value as the code works with it, or raises the project's own error, which names the
argument, the value (shortened) and the allowed ones. `what` is the argument's name as the message gives it. numpy only.
"""

import difflib
import inspect
import math
import numbers
import os
import pathlib
import re
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import numpy as np

from . import colornames
from .errors import ClothError, SceneError, did_you_mean, shown

# No quantity in SI units is larger, or positive and smaller: beyond that, squares and ratios of floats overflow.
LARGEST, SMALLEST = 1e30, 1e-30
MOST = 1_000_000_000  # of anything that is counted: it fits 32 bits
DIGITS = 18  # of a whole number in a text
A_NUMBER = r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)(e[+-]?[0-9]+)?(/[0-9.]+)?"  # as Python reads it, such as 1e-3 or 1/60

T = TypeVar("T")
Error = type[ClothError]


def number(what: str, value: object, unit: str = "", *, positive: bool = False, least: float | None = None,
           most: float | None = None, error: Error = SceneError) -> float:
    """A finite number, as a float.

    Args:
        unit: for the message.
        positive: whether it must be more than 0.
        least, most: bounds that it may reach.

    Raises:
        error: no number (a truth value is none), not finite, or out of its bounds.
    """
    out = _real(value)
    low = SMALLEST if positive else -LARGEST if least is None else least
    high = LARGEST if most is None else most
    if not low <= out <= high:
        allowed = _allowed(out, positive, least, most) + _quoted(value)
        raise error(f"{what} = {shown(value)}{unit and ' ' + unit}: must be {allowed}")
    return out


def number_or_pair(what: str, value: object, unit: str = "", *, positive: bool = False, least: float | None = None,
                   error: Error = SceneError) -> float | tuple[float, float]:
    """A number as `number` takes it, or two in a tuple, list or array."""
    if not is_sequence(value):
        return number(what, value, unit, positive=positive, least=least, error=error)
    if len(value) != 2:  # type: ignore[arg-type]
        raise error(f"{what} = {shown(value)}: needs a number or a pair")
    a, b = (number(what, v, unit, positive=positive, least=least, error=error) for v in value)  # type: ignore[attr-defined]
    return a, b


def is_sequence(value: object) -> bool:
    """Whether a value is several: a tuple, a list, or an array that is no scalar."""
    return isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim > 0)


def integer(what: str, value: object, least: int = 1, most: int = MOST, error: Error = SceneError) -> int:
    """A whole number from `least` to `most`, as an int; 3.0 is one.

    Raises:
        error: it is none.
    """
    out = _real(value)
    if not (least <= out <= most and out == int(out)):
        bound = f"of at least {least:,}" if not out > most else f"from {least:,} to {most:,}"
        said = f"{out:.0f}" if isinstance(value, float) and out.is_integer() else shown(value)
        raise error(f"{what} = {said}: must be a whole number {bound}{_quoted(value)}")
    return int(out)


def is_whole(text: str) -> bool:
    """Whether a text is a whole number in digits, of no more than are ever meant."""
    return text.isascii() and text.isdecimal() and len(text) <= DIGITS


def kept(what: str, value: object, error: Error = SceneError) -> int | str:
    """How many of the last are kept: "all", or a number, of which "none" is 0.

    Raises:
        error: it is neither.
    """
    if isinstance(value, str):
        value = 0 if value == "none" else int(value) if is_whole(value) else value
    if isinstance(value, str) and value != "all":
        raise error(f"{what} = {shown(value)}: must be \"all\", \"none\", or how many of the last steps are kept")
    return "all" if isinstance(value, str) else integer(what, value, least=0)


def flag(what: str, value: object, error: Error = SceneError) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise error(f"{what} = {shown(value)}: must be True or False")
    return bool(value)


def choice(what: str, value: object, choices: Iterable[str], error: Error = SceneError) -> str:
    """`value` itself where it is one of `choices`.

    Raises:
        error: if it is not, with the nearest right one.
    """
    choices = list(choices)
    if not isinstance(value, str) or value not in choices:
        raise error(f"unknown {what} {shown(value)}; {did_you_mean(value, choices)}")
    return value


def name(what: str, value: object, error: Error = SceneError) -> str:
    """A text of at least one character, all of them printable: names go into files, line by line."""
    if not isinstance(value, str) or not value.strip() or not value.isprintable():
        raise error(f"{what} = {shown(value)}: must be a text of at least one character, on one line")
    return value


def instance(what: str, value: object, kind: type[T], error: Error = SceneError) -> T:
    """An object of a class."""
    if not isinstance(value, kind):
        raise error(f"{what} = {shown(value)}: must be {_article(kind.__name__)}")
    return value


def maybe(value: T | None, check: Callable[..., Any], what: str, *args: Any, **bounds: Any) -> Any:
    """None, or the value as `check` returns it."""
    return None if value is None else check(what, value, *args, **bounds)


def function(what: str, value: object, *arguments: str, error: Error = SceneError) -> Callable:
    """Something that can be called with so many arguments.

    Args:
        arguments: their names, for the message.
    """
    wanted = f"a function of {' and '.join(arguments)}" if arguments else "a function"
    if not callable(value):
        raise error(f"{what} = {shown(value)}: must be {wanted}")
    if arguments and takes(value, len(arguments)) is False:
        raise error(f"{what} = {shown(value)}: must be {wanted}, but cannot be called with {len(arguments)} arguments")
    return value


def takes(function: Callable, count: int) -> bool | None:
    """Whether a function can be called with so many arguments; None if Python does not know."""
    try:
        inspect.signature(function).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:
        return None
    return True


def vector(what: str, value: object, unit: str = "", *, error: Error = SceneError) -> np.ndarray:
    """(3,) three finite numbers, a copy in float64."""
    out = _floats(value)
    if out is None or out.shape != (3,) or not _usable(out).all():
        raise error(f"{what} = {shown(value)}{unit and ' ' + unit}: needs three finite numbers")
    return out


def color(what: str, value: object, error: Error = SceneError) -> tuple[float, float, float]:
    """Linear red, green and blue, each from 0 to 1, of such numbers, or of a name or #rrggbb in sRGB."""
    if isinstance(value, str):
        named = colornames.linear_of(value)
        if named is None:
            near = difflib.get_close_matches(value[:40].lower(), colornames.NAMES, n=1)
            hint = f"did you mean {near[0]!r}? It needs a name of CSS" if near else "needs a name of CSS, such as 'crimson'"
            raise error(f"{what} = {shown(value)}: is not a colour: {hint}, '#rrggbb' in sRGB, or linear red, green and blue "
                        "from 0 to 1")
        return named
    out = _floats(value)
    if out is None or out.shape != (3,) or not ((out >= 0) & (out <= 1)).all():
        raise error(f"{what} = {shown(value)}: needs red, green and blue, each from 0 to 1, or a name or '#rrggbb'")
    red, green, blue = out.tolist()
    return red, green, blue


def array(what: str, value: object, *shapes: Sequence[int | str], row: str = "row", of: np.ndarray | None = None,
          hint: str = "", error: Error = SceneError) -> np.ndarray:
    """Finite numbers of one of some shapes, a copy in float64.

    Args:
        shapes: lengths; a letter stands for any. A shape that has all but the first of the longest is one value for all rows.
        row, of, hint: for the messages. The kind of an index along the first axis, the number of each row (None: its own), and
            advice on a wrong shape.

    Raises:
        error: no array of numbers, another shape, or a number that is not finite.
    """
    out = _floats(value)
    if out is None:
        raise error(f"{what}: needs numbers in the shape {_shapes(shapes)}, not {shown(value)}")
    if not any(_fits(out.shape, shape) for shape in shapes):
        raise error(f"{what}: needs shape {_shapes(shapes)}, not {out.shape}{hint}")
    bad = np.argwhere(~_usable(out))
    if len(bad):
        k, rows = bad[0][0], len(np.unique(bad[:, 0]))
        where, values = "", out
        if out.shape != tuple(max(shapes, key=len)[1:]):
            where, values = f"{row} {k if of is None else of[k]} " + (f"({rows} such) " if rows > 1 else ""), out[k]
        why = f"beyond {LARGEST:g}" if np.isfinite(values).all() else "not finite"
        raise error(f"{what}: {where}is {why}: {shown(values.tolist())}")
    return out


def indices(what: str, value: object, count: int, *, width: int | None = None, row: str = "row",
            error: Error = SceneError) -> np.ndarray:
    """Indices of vertices, whole numbers from 0 to below `count`, a copy in int64: (k,), or (m, width).

    Args:
        row: the kind of an index along the first axis of (m, width), for the message.

    Raises:
        error: not whole numbers, another shape, or out of range: with the row and its values.
    """
    try:
        out = np.array(value)
    except (TypeError, ValueError, OverflowError):
        out = np.array(None)
    shape = "(k,)" if width is None else f"(m, {width})"
    if out.dtype == object or out.dtype.kind in "USbcmMV":
        raise error(f"{what}: needs integer indices of vertices in the shape {shape}, not {shown(value)}")
    if out.ndim != (1 if width is None else 2) or (width is not None and out.shape[1] != width):
        raise error(f"{what}: needs shape {shape}, not {out.shape}")
    if out.size and not np.issubdtype(out.dtype, np.integer):
        raise error(f"{what}: needs integer indices of vertices, not {out.dtype}")
    wrong = (out < 0) | (out >= count)
    bad = np.flatnonzero(wrong if width is None else wrong.any(axis=1))
    if len(bad):
        k = bad[0]
        which = f"names vertex {out[k]}" if width is None else f"{row} {k} {out[k].tolist()} names a vertex out of range"
        raise error(f"{what}: {which}, but there are {count} vertices")
    return out.astype(np.int64)


def path(what: str, value: object, error: Error = SceneError) -> pathlib.Path:
    """A path from a text or a path."""
    if not isinstance(value, (str, os.PathLike)) or not os.fspath(value):
        raise error(f"{what} = {shown(value)}: must be a path")
    try:
        out = pathlib.Path(value)
        out.exists()  # names that no file can have are refused here, not where they are opened
    except (OSError, TypeError, ValueError) as problem:
        raise error(f"{what} = {shown(value)}: is not a path: {problem.args[-1]}") from None
    return out


def png(what: str, value: object, error: Error = SceneError) -> pathlib.Path:
    """A path of a PNG, which its name ends with."""
    out = path(what, value, error)
    if out.suffix.lower() != ".png":
        raise error(f"{what} = {str(out)!r}: must end with .png: pictures are written as PNG only")
    return out


def _quoted(value: object) -> str:
    """A half-sentence on a text that is a number but for its quotes; "" for all else."""
    a_number = isinstance(value, str) and len(value) <= DIGITS and re.fullmatch(A_NUMBER, value)
    return f", not text: {value} without quotes" if a_number else ""


def _real(value: object) -> float:
    """A number as a float; NaN if it is none, infinity where it is too large for one."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, numbers.Real):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.inf if value > 0 else -math.inf  # type: ignore[operator]


def _floats(value: object) -> np.ndarray | None:
    """A copy as an array of float64; None if it is no array of numbers."""
    try:
        out = np.array(value)
        if out.dtype == object:  # integers too large for 64 bits, fractions; anything else is no number
            out = np.vectorize(_real, otypes=[np.float64])(out) if out.size else out.astype(np.float64)
            return None if np.isnan(out).any() else out
        return out.astype(np.float64, copy=False) if out.dtype.kind in "fiu" else None
    except (TypeError, ValueError, OverflowError):
        return None


def _usable(values: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.abs(values) <= LARGEST


def _fits(shape: tuple[int, ...], wanted: Sequence[int | str]) -> bool:
    return len(shape) == len(wanted) and all(isinstance(w, str) or n == w for n, w in zip(shape, wanted))


def _shapes(shapes: Sequence[Sequence[int | str]]) -> str:
    return " or ".join(f"({', '.join(map(str, s))}{',' * (len(s) == 1)})" for s in shapes)


def _allowed(value: float, positive: bool, least: float | None, most: float | None) -> str:
    """The range of a number; `value` is one that may not be."""
    if positive and most is None:
        return "a positive number" + (f" from {SMALLEST:g} to {LARGEST:g}" if 0 < value < math.inf else "")
    if least is not None and most is not None:
        return f"a number from {least:g} to {most:g}"
    if positive:
        return f"a positive number of at most {most:g}"
    if least is not None:
        return f"a number of at least {least:g}" + (f" and at most {LARGEST:g}" if LARGEST < value < math.inf else "")
    return "a finite number" + (f" of at most {LARGEST:g}" if math.isfinite(value) else "")


def _article(noun: str) -> str:
    return f"{'an' if noun[0] in 'AEIOU' else 'a'} {noun}"
