"""One run of a sweep: a scene is built, simulated, and becomes a row of figures. A failure is a row too, with its name."""

import hashlib
import math
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ..errors import ClothError, SceneError, SimulationError, shown
from ..scene.scene import Scene
from ..simulation import Simulation
from .description import described, of_failure

OK, GAVE_UP, FAILED, LOST = "ok", "gave up", "failed", "lost"
KEPT = "kept"  # the status of a run that was done before
SCRIPT = "ScriptError"  # the reason where a scene's or a metric's own code ends with an exception
Metrics = Callable[[Simulation], Any] | Mapping[str, Callable[[Simulation], float]]
Failure = tuple[str, str, str]  # status, reason and message
T = TypeVar("T")

_one_at_a_time = threading.Lock()  # Taichi runs once in a process


@dataclass(frozen=True)
class Task:
    """Description of a run for a worker.

    Attributes:
        build: makes the scene of `settings`.
        metrics: of the simulation at its end: a function that returns a number or numbers by name, or functions by name.
        kept: digests of scenes of which there are rows already; such a one is not simulated again.
    """

    build: Callable[..., Scene]
    settings: dict[str, Any]
    options: dict[str, Any]
    duration: float
    fps: float
    metrics: Metrics | None = None
    kept: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Outcome:
    """Result of a run.

    Attributes:
        status: "ok", "gave up", "failed", or "lost" where its worker died more often than it is tried again.
        reason: a rejection's name, or an error's class; message: its text.
        figures: by name; those that the run did not reach are absent.
        wall: time it took [s].
        scene: digest by which the run is known again, besides its settings; "" if it is not, and `unknown` says why.
    """

    status: str
    reason: str
    message: str
    figures: dict[str, Any]
    wall: float
    scene: str = ""
    unknown: str = ""


def perform(task: Task) -> Outcome:
    """Runs it, unless it is one that was done before; never raises for errors of the scene, its code or the simulation."""
    begun = time.perf_counter()
    with _one_at_a_time:
        made, failure = _attempt(lambda: _built(task))
        scene, unknown = of_failure(*failure[1:]) if made is None else described(
            made, getattr(task.metrics, "of_file", task.metrics), task.duration, task.fps)
        if scene in task.kept:
            return Outcome(KEPT, "", "", {}, 0.0, scene)
        figures: dict[str, Any] = {}
        if made is not None:
            figures, failure = _simulated(made, task)
    return Outcome(*failure, figures, time.perf_counter() - begun, scene, unknown)


def _simulated(scene: Scene, task: Task) -> tuple[dict[str, Any], Failure]:
    """(figures, outcome)"""
    sim, failure = _attempt(lambda: Simulation(scene, **task.options))
    if sim is None:
        return {}, failure
    with sim:
        figures, failure = _attempt(lambda: _figures(sim, task))
        return figures or (outcome(sim) if failure[0] == GAVE_UP and sim.last else {}), failure


def _figures(sim: Simulation, task: Task) -> dict[str, Any]:
    """Figures of a run, made from its start to its end."""
    sim.run(task.duration, task.fps)
    return {**outcome(sim), **_measured(task, sim)}


def _attempt(what: Callable[[], T]) -> tuple[T | None, Failure]:
    """(its result, ("ok", "", "")), or (None, why there is none)."""
    try:
        return what(), (OK, "", "")
    except SimulationError as error:
        return None, (GAVE_UP, error.reason or type(error).__name__, str(error))
    except ClothError as error:
        return None, (FAILED, type(error).__name__, str(error))
    except Exception as error:  # a user's
        place = traceback.extract_tb(error.__traceback__)[-1]
        return None, (FAILED, SCRIPT, f"{type(error).__name__}: {error} ({place.filename}, line {place.lineno})")


def _built(task: Task) -> Scene:
    scene = task.build(**task.settings)
    if not isinstance(scene, Scene):
        raise SceneError(f"sweep: build returned {shown(scene)}, not a Scene")
    return scene


def outcome(sim: Simulation) -> dict[str, Any]:
    """Columns of every row: effort, trouble, energies [J], the lowest vertex [m], and a digest of the state, bit for bit."""
    t, x, v = sim.tally, sim.positions(), sim.velocities()
    energies = sim.last.energies if sim.last is not None else sim.energy()
    kinetic = energies.get("kinetic", 0.0)
    return {"time_s": sim.time, "steps": t.steps, "solves": t.solves, "iterations": t.iterations, "evaluations": t.evaluations,
            "rejected": t.rejections.total(), "fallbacks": t.fallbacks.total(), "contacts": t.contacts,
            "largest_stretch": t.stretch, "kinetic_J": kinetic, "potential_J": sum(energies.values()) - kinetic,
            "unaccounted_J": t.ledger["unaccounted"], "lowest_m": float(x[:, 1].min()),
            "digest": hashlib.sha256(x.tobytes() + v.tobytes()).hexdigest()[:16]}


def _measured(task: Task, sim: Simulation) -> dict[str, Any]:
    metrics = task.metrics
    if metrics is None:
        return {}
    if isinstance(metrics, Mapping):
        found = {name: measure(sim) for name, measure in metrics.items()}
    else:
        value = metrics(sim)
        found = dict(value) if isinstance(value, Mapping) else {getattr(metrics, "__name__", "metric"): value}
    for name in found:
        if name in task.settings or name in task.options:
            raise SceneError(f"metric {name!r} has the name of a setting: give it another")
    return {str(name): _figure(name, value) for name, value in found.items()}


def _figure(name: str, value: object) -> float | int | str | bool | None:
    """A figure as JSON has it; None if it is not finite."""
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    raise SceneError(f"metric {name!r} = {shown(value)}: must be a number, a text or None")
