"""BDF2 in contact: of second order where nothing is hit, contact settled at the step's end.

With w = h/h_0, the step over the one before, and k = w^2/(1 + 2 w),

    M (v_1 - v_b) = c f(x_1, v_1),  x_1 = x_b + c v_1,  c = h (1 + w)/(1 + 2 w),
    (x_b, v_b) = (x_0, v_0) + k (x_0 - x', v_0 - v'),

with (x', v') the state before: a step of backward Euler from another base, so that contact is in its solve as it is there.
Pins, and contacts along their normals, end with their mean velocity of the step, (target - x_0)/h. An alteration y makes up
for the rest, so nothing bounces. What sticks has the formula's velocity along the solid, as it has where it slides. If not,
the force that holds would jump where it slips, and a step that needs a force in between would have no solution: cloth that
stuck to a turntable slipped by 1e-6 of its speed, in 16 solves a step for 2. The first solve is linearized at the extrapolated
motion, v = v_0 + w (v_0 - v'). Newton's method goes on as in a stage of TR-BDF2.

Impacts are no part of a motion that goes on. Before the next step they are taken out of (x', v'):
- of contacts with solids that have just begun, the whole change of velocity along their normals, and as large a part of
  the friction's share in it: what the normal force bore beyond the impact, friction goes on with;
- of pairs that did not repel in the step before, the part of their impulse that shows in the change of velocity of the
  two. The part that other forces balanced stays. (With all growth of such forces, not that of new pairs alone, what lies
  under a load is lifted by more than it pressed: ten sheets at rest shook for ever.)

Source: Curtiss, Hirschfelder 1952; the treatment of contact is ours. A step that it cannot take is redone by backward Euler,
and so are the first one, those in which cloth comes at a solid faster than it falls in a step, those of sewn cloth, and those
in which something is pinched or tangled.
"""

from collections.abc import Callable

import numpy as np

from ...contact.points import among
from ...options import Options
from ...system.assembler import Measures
from ...system.base import Base
from ...system.held import Held
from ..attempt import Attempt
from ..nonlinear.history import HistoryEnergy
from ..nonlinear.linear_system import System
from ..nonlinear.newton import CALM, OTHERS, PART, PRELIMINARY, NewtonTolerance
from .backward_euler import BackwardEuler

NONE = (np.zeros(0, dtype=np.int64),) * 2  # of solids and of layers
RATIO = 2.0  # largest step over the one before; BDF2 is stable up to 1 + sqrt 2


