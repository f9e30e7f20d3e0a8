"""Backward Euler steps in which cloth is kept from cloth by springs: one solve, and no further than nothing collides."""

from dataclasses import replace

from ...backend.timing import Clock
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.held import Held
from ..attempt import CONTACT
from .newton import Outcome
from .solid_contact import SolidPolicy


class SpringPolicy(SolidPolicy):
    """Steps with the springs of `contact.cloth.springs` among their forces."""

    def attempt(self, h: float, pins: Held | None, start: Measures, clock: Clock, solutions: list[Solution]) -> Outcome:
        """See `EulerPolicy`."""
        contacts, made = self.system.contacts, super().attempt(h, pins, start, clock, solutions)
        layers = contacts.layers
        if made.rejection is None:
            layers.record_forces()
            part = layers.advance()
            if part < 1:
                if contacts.start.small:
                    layers.release(contacts.start.smallest)
                detail = f"cloth would pass through cloth, a collision-free step is {part:.2g} of it"
                made = replace(made, rejection=CONTACT, detail=detail)
            layers.look()
        if layers.intersections.active:
            layers.count_tangled()
        return made
