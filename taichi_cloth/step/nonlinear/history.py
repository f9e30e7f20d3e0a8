"""The test of energy, and the ledger, of a step that goes on from the one before.

Works are taken as c of the power at the step's end and h - c of that at its beginning. A method of second order gains and
loses in turn: a hundredth of the motion's energy may come in a step, and three before as much has gone again.
"""

import math
from collections.abc import Callable
from dataclasses import asdict, replace

import numpy as np

from ...system.assembler import Measures
from ...system.base import Base
from ...system.checkpoint import Checkpointed
from ...system.held import Held
from ..ledger import Ledger, Work, gained
from .energy import EnergyTest
from .linear_system import System

GAIN, DEBT = 0.01, 0.03  # of the motion's energy: gain allowed in a step, and in steps before they have lost as much again
LAPSE = 0.1  # s, over which the motion's scale forgets
FALL = 0.1  # m/s: and the work of gravity at this speed counts
GOES_ON = ("pins", "solids", "friction")  # works that have a power; the others are of their step alone


class HistoryEnergy(EnergyTest, Checkpointed):
    """On the steps of a system.

    Attributes:
        base: of the attempt, or None: backward Euler's.
    """

    STATE = ("power", "accumulated_gain", "motion")

    def __init__(self, system: System, gravity: np.ndarray) -> None:
        super().__init__(system)
        self.base: Base | None = None
        self.weight = float(np.linalg.norm(gravity) * self.model.mass.sum())
        self.power = self.power_1 = np.zeros(len(GOES_ON))  # [W]
        self.accumulated_gain = self.accumulated_gain_1 = self.motion = self.motion_1 = 0.0

    def commit(self, taken: float) -> None:
        """The step was accepted."""
        self.power, self.accumulated_gain, self.motion = self.power_1, max(0.0, self.accumulated_gain_1 - taken), self.motion_1

    def follow(self, power: float) -> None:
        """A step was made by another method, whose pins had a power [W] at its end."""
        self.power = np.array([power] + [0.0] * (len(GOES_ON) - 1))

    def reset(self) -> None:
        """The state was changed by hand."""
        self.power, self.accumulated_gain, self.motion = np.zeros(len(GOES_ON)), 0.0, 0.0

    def conclude(self, h: float, held: Held | None, start: Measures, measures: Measures, most: float,
                 fits: Callable[[Measures, Ledger], bool] | None = None, slack: float = 0.0) -> tuple[Measures, Ledger] | None:
        """See `EnergyTest`; `h` is c of the step."""
        base = self.base
        self.motion_1 = max(start.energies["kinetic"], measures.energies["kinetic"],
                            self.motion * math.exp(-(h if base is None else base.h) / LAPSE))
        if base is None:
            made = super().conclude(h, held, start, measures, most, fits, slack)
            if made is not None:
                self.power_1 = np.array([getattr(made[1], name) for name in GOES_ON]) / h
                self.accumulated_gain_1 = max(0.0, self.accumulated_gain + made[1].change - made[1].total
                                              - max(0.0, made[1].wind))
            return made
        c, rest = base.c, base.h - base.c
        end = self.work(c, held, start, measures)
        self.power_1 = np.array([getattr(end, name) for name in GOES_ON]) / c
        work = replace(end, **{name: getattr(end, name) + rest * p for name, p in zip(GOES_ON, self.power.tolist())})
        stored = measures.energies.get("contact", 0.0) - start.energies.get("contact", 0.0)
        undone = self._undone(c, measures, end, stored)
        wind, damping = c * measures.wind + rest * start.wind, 2 * (c * measures.damped + rest * start.damped)
        ledger = Ledger(**asdict(work), kinetic=measures.energies["kinetic"] - start.energies["kinetic"],
                        potential=measures.potential - start.potential, wind=wind, damping=damping)
        ledger = replace(ledger, method=undone - ledger.unaccounted)
        over = gained(start, measures, work) - max(0.0, wind)
        self.accumulated_gain_1 = max(0.0, self.accumulated_gain + over)
        scale, rounding = self.motion_1 + self.weight * FALL * base.h, self.system.rounding(c, start, measures)
        if over > GAIN * scale + rounding or (over > rounding and self.accumulated_gain_1 > DEBT * scale + rounding):
            return None
        return measures, ledger

    def _undone(self, c: float, measures: Measures, end: Work, stored: float) -> float:
        """Work [J] of the solve's residual: v . (M (v - v_base) - c F)."""
        assert self.base is not None
        kinetic = 0.5 * float(np.sum(self.model.mass[:, None] * self.base.v**2))
        free = end.total - end.pushed_out - end.pulled_down - stored
        done = free - c * measures.rate + c * measures.wind - 2 * c * measures.damped
        return measures.energies["kinetic"] + measures.change - kinetic - done
