"""What contacts add to the system of a step besides held directions: points of cloth with a 3x3 block each.

A point is a weighted sum of up to four particles: a particle that slides under friction, the place on a cloth edge or
face that a solid's edge or corner presses, the difference of two places on cloth. Its block and right-hand side are
worked out on the host, a few numbers a contact, and added to A and b like any force's.
"""

import numpy as np
import taichi as ti

from ..fields import Fields
from ..forces.conditions import sym_times
from ..model import Model
from ..ordering import touching

ROOM, LAYERED = 8, 40  # points a particle that there is room for, without and with cloth that meets cloth, and
SPARE = 32768  # more
CORNERS = 4


@ti.data_oriented
class Touch:
    """Points of contact as a force of the operator; see `forces` for the contract."""

    energies, extremes = (), 0

    def __init__(self, fields: Fields, model: Model, layered: bool = False) -> None:
        self.model, self._fields = model, fields
        self.capacity = (LAYERED if layered else ROOM) * model.n + SPARE
        self.first = fields.integer(model.blocks.count + 1, data=np.zeros(model.blocks.count + 1))
        self.exchange = model.exchange

    def build_stiffness(self) -> None:
        """Allocates the points."""
        self.vertices = self._fields.integer(self.capacity, CORNERS)
        self.weights = self._fields.real(self.capacity, CORNERS)
        self.A = self._fields.real(self.capacity, 6)
        self.rhs = self._fields.real(self.capacity, 3)

    def set(self, vertices: np.ndarray, weights: np.ndarray, A: np.ndarray, rhs: np.ndarray) -> bool:
        """Replaces the points; False where there are more than there is room for.

        Args:
            vertices: (k, 4) particles; weights: (k, 4).
            A: (k, 6) symmetric blocks [kg]; rhs: (k, 3) [kg m/s].
        """
        e, first = touching(vertices, self.model.blocks.bounds)
        if len(e) > self.capacity:
            return False
        self._set(first.astype(np.int32), np.ascontiguousarray(vertices[e], dtype=np.int32),
                  *(np.ascontiguousarray(a[e], dtype=self.exchange) for a in (weights, A, rhs)))
        return True

    @ti.kernel
    def _set(self, first: ti.types.ndarray(), vertices: ti.types.ndarray(), weights: ti.types.ndarray(),
             A: ti.types.ndarray(), rhs: ti.types.ndarray()):
        for b in range(first.shape[0]):
            self.first[b] = first[b]
        for e in range(vertices.shape[0]):
            for c in ti.static(range(CORNERS)):
                self.vertices[e][c] = vertices[e, c]
                self.weights[e][c] = weights[e, c]
            for c in ti.static(range(3)):
                self.rhs[e][c] = rhs[e, c]
            for c in ti.static(range(6)):
                self.A[e][c] = A[e, c]

    @ti.func
    def evaluate(self, block, linearizes, moves, c, to: ti.template(), base: ti.template(), report: ti.template(),
                 dtype: ti.template()):
        """With `linearizes`, adds the right-hand sides to b and the blocks to P. No energy, no dissipation."""
        if linearizes == 1:
            lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
            for e in range(self.first[block], self.first[block + 1]):
                for k in ti.static(range(CORNERS)):
                    w, i = self.weights[e][k], self.vertices[e][k]
                    self.model.blocks.add(to.b, i, w * self.rhs[e], lo, hi)
                    self.model.blocks.add(to.P, i, w * w * self.A[e], lo, hi)
        report[block, base] = 0

    @ti.func
    def add_diagonal(self, block, P: ti.template()):
        """Adds the blocks to P."""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            for k in ti.static(range(CORNERS)):
                w = self.weights[e][k]
                self.model.blocks.add(P, self.vertices[e][k], w * w * self.A[e], lo, hi)

    @ti.func
    def add_product(self, block, p: ti.template(), q: ti.template()):
        """q += the blocks times p"""
        lo, hi = self.model.blocks.row[block], self.model.blocks.row[block + 1]
        for e in range(self.first[block], self.first[block + 1]):
            v, w = self.vertices[e], self.weights[e]
            r = sym_times(self.A[e], w[0] * p[v[0]] + w[1] * p[v[1]] + w[2] * p[v[2]] + w[3] * p[v[3]])
            for k in ti.static(range(CORNERS)):
                self.model.blocks.add(q, v[k], w[k] * r, lo, hi)
