"""Boundary conditions of a script at a time: held particles and their targets, the wind, and places of solids."""

from collections.abc import Sequence

import numpy as np

from ..errors import SceneError
from ..forces.force import Force
from ..forces.pulls import NOTHING, Pulled, Pulls
from ..scene.attachment import Script
from ..system.checkpoint import Checkpointed
from ..system.constraints import Attachments
from ..system.held import Held
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
        self.attachments = Attachments(model, model.exchange)
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
            self.contacts.scan.set_time(t, h)
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
        self.attachments = Attachments(self.model, self.model.exchange)

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
