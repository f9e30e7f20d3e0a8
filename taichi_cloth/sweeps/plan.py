"""From a grid of settings to runs: each combination with its manifest, and the hash of that."""

import hashlib
import inspect
import itertools
import json
import numbers
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import __version__, checks
from ..backend import compiler
from ..errors import SceneError, did_you_mean, shown
from ..options import BY_NAME, Options

SEED = "seed"
MOST = 1_000_000  # runs of a sweep
FORMAT = 2  # of a run's description, and of its file
ADDRESS = re.compile(r"\b0x[0-9a-fA-F]{6,}")


@dataclass(frozen=True)
class Run:
    """One combination.

    Attributes:
        settings: arguments of the scene's build; options: of `Simulation`.
        varied: those of both that the grid names, as they stand in the table.
        manifest: the settings; key: their hash. The run's figures are decided by these and by the scene that build makes of
            them.
    """

    settings: dict[str, Any]
    options: dict[str, Any]
    varied: dict[str, Any]
    manifest: dict[str, Any]
    key: str


def runs_of(build: Callable, grid: Mapping[str, Iterable], options: Mapping[str, Any], about: Mapping[str, Any]) -> list[Run]:
    """Every combination of a grid, the last name's values next to each other.

    Args:
        build: makes the scene; its parameters may be named by the grid, and so may `Options`.
        options: of every `Simulation`, where the grid does not name them.
        about: duration, fps.

    Raises:
        SceneError: an unknown name, no value, a value twice, or one without a text of its own.
    """
    parameters = _parameters(build)
    columns = {name: _values(name, values, parameters) for name, values in grid.items()}
    count = 1
    for values in columns.values():
        count *= len(values)
    checks.integer("sweep: the number of runs", count, most=MOST)
    needed = [n for n, p in parameters.items() if p.default is p.empty and n not in columns and p.kind not in (
        p.VAR_POSITIONAL, p.VAR_KEYWORD)]
    if needed:
        raise SceneError(f"sweep: build needs a value for {needed[0]!r}: name it in the grid")
    out = []
    for combination in itertools.product(*columns.values()):
        varied = dict(zip(columns, combination))
        settings = {name: value for name, value in varied.items() if _of_scene(name, parameters)}
        chosen = {**options, **{name: value for name, value in varied.items() if name not in settings}}
        full = Options.named({**vars(Options()), **chosen})
        manifest = {"taichi_cloth": __version__, "format": FORMAT, **about, **compiler.told(),
                    "settings": {n: plain(v) for n, v in settings.items()},
                    "simulation": {n: plain(v) for n, v in vars(full).items() if n not in ("quiet", "debug")}}
        out.append(Run(settings, chosen, varied, manifest, key_of(manifest)))
    return out


def key_of(manifest: Mapping[str, Any]) -> str:
    """16 hexadecimal digits that tell runs apart."""
    return hashlib.sha256(json.dumps(manifest, sort_keys=True).encode()).hexdigest()[:16]


def plain(value: object) -> object:
    """A value as JSON and the table have it: numbers, truth values and texts as they are, anything else by its repr."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, str)):
        return value
    if isinstance(value, numbers.Integral):
        return int(value)
    if isinstance(value, numbers.Real):
        return float(value)
    try:
        return repr(value)
    except Exception:  # another's code
        return shown(value)


def _parameters(build: Callable) -> dict[str, inspect.Parameter]:
    try:
        return dict(inspect.signature(build).parameters)
    except (TypeError, ValueError):
        return {}


def _of_scene(name: str, parameters: Mapping[str, inspect.Parameter]) -> bool:
    """Whether a name is an argument of build; its own come before `Options`."""
    takes_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    return name in parameters or (takes_any and name not in BY_NAME)


def _values(name: str, values: Iterable, parameters: Mapping[str, inspect.Parameter]) -> list:
    if not (_of_scene(name, parameters) or name in BY_NAME):
        known = [*parameters, *BY_NAME]
        hint = "; --seeds and seeds= need a scene with an option `seed`" if name == SEED else ""
        raise SceneError(f"sweep: neither the scene nor Simulation has an option {name!r}{hint}; {did_you_mean(name, known)}")
    try:
        out = [] if isinstance(values, (str, bytes)) else list(itertools.islice(values, MOST + 1))
    except TypeError:
        out = []
    if not out:
        raise SceneError(f"sweep: {name} = {shown(values)}: must be several values, such as a list")
    texts: set[str] = set()
    checks.integer(f"sweep: the number of values of {name}", len(out), most=MOST)
    for value in out:
        text = json.dumps(plain(value))
        if text in ("NaN", "Infinity", "-Infinity"):
            raise SceneError(f"sweep: {name} = {shown(value)}: must be finite")
        if ADDRESS.search(text):
            raise SceneError(f"sweep: {name} = {shown(value)}: its text is another in every process, so that its runs could "
                             "not be found again: sweep over a name or a number, and choose by it in build")
        if text in texts:
            raise SceneError(f"sweep: {name} = {shown(value)} is named twice")
        texts.add(text)
    return out
