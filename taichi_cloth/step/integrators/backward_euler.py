"""Backward Euler: the paper's single linear solve (18), and more of them where the first does not hold.

The step is the minimum of

    Phi(v) = 1/2 (v - v_0)^T M (v - v_0) + E(x_0 + h v + y) + h R(v),

R half the dissipated power. `nonlinear.euler` decides how closely it is approached. `nonlinear.solid_contact` and
`nonlinear.layer_contact` add the terms of contact.
"""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...backend.timing import Clock
from ...options import Options
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.checkpoint import Checkpointed
from ...system.held import Held
from ..attempt import Attempt
from ..ledger import with_attachments
from ..nonlinear.energy import EnergyTest
from ..nonlinear.euler import EulerPolicy
from ..nonlinear.linear_system import System
from ..nonlinear.newton import NewtonTolerance
from ..prescribed import ExplicitTimeWork


class BackwardEuler(Checkpointed):
    """[BW98 §3.1, §6] on a system."""

    stable_step = math.inf
    STATE: tuple[str, ...] = ("dv",)

    def __init__(self, system: System, options: Options, effort: NewtonTolerance | None = None) -> None:
        self.system, self.options, self.effort = system, options, effort
        self.contacts, self.energy, self.time_work = system.contacts, EnergyTest(system), ExplicitTimeWork(system.meter)
        self.dv = system.solver.dv  # of the last solve, from which contacts predict the next step
        self.policy = self._policy()
        if self.contacts is not None and options.contact_tol is not None and not self.contacts.sprung:
            from ..nonlinear.solved_contact import SolvedStep

            self.policy.solved = SolvedStep  # type: ignore[attr-defined]

    def _policy(self) -> EulerPolicy:
        """The policy that makes the problems of a step."""
        contacts, with_what = self.contacts, (self.system, self.energy, self.effort)
        if contacts is None:
            return EulerPolicy(*with_what)
        if contacts.layers is None:
            from ..nonlinear.solid_contact import SolidPolicy

            return SolidPolicy(*with_what)
        from ..nonlinear.layer_contact import LayerPolicy, SpringPolicy

        return (SpringPolicy if contacts.sprung else LayerPolicy)(*with_what)

    def reset(self) -> None:
        """The state was changed by hand: nothing is remembered."""

    def loosen(self) -> None:
        """Seams have opened in the model's state."""
        self.system.loosen()

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        clock, held, contacts = Clock(), held_at(h), self.contacts
        solutions: list[Solution] = []
        layers = None if contacts is None else contacts.layers
        before = 0.0 if layers is None else layers.seconds
        start, led = self.system.meter.led(start, 0.0)
        start, pumped = self.time_work.at_end(start)
        made = self.policy.attempt(self._span(h), held, start, clock, solutions)
        ledger = made.ledger and replace(made.ledger, gas=pumped, potential=made.ledger.potential + pumped)
        if layers is not None:
            spent = layers.seconds - before
            clock.seconds |= {"C-C": spent, "C-S": max(clock.seconds.get("C-S", 0.0) - spent, 0.0)}
        return Attempt(made.rejection, made.detail, made.measures, tuple(solutions), clock.seconds,
                       ledger=None if ledger is None else with_attachments(ledger, led),
                       **({} if contacts is None else contacts.counts()))

    def expected(self) -> tuple[np.ndarray, float, int]:
        """(velocities (n, 3) [m/s] extrapolated to the end of the last attempt, error factor, order of the method).

        The factor times h, times the error of these velocities, is the error of positions.
        """
        return self.system.model.read_saved()[1], 0.5, 1

    def follow(self, h: float, power: float) -> None:
        """A step of h [s] without contact was made by another method, whose pins had a power [W] at its end."""

    def forget(self) -> None:
        """The next attempt does not go on from the step before."""

    def _span(self, h: float) -> float:
        """The method's factor of forces [s]."""
        return h

    def commit(self, taken: float = 0.0) -> None:
        """The last attempt was accepted; forces with memory took the energy `taken` [J] after it."""
        if self.contacts is not None:
            self.contacts.commit()
