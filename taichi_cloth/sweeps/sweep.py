"""A sweep: all combinations of a grid are run, each once, and become the rows of one table."""

import contextlib
import json
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .. import checks
from ..errors import OutputError, SceneError, ScriptError, did_you_mean
from ..scene.scene import Scene
from . import engine, page
from .plan import SEED, Run, plain, runs_of
from .store import PARQUET, RUNS, TABLE, Store, as_csv, columns, name_of
from .task import KEPT, OK, Metrics, Outcome, Task

PAGE, ASKED = "sweep.html", "sweep.json"
MOST_WORKERS = 100_000


@dataclass
class Sweep:
    """Result of a sweep.

    Attributes:
        varied: names of the settings that the grid names.
        rows: one a combination, in the order of the grid: run, the settings, status ("ok", "gave up", "failed" or "lost"),
            reason, message, figures, wall_s (the time it took), key.
        folder: its own, or None.
        again: rows that were there before.
        notes: remarks on it, a sentence each.
    """

    varied: list[str]
    rows: list[dict[str, Any]] = field(default_factory=list)
    folder: pathlib.Path | None = None
    again: int = 0
    notes: list[str] = field(default_factory=list)

    def column(self, name: str) -> np.ndarray:
        """(runs,) of one name; NaN, or None if it holds texts, in rows that do not have it.

        Raises:
            SceneError: no row has it.
        """
        if name not in columns(self.rows):
            raise SceneError(f"sweep: no column {name!r}; {did_you_mean(name, columns(self.rows))}")
        values = [row.get(name) for row in self.rows]
        numeric = all(v is None or isinstance(v, (int, float)) for v in values)
        return np.array([np.nan if v is None else v for v in values] if numeric else values)

    @property
    def failed(self) -> list[dict[str, Any]]:
        """Rows whose status is not "ok"."""
        return [row for row in self.rows if row["status"] != OK]

    def summary(self) -> str:
        """How many runs, and their outcomes."""
        reasons: dict[str, int] = {}
        for row in self.failed:
            name = f"{row['status']} ({row['reason']})"
            reasons[name] = reasons.get(name, 0) + 1
        parts = [f"{len(self.rows) - len(self.failed)} ok", *(f"{count} {name}" for name, count in reasons.items())]
        return f"{len(self.rows)} runs: {', '.join(parts)}" + (f"; {self.again} were there already" if self.again else "")

    def __repr__(self) -> str:
        return f"<Sweep over {', '.join(self.varied) or 'nothing'}; {self.summary()}>"

    def _repr_html_(self) -> str:
        return page.body(self.varied, self.rows, self.summary(), self.notes)


def sweep(build: Callable[..., Scene], grid: Mapping[str, Iterable], metrics: Metrics | None = None, *,
          seeds: int | Iterable[int] | None = None, duration: float = 1.0, fps: float = 30.0,
          out: str | pathlib.Path | None = None, workers: int | None = None, scheduler: str | None = None,
          slurm: Mapping[str, Any] | None = None, tls: Mapping[str, Any] | None = None, dashboard: str | None = None,
          say: Callable[[str], None] = lambda text: None, **options: Any) -> Sweep:
    """Runs a scene with every combination of some settings.

    A run is a task of Dask distributed on a worker with one core, or one GPU where arch is "cuda"; the run of a worker that
    died is made again. With `out`, each row is kept when it is done, by the hash of its description: the settings, all that
    the scene which `build` returns describes, and the code of `metrics`. Another sweep there builds the scene, and does not
    simulate one of which there is a row. Runs use one thread, so that a row is the same, bit for bit, wherever it was made.

    Args:
        build: makes the scene of the settings that the grid names.
        grid: values by name: arguments of `build`, or options of `Simulation`.
        metrics: figures of a simulation at its end: a function that returns a number, or numbers by name; or functions by
            name. Rows have steps, energies and the like besides.
        seeds: values of the option `seed`, or how many of them from 0 on.
        duration: of each run [s]; fps: frames a second, whose times steps hit.
        out: folder for runs/, sweep.csv, sweep.html and, where pyarrow is installed, sweep.parquet.
        workers: processes on this machine, as many as cores (GPUs) if None; 0 runs one after the other in this one. With
            `slurm`, the number of jobs.
        scheduler: address of a Dask scheduler, instead.
        slurm: arguments of dask_jobqueue's SLURMCluster, such as {"queue": "cpu", "walltime": "01:00:00"}, instead.
        tls: PEM files "ca", "cert" and, where cert does not hold it, "key": connections are encrypted, and only who has such
            a certificate gets one. Without, whoever reaches the scheduler's port can run code on the workers.
        dashboard: address at which Dask shows its pages, such as "127.0.0.1:8787" (needs bokeh); None has none.
        say: is told of each run that is done.
        options: of `Simulation`, by name.

    Raises:
        SceneError: an unknown name or impossible value, before anything is run.
        BackendError: no Dask, or no scheduler.
        OutputError: a folder that cannot be written.
        ScriptError: `say` ends with an exception.
    """
    runs, tasks = _planned(build, grid, metrics, seeds, duration, fps, say, options)
    engine_of = _engine(workers, scheduler, slurm, runs, tls, dashboard)
    folder = None if out is None else checks.path("sweep: out", out, OutputError)
    result = Sweep(list(runs[0].varied), folder=folder)
    store = None if folder is None else Store(folder)
    found: dict[int, Outcome] = {}
    with contextlib.ExitStack() as last:
        kept: list[dict[str, Outcome]] = [{} for _ in runs]
        if store:
            last.callback(store.close)
            kept = [store.kept(run) for run in runs]
            tasks = [replace(task, kept=frozenset(there)) for task, there in zip(tasks, kept)]
        last.callback(_finish, result, runs, found, store)  # of the rows that are done, also where it is interrupted
        for k, done in engine_of(tasks):
            if done.status == KEPT:
                found[k] = kept[k][done.scene]
                result.again += 1
                continue
            found[k] = done
            if store:
                store.put(runs[k], done)
            try:
                say(f"[{len(found)}/{len(runs)}] {_told(runs[k], done)}")
            except Exception as error:
                raise ScriptError(f"sweep: say: {type(error).__name__}: {error}") from error
    return result


