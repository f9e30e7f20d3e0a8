"""The default: TR-BDF2, and BDF2 or backward Euler for the steps that it cannot take.

A step that gains energy or whose Newton iteration fails is redone by backward Euler with its energy test. This loses
accuracy but not the run. In scenes without contact and limits of strain, a step that fails with NEWTON or ENERGY is first
tried with a half and a quarter of its size. Steps in which cloth touches something are BDF2's where they are solved, in
contact with solids alone, else backward Euler's: contact is part of the solve of either. So are those in which a seam is being
closed, or something tears and recoils.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...system.assembler import Measures
from ...system.checkpoint import Checkpointed
from ...system.held import Held
from ..attempt import ACCURACY, ENERGY, NEWTON, NOT_FINITE, SOLVER, TOUCH, Attempt
from ..nonlinear.linear_system import System
from .backward_euler import BackwardEuler
from .tr_bdf2 import HORIZON, TRBDF2

REDONE = (ENERGY, NEWTON, NOT_FINITE, SOLVER)
STUBBORN = 64  # with `tolerance`, how many times smaller than the largest a failed step is tried before it is redone
SLOW = 4  # the same without: two small steps are far more accurate than one of backward Euler. With 1 stiff cloth loses .48 J
# for .38 (`test_stability`)
LAPSE = 0.02  # s, over which the acceleration of cloth in contact is averaged


class Safe(Checkpointed):
    """TR-BDF2 with backward Euler to fall back on.

    Args:
        only_contact: falls back to backward Euler for contact only.
    """

    stable_step = math.inf
    STATE = ("accurate", "robust", "touching", "largest", "mean")

    def __init__(self, system: System, accurate: TRBDF2, robust: BackwardEuler, only_contact: bool = False) -> None:
        self.system, self.accurate, self.robust, self.only_contact = system, accurate, robust, only_contact
        self.model, self.contacts, self.tolerance = system.model, system.contacts, system.options.tolerance
        self.stiffens_sharply = any(force.stiffens_sharply for force in system.meter.forces)
        self.touching, self.gained = False, 0.0  # whether cloth is in contact; energy [J] of the last attempt by `robust`
        self.last: TRBDF2 | BackwardEuler = accurate
        self.fresh = False  # whether nothing was asked of `accurate` since it was reset
        self.largest = self.tried = 0.0  # steps [s]: of all, of the last attempt
        self.mean = self.mean_1 = np.zeros((self.model.n, 3))  # acceleration [m/s^2] in contact, over LAPSE; after the attempt

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        self.largest, self.tried = max(self.largest, h), h
        made, reason = None, TOUCH
        sewn = self.model.sewn
        if not (self.touching or self.system.stitches_failed or (sewn is not None and (sewn.open or sewn.pulled))):
            self.last, self.fresh = self.accurate, False
            if self.contacts is not None:
                self.contacts.force.clear()  # of an attempt in contact before it
            made = self.accurate.attempt(h, held_at, start)
            reason = made.rejection or ""
            if self.contacts is not None and (made.rejection is None or made.rejection == ACCURACY) and self._touches(
                    h, held_at(h)):
                reason = TOUCH
            slow = SLOW if reason in (NEWTON, ENERGY) and self.contacts is None and not self.stiffens_sharply else 1
            stubborn = STUBBORN if self.tolerance is not None else slow
            patient = self.only_contact or (self.system.options.adaptive and h > self.largest / stubborn)
            if reason != TOUCH and (reason not in REDONE or patient):
                return made
            self.model.restore()
            if reason != TOUCH:
                self.robust.forget()
        self.last = self.robust
        redone = self._judged(h, self.robust.attempt(h, held_at, start), held_at)
        self.gained = 0.0 if redone.ledger is None else redone.ledger.change - redone.ledger.total
        if made is None:
            return replace(redone, fallback_reason=redone.fallback_reason or reason)
        return redone.instead_of(made, reason)

    def commit(self, taken: float = 0.0) -> None:
        """The last attempt was accepted; forces with memory took the energy `taken` [J] after it."""
        self.last.commit(taken)
        if self.last is self.robust:
            self.mean = self.mean_1
            accumulated_gain = max(0.0, self.accurate.accumulated_gain + self.gained - taken)
            if not self.fresh or accumulated_gain != self.accurate.accumulated_gain:
                self.accurate.reset(accumulated_gain)
                self.fresh = True
            self.touching = self.contacts is not None and self.contacts.touching
        else:
            self.robust.follow(self.tried, self.accurate.power)
            if self.contacts is not None:
                self.contacts.pass_by()

    def reset(self) -> None:
        """The state was changed by hand."""
        self.accurate.reset()
        self.robust.reset()
        self.touching, self.mean = False, np.zeros((self.model.n, 3))

    def loosen(self) -> None:
        """See `TRBDF2`."""
        self.accurate.loosen()

    def _touches(self, h: float, held: Held | None) -> bool:
        """Whether the step as taken meets a solid."""
        x, v = self.model.read_saved()
        return self.contacts.meets(h, held, x, v)

    def _judged(self, h: float, made: Attempt, held_at: Callable[[float], Held | None]) -> Attempt:
        """The attempt with an estimate of its error, if one is asked for.

        It is h (v_1 - v_0) / 2 for backward Euler, and h (h + h_0) / (3 (2 h + h_0)) (v_1 - v) for BDF2. v is the
        velocity extrapolated from v_0 and the step before. Summed over steps these estimates telescope: oscillations, as of
        cloth after an impact, cancel. Therefore the mean acceleration over a while counts. Held directions are exact.
        """
        if self.tolerance is None or made.rejection is not None:
            return made
        v, share, order = self.robust.expected()
        a = (self.model.read_particles()[1] - v) / h
        held = held_at(h)
        if held is not None:
            a[held.index] -= np.einsum("kij,kj->ki", held.projector, a[held.index])
        self.mean_1 = self.mean - math.expm1(-h / LAPSE) * (a - self.mean)
        error = h * share * float(np.sqrt(np.mean(np.sum(self.mean_1**2, axis=1)))) * HORIZON / self.tolerance
        return replace(made, error=error, order=order, rejection=ACCURACY if error > 1 else None,
                       detail=f"{error:.2g} times the error allowed")
