"""What gives within a step: where stitches bear more than they can, it is tried again from its start with those open.

A step that is accepted loads nothing beyond what it bears, unless more gives in it than `TRIES` tries tell; the rest
follows in the next step. A step that is tried smaller begins with what was whole before.
"""

import numpy as np

from ..system.stitches import Stitches

TRIES = 16  # of a step, each with more open


class Giving:
    """The stitches of a model, from step to step.

    Args:
        stitches: those of the scene.
        integrator: what tries steps; its system knows what stitches bear.
        meter: measures potential energy where the model is.
        contacts: what is told of surfaces that are now apart, or None.
        tears: `tearing.Tears` where cloth may tear, or None.
    """

    def __init__(self, stitches: Stitches, integrator, meter, contacts, tears=None) -> None:
        self.stitches, self.integrator, self.meter, self.contacts = stitches, integrator, meter, contacts
        self.tears = tears
        integrator.system.fragile |= stitches.gives or tears is not None
        self.before: np.ndarray = stitches.whole  # at the start of a step in which something gave
        self.torn, self.tries = 0.0, 0  # J that is gone with what gave in this step; tries that let go

    def gives(self) -> bool:
        """Whether the attempt that the model shows loads anything beyond what it bears: that is open then, and the model back
        at its start."""
        if self.tries == TRIES or not (self.stitches.gives or self.tears is not None):
            return False
        system = self.integrator.system
        given = np.zeros(len(self.stitches.whole), dtype=bool)
        if self.stitches.gives:
            given = self.stitches.giving(system.tension() / system.span)
        if self.tears is not None:
            given[self.tears.giving(system.held)] = True
        if not given.any():
            return False
        if not self.tries:
            self.before = self.stitches.whole
        self.tries, system.gave = self.tries + 1, True
        self.stitches.model.restore()
        self.torn += self._set(self.stitches.whole & ~given)
        return True

    def take_back(self) -> bool:
        """What gave in a step that is to be tried smaller holds again. Whether anything did; the model is at its start."""
        changed = self.tries > 0
        if changed:
            self._set(self.before)
        self.torn, self.tries, self.integrator.system.gave = 0.0, 0, False
        return changed

    def commit(self) -> tuple[float, int, int]:
        """The step was accepted: (energy [J] that went with what gave, stitches that are open, crossings of cloth with cloth,
        among them the sides of what has opened, and of what is not closed yet)."""
        torn, tangled = self.torn, 0
        self.torn, self.tries, self.integrator.system.gave = 0.0, 0, False
        if self.contacts is not None and self.contacts.layers is not None:
            self.contacts.layers.part(self.stitches.whole | self.stitches.pulled)
            tangled = self.contacts.layers.tangled(self.stitches.parted)
        return torn, self.stitches.open, tangled

    def join(self) -> bool:
        """After a step that was accepted: what was pulled together and has come near holds. Whether anything does."""
        joined = self.stitches.join()
        if joined:
            self.integrator.loosen()
        return joined

    def pull_firmer(self, factor: float) -> None:
        """What is pulled together is pulled by so many times as much from now on, between steps."""
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
        """What holds from now on; energy [J] that this takes."""
        had = self.meter.measure().potential
        self.stitches.set(whole)
        self.integrator.loosen()
        return had - self.meter.measure().potential
