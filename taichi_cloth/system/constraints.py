"""Held directions imposed on the unknown of a solve and on the state, and constraints asked for by hand. [BW98 §5.1]"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..backend.device_arrays import array
from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.runtime import for_device
from ..errors import SceneError, shown
from ..scene.attachment import orthonormal
from .held import Held, kernel_array
from .state import ParticleState


@dataclass(frozen=True)
class Constraint:
    """One vertex held in a solve asked for by hand.

    Args:
        vertex: in the user's order.
        directions: as in `Scene.pin`.
        z: (3,) velocity change in those directions [m/s]; other components are ignored.
        y: (3,) alteration of position [m], in any direction.
    """

    vertex: int
    directions: object = None
    z: ArrayLike = (0.0, 0.0, 0.0)
    y: ArrayLike = (0.0, 0.0, 0.0)
    basis: np.ndarray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertex", checks.integer("constraint: vertex", self.vertex, least=0))
        object.__setattr__(self, "basis", orthonormal(self.directions))
        if not isinstance(self.directions, (str, type(None))):
            object.__setattr__(self, "directions", self.basis)
        for name, unit in (("z", "m/s"), ("y", "m")):
            value = checks.vector(f"constraint of vertex {self.vertex}: {name}", getattr(self, name), unit)
            object.__setattr__(self, name, value)


def by_hand(constraints: Sequence[Constraint], model: ParticleState,
            exchange: type) -> tuple[Held | None, np.ndarray]:
    """Held particles and z (k, 3) from constraints in the user's order.

    Raises:
        SceneError: a vertex out of range, without a face, or named twice.
    """
    if not isinstance(constraints, (list, tuple)):
        raise SceneError(f"constraints = {shown(constraints)}: must be Constraint objects in a list")
    vertices = [checks.instance("constraint", c, Constraint).vertex for c in constraints]
    for v in vertices:
        if not 0 <= v < len(model.particle) or model.particle[v] < 0:
            raise SceneError(f"constraint: vertex {v} is not simulated; there are {len(model.particle)} vertices")
        if vertices.count(v) > 1:
            raise SceneError(f"constraint: vertex {v} is named twice; give it all its directions at once")
    if not constraints:
        return None, np.zeros((0, 3))
    projector = np.array([c.basis.T @ c.basis for c in constraints])
    index = model.particle[vertices]
    z, y = ([getattr(c, name) for c in constraints] for name in "zy")
    return Held.of(index, projector, np.zeros((len(index), 3)), False, y, exchange), kernel_array(z, exchange)


@ti.data_oriented
class Filter:
    """Imposes held directions on the unknown: dv = z, and on the state that follows from it."""

    def __init__(self, fields: Fields, model: ParticleState, dv) -> None:
        self.model, self.dv, self.device = model, dv, for_device()
        self._brought: Held | None = None

    def bring(self, held: Held) -> None:
        """A device gets copies of held particles, once; those of the last ones serve for others that are the same."""
        if not self.device or not len(held.index) or held.copies:
            return
        if self._brought is not None and held.same(self._brought):
            held.copies.extend(self._brought.copies)
        else:
            kinds = np.int32, *(self.model.exchange,) * 3
            held.copies.extend(array(kind, *rows.shape) for kind, rows in zip(kinds, held.arrays))
            self._bring(held.index, held.projector, held.target, held.y, *held.copies)
        self._brought = held

    @ti.kernel
    def _bring(self, index: ti.types.ndarray(), projector: ti.types.ndarray(), target: ti.types.ndarray(),
               y: ti.types.ndarray(), to_index: ti.types.ndarray(), to_projector: ti.types.ndarray(),
               to_target: ti.types.ndarray(), to_y: ti.types.ndarray()):
        for k in range(index.shape[0]):
            to_index[k] = index[k]
            for a in ti.static(range(3)):
                to_target[k, a], to_y[k, a] = target[k, a], y[k, a]
                for b in ti.static(range(3)):
                    to_projector[k, a, b] = projector[k, a, b]

    @ti.kernel
    def prescribe(self, index: ti.types.ndarray(), projector: ti.types.ndarray(), target: ti.types.ndarray(),
                  y: ti.types.ndarray(), h: float, zero: int):
        """dv = S dv + (I - S) z so that held directions reach their target in a step: z = (target - y - x_base)/h - v_base.

        Args:
            index: (k,) particles; projector: (k, 3, 3) I - S; target: (k, 3) [m]; y: (k, 3) [m], see `Held`.
            h: [s]; zero: 1 sets S dv = 0.
        """
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            if zero == 1:
                self.dv[i] = ti.Vector.zero(float, 3)
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(index.shape[0]):
            i = index[k]
            z = (row(target, k) - row(y, k) - self.model.x_saved[i] - self.model.x_offset[i]) / h - self.model.v[i]
            self.dv[i] = self.dv[i] + project(projector, k, z - self.dv[i])

    @ti.kernel
    def lead(self, index: ti.types.ndarray(), projector: ti.types.ndarray(), target: ti.types.ndarray(), c: float):
        """dv = (I - S) (target - x)/c, for particles index (k,); with c = 0 x goes there, without the rounding of x + h v."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            if c > 0:
                self.dv[i] = ti.Vector.zero(float, 3)
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(index.shape[0]):
            i = index[k]
            way = project(projector, k, row(target, k) - self.model.x[i])
            if c > 0:
                self.dv[i] = way / c
            else:
                self.model.x[i] = self.model.x[i] + way

    @ti.kernel
    def impose(self, index: ti.types.ndarray(), projector: ti.types.ndarray(), z: ti.types.ndarray(), zero: int):
        """dv = S dv + (I - S) z, for particles index (k,) and z (k, 3) [m/s]; with `zero`, S dv = 0."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            if zero == 1:
                self.dv[i] = ti.Vector.zero(float, 3)
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(index.shape[0]):
            i = index[k]
            self.dv[i] = self.dv[i] + project(projector, k, row(z, k) - self.dv[i])

    @ti.kernel
    def impose_rest(self, index: ti.types.ndarray(), projector: ti.types.ndarray(), target: ti.types.ndarray(), c: float,
                    zero: int):
        """`impose` with the velocities that lead from where the model is to targets (k, 3) [m] in a span c [s]."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            if zero == 1:
                self.dv[i] = ti.Vector.zero(float, 3)
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(index.shape[0]):
            i = index[k]
            self.dv[i] = self.dv[i] + project(projector, k, (row(target, k) - self.model.x[i]) / c - self.dv[i])


@ti.func
def row(values: ti.template(), k):
    """Row k of an (m, 3) array."""
    return ti.Vector([ti.cast(values[k, 0], float), ti.cast(values[k, 1], float), ti.cast(values[k, 2], float)])


@ti.func
def project(projector: ti.template(), k, x):
    """projector[k] x"""
    out = ti.Vector.zero(float, 3)
    for a, b in ti.static(ti.ndrange(3, 3)):
        out[a] += ti.cast(projector[k, a, b], float) * x[b]
    return out
