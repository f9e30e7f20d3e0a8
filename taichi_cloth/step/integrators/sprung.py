"""A backward Euler step in which cloth is kept from cloth by springs: one solve, and no further than its way is free."""

from dataclasses import replace

from ...system.assembler import Measures
from ...system.constraints import Held
from .attempt import CONTACT, Attempt


class Sprung:
    """Steps of a `BackwardEuler` whose cloth meets cloth, by `contact.springs`."""

    def __init__(self, euler) -> None:
        self.euler, self.contacts, self.layers = euler, euler.contacts, euler.contacts.layers

    def attempt(self, h: float, pins: Held | None, start: Measures) -> Attempt:
        """One step; see the package."""
        layers, before = self.layers, self.layers.seconds
        made = self.euler.solve_once(h, pins, start)
        if made.rejection is None:
            layers.record_forces()
            part = layers.advance()
            if part < 1:
                if self.contacts.small:
                    layers.let_go(self.contacts.smallest)
                made = replace(made, rejection=CONTACT, detail=f"cloth would pass through cloth, {part:.2g} of the way free")
            layers.look()
        if layers.tangles.active:
            layers.count_tangled()
        spent = layers.seconds - before
        seconds = {**made.seconds, "C-C": spent, "C-S": max(made.seconds.get("C-S", 0.0) - spent, 0.0)}
        return replace(made, seconds=seconds, layers=layers.count, least=layers.least, tangled=layers.tangles.count,
                       pinched=layers.tangles.pinched)
