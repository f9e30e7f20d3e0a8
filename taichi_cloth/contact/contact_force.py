"""Terms of contacts in the system of a step besides held directions: points of cloth with a 3x3 block each.

A point is a weighted sum of up to four particles. It is a particle that slides under friction, the place on a cloth edge or
face that a solid's edge or corner presses, or the difference of two places on cloth. Its block and right-hand side are
worked out on the host, a few numbers a contact, and added to A and b like any force's. Between layers it also goes by how
the cloth round it turns: `points`.
"""

import numpy as np

from ..backend import shared_kernels
from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.ordering import touching
from ..backend.rows import write
from ..forces.conditions import sym_both, sym_outer, sym_times
from ..forces.force import Force
from ..system.state import ParticleState
from .points import CORNERS, Points

ROOM, SPARE = 4, 32768  # points a particle that there is room for to begin with, and more than those
MOST = 40  # a particle that there may be, and SPARE more


@ti.data_oriented
class ContactForce(Force):
    """Points of contact as a force of the operator.

    Attributes:
        capacity: points that there is room for, which grows; most: that there may be.
    """

    of_contact = True

    def __init__(self, fields: Fields, model: ParticleState, layered: bool = False) -> None:
        self.model, self._fields, self.layered = model, fields, layered
        self.capacity = ROOM * model.n + SPARE
        self.most = MOST * model.n + SPARE
        self.first = fields.integer(model.blocks.count + 1, data=np.zeros(model.blocks.count + 1))
        self.exchange = model.exchange

    def rounding_energy(self, d: float) -> float:
        """None: points have no energy of their own."""
        return 0.0

    def build_stiffness(self) -> None:
        """Declares the points."""
        self.stiff = True
        self._declare(self._fields)

    def _declare(self, fields: Fields) -> None:
        self.vertices = fields.integer(self.capacity, CORNERS)
        self.weights = fields.real(self.capacity, CORNERS)
        self.A = fields.real(self.capacity, 6)
        self.rhs = fields.real(self.capacity, 3)
        if self.layered:
            self.normal = fields.real(self.capacity, 3)
            self.turns = fields.real(self.capacity, 3 * CORNERS)
        self._use(0)

    def _use(self, rows: int) -> None:
        """Sets how many rows of the points' fields are used."""
        for field in self._points():
            field.rows = rows

    def _points(self) -> list:
        """Fields with a row a point."""
        layered = [self.normal, self.turns] if self.layered else []
        return [self.vertices, self.weights, self.A, self.rhs, *layered]

    def _grow(self, count: int) -> None:
        """Makes room for so many points, and some. Kernels that read points are compiled for the new fields."""
        self.capacity = min(max(2 * self.capacity, count), self.most)
        fields = self._fields.more()
        self._declare(fields)
        fields.allocate()
        shared_kernels.look_again()

    def set(self, p: Points) -> bool:
        """Replaces the points; False where there are more than there may be."""
        e, first = touching(p.vertices, self.model.blocks.bounds)
        if len(e) > self.most:
            return False
        if len(e) > self.capacity:
            self._grow(len(e))
        self._use(len(e))
        write(self.first, first.astype(np.int32))
        write(self.vertices, p.vertices.take(e, axis=0).astype(np.int32))
        for field, numbers in ((self.weights, p.weights), (self.A, p.block), (self.rhs, p.rhs)):
            write(field, numbers.take(e, axis=0).astype(self.exchange, copy=False))
        if self.layered:
            none = np.zeros((len(p.rhs), CORNERS, 3))
            normal, turns = (none[:, 0], none) if p.normal is None or p.turns is None else (p.normal, p.turns)
            write(self.normal, normal.take(e, axis=0).astype(self.exchange, copy=False))
            write(self.turns, turns.take(e, axis=0).astype(self.exchange, copy=False))
        return True

    @ti.func
    def add_force(self, block, f: ti.template()):
        """Nothing: points are of a solve, explicit methods know no contact."""

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """With `linearizes`, adds the right-hand sides to b and the blocks to P. No energy, no dissipation."""
        if linearizes == 1:
            lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
            for e in range(self.first[block], self.first[block + 1]):
                for k in ti.static(range(CORNERS)):
                    w, i, r = self.weights[e][k], self.vertices[e][k], self.rhs[e]
                    push = w * r
                    if ti.static(self.layered):
                        push += self.turn(e, k).dot(r) * self.normal[e]
                    self.model.blocks.add(to.b, i, push, lo, hi)
                    self.model.blocks.add(to.P, i, self.own(e, k), lo, hi)
        report[block, base] = 0
        report[block, base + 1] = 0

    @ti.func
    def add_diagonal(self, block, P: ti.template()):
        """Adds the blocks to P."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            for k in ti.static(range(CORNERS)):
                self.model.blocks.add(P, self.vertices[e][k], self.own(e, k), lo, hi)

    @ti.func
    def turn(self, e, k: ti.template()):
        """Turn of corner k of entry e."""
        t = self.turns[e]
        return ti.Vector([t[3 * k], t[3 * k + 1], t[3 * k + 2]])

    @ti.func
    def own(self, e, k: ti.template()):
        """Diagonal block of corner k of entry e."""
        w, A = self.weights[e][k], self.A[e]
        out = w * w * A
        if ti.static(self.layered):
            n, t = self.normal[e], self.turn(e, k)
            pull = sym_times(A, t)
            out += w * sym_both(pull, n) + t.dot(pull) * sym_outer(n)
        return out

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += the blocks times p"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            v, w = self.vertices[e], self.weights[e]
            moved = w[0] * p[v[0]] + w[1] * p[v[1]] + w[2] * p[v[2]] + w[3] * p[v[3]]
            if ti.static(self.layered):
                for k in ti.static(range(CORNERS)):
                    moved += self.normal[e].dot(p[v[k]]) * self.turn(e, k)
            r = sym_times(self.A[e], moved)
            for k in ti.static(range(CORNERS)):
                push = w[k] * r
                if ti.static(self.layered):
                    push += self.turn(e, k).dot(r) * self.normal[e]
                self.model.blocks.add(q, v[k], push, lo, hi)

    def build_levels(self, levels) -> None:
        """Nothing: the levels take the points' diagonal, see `add_diagonal`."""

    @ti.func
    def add_level_block(self, n, c, D, levels: ti.template()):
        """D"""
        return D