class BDF2(BackwardEuler):
    """On a system."""

    STATE = ("dv", "h_0", "x_0", "v_0", "borne", "energy")

    def __init__(self, system: System, options: Options, gravity: np.ndarray) -> None:
        super().__init__(system, options)
        self.model = system.model
        self.energy: HistoryEnergy = HistoryEnergy(system, gravity)
        self.policy.energy = self.energy
        n = self.model.n
        self.h_0 = self.h_1 = 0.0  # s: the step before, 0 where there is none; the attempt
        self.x_0, self.v_0 = np.zeros((n, 3)), np.zeros((n, 3))  # the state before
        self.borne: tuple[np.ndarray, ...] = NONE  # keys of the pairs that repelled in that step

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """See `Checkpointed`. Runs of versions before 16 made their steps in contact by backward Euler, unless BDF2 was asked
        for, and kept no keys: the next step begins anew."""
        super().resume(state if "borne.0" in state else {**self.checkpoint(), "h_0": np.array(0.0), "dv": state["dv"]})

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        made = None
        self.h_1 = h
        if self._may(h):
            base = self.system.base = self.energy.base = self._base(h)
            self.system.start_over()
            asked = self.options.newton_tol
            self.policy.effort = NewtonTolerance(asked or CALM * base.c, 0.0 if asked else PART, PRELIMINARY, OTHERS)
            made = super().attempt(h, held_at, start)
            self.system.base = self.policy.effort = None
            if made.rejection is None:
                return made
            self.model.restore()
        self.energy.base = None
        redone = super().attempt(h, held_at, start)
        return redone if made is None else redone.instead_of(made, made.rejection or "")

    def _may(self, h: float) -> bool:
        """Whether the step can go on from the one before."""
        return 0 < h <= RATIO * self.h_0 and self.model.sewn is None and not self.contacts.hindered

    def expected(self) -> tuple[np.ndarray, float, int]:
        """See `BackwardEuler`."""
        base = self.energy.base
        if base is None:
            return super().expected()
        return base.guess, (base.h + self.h_0) / (3 * (2 * base.h + self.h_0)), 2

    def forget(self) -> None:
        """See `BackwardEuler`."""
        self.h_0 = 0.0

    def follow(self, h: float, power: float) -> None:
        """See `BackwardEuler`."""
        x, v = self.model.read_saved()
        self.x_0, self.v_0, self.h_0 = x.copy(), v.copy(), h
        self.borne = NONE
        self.energy.follow(power)

    def _base(self, h: float) -> Base:
        """The base of a step of h [s] from the saved state."""
        x, v = self.model.read_saved()
        w = h / self.h_0
        k, moved, faster = w**2 / (1 + 2 * w), x - self.x_0, v - self.v_0
        return Base(h, h * (1 + w) / (1 + 2 * w), k * moved, v + k * faster, v + w * faster)

    def _span(self, h: float) -> float:
        return h if self.system.base is None else self.system.base.c

    def commit(self, taken: float = 0.0) -> None:
        """The last attempt was accepted; forces with memory took the energy `taken` [J] after it."""
        x, v = self.model.read_particles()
        x_0, v_0 = self.model.read_saved()
        self.x_0, self.v_0, self.h_0 = x_0.copy(), v_0.copy(), self.h_1
        self._forget_impacts(x, v)
        self.energy.commit(taken)
        super().commit(taken)

    def _forget_impacts(self, x: np.ndarray, v: np.ndarray) -> None:
        """The state before becomes one from which the motion goes on to x, v (n, 3): see above."""
        mass, before = self.model.mass, self.v_0.copy()
        c = self.h_1 if self.energy.base is None else self.energy.base.c
        for i, n, force in zip(*self.contacts.solids.begun()):  # one after the other: a particle may have several
            gained, given = v[i] - self.v_0[i], c * force / mass[i]  # m/s: all in all, and by the contact
            along, pressed = n @ gained, n @ given
            hit = min(max(along / max(pressed, 1e-300), 0.0), 1.0)  # part of the contact's impulse that is an impact's
            self.v_0[i] += along * n + hit * _share(gained - along * n, given - pressed * n)
        every, changed = self.contacts.pushes(), v - self.v_0
        given = np.zeros_like(v)
        for pushes in every:
            pushes.add(given)
        given *= (c / mass)[:, None]
        for k, pushes in enumerate(every):  # all particles of a pair by the same part, so that momentum stays
            part = np.clip(pushes.of(changed) / np.maximum(pushes.of(given), 1e-300), 0, 1)
            part[among(self.borne[k], pushes.key)] = 0.0
            self.v_0 += pushes.add(np.zeros_like(v), part) * (c / mass)[:, None]
        self.borne = tuple(np.sort(pushes.key) for pushes in every)
        moved = (self.v_0 != before).any(axis=1)
        self.x_0[moved] = x[moved] - self.h_1 * (v[moved] + self.v_0[moved]) / 2

    def reset(self) -> None:
        """The state was changed by hand."""
        self.forget()
        self.borne = NONE
        self.energy.reset()


def _share(change: np.ndarray, impulse: np.ndarray) -> np.ndarray:
    """The part of an impulse (3,) per mass [m/s] that shows in a change of velocity (3,), not balanced by other forces."""
    return min(max(change @ impulse / max(impulse @ impulse, 1e-300), 0.0), 1.0) * impulse
