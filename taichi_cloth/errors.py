"""Named failures. Each message names the culprit and the way out."""

import dataclasses
import difflib
import itertools
import pathlib
import sys
import types
import warnings
from collections.abc import Iterable


class ClothError(Exception):
    """Base of every error that taichi_cloth raises on purpose."""

    exit_code = 2


class MeshError(ClothError, ValueError):
    """A mesh, or a file with a mesh, that cannot be simulated."""


class SceneError(ClothError, ValueError):
    """A scene, a fabric or an option with an impossible value or an unknown name."""


class NameUnknown(SceneError, KeyError):
    """A name that is in no table, such as a fabric's."""

    __str__ = Exception.__str__  # a KeyError would show the message's repr


class AttributeRefused(SceneError, dataclasses.FrozenInstanceError):
    """An attribute that an object does not have, or that does not change."""


class BackendError(ClothError, RuntimeError):
    """An arch, precision or simulation that is not there (any more)."""


class OutputError(ClothError, OSError):
    """A folder or file that cannot be written without losing its content."""


class ScriptError(ClothError, RuntimeError):
    """Code of a scene, an event, a motion or a check, ended with an exception of its own, which is the cause of this one."""

    exit_code = 4


class SimulationError(ClothError, RuntimeError):
    """The simulation gave up: no step of allowed size passes.

    Attributes:
        reason: the name of the last rejection, a key of `taichi_cloth.stepper.ADVICE`.
        time: simulated time [s] that was reached.
    """

    exit_code = 3

    def __init__(self, message: str, reason: str = "", time: float = 0.0) -> None:
        super().__init__(message)
        self.reason = reason
        self.time = time


def warn(said: str) -> None:
    """Warns with the line outside of this package that led here; Python shows each once a line."""
    frame: types.FrameType | None = sys._getframe(1)
    level = 2
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == __package__:
        frame, level = frame.f_back, level + 1
    warnings.warn(said, stacklevel=level)


def did_you_mean(name: object, choices: Iterable[object]) -> str:
    """A half-sentence for an error about an unknown name: the nearest right one and all there are."""
    names = sorted({str(c) for c in choices})
    near = nearest(name, names) if isinstance(name, str) else None
    hint = f"did you mean {near!r}? " if near else ""
    return f"{hint}known: {', '.join(names) or 'none'}"


def nearest(name: str, names: Iterable[str], cutoff: float = 0.5) -> str | None:
    """The one of some names that is most like a wrong one; capitals count less than letters."""
    name, names = name[:100], list(names)
    found = difflib.get_close_matches(name.lower(), [known.lower() for known in names], n=1, cutoff=cutoff)
    alike = [known for known in names if found and known.lower() == found[0]]
    return max(alike, key=lambda known: difflib.SequenceMatcher(None, name, known).ratio(), default=None)


def near(path: object) -> str:
    """A half-sentence for an error about a file or folder: the one beside it with nearly its name; "" if it is there."""
    place = pathlib.Path(str(path))
    try:
        names = [] if place.exists() else [f.name for f in itertools.islice(place.parent.iterdir(), 10_000)]
    except (OSError, ValueError):
        return ""
    found = difflib.get_close_matches(place.name, names, n=1, cutoff=0.7)
    return f"; did you mean {str(place.parent / found[0])!r}?" if found else ""


def many(count: int, noun: str, several: str = "") -> str:
    """A count with its noun: "1 step", "3 steps"; `several` is a plural that is not the noun's with an s."""
    return f"{count:,} {noun if count == 1 else several or noun + 's'}"


def shown(value: object, most: int = 60) -> str:
    """A value as a message shows it: its repr, shortened; an object whose repr fails by its class."""
    try:
        text = " ".join(repr(value).split())
    except Exception:  # another's code, or an integer with too many digits
        text = f"<{type(value).__name__}>"
    return text if len(text) <= most else f"{text[: most - 4]} ..."
