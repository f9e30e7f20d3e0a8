"""Soft attachments and pins: springs from vertices to places, none of which pulls with more than a largest force.

With d = |x - g|, g the place that the vertex rides at,

    E = k d^2/2 where k d <= F, else F d - F^2/2k,    f = -T (x - g)/d,    T = min(k d, F):

convex, with a continuous force. A step's first solve takes T/d of where the step is led to, in all directions: an upper
bound of the second derivative, so that it pulls no vertex past its place. For vertices that move away from their places it
takes the derivative, as further solves and K = "paper" do. With the bound, vertices loaded beyond F hung on for a fifth of a
second, and Newton's method came to 1e-11 m in 61 solves or not at all.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.rows import write
from ..scene.scene import Scene
from ..system.state import ParticleState
from .conditions import sym_outer, sym_scaled_identity, sym_times
from .force import Force


@dataclass(frozen=True)
class Pulled:
    """Soft attachments at a time.

    Attributes:
        index: (k,) particles; place: (k, 3) where they are pulled to [m].
        law: (k, 2) stiffness [N/m], and largest force [N].
    """

    index: np.ndarray
    place: np.ndarray
    law: np.ndarray

    def energy(self, x: np.ndarray) -> float:
        """E [J] with particles at x (n, 3) [m]."""
        k, most = self.law.T
        d = np.linalg.norm(x[self.index] - self.place, axis=1)
        reach = most / k
        near = np.minimum(d, reach)
        with np.errstate(invalid="ignore"):
            beyond = np.where(d > reach, most * (d - near), 0.0)
        return float(np.sum(k * near**2 / 2 + beyond))

    def forces(self, x: np.ndarray) -> np.ndarray:
        """(k, 3) [N] on them, with particles at x (n, 3) [m]."""
        k, most = self.law.T
        away = x[self.index] - self.place
        d = np.linalg.norm(away, axis=1)
        return -(np.minimum(k, most / np.maximum(d, 1e-300)))[:, None] * away


NOTHING = Pulled(np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 2)))


@ti.data_oriented
class Pulls(Force):
    """Springs of soft attachments, at most one a particle.

    Attributes:
        source: gives the soft attachments at a time [s].
        began: time [s] at which the current step does.
    """

    energies = ("attachments",)

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, mode: str) -> None:
        self.model, self._fields, self.exact = model, fields, mode == "paper"
        self.sum_k = sum(float(a.springs.sum()) for a in scene.script.attachments)
        self.source: Callable[[float], Pulled] = lambda t: NOTHING
        self.now, self.began = NOTHING, 0.0
        self.attached = np.zeros((0, 3))
        self.law, self.place = fields.real(model.n, 2), fields.real(model.n, 3)

    def rounding_energy(self, d: float) -> float:
        """See `Force`."""
        return self.sum_k * d * d / 2

    def build_stiffness(self) -> None:
        """See `Force`."""
        self.A, self.stiff = self._fields.real(self.model.n, 6), True

    def set_time(self, t: float) -> None:
        """Places, as they are at t [s]."""
        self.now = self.source(t)
        self.put(self.now)

    def put(self, pulled: Pulled) -> None:
        """These are attached, at their places."""
        self.attached = np.column_stack([pulled.index, pulled.law])
        for field, some in ((self.law, pulled.law), (self.place, pulled.place)):
            rows: np.ndarray = np.zeros((self.model.n, some.shape[1]), dtype=self.model.exchange)
            rows[pulled.index] = some
            write(field, rows)

    def led(self, before: float, part: float) -> float:
        """Work [J] of moving the places in the step, attaching and letting go included.

        With `part` 0 it is E(x_0, g_1) - E_0, with the cloth as at the beginning: the bound of backward Euler's energy. With
        1/2 it is the mean of that and of the same at the end: of second order.

        Args:
            before: energy with which the step began [J].
        """
        x = self.model.read_saved()[0]
        work = self.now.energy(x) - before
        if part:
            x_1, old = self.model.read_particles()[0], self.source(self.began)
            jump = old.energy(x) - before
            work += part * (self.now.energy(x_1) - old.energy(x_1) + jump - work)
        return work

    @ti.func
    def pull(self, i, x):
        """(T, d, T/d) at x."""
        k, most = self.law[i][0], self.law[i][1]
        d = (x - self.place[i]).norm()
        T = ti.min(k * d, most)
        ratio = k
        if k * d > most:
            ratio = most / d
        return T, d, ratio

    @ti.func
    def add_force(self, block, f: ti.template()):
        """f += -T/d (x - g)"""
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            if self.law[i][0] > 0:
                T, d, ratio = self.pull(i, self.model.x[i])
                f[i] = f[i] - ratio * (self.model.x[i] - self.place[i])

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """Energy [J] in column `base`, no dissipation, the rate at which the energy grows [W]. With `linearizes`, the linear
        system too."""
        total, rate = ti.cast(0, dtype), ti.cast(0, dtype)
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            k, away = self.law[i][0], self.model.x[i] - self.place[i]
            if k > 0:
                T, d, ratio = self.pull(i, self.model.x[i])
                total += T * (d - 0.5 * T / k)
                rate += ratio * away.dot(self.model.v[i])
            if ti.static(self.stiff):
                if linearizes == 1:
                    self.linearize(i, moves, c, to)
        report[block, base] = total
        report[block, base + 1] = 0
        report[block, base + 2] = rate

    @ti.func
    def linearize(self, i, moves, c, to: ti.template()):
        """b += c (f + K motion), P += A; A = -c^2 K"""
        A = ti.Vector.zero(float, 6)
        if self.law[i][0] > 0:
            led = self.model.x[i]
            bounded = moves == 1 and ti.static(not self.exact)
            if bounded:
                led += to.rhs_displacement[i]
                bounded = to.rhs_displacement[i].dot(led - self.place[i]) <= 0
            T, d, ratio = self.pull(i, led)
            b = -c * ratio * (led - self.place[i])
            A = sym_scaled_identity(c * c * ratio)
            if not bounded:
                if ratio < self.law[i][0]:
                    A -= c * c * ratio * sym_outer((led - self.place[i]) / d)
                if moves == 1:
                    b -= sym_times(A, to.rhs_displacement[i]) / c
            to.b[i] = to.b[i] + b
            to.P[i] = to.P[i] + A
        self.A[i] = A

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += A p"""
        for i in range(self.model.blocks.row[block], self.model.blocks.row[block + 1]):
            q[i] = q[i] + sym_times(self.A[i], p[i])

    def build_levels(self, levels) -> None:
        """Nothing: a node's block is summed up from its particles'."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D += sum_i w_i^2 A_i over the particles that are not held"""
        return levels.add_diagonal(n, D, self.A)