def _planned(build: Callable, grid: Mapping, metrics: Metrics | None, seeds: int | Iterable[int] | None, duration: float,
             fps: float, say: Callable, options: dict[str, Any]) -> tuple[list[Run], list[Task]]:
    checks.function("sweep: build", build)
    checks.function("sweep: say", say, "text")
    grid = dict(checks.instance("sweep: grid", grid, Mapping))  # type: ignore[type-abstract]
    if seeds is not None:
        if SEED in grid:
            raise SceneError("sweep: the grid has `seed` already: leave seeds out")
        grid[SEED] = seeds if isinstance(seeds, Iterable) else range(checks.integer("sweep: seeds", seeds))
    if metrics is not None:
        for name, measure in (metrics if isinstance(metrics, Mapping) else {"metrics": metrics}).items():
            checks.function(f"sweep: {name}", measure, "simulation")
    duration = checks.number("sweep: duration", duration, "s", positive=True)
    fps = checks.number("sweep: fps", fps, positive=True)
    runs = runs_of(build, grid, {"threads": 1, **options}, {"duration": duration, "fps": fps})
    return runs, [Task(build, r.settings, r.options, duration, fps, metrics) for r in runs]


def _engine(workers: int | None, scheduler: str | None, slurm: Mapping | None, runs: Sequence[Run],
            tls: object, dashboard: str | None) -> Callable[[Sequence[Task]], Iterator[tuple[int, Outcome]]]:
    checks.maybe(scheduler, checks.name, "sweep: scheduler")
    checks.maybe(slurm, checks.instance, "sweep: slurm", Mapping)
    workers = checks.maybe(workers, checks.integer, "sweep: workers", least=0, most=MOST_WORKERS)
    if scheduler is not None and slurm is not None:
        raise SceneError("sweep: a scheduler's address or Slurm: choose one")
    if workers == 0 and (scheduler is not None or slurm is not None):
        raise SceneError("sweep: workers = 0 runs in this process: leave the scheduler out")
    checks.maybe(dashboard, checks.name, "sweep: dashboard")
    if dashboard is not None and (workers == 0 or scheduler is not None):
        raise SceneError("sweep: a dashboard is of workers that the sweep starts: leave it out")
    tls = engine.checked_tls(tls)
    if workers == 0:
        return engine.serially
    gpu = any(r.options.get("arch") == "cuda" for r in runs)
    engine.needs("distributed", "sweeps on several workers; workers=0 (--workers 0) runs one after the other")
    if dashboard is not None:
        engine.needs("bokeh", "Dask's pages", "bokeh")

    def there(tasks: Sequence[Task]) -> Iterator[tuple[int, Outcome]]:
        count = workers or (1 if slurm is not None else engine.places(gpu))
        return engine.on_workers(tasks, engine.Where(min(count, len(tasks)), scheduler, slurm, gpu, tls, dashboard))

    return there


def _told(run: Run, done: Outcome) -> str:
    """A run in one line."""
    settings = " ".join(f"{name}={plain(value)}" for name, value in run.varied.items())
    return f"{settings}: {done.status}{f' ({done.reason})' if done.reason else ''}, {done.wall:.2f} s"


def _finish(result: Sweep, runs: Sequence[Run], found: Mapping[int, Outcome], store: Store | None) -> None:
    """The rows, and the files that are made of them."""
    for k in sorted(found):
        run, done = runs[k], found[k]
        result.rows.append({"run": k, **{name: plain(value) for name, value in run.varied.items()}, "status": done.status,
                            "reason": done.reason, "message": done.message, **done.figures,
                            "wall_s": round(done.wall, 4), "key": name_of(run, done)})
    if store is None:
        return
    unknown = [done.unknown for done in found.values() if done.unknown]
    if unknown:
        result.notes.append(f"{len(unknown)} rows cannot be known again and are not kept, since their scene or metrics hold "
                            f"values that cannot be read: {unknown[0]}")
    if store.others:
        result.notes.append(f"{store.others} files in {store.path / RUNS} are of an earlier version, which knew runs by the "
                            "text of build only: they are left, and not used")
    store.write(TABLE, as_csv(result.rows))
    if not store.write_parquet(result.rows):
        (store.path / PARQUET).unlink(missing_ok=True)  # of an earlier sweep
        result.notes.append(f"no {PARQUET} was written: pyarrow is not installed (pip install pyarrow)")
    store.write(PAGE, page.page(result.varied, result.rows, result.summary(), result.notes))
    same = {name: value for name, value in runs[0].manifest.items() if name not in ("settings", "simulation")}
    asked = {**same, "runs": len(runs), "done": len(found),
             "varied": {name: sorted({json.dumps(plain(r.varied[name])) for r in runs}) for name in result.varied}}
    store.write(ASKED, json.dumps(asked, indent=1) + "\n")
