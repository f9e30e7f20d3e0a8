"""Explicit work of time on a force's energy, as by a pump that raises a pressure: the part of dE/dt at fixed positions.

A step of one stage has the forces of its end: the work is E(x_0, t_1) - E(x_0, t_0) exactly. For others it is the mean of
that and E(x_1, t_1) - E(x_1, t_0), of second order.
"""

from collections.abc import Callable
from dataclasses import replace

from ..system.assembler import Assembler, Measures
from ..system.held import Held


class Pump:
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
