"""Scene files: Python modules with build(...) and check(sim), found by path or by name.

A scene file has a docstring, whose first line is the scene's summary, and `build(**options) -> Scene`. It may have

- `check(sim)`: yields (sentence, passed) pairs;
- `metrics(sim)`: figures by name, for `sweep`;
- `RUN`: defaults for the run (duration, fps, h, ...);
- `SMALL`: options that make it quick;
- `RANGES`: (low, high) of options' sliders by name, for `view`.
"""

import importlib.util
import inspect
import math
import pathlib
import sys
import traceback
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..errors import ClothError, SceneError, ScriptError, did_you_mean, near, shown
from ..scene.every import EVERY, known
from ..scene.reading import builds, instead, reading
from .waiting import waiting

if TYPE_CHECKING:
    from ..scene.scene import Scene

OWN = pathlib.Path("scenes")  # where scenes of one's own are looked for by name


@dataclass(frozen=True)
class SceneFile:
    """A scene file that was read.

    Attributes:
        name: its file's name without .py.
        summary: first line of its docstring.
        options: names and default values of build's parameters.
    """

    name: str
    path: str
    summary: str
    build: Callable
    check: Callable | None
    run: dict = field(default_factory=dict)
    small: dict = field(default_factory=dict)
    metrics: Callable | None = None
    ranges: object = field(default_factory=dict)

    @property
    def options(self) -> dict[str, inspect.Parameter]:
        """build's parameters by name."""
        return dict(inspect.signature(self.build).parameters)

    def make(self, settings: dict[str, object]):
        """The scene, built with options; strings are read as the types of the options' defaults.

        Raises:
            SceneError: an unknown option, or a value that is not of its type.
        """
        try:
            with waiting(" ".join([f"building {self.name}", *(f"{name}={value}" for name, value in settings.items())])):
                said_of_all = {n: value for n, value in self.typed(settings).items() if n not in self.options and value != ""}
                scene = self.build(**{name: value for name, value in self.typed(settings).items() if name in self.options})
        except ClothError:
            raise
        except Exception as error:
            raise SceneError(f"scene {self.name}: {said(error, self.path)}") from error
        from ..scene.scene import Scene

        if not isinstance(scene, Scene):
            raise SceneError(f"scene {self.name}: build() returned {type(scene).__name__}, not a Scene")
        scene = self._told(scene, **said_of_all)
        from ..scene.fliers import fliers

        for note in fliers(scene) if settings.get("wind") or settings.get("fabric") else ():
            warnings.warn(note, stacklevel=2)
        return scene

    def _told(self, scene: "Scene", fabric: Any = None, wind: Any = None) -> "Scene":
        """The scene with the options of every scene: a fabric for all its cloths, and a wind, in air as plates feel it."""
        from ..scene.air import Air
        from ..scene.winds import DRAG, LIFT

        for cloth in scene.cloths if fabric is not None else ():
            scene.set_fabric(cloth, fabric, panels=True)
        if wind is not None and scene.air is None:
            scene.air = Air(wind=wind, drag=DRAG, lift=LIFT)
        elif wind is not None:
            scene.set_wind(wind)
        return scene

    def typed(self, settings: dict[str, object]) -> dict[str, object]:
        """Options with strings read as the types of the defaults.

        Raises:
            SceneError: an unknown option, or a value that is not of its type.
        """
        return {name: self._typed(name, value) for name, value in settings.items()}

    def settings(self, settings: dict[str, object]) -> dict[str, object]:
        """All options with their values: those that are set, and the defaults of the others."""
        left = {name: p.default for name, p in self.options.items() if p.default is not p.empty}
        return left | self.typed(settings)

    def changed(self, recorded: dict[str, object]) -> dict[str, object]:
        """The settings of a manifest that differ from the scene's defaults."""
        left = {name: plain(value) for name, value in self.settings({}).items()}
        return {name: value for name, value in recorded.items() if name not in left or value != left[name]}

    def _typed(self, name: str, value: object):
        if name not in self.options:
            if name in EVERY:
                return known(name, value)
            raise SceneError(f"scene {self.name} has no option {name!r}; {did_you_mean(name, (*self.options, *EVERY))}")
        kind = type(self.options[name].default)
        if not isinstance(value, str) or kind is str:
            return value
        try:
            if kind is bool:
                return {"true": True, "1": True, "yes": True, "false": False, "0": False, "no": False}[value.lower()]
            if kind is tuple:
                return numbers(value, len(self.options[name].default))
            return number(value, kind) if kind in (int, float) else value
        except (KeyError, ValueError):
            needs = f"{len(self.options[name].default)} numbers, as in 0,-.1,2" if kind is tuple else _article(kind)
            raise SceneError(f"scene {self.name}: option {name}={value!r} needs {needs}") from None


