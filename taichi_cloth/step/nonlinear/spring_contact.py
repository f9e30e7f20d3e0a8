"""Backward Euler steps in which cloth is kept from cloth by springs: one solve, and no further than nothing collides."""

from collections.abc import Callable
from dataclasses import replace

from ..attempt import CONTACT
from .problem import Outcome


class SpringPolicy:
    """Steps of a system whose cloth meets cloth, by `contact.cloth.springs`."""

    def __init__(self, system) -> None:
        self.contacts, self.layers = system.contacts, system.contacts.layers

    def attempt(self, apart: Callable[[], Outcome], *_) -> Outcome:
        """As `LayerPolicy.attempt`; `apart` makes the step, with springs among its forces."""
        made, layers = apart(), self.layers
        if made.rejection is None:
            layers.record_forces()
            part = layers.advance()
            if part < 1:
                if self.contacts.small:
                    layers.release(self.contacts.smallest)
                detail = f"cloth would pass through cloth, a collision-free step is {part:.2g} of it"
                made = replace(made, rejection=CONTACT, detail=detail)
            layers.look()
        if layers.intersections.active:
            layers.count_tangled()
        return made
