"""A running scene: steps, frames, changes between them, and checkpoints."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..backend import placement
from ..backend.language import ti
from ..errors import SceneError
from ..options import MOST_FRAMES, SHORTEST, signature
from ..scene.air import Wind
from ..scene.attachment import Path
from ..scene.cloth import Cloth
from ..scene.inflation import ATMOSPHERE, Drive
from ..scene.load import Force, Load
from ..scene.scene import Scene
from ..scene.sewing import Seam
from ..scene.solids import Prop, Solid
from ..step.records import StepRecord
from ..system.checkpoint import VERSION, Checkpointed, below, numbered, understood, unknown
from .queries import Queries

ROUND_TIME = 1e-9  # part of a step below which two times are the same
MOST_STEPS = 1e10  # of a run: more have no end


@ti.data_oriented
class Simulation(Queries):
    """A running scene. Arrays are the user's: his vertex order, float64, SI units.

    Args:
        scene: the scene to simulate; it stays as it was built.
        h: step size [s], one of the options.
        options: all of them at once.
        named: any of `Options` by name; these come before `options`.

    Raises:
        SceneError: an impossible value or an unknown name.
        BackendError: an arch or precision that is not there.

    Attributes:
        time: simulated time [s].
        log: one `StepRecord` a step, of the steps that the option `log` keeps.
        tally: sums over all steps, a `Tally`.
        runtime: arch, precision and threads.
        notes: findings about the meshes and solids, and repairs.
    """

    __signature__ = signature(
        inspect.Parameter("scene", inspect.Parameter.POSITIONAL_OR_KEYWORD, annotation=Scene),
        inspect.Parameter("h", inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=float | None))

    # running

    def step(self, h: float | None = None) -> StepRecord:
        """Advances by h [s] (the simulation's own if None), in one step if it passes, else in smaller ones.

        Returns:
            the record of the last of them.

        Raises:
            SimulationError: where no step passes.
        """
        h = self._h if h is None else checks.number("h", h, "s", least=SHORTEST)
        self._check_length("h", h)
        return self._advance_to(self.time + h)

    def run(self, duration: float, fps: float, on_frame: Callable[[Simulation, int], None] | None = None,
            resumed: int | None = None) -> None:
        """Runs for `duration` [s], rounded to whole frames, and calls on_frame(simulation, frame) at the start and at
        every frame's time.

        Frames are hit exactly; steps between them are equal where nothing goes wrong.

        Args:
            resumed: the frame of a run from time 0 at which this simulation now is; it goes on with the next.
        """
        duration, fps = self.checked_run(duration, fps)
        checks.maybe(on_frame, checks.function, "on_frame", "simulation", "frame")
        resumed = checks.maybe(resumed, checks.integer, "resumed", least=0)
        start, frames = self.time if resumed is None else 0.0, max(1, round(duration * fps))
        for frame in range(0 if resumed is None else resumed + 1, frames + 1):
            if frame:
                self._advance_to(start + frame / fps)
            if on_frame is not None:
                on_frame(self, frame)

    def checked_run(self, duration: float, fps: float) -> tuple[float, float]:
        """The arguments of `run`, where they are possible.

        Raises:
            SceneError: they are not.
            BackendError: the simulation was closed.
        """
        duration, fps = checks.number("duration", duration, "s", positive=True), checks.number("fps", fps, positive=True)
        self._live()._check_length("duration", max(duration, 1 / fps))
        checks.integer("run: duration * fps, the number of frames,", max(1, round(duration * fps)), most=MOST_FRAMES)
        return duration, fps

    # between steps

    def set_state(self, x: ArrayLike, v: ArrayLike) -> None:
        """Sets positions (n, 3) [m] and velocities (n, 3) [m/s]; pins begin anew where their vertices now are.

        Raises:
            SceneError: a wrong shape or a number that is not finite.
        """
        x, v = (checks.array(f"set_state: {name}", value, (self.vertex_count, 3), row="vertex")
                for name, value in (("positions", x), ("velocities", v)))
        self._live().model.write(x, v)
        self._note_collapsed(x)
        self.stepper.forget(contacts=False)
        self.integrator.reset()
        if self.integrator.system is not None:
            self.integrator.system.forget()
        if self.contacts is not None:
            self.contacts.clear()
        self.prescribed.begin_anew()

    def pin(self, cloth: Cloth, vertices: object, directions: object = None, stiffness: float | None = None) -> None:
        """`Scene.pin` for this simulation, from now on."""
        self._check_soft("pin", stiffness)
        self._change(lambda: self.scene.pin(cloth, vertices, directions, stiffness))

    def move(self, cloth: Cloth, vertices: object, path: Path, relative: bool = False, directions: object = None,
             stiffness: float | None = None, most: float | None = None) -> None:
        """`Scene.move` for this simulation, from now on; the path is a function of the simulation's time.

        Raises:
            SceneError: with a stiffness, as `attach`.
        """
        self._check_soft("move", stiffness)
        self._change(lambda: self.scene.move(cloth, vertices, path, relative, directions, stiffness, most))

    def attach(self, cloth: Cloth, vertices: object, solid: Solid | Prop, since: float | None = None,
               stiffness: float | None = None, most: float | None = None) -> None:
        """`Scene.attach` for this simulation, from now on; `since` [s] is now if None.

        Raises:
            SceneError: with a stiffness, where the scene had nothing attached softly, and no events, when it was begun.
        """
        self._check_soft("attach", stiffness)
        begins = self.time if since is None else since
        self._change(lambda: self.scene.attach(cloth, vertices, solid, begins, stiffness, most))

    def _check_soft(self, what: str, stiffness: float | None) -> None:
        if stiffness is not None and self.prescribed.pulls is None:
            raise SceneError(f"{what}: this simulation was made without soft attachments: attach something with a stiffness "
                             "in its scene before, and detach it by hand, or attach in an event (scene.at)")

    def detach(self, cloth: Cloth, vertices: object = None) -> None:
        """`Scene.detach` for this simulation, from now on."""
        self._change(lambda: self.scene.detach(cloth, vertices))

    def unpin(self, cloth: Cloth, vertices: object = None) -> None:
        """`Scene.unpin` for this simulation, from now on."""
        self._change(lambda: self.scene.unpin(cloth, vertices))

    def unsew(self, seam: Seam, vertices: object = None) -> None:
        """`Scene.unsew` for this simulation, from now on."""
        self._change(lambda: self.scene.unsew(seam, vertices))
        self._stitch()

    def resew(self, seam: Seam, vertices: object = None) -> None:
        """`Scene.resew` for this simulation, from now on."""
        self._change(lambda: self.scene.resew(seam, vertices))
        self._stitch()

    def _stitch(self) -> None:
        """Opens and closes stitches by hand, as asked for."""
        stitched = self.prescribed.script.stitched
        if stitched:
            first = dict(zip(self.scene.seams, self.stitch_failure.stitches.first.tolist()))
            for seam, rows, holds in stitched:
                if self.stitch_failure.set_by_hand(first[seam] + rows, holds):
                    self.stepper.forget()
            stitched.clear()

    def inflate(self, cloth: Cloth, pressure: Drive | None = None, gas: str = "constant", volume: Drive | None = None,
                part: object = None, ambient: float = ATMOSPHERE, bulk: float = 1e6) -> None:
        """`Scene.inflate` for this simulation, from now on: a piece that was inflated when it was made gets other gas."""
        self._change(lambda: self.scene.inflate(cloth, pressure, gas, volume, part, ambient, bulk))

    def deflate(self, cloth: Cloth, part: object = None) -> None:
        """`Scene.deflate` for this simulation, from now on."""
        self._change(lambda: self.scene.deflate(cloth, part))

    def add_load(self, cloth: Cloth, vertices: object, force: Force) -> Load:
        """`Scene.add_load` for this simulation, from now on; a function is one of the simulation's time.

        Raises:
            SceneError: besides, where the scene had no load when this simulation was made.
        """
        return self._change(lambda: self.scene.add_load(cloth, vertices, force))

    def remove_load(self, load: Load) -> None:
        """`Scene.remove_load` for this simulation, from now on."""
        self._change(lambda: self.scene.remove_load(load))

    def set_wind(self, wind: Wind) -> None:
        """`Scene.set_wind` for this simulation, from now on.

        Raises:
            SceneError: besides, a function of time where the method is explicit and the scene's own wind is none.
        """
        air = self.scene.air
        if callable(wind) and air is not None and not callable(air.wind) and self.integrator.system is None:
            raise SceneError(f"set_wind: {self.integrator_name!r} takes its steps from the scene's own wind, which does not "
                             "change: give the scene a wind that is a function of time")
        self._change(lambda: self.scene.set_wind(wind))

    def _change(self, change: Callable[[], Any]) -> Any:
        """The script is changed by hand; new motions begin where their vertices are."""
        self._live()
        before = self.prescribed.script.drives()
        with self.scene.running(self.prescribed.script):
            made = change()
        self.prescribed.changes += 1
        self._drives_changed(before)
        return made

    def _drives_changed(self, before: tuple) -> None:
        """Forces jump where gas, loads or wind are others at once: nothing of the last step goes on."""
        now = self.prescribed.script.drives()
        if len(before) != len(now) or any(was is not what for was, what in zip(before, now)):
            self.prescribed.set_time(self.time)
            self.stepper.forget()
            self.integrator.reset()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """Everything that decides how the simulation goes on, as arrays by name; see `resume`."""
        self._live()
        out = {"version": np.array(VERSION), "time": np.array(self.time), "records": np.array(self.tally.steps),
               "integrator": np.array(self.integrator_name), "felt": np.array(self._felt())}
        for name, part in self._parts().items():
            out |= {f"{name}.{key}": array for key, array in part.checkpoint().items()}
        return out

    def _parts(self) -> dict[str, Any]:
        """Parts with a state of their own, by name."""
        parts = {"particles": self.model, "step": self.stepper, "integrator": self.integrator}
        if self.integrator.system is not None:
            parts["preconditioner"] = self.integrator.system.preconditioner
        if self.stitch_failure is not None:
            parts["stitches"] = self.stitch_failure.stitches
        if self.contacts is not None:
            parts["contacts"] = self.contacts
        return parts | self._remembering() | {"script": self.prescribed}

    def _remembering(self) -> dict[str, Any]:
        """Forces with a state of their own, by name."""
        forces = numbered(force for force in self.force_terms if isinstance(force, Checkpointed))
        return {f"force.{name}": force for name, force in forces.items()}

    def _felt(self) -> str:
        """Energies and forces of the present state."""
        self.prescribed.set_time(self.time)
        self.model.save()
        return self.meter.felt()

    def resume(self, state: dict[str, np.ndarray], edited: bool = False) -> None:
        """Goes on where `checkpoint` was taken, bit for bit on the same machine, threads and precision.

        Events of the scene up to then are fired again; the simulation must be new. If cloth is of another material, the
        next step begins with the energies as they now are and takes nothing from the last step; its ledger has the
        difference as `edited`.

        Args:
            edited: the scene may have been edited since. Another integrator then begins anew. Parts that the scene no longer
                has, and changes by hand, are left out; `notes` tell of it.

        Raises:
            SceneError: the state is of another mesh, of a scene that lacks parts of this one or, unless it was edited, has
                more, or of another version.
        """
        self._live()
        checks.instance("resume: state", state, dict)
        checks.flag("resume: edited", edited)
        state = understood(state, self.integrator_name, (name.removeprefix("force.") for name in self._remembering()))
        for name, value in state.items():
            if (name in ("time", "step.h") or name.startswith("script.")) and not np.isfinite(value).all():
                raise SceneError(f"the checkpoint's {name} is not finite")
        if edited:
            state = self._without_hands(state)
        try:
            self.time = float(state["time"])
            for name, part in self._going_on(state, edited).items():
                part.resume(below(name, state))
        except KeyError as missing:
            raise SceneError(f"the checkpoint has no {missing}: it is of a run with other options") from None
        self._fire_events(again=True)
        self.prescribed.resume(below("script", state))  # attachments that events began, began where they did
        if str(state["felt"]) not in ("", self._felt()):
            self.stepper.forget()
            self.integrator.reset()
            if self.integrator.system is not None:
                self.integrator.system.loosen()

    def _without_hands(self, state: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """The checkpoint as one of a simulation that was changed by hand as this one was."""
        changes = self.prescribed.changes
        if int(state.get("script.changed", changes)) == changes:
            return state
        self.notes.append("changes by hand (sim.pin, unpin, move, attach, add_load, set_wind and so on) before the "
                          "checkpoint are left out")
        return {**state, "script.changed": np.array(changes)}

    def _going_on(self, state: dict[str, np.ndarray], edited: bool) -> dict[str, Any]:
        """The parts that go on from a checkpoint; all of them, unless the scene was edited."""
        parts, was = self._parts(), str(state["integrator"])
        others = () if was == self.integrator_name else ("integrator", "preconditioner")
        if others and not edited:
            raise SceneError(f"the checkpoint is of the integrator {was!r}, and this simulation's is {self.integrator_name!r}")
        more = unknown(state, parts, ("version", "time", "records", "integrator", "felt", *others))
        if more and not edited:
            raise SceneError(f"the checkpoint has {', '.join(more[:3])}, of which this scene has nothing: it is of "
                             "another scene")
        if others:
            self.notes.append(f"the integrator was {was!r} and is {self.integrator_name!r}: it begins anew")
        if more:
            self.notes.append(f"the scene no longer has the part that the checkpoint calls {', '.join(more[:3])}: left out")
        return {name: part for name, part in parts.items()
                if name not in others and not (edited and part.STATE and not below(name, state))}

    def __repr__(self) -> str:
        names = ", ".join(f"{c.name} ({c.mesh.vertex_count:,} vertices)" for c in self.scene.cloths)
        state = f"t = {self.time:g} s, {self.tally.steps} steps" if self._open else "closed"
        return f"<Simulation of {names}; {self.integrator_name}, {self.runtime.arch} {self.runtime.precision}; {state}>"

    def _check_length(self, name: str, time: float) -> None:
        """Refuses a span that would need more steps than anybody waits for."""
        steps = time / self.control.h_max
        if steps > MOST_STEPS:
            raise SceneError(f"{name} = {time:g} s is {steps:.2g} steps of h = {self.control.h_max:g} s: at most "
                             f"{MOST_STEPS:.0e}")

    def _advance_to(self, end: float) -> StepRecord:
        self._live()
        record = None
        while end - self.time > ROUND_TIME * self.control.h_max or record is None:
            placement.mind()
            self._fire_events()
            stop = min([end, *(e.time for e in self.prescribed.script.events[:1])])
            remaining = stop - self.time
            h = min(self.control.h_max, self.stepper.h) if self.control.adaptive else self.control.h_max
            steps = max(1, math.ceil(remaining / h - ROUND_TIME)) if remaining > h else 1
            record = self.stepper.step(self.time, remaining / steps, self.prescribed.at)
            self.time = stop if steps == 1 and abs(record.t - stop) <= ROUND_TIME * record.h else record.t
            record.t = self.time
            if self.options.count_intersections:
                record.intersections = self.intersections()
            self._made_step(record)
        self._fire_events()
        return record

    def _fire_events(self, again: bool = False) -> None:
        """Calls events that are due; `again` after a checkpoint that has their effects."""
        script = self.prescribed.script
        while script.events and script.events[0].time <= self.time + ROUND_TIME * self.control.h_max:
            event = script.events.pop(0)
            before = script.drives()
            with self.scene.running(script):
                self.scene.fire(event)
            if not again:
                self._drives_changed(before)
            script.events.sort(key=lambda e: e.time)
        if again:
            script.stitched.clear()
        self._stitch()