def said(error: Exception, file: str) -> str:
    """An exception of a scene's own code in one line: type, message, and line of the scene's file."""
    places = traceback.extract_tb(error.__traceback__)
    where = next((p for p in reversed(places) if p.filename == file), None)
    if where is None and places[-1].filename == __file__:
        return f"{type(error).__name__}: {error} ({file})"
    where = where or places[-1]
    return f"{type(error).__name__}: {error} ({where.filename}, line {where.lineno})"


def own_lines(error: BaseException) -> str:
    """The traceback of an exception of a user's code, from his first line on."""
    places = traceback.extract_tb(error.__traceback__)
    others = str(pathlib.Path(__file__).parents[1]), sys.prefix, sys.base_prefix  # this package's and installed ones
    first = next((k for k, p in enumerate(places) if not p.filename.startswith(others)), 0)
    lines = traceback.StackSummary.from_list(places[first:]).format() + traceback.format_exception_only(error)
    return "Traceback (most recent call last):\n" + "".join(lines)


def settings_of(words: Iterable[str]) -> dict[str, str]:
    """Options of a scene from NAME=VALUE.

    Raises:
        SceneError: a word that is not.
    """
    settings = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals:
            raise SceneError(f"--set {word!r}: needs name=value")
        settings[name] = value
    return settings


def plain(value: object) -> int | float | str:
    """An option's value as a manifest has it, and as it is read again."""
    if isinstance(value, tuple):
        return ",".join(map(str, value))
    return value if isinstance(value, (int, float)) else str(value)


def number(text: str, kind: type = float):
    """A finite number from text such as "51", "1e-3" or "1/60".

    Raises:
        ValueError: it is none.
    """
    if kind is int:
        return int(text)
    top, _, bottom = text.partition("/")
    out = float(top) / (float(bottom) or math.nan if bottom else 1.0)
    if not math.isfinite(out):
        raise ValueError(text)
    return out


def numbers(text: str, count: int) -> tuple[float, ...]:
    """Finite numbers, `count` of them, from text such as "0,-.1,1e-2".

    Raises:
        ValueError: they are not.
    """
    out = tuple(map(number, text.split(",")))
    if len(out) != count:
        raise ValueError(text)
    return out


def folders() -> list[pathlib.Path]:
    """Folders of scenes, in the order of search: ./scenes, the checkout's, the installed package's."""
    here = pathlib.Path(__file__).parents[1]
    places = [OWN, here.parent / "scenes", here / "bundled_scenes"]
    return [p for p in places if p.is_dir()]


def available() -> dict[str, pathlib.Path]:
    """Scenes by name; the first folder that has one wins."""
    found: dict[str, pathlib.Path] = {}
    for folder in folders():
        for path in folder.glob("*.py"):
            if not path.name.startswith("_"):
                found.setdefault(path.stem, path)
    from ..io.sequence import natural

    return {name: found[name] for name in sorted(found, key=natural)}


