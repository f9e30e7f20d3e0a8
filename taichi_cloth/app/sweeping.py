"""The command `sweep`: a scene with every combination of some of its options."""

import argparse
import inspect
import os
import sys
from collections.abc import Callable
from typing import Any

from ..scene.every import EVERY
from . import scenefile
from .flags import number_of

FAILED = 1  # exit code where some rows are not ok


class FromFile:
    """A scene file's build, and its metrics, as a worker reads them again from the file."""

    def __init__(self, path: str) -> None:
        self.path = os.path.abspath(path)
        self._read: scenefile.SceneFile | None = None

    def __getstate__(self) -> dict[str, str]:
        return {"path": self.path}

    def __setstate__(self, state: dict[str, str]) -> None:
        self.path, self._read = state["path"], None

    @property
    def file(self) -> scenefile.SceneFile:
        """The scene file, read once in a process."""
        if self._read is None:
            self._read = scenefile.read(self.path)
        return self._read

    @property
    def __signature__(self) -> inspect.Signature:
        own = inspect.signature(self.file.build)
        more = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None) for name in EVERY
                if name not in own.parameters]
        any_name = [p for p in own.parameters.values() if p.kind is p.VAR_KEYWORD]
        return own.replace(parameters=[*(p for p in own.parameters.values() if p not in any_name), *more, *any_name])

    def __call__(self, **settings: Any):
        return self.file.make(settings)


class MetricsOfFile(FromFile):
    """A scene file's metrics(sim)."""

    @property
    def of_file(self) -> Callable:
        """The function itself, by which runs are known again."""
        assert self.file.metrics is not None
        return self.file.metrics

    @property
    def __signature__(self) -> inspect.Signature:
        return inspect.signature(self.of_file)

    def __call__(self, sim):  # type: ignore[override]
        return self.of_file(sim)


def add_parser(commands, simulation_flags) -> None:
    """`sweep` and its flags; `simulation_flags` adds those of every run, `--set` among them."""
    parser = commands.add_parser("sweep", help="a scene with every combination of some options: a table and a page")
    add = parser.add_argument
    add("scene", help="a scene file or name; figures of its metrics(sim) become columns")
    add("--out", required=True, metavar="DIR", help="folder for sweep.csv, sweep.html and runs/; runs that are there are kept")
    add("--seeds", metavar="N", help="N seeds from 0 on, or FROM:TO, for the scene's option seed")
    add("--workers", type=int, metavar="N", help="processes; one a core (GPU) where not given; 0: one run after the other")
    add("--scheduler", metavar="ADDRESS", help="of a Dask scheduler that runs, such as tcp://host:8786")
    add("--slurm", metavar="NAME=VALUE,...", help='arguments of a Slurm job, such as "queue=cpu,walltime=01:00:00,memory=4GB"')
    add("--tls", metavar="NAME=FILE,...", help='PEM files that connections need: "ca=ca.pem,cert=own.pem,key=own.key"')
    add("--dashboard", metavar="ADDRESS", help="where Dask shows its pages, such as 127.0.0.1:8787 (needs bokeh)")
    add("--small", action="store_true", help="with the scene's quick options")
    simulation_flags(parser)


def run(args: argparse.Namespace, duration: float, fps: float, simulation: dict[str, Any]) -> int:
    """Sweeps; returns the exit code.

    Args:
        duration, fps, simulation: of every run, as for `run`.
    """
    from ..sweeps.sweep import PAGE, TABLE, sweep

    build = FromFile(scenefile.read(args.scene).path)
    scene = build.file
    grid = {name: [value] for name, value in scene.small.items()} if args.small else {}
    grid |= grid_of(args.set, scene)
    result = sweep(build, grid, MetricsOfFile(scene.path) if scene.metrics else None, seeds=seeds_of(args.seeds),
                   duration=duration, fps=fps, out=args.out, workers=args.workers, scheduler=args.scheduler,
                   slurm=slurm_of(args.slurm), tls=_pairs("--tls", args.tls, "ca=ca.pem,cert=own.pem,key=own.key"),
                   dashboard=args.dashboard, say=_say, **simulation)
    for note in result.notes:
        _say(f"note: {note}")
    print(f"{result.summary()}\nwritten to {os.path.join(args.out, TABLE)} and {os.path.join(args.out, PAGE)}")
    return FAILED if result.failed else 0


def grid_of(items: list[str], scene: scenefile.SceneFile) -> dict[str, list]:
    """Values by name of `--set name=a,b,c`, read as the types of the options' defaults.

    Raises:
        SceneError: no name and value, or a value that is not of its option's type.
    """
    from ..errors import SceneError
    from ..options import BY_NAME

    grid: dict[str, list] = {}
    for item in items:
        name, equals, text = item.partition("=")
        if not equals:
            raise SceneError(f"--set {item!r}: needs name=value,value,...")
        if name in grid:
            raise SceneError(f"--set {name}: twice; all its values go with commas after one: --set {name}=a,b")
        values = [value for value in text.split(",") if value]
        if name in scene.options or name in EVERY:
            grid[name] = [scene.typed({name: value})[name] for value in values]
        elif name in BY_NAME:
            grid[name] = [_option(name, value) for value in values]
        else:
            grid[name] = list(values)  # refused with a list of the names that there are
    return grid


def seeds_of(text: str | None) -> list[int] | None:
    """0 to N - 1 of "N", and FROM to TO - 1 of "FROM:TO".

    Raises:
        SceneError: neither.
    """
    from ..errors import SceneError, shown
    from ..sweeps.plan import MOST

    if text is None:
        return None
    first, colon, last = text.partition(":")
    try:
        out = range(int(first), int(last)) if colon else range(int(first))
    except ValueError:
        out = range(0)
    if not 0 < out.stop - out.start <= MOST:
        raise SceneError(f"--seeds {shown(text)}: needs a number, or FROM:TO, of at most {MOST:,} seeds")
    return list(out)


def slurm_of(text: str | None) -> dict[str, Any] | None:
    """Arguments of a cluster from "queue=cpu,cores=1".

    Raises:
        SceneError: not names and values.
    """
    from .. import checks

    given = _pairs("--slurm", text, "queue=cpu,walltime=01:00:00")
    return None if given is None else {name: int(value) if checks.is_whole(value) else value for name, value in given.items()}


def _pairs(flag: str, text: str | None, such: str) -> dict[str, str] | None:
    """Names and values of "name=value,name=value"."""
    from ..errors import SceneError

    if text is None:
        return None
    pairs = [part.partition("=") for part in text.split(",") if part]
    if not pairs or not all(name and equals for name, equals, _ in pairs):
        raise SceneError(f"{flag} {text!r}: needs names and values, such as {such}")
    return {name: value for name, _, value in pairs}


def _option(name: str, text: str) -> Any:
    """An option of `Simulation` from text."""
    from ..errors import SceneError
    from ..options import BY_NAME

    kind = BY_NAME[name].metadata["kind"]
    try:
        if kind == "flag":
            return {"true": True, "false": False}[text.lower()]
        return number_of(text) if kind == "number" else int(text) if kind == "integer" else text
    except (KeyError, ValueError, argparse.ArgumentTypeError):
        what = {"flag": "true or false", "integer": "a whole number"}.get(kind, "a number")
        raise SceneError(f"--set {name}={text!r}: needs {what}") from None


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
