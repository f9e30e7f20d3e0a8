"""Boundary conditions of a script at a time: held particles and their targets, the wind, and places of solids; and the work
that time does on energies.

The explicit work of time on a force's energy is the part of dE/dt at fixed positions, as by a pump that raises a pressure. A
step of one stage has the forces of its end: the work is E(x_0, t_1) - E(x_0, t_0) exactly. For others it is the mean of that
and E(x_1, t_1) - E(x_1, t_0), of second order.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..errors import SceneError
from ..forces.force import Force
from ..forces.pulls import NOTHING, Pulled, Pulls
from ..scene.attachment import Script
from ..system.assembler import Assembler, Measures
from ..system.checkpoint import Checkpointed
from ..system.held import Attachments, Held
from ..system.state import ParticleState


class Prescribed(Checkpointed):
    """The boundary conditions of a run.

    Attributes:
        script: attachments and events that are still to come; it changes as the run goes on.
        changes: how often the script was changed by hand.
    """

    STATE = ("anchors", "changed")

    def __init__(self, model: ParticleState, script: Script, forces: Sequence[Force], contacts) -> None:
        self.model, self.script, self.forces, self.contacts = model, script, forces, contacts
        self._driven = [force for force in forces if force.does("set_time")]
        self.script.events.sort(key=lambda event: event.time)
        self.attachments = Attachments(model.particle, model.origin, model.exchange)
        for force in forces:
            force.follow(script)
        self.changes = 0
        self.pulls = next((force for force in forces if isinstance(force, Pulls)), None)
        if self.pulls is not None:
            self.pulls.source = self.pulled

    def at(self, t: float, h: float) -> Held | None:
        """Constraints at the end of a step from t to t + h [s]; wind is set to that time, solids to both ends."""
        if self.pulls is not None:
            self.pulls.began = t
        self.set_time(t + h)
        if self.contacts is not None and h > 0:
            self.contacts.detector.set_time(t, h)
        held, sewn = self.held(t + h), self.model.sewn
        return held if sewn is None else sewn.spread(held, h)

    def held(self, t: float) -> Held | None:
        """Constraints at t [s]."""
        self.attachments.update(self.script.attachments, lambda: self.model.read()[0])
        return self.attachments.at(self.script.attachments, t)

    def pulled(self, t: float) -> Pulled:
        """The soft attachments at t [s]."""
        self.attachments.update(self.script.attachments, lambda: self.model.read()[0])
        soft = self.attachments.soft(self.script.attachments, t)
        return NOTHING if soft is None else Pulled(*soft)

    def set_time(self, t: float) -> None:
        """Sets forces that change with time by themselves, such as the wind, to their values at t [s]."""
        for force in self._driven:
            force.set_time(t)

    def begin_anew(self) -> None:
        """Pins begin where their vertices now are."""
        self.attachments = Attachments(self.model.particle, self.model.origin, self.model.exchange)

    @property
    def changed(self) -> np.ndarray:
        """`changes`. Functions of time cannot be kept: a resumed run has to be told of the same changes before."""
        return np.array(self.changes)

    @changed.setter
    def changed(self, count: np.ndarray) -> None:
        if int(count) != self.changes:
            raise SceneError(f"the checkpoint is of a simulation that was changed {int(count)} times by hand (sim.pin, unpin, "
                             f"move, attach, add_load, set_wind and so on), and this one {self.changes} times: change it "
                             "alike, then resume")

    @property
    def anchors(self) -> dict[str, np.ndarray]:
        """Positions of cloths when attachments began, by the attachments' keys."""
        return {str(key): x for key, x in self.attachments.anchors.items()}

    @anchors.setter
    def anchors(self, anchors: dict[str, np.ndarray]) -> None:
        self.attachments.anchors.update({int(key): x for key, x in anchors.items()})


class ExplicitTimeWork:
    """On the forces of a meter whose energy depends on time; does nothing, at no cost, where there are none."""

    def __init__(self, meter: Assembler) -> None:
        self.meter = meter

    @property
    def runs(self) -> bool:
        """Whether anything changes by itself."""
        return any(force.time_dependent_energy for force in self.meter.forces)

    def at_end(self, start: Measures) -> tuple[Measures, float]:
        """(measures of a step's start, where the model is, as if its end's time were come; the work of that [J])."""
        if not self.runs:
            return start, 0.0
        stored = self._stored()
        pumped = sum(stored.values()) - sum(start.energies[name] for name in stored)
        return replace(start, energies={**start.energies, **stored}), pumped

    def go_on(self, held_at: Callable[[float], Held | None], t: float) -> tuple[Held | None, float]:
        """(constraints t seconds into a step, the work [J] of going there where the model is)."""
        if not self.runs:
            return held_at(t), 0.0
        before = sum(self._stored().values())
        held = held_at(t)
        return held, sum(self._stored().values()) - before

    def around(self, held_at: Callable[[float], Held | None], h: float, start: Measures) -> float:
        """Work [J] as it is at a step's start, where the model is; the time is then the start's."""
        if not self.runs:
            return 0.0
        held_at(h)
        pumped = self.at_end(start)[1]
        held_at(0.0)
        return pumped

    def mean(self, held_at: Callable[[float], Held | None], h: float, end: Measures, pumped: float) -> float:
        """Work [J] of a step of which `around` gave `pumped`; the model is at its end, and stays there."""
        if not self.runs:
            return 0.0
        held_at(0.0)
        stored = self._stored()
        held_at(h)
        return (pumped + sum(end.energies[name] for name in stored) - sum(stored.values())) / 2

    def _stored(self) -> dict[str, float]:
        energies = self.meter.measure().energies
        return {name: energies[name] for force in self.meter.forces if force.time_dependent_energy for name in force.energies}
