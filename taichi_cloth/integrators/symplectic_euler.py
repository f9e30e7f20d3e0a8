"""Symplectic Euler: v += h f(x, v)/m, x += h v. Explicit, no solver; stable only for small h."""

import math

import taichi as ti

from ..constraints import Filter, Held
from ..errors import SceneError
from ..fields import Fields
from ..measure import Measures, Meter
from ..model import Model
from ..operator import ForceField
from ..runtime import Runtime
from ..scene import Scene
from ..timing import Clock
from . import NOT_FINITE, Attempt, Options


@ti.data_oriented
class SymplecticEuler:
    """The seed's own method, on a model."""

    operator = None
    solver = None

    def __init__(self, fields: Fields, model: Model, forces: list, meter: Meter, options: Options,
                 runtime: Runtime, scene: Scene, contacts=None) -> None:
        if contacts is not None:
            raise SceneError("integrator 'symplectic_euler' has no contact with solids: use 'backward_euler'")
        self.model, self.meter = model, meter
        self.forces = ForceField(fields, model, forces)
        self.dv = fields.real(model.n, 3)
        self.stable_step = stable_step(sum(force.rates[0] for force in forces), sum(force.rates[1] for force in forces))
        self.filter = Filter(fields, model, self.dv)

    def attempt(self, h: float, held: Held | None, start: Measures) -> Attempt:
        """One step; see the package."""
        clock = Clock()
        with clock.part("EVAL"):
            self.forces.compute()
            self._kick(h)
            if held is not None:
                self.filter.prescribe(held.index, held.projector, held.target, held.y, h)
            self._drift(h)
            if held is not None:
                self.filter.settle(held.index, held.projector, held.target)
            measures = self.meter.measure()
        rejection = None if measures.finite else NOT_FINITE
        return Attempt(rejection, "" if measures.finite else "explicit step", measures, (), clock.seconds)

    def commit(self) -> None:
        """The attempt was accepted: nothing to keep."""

    def checkpoint(self) -> dict:
        """Nothing is remembered from step to step."""
        return {}

    def resume(self, state: dict) -> None:
        """Nothing to go on from."""

    @ti.kernel
    def _kick(self, h: float):
        """dv = h f/m"""
        for i in range(self.model.n):
            self.dv[i] = h * self.forces.f[i] / self.model.m[i]

    @ti.kernel
    def _drift(self, h: float):
        """v += dv, x += h v"""
        for i in range(self.model.n):
            self.model.v[i] += self.dv[i]
            self.model.x[i] += h * self.model.v[i]


def stable_step(omega2: float, damping: float) -> float:
    """The step [s] up to which h^2 omega^2 + 2 h damping <= 4, the limit of stability at rest.

    Args:
        omega2: largest squared frequency [1/s^2]; damping: largest damping rate [1/s].
    """
    if omega2 == 0:
        return 2 / damping if damping else math.inf
    return (math.sqrt(damping**2 + 4 * omega2) - damping) / omega2
