"""A simulation that is played, paused, stepped, begun again, changed and pulled at, in the one thread that simulates.

A page, or whatever shows it, asks from any thread, or puts calls into `orders`; it touches nothing of the simulation.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .. import checks
from ..errors import ClothError, SimulationError
from ..recording import record
from ..scene.air import Air, Wind
from ..scene.scene import Scene
from ..system.quantities import MARKS, QUANTITIES
from .orders import Orders, named
from .parameters import Parameter

if TYPE_CHECKING:  # a page shows a scene as it was built before Taichi is imported
    from ..simulation import Simulation
    from .hand import Hand
    from .shapes import Arrays

IDLE = 0.5  # s that a paused session waits at a time: a wait without end would keep Ctrl-C from some systems
PICTURE = 1 / 30  # s from picture to picture of a cloth that moves, at least
ASKED = ("play", "pause", "step", "reset", "set", "blow", "color_by", "look", "grab", "drag", "drop", "watch", "finish")
ASIDE = ("look", "drag", "drop", "watch")  # orders that keep the message of the last trouble
SAME = ("x", "faces", "uv", "solid_x", "solid_faces", "cloth_start")  # arrays as built that a run needs to go on


class Source(Protocol):
    """Maker of scenes and their simulations.

    Attributes:
        parameters: that can be changed.
        again: whether it makes new ones; else there is the one simulation.
    """

    parameters: tuple[Parameter, ...]
    again: bool

    def scene(self, settings: dict[str, object]) -> Scene:
        """A scene with its parameters so."""

    def simulation(self, scene: Scene) -> Simulation:
        """A simulation of it."""


class Session:
    """A simulation with its state of play, its view and the orders for it.

    Args:
        show: is called with the session when there is something new to be seen.

    Attributes:
        running: whether step follows step; over: whether it is to end.
        watched: whether anybody looks. Before, there is one step at most, which loads kernels: who looks sees the beginning.
        trouble: the last error, in a line; "" if there is none.
        changes: of parameters and wind, how many were asked for and dealt with; change: the last in words, "" before.
        geometry, arrays: the view, as `record` has it; preview: whether it is the scene as built, before there is a
            simulation, and so without heat maps.
        heat: the quantity that colours the cloth, or "".
        sim: None until `begin`.
    """

    def __init__(self, source: Source, show: Callable[[Session], object]) -> None:
        self.source, self.show, self.orders = source, show, Orders()
        self.settings: dict[str, object] = {p.name: p.value for p in source.parameters}
        self.running, self.over, self.preview, self.watched = False, False, True, True
        self.trouble = self.heat = self.change = ""
        self.changes = 0
        self.sim: Simulation | None = None
        self.hand: Hand | None = None
        self.breeze = np.zeros(3)
        self.scene = source.scene(self.settings)
        self.geometry = self._built = record.as_built(self.scene)
        self.arrays = _at_rest(self.geometry)
        self._clock = self._drawn = 0.0

    def begin(self, plays: bool = True) -> None:
        """Makes the simulation; before, shows the scene as it was built, which needs no compiled kernels."""
        self._simulate(self.scene, self._built, None)
        if plays:
            self.play()
        self._look()

    def turn(self) -> None:
        """Carries out the waiting orders, then a step if the session runs and it is time for one; else waits.

        Another simulation is seen before its first step.
        """
        calls, before = self.orders.take(min(self._ahead(), IDLE) if self._goes_on else IDLE), self.sim
        for call in calls:
            self._try(call)
        if self._goes_on and self.sim is before and self._ahead() <= 0:
            self._try(self._advance)
        if calls or (self.running and time.monotonic() - self._drawn >= PICTURE):
            self._look()

    def end(self) -> None:
        """The simulation is over, where this session made it."""
        self.drop()
        if self.source.again and self.sim is not None:
            self.sim.close()

    def ask(self, name: str, values: tuple = (), key: str = "") -> None:
        """One of `ASKED` is to be done, in its turn; of those with one key only the last. From any thread."""
        checks.choice("ask", name, ASKED)

        def do() -> None:
            if name not in ASIDE:
                self.trouble = ""
            with self._telling(named(name, values)):
                getattr(self, name)(*values)

        self.orders.put(do, key)

    # the orders of `ASKED`

    def play(self) -> None:
        """Step follows step, no faster than the clock."""
        self.running, self._clock = True, time.monotonic() - self._live.time

    def pause(self) -> None:
        """No more steps."""
        self.running = False

    def step(self) -> None:
        """One step, and no more."""
        self.running = False
        self._advance()

    def reset(self) -> None:
        """Begins again at time 0."""
        self._build(self.settings, anew=True)

    def set(self, name: str, value: object) -> None:
        """Another value of a parameter. The cloth goes on as it is where it is the same mesh beside the same solids."""
        self._build({**self.settings, name: value})

    def blow(self, wind: np.ndarray) -> None:
        """Adds a wind (3,) [m/s] to the scene's own."""
        self.breeze = checks.vector("wind", wind, "m/s")
        self._blow()

    def color_by(self, heat: str) -> None:
        """Colours the cloth by a quantity; by its look where ""."""
        self.heat = heat and checks.choice("heat", heat, self.heats())

    def heats(self) -> list[str]:
        """Quantities that this scene has."""
        touches = self.sim is not None and self.sim.contacts is not None
        return [name for name in QUANTITIES if MARKS.get(name, "faces") in self.geometry and (touches or name != "contact")]

    def grab(self, point: np.ndarray) -> None:
        """Takes hold of the cloth near a point (3,) [m]."""
        from .hand import Hand

        self.drop()
        self.hand = Hand(self._live, point)

    def drag(self, place: np.ndarray) -> None:
        """Pulls the held patch to a place (3,) [m]."""
        if self.hand is not None:
            self.hand.place = checks.vector("place", place, "m")

    def drop(self) -> None:
        """Lets go."""
        if self.hand is not None:
            hand, self.hand = self.hand, None
            hand.let_go()

    def look(self) -> None:
        """Nothing: after any order there is something to be seen."""

    def watch(self) -> None:
        """Somebody looks from now on."""
        self.watched = True
        if self.running:
            self.play()

    def finish(self) -> None:
        """The session is to end."""
        self.over = True

    # how it is done

    @property
    def _live(self) -> Simulation:
        assert self.sim is not None, "begin() comes first"
        return self.sim

    @property
    def _goes_on(self) -> bool:
        """Whether a step is to be made as soon as it is time for one."""
        return self.running and (self.watched or not self._live.tally.steps)

    @contextlib.contextmanager
    def _telling(self, change: str) -> Iterator[None]:
        """Keeps in words how a change ends, which is made within it."""
        try:
            yield
        except Exception:
            change = change and f"{change}: not possible"
            raise
        else:
            change = change and f"{change}, from t = {self._live.time:.3f} s"
        finally:
            if change:
                self.changes, self.change = self.changes + 1, change

    def _ahead(self) -> float:
        """s that simulated time is ahead of the clock."""
        return self._clock + self._live.time - time.monotonic()

    def _advance(self) -> None:
        self._live.step()
        if (late := -self._ahead()) > 0:
            self._clock += late  # lost time is not made up for

    def _build(self, settings: dict[str, object], anew: bool = False) -> None:
        scene = self.source.scene(settings)
        built = record.as_built(scene)
        moved = not anew and self._live.tally.steps > 0  # else its start is at hand, and needs no compiled kernels
        goes_on = moved and all(np.array_equal(built[name], self._built[name]) for name in SAME)
        self._simulate(scene, built, self._live.checkpoint() if goes_on else None)
        self.settings = settings

    def _simulate(self, scene: Scene, built: Arrays, state: Arrays | None) -> None:
        """A simulation of the scene, as `record.as_built` has it, in place of the one before, which stays where there can be
        none of it."""
        before = self.sim
        if state is None and self.source.again:
            self.geometry, self.arrays, self.preview = built, _at_rest(built), True
            self.show(self)
        sim = self.source.simulation(scene)
        try:
            if state is not None:
                sim.resume(state, edited=True)
        except ClothError:  # it is of other forces than it seemed
            sim.close()
            sim = self.source.simulation(scene)
        self.hand = None
        if before is not None:
            before.close()
        self.scene, self.sim, self._built = scene, sim, built
        self._see()
        self.heat = self.heat if self.heat in self.heats() else ""
        self._clock = time.monotonic() - sim.time
        self._blow()

    def _blow(self) -> None:
        if self.breeze.any() or (self.scene.air is not None and self._live.prescribed.script.air is not None):
            self._live.set_wind(added(self.scene.air, self.breeze) if self.scene.air else self.breeze)

    def _see(self) -> None:
        """Takes the geometry of this simulation, which does not change."""
        self.geometry, self.preview = record.geometry(self._live), False

    def _look(self) -> None:
        if self.sim is not None:
            if self.preview:  # of a scene that no simulation could be made of
                self._see()
            self.arrays = record.frame(self.sim)
        self._drawn = time.monotonic()
        self.show(self)

    def _try(self, call: Callable[[], object]) -> None:
        """Makes a call; an error becomes `trouble`, and the session goes on."""
        try:
            call()
        except ClothError as error:
            self.trouble, self.running = str(error), self.running and not isinstance(error, SimulationError)
        except Exception as error:  # a scene's own functions may raise anything
            self.trouble, self.running = f"{type(error).__name__}: {error}", False


def added(air: Air, breeze: np.ndarray) -> Wind:
    """The wind of air, and another (3,) [m/s] that is the same everywhere."""
    own = air.wind
    if not callable(own):
        return np.add(own, breeze)
    if air.varies_in_space:
        return lambda x, t: np.asarray(own(x, t)) + breeze  # type: ignore[call-arg, arg-type]
    return lambda t: np.asarray(own(t)) + breeze  # type: ignore[call-arg, arg-type]


def _at_rest(geometry: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """A frame of the scene as it was built."""
    return {"t": np.array(0.0), "x": geometry["x"].astype(np.float32), "v": np.zeros(geometry["x"].shape, dtype=np.float32)}
