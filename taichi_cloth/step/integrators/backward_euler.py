"""Backward Euler: the paper's single linear solve (18), and more of them where the first does not hold.

The step is the minimum of
    Phi(v) = 1/2 (v - v_0)^T M (v - v_0) + E(x_0 + h v + y) + h R(v),
R half the dissipated power; `nonlinear.euler` says how far it is gone after, `nonlinear.solid_contact` and
`nonlinear.layer_contact` what contact adds.
"""

import math
from collections.abc import Callable
from typing import Any

from ...backend.timing import Clock
from ...options import Options
from ...solver.pcg import Solution
from ...system.assembler import Measures
from ...system.checkpoint import Checkpointed
from ...system.constraints import Held
from ..attempt import Attempt
from ..nonlinear.energy import EnergyTest
from ..nonlinear.euler import EulerStep
from ..nonlinear.newton import minimize
from ..nonlinear.problem import Outcome
from ..nonlinear.system import System


class BackwardEuler(Checkpointed):
    """[BW98 §3.1, §6] on a system."""

    stable_step = math.inf
    STATE = ("dv",)

    def __init__(self, system: System, options: Options, converge: bool = False) -> None:
        self.system, self.options, self.converge = system, options, converge
        self.contacts, self.energy = system.contacts, EnergyTest(system)
        self.dv = system.solver.dv  # the last change of velocity, from which contacts predict the next
        self.problem: type[EulerStep] = EulerStep
        self.policy: Any = None  # who makes steps of cloth that may meet cloth
        if self.contacts is None:
            return
        from ..nonlinear.solid_contact import SolidStep

        self.problem, layers = SolidStep, self.contacts.layers
        if layers is not None and self.contacts.sprung:
            from ..nonlinear.spring_contact import SpringPolicy

            self.policy = SpringPolicy(system)
        elif layers is not None:
            from ..nonlinear.layer_contact import LayerPolicy

            self.policy = LayerPolicy(system, self.energy)

    def reset(self) -> None:
        """The state was changed by hand: nothing is remembered."""

    def attempt(self, h: float, held_at: Callable[[float], Held | None], start: Measures) -> Attempt:
        """One step; see the package."""
        clock, held, contacts = Clock(), held_at(h), self.contacts
        solutions: list[Solution] = []
        layers = None if contacts is None else contacts.layers
        before = 0.0 if layers is None else layers.seconds

        def apart() -> Outcome:
            problem = self.problem(self.system, self.energy, self.converge, h, held, start, clock, solutions)
            return minimize(problem, 1 + self.options.newton_max)

        made = apart() if self.policy is None else self.policy.attempt(apart, h, held, start, clock, solutions)
        if layers is not None:
            spent = layers.seconds - before
            clock.seconds |= {"C-C": spent, "C-S": max(clock.seconds.get("C-S", 0.0) - spent, 0.0)}
        return Attempt(made.rejection, made.detail, made.measures, tuple(solutions), clock.seconds, ledger=made.ledger,
                       **({} if contacts is None else contacts.counts()))

    def commit(self) -> None:
        """The last attempt was accepted."""
        if self.contacts is not None:
            self.contacts.commit()
