"""The accelerated proximal gradient method, for friction of contacts in the linear system of a step.

With the friction cones of contacts fixed, a step's impulses balance where

    1/2 dv^T A dv - b^T dv + sum_k cone_k |u_k|

is least over all dv that keep contacts closed; u_k is the slip of contact k. An iteration goes down the first two terms by
A dv - b over the norm of each particle's block of A. Then each contact goes towards no slip by its cone over that norm: the
proximal point of cone |u|, where a contact that sticks has no slip at all [Beck and Teboulle 2009]. An iteration costs a
product. A few tell which contacts stick, and which way the others slip. The rest of dv is smooth, and for conjugate gradients:
a linear solve with these states follows, and where it went too far, the next iterations begin from the least value on its way.
That is Newton's method on the sum above, with a nonlinear smoother [Graeser and Kornhuber 2009].
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.phases import END, TASK
from ..backend.rows import read, write
from ..system.cones import Cones
from .pcg import DID, MULTIPLY, PCG, UPDATE

ITERATIONS = 30  # with 15, this and 60 `sphere_drape` of 50 cells takes 410, 402, 385 solves for 1 s, and as long
MOMENTUM = 0.9  # .8: 385 solves, and `table` 368 for 336
STABLE = 2 * (1 + MOMENTUM) / (1 + 2 * MOMENTUM)  # eigenvalue, times the step, up to which iterations do not grow
WIDTH = 4  # particles of an element of most forces
HALVINGS = 12  # of the way of a linear solve
FREE, TOUCHES, STAYS = range(3)  # kinds of particles


@ti.data_oriented
class ProximalGradient:
    """Iterations from a solver's dv, with a system whose product is without the cones' friction, and without forces of low
    rank.

    Attributes:
        step: over the Frobenius norms of particles' blocks. An element of k particles has eigenvalues of k at most by these
            norms, so a product of such elements has no larger ones. Drapes have 1.6, on meshes 2.6: with twice the step
            iterations on meshes grew.
        kind, normal, cone, rest: of each particle; rest is the dv with which its contact neither slips nor opens.
        press: impulse along the normal that keeps it closed [N s].
        ended: (n, 3) dv where the last iterations of this system ended, or None.
    """

    def __init__(self, fields: Fields, solver: PCG) -> None:
        self.solver, self.operator, self.blocks = solver, solver.operator, solver.blocks
        self.step = STABLE / max([WIDTH] + [force.width for force in self.operator.forces if hasattr(force, "width")])
        self.phases, self.count = solver.phases, solver.count
        more, n = fields.more(), solver.operator.model.n
        self.kind = more.integer(n)
        self.normal, self.rest, self.cone, self.press = more.real(n, 3), more.real(n, 3), more.real(n), more.real(n)
        more.allocate()
        self.ended: np.ndarray | None = None

    def run(self, cones: Cones) -> tuple[np.ndarray, np.ndarray]:
        """Iterates; dv is left where that ends. Returns (slips there (k, 3), as parts of dv [m/s], impulses along the normals
        (k,) [N s])."""
        dv = read(self.solver.dv).astype(float)
        rest = dv[cones.index] + cones.way
        self._take(cones, rest)
        if self.ended is not None:
            self._shorten(cones, rest, dv, self.ended)
        self._begin()
        if self.solver.together:
            self._together(ITERATIONS)
        else:
            for _ in range(ITERATIONS):
                self._iterate()
        self.ended = dv = read(self.solver.dv).astype(float)
        return dv[cones.index] - rest, read(self.press, cones.index).astype(float)

    def _take(self, cones: Cones, rest: np.ndarray) -> None:
        """Sets what iterations read; b and P lose the friction that is in them."""
        operator = self.operator
        n, exchange = operator.model.n, operator.model.exchange
        kind = np.where(cones.stays, STAYS, FREE).astype(np.int32)
        kind[cones.index] = TOUCHES
        write(self.kind, kind)
        for field, rows in ((self.normal, cones.normal), (self.rest, rest), (self.cone, cones.size)):
            values = np.zeros((n, *rows.shape[1:]), dtype=exchange)
            values[cones.index] = rows
            write(field, values)
        for field, part in ((operator.b, cones.push), (operator.P, cones.block)):
            if part.any():
                write(field, (read(field) - part).astype(exchange))

    def _shorten(self, cones: Cones, rest: np.ndarray, dv: np.ndarray, before: np.ndarray) -> None:
        """Goes back from dv (n, 3) towards `before`, where the last iterations ended, to the least value on the way. Contacts
        that a linear solve led into solids, or whose slip it turned round, first stop there."""
        i, n = cones.index, cones.normal
        dv[i] += np.maximum(np.einsum("ki,ki->k", rest - dv[i], n), 0)[:, None] * n
        slip, slid = (a - np.einsum("ki,ki->k", a, n)[:, None] * n for a in (dv[i] - rest, before[i] - rest))
        turned = np.einsum("ki,ki->k", slip, slid) < 0
        dv[i[turned]] -= slip[turned]
        way = dv - before
        uphill = np.sum(way * (self._product(dv) - read(self.operator.b)), axis=1)
        curved = float(np.sum(way * self._product(way)))
        end = float(uphill[~cones.stays].sum())
        there, along = (a - np.einsum("ki,ki->k", a, n)[:, None] * n for a in (dv[i] - rest, way[i]))

        def slope(back: float) -> float:
            w = there - back * along
            speed = np.maximum(np.sqrt(np.einsum("ki,ki->k", w, w)), 1e-300)
            return end - back * curved + float(np.sum(cones.size * np.einsum("ki,ki->k", w, along) / speed))

        least, most = 0.0, 1.0
        if slope(0.0) > 0:
            for _ in range(HALVINGS):
                middle = (least + most) / 2
                least, most = (middle, most) if slope(middle) > 0 else (least, middle)
            dv = dv - most * way
        write(self.solver.dv, dv.astype(self.operator.model.exchange))

    def _product(self, rows: np.ndarray) -> np.ndarray:
        """(n, 3) A times rows (n, 3)."""
        write(self.solver.s, rows.astype(self.operator.model.exchange))
        if self.solver.together:
            self._together(0)
        else:
            self._multiply()
        return read(self.solver.As).astype(float)

    @ti.kernel
    def _multiply(self):
        """As = A s"""
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.operator.product(t // self.blocks.grain, self.solver.s, self.solver.As)

    @ti.kernel
    def _begin(self):
        """dv is brought into contact; s = dv"""
        for i in range(self.operator.model.rows()):
            dv = self.solver.dv[i]
            if self.kind[i] == TOUCHES:
                dv += ti.max((self.rest[i] - dv).dot(self.normal[i]), 0) * self.normal[i]
                self.solver.dv[i] = dv
            self.solver.s[i] = dv

    @ti.kernel
    def _iterate(self):
        """One iteration, on all threads."""
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.operator.product(t // self.blocks.grain, self.solver.s, self.solver.As)
        for t in range(self.blocks.count * self.blocks.grain):
            if t % self.blocks.grain == 0:
                self.go_down(t // self.blocks.grain)

    @ti.kernel
    def _together(self, most: int):
        """Iterations in one launch, by the solver's phase scheduler; with none, As = A s."""
        self.phases.start(MULTIPLY)
        self.count[DID] = 0
        for t in range(self.phases.tasks):
            if t % TASK == 0:
                phase, kind, block, waited = 0, MULTIPLY, 0, 0
                while kind != END:
                    phase, kind = self.phases.phase(), self.phases.kind(waited)
                    if kind != END:
                        block, waited = self.phases.claim(t // TASK, phase, waited)
                        if block >= 0:
                            self.work(kind, block)
                            if self.phases.last(phase):
                                self.phases.turn(self.after(kind, most))

    @ti.func
    def work(self, kind, block):
        """A block's part of a phase."""
        if kind == MULTIPLY:
            self.operator.product(block, self.solver.s, self.solver.As)
        elif kind == UPDATE:
            self.go_down(block)

    @ti.func
    def after(self, kind, most):
        """The kind of phase that follows."""
        following = MULTIPLY
        if kind == MULTIPLY and most > 0:
            following = UPDATE
        if kind == UPDATE:
            self.count[DID] += 1
        if self.count[DID] >= most:
            following = END
        return following

    @ti.func
    def go_down(self, block):
        """dv = the proximal point from s, s = dv + momentum times its change, on the rows of a block"""
        for i in range(self.blocks.row[block], self.blocks.row[block + 1]):
            if self.kind[i] != STAYS:
                P, before = self.operator.P[i], self.solver.dv[i]
                norm = ti.sqrt(P[0] ** 2 + P[3] ** 2 + P[5] ** 2 + 2 * (P[1] ** 2 + P[2] ** 2 + P[4] ** 2)) / self.step
                dv = self.solver.s[i] - (self.solver.As[i] - self.operator.b[i]) / norm
                if self.kind[i] == TOUCHES:
                    n, slip = self.normal[i], dv - self.rest[i]
                    opens = slip.dot(n)
                    self.press[i] = ti.max(-opens * norm, 0)
                    if opens < 0:
                        slip -= opens * n
                        size = slip.norm() * norm
                        dv = self.rest[i]
                        if size > self.cone[i]:
                            dv += (1 - self.cone[i] / size) * slip
                self.solver.dv[i] = dv
                self.solver.s[i] = dv + MOMENTUM * (dv - before)
