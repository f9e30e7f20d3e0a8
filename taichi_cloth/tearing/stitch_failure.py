"""Stitches that fail within a step: a step with overloaded stitches is tried again from its start with those open.

An accepted step overloads no stitch. A step that is tried smaller begins with the stitches that were whole before.
"""

import numpy as np

from ..system.stitches import Stitches


class StitchFailure:
    """The stitches of a model, from step to step.

    Args:
        stitches: those of the scene.
        integrator: tries steps; its system knows the tension of stitches.
        meter: measures potential energy where the model is.
        contacts: contacts to tell of surfaces that are now apart, or None.
        tears: `tears.Tears` where cloth may tear, or None.
    """

    def __init__(self, stitches: Stitches, integrator, meter, contacts, tears=None) -> None:
        self.stitches, self.integrator, self.meter, self.contacts = stitches, integrator, meter, contacts
        self.tears = tears
        integrator.system.fragile |= stitches.breakable or tears is not None
        self.before: np.ndarray = stitches.whole  # at the start of a step in which something gave
        self.torn = 0.0  # J lost with stitches that failed in this step

    def open_overloaded(self) -> bool:
        """Whether the attempt in the model overloads anything: then that is opened, and the model is back at the
        step's start."""
        if not (self.stitches.breakable or self.tears is not None):
            return False
        system = self.integrator.system
        given = np.zeros(len(self.stitches.whole), dtype=bool)
        if self.stitches.breakable:
            given = self.stitches.overloaded(system.tension() / system.dt_coefficient)
        if self.tears is not None:
            given[self.tears.overloaded(system.held)] = True
        if not given.any():
            return False
        if not system.stitches_failed:
            self.before = self.stitches.whole
        system.stitches_failed = True
        self.stitches.model.restore()
        self.torn += self._set(self.stitches.whole & ~given)
        return True

    def take_back(self) -> bool:
        """Closes the stitches that failed in a step to be tried smaller. Whether any had; the model is at the step's start."""
        changed = self.integrator.system.stitches_failed
        if changed:
            self._set(self.before)
        self.torn, self.integrator.system.stitches_failed = 0.0, False
        return changed

    def commit(self) -> tuple[float, int, int]:
        """The step was accepted: (energy [J] lost with failed stitches, stitches that are open, crossings of cloth with cloth
        among the sides of seams that have opened or are not closed yet)."""
        torn, tangled = self.torn, 0
        self.torn, self.integrator.system.stitches_failed = 0.0, False
        if self.contacts is not None and self.contacts.layers is not None:
            self.contacts.layers.part(self.stitches.whole | self.stitches.pulled)
            tangled = self.contacts.layers.tangled(self.stitches.parted)
        return torn, self.stitches.open, tangled

    def join(self) -> bool:
        """After an accepted step: stitches that were pulled together and have come near hold. Whether any now do."""
        joined = self.stitches.join()
        if joined:
            self.integrator.loosen()
        return joined

    def pull_firmer(self, factor: float) -> None:
        """Multiplies the pull on stitches being closed from now on, between steps."""
        self.stitches.firm *= factor
        self.stitches.resumed()
        self.integrator.loosen()

    def set_by_hand(self, rows: np.ndarray, holds: bool) -> bool:
        """Opens stitches by hand, or closes them, between steps. Whether that is a change."""
        changed = self.stitches.set_by_hand(rows, holds)
        if changed:
            self.integrator.loosen()
            if holds and self.contacts is not None and self.contacts.layers is not None:
                self.contacts.layers.join(self.stitches.whole | self.stitches.pulled)
        return changed

    def _set(self, whole: np.ndarray) -> float:
        """Sets the stitches that hold from now on. Returns the energy [J] that this takes."""
        had = self.meter.measure().potential
        self.stitches.set(whole)
        self.integrator.loosen()
        return had - self.meter.measure().potential