def own(scene: str) -> str:
    """The file of a scene's name if it is one of the user's in ./scenes; "" for others, and for paths."""
    path, package = available().get(scene), [p for p in folders() if p != OWN]
    if pathlib.Path(scene).is_file() or path is None or path.parent != OWN or OWN.resolve() in (p.resolve() for p in package):
        return ""
    return str(path) + next((f", not {p / path.name}" for p in package if (p / path.name).is_file()), "")


def path_of(scene: str) -> pathlib.Path:
    """A scene's file, from its path or name.

    Raises:
        SceneError: there is none.
    """
    path = pathlib.Path(scene)
    if not path.is_file():
        known = available()
        if scene not in known and (path.suffix == ".py" or len(path.parts) > 1):
            shipped = f"; the scene of that name is meant by {path.stem!r}" if path.stem in known else ""
            there = "is a folder" if path.is_dir() else "there is no such file"
            raise SceneError(f"no scene file {scene!r}: {there}{near(path)}{shipped}; `taichi-cloth list` names "
                             "those that are shipped")
        if scene not in known:
            raise SceneError(f"no scene {scene!r}{near(path) or '; ' + did_you_mean(scene, known)}")
        path = known[scene]
    return path


def read(scene: str) -> SceneFile:
    """A scene file from its path or name.

    Raises:
        SceneError: there is none, or it does not run.
    """
    path = path_of(scene)
    spec = importlib.util.spec_from_file_location(f"scene_{path.stem}", path)
    if spec is None or spec.loader is None:
        raise SceneError(f"{path} is not a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    if (folder := str(path.parent.resolve())) not in sys.path:
        sys.path.append(folder)  # for modules beside it, as where Python runs it
    nothing = SceneError(f"{path} has no build() that returns a Scene. {instead(str(path))}")
    if not builds(path.read_text(encoding="utf-8", errors="replace")):
        raise nothing  # before anything of it runs
    try:
        with reading(str(path)):
            spec.loader.exec_module(module)
    except ClothError:
        raise
    except Exception as error:
        raise SceneError(f"{path} does not run: {said(error, str(path))}") from error
    if not hasattr(module, "build"):
        raise nothing
    return of_module(module.build, module)


def of_module(build: Callable, module: ModuleType | None = None) -> SceneFile:
    """The scene file that a build function belongs to."""
    module = module or sys.modules[build.__module__]
    path = getattr(module, "__file__", None) or build.__name__
    summary = (module.__doc__ or "").strip().split("\n")[0]
    return SceneFile(pathlib.Path(path).stem, str(path), summary, build, getattr(module, "check", None),
                     dict(getattr(module, "RUN", {})), dict(getattr(module, "SMALL", {})), getattr(module, "metrics", None),
                     getattr(module, "RANGES", {}))


def checked(scene: SceneFile) -> SceneFile:
    """A scene that has a check.

    Raises:
        SceneError: it has none.
    """
    if scene.check is None:
        raise SceneError(f"scene {scene.name} has no check(sim): a function in its file that yields pairs (text, "
                         "whether that holds) after a run")
    return scene


def run_check(scene: SceneFile, sim) -> Iterable[tuple[str, bool]]:
    """The pairs that a scene's check yields.

    Raises:
        SceneError: it has none.
        ScriptError: it ends with an exception of its own, or does not yield a sentence and True or False.
    """
    import numpy as np

    count = 0
    try:
        for pair in checked(scene).check(sim):  # type: ignore[misc]
            sentence, good = pair if isinstance(pair, (tuple, list)) and len(pair) == 2 else (None, None)
            if not isinstance(sentence, str) or not isinstance(good, (bool, np.bool_)):
                raise TypeError(f"it yielded {shown(pair)}, not a sentence and True or False")
            count += 1
            yield sentence, bool(good)
        if not count:
            raise TypeError("it yielded nothing: yield a sentence and True or False for each check")
    except ClothError:
        raise
    except Exception as error:
        raise ScriptError(f"scene {scene.name}: check: {said(error, scene.path)}") from error


def _article(kind: type) -> str:
    return {int: "a whole number", float: "a number", bool: "true or false"}.get(kind, kind.__name__)
