"""The coarsest level of sewn cloth, summed up and inverted where a device has it: see `coarse`.

Only Q^T A_0 Q goes there, where it has aged, and two numbers come back. Gauss-Jordan elimination goes node by node, by a loop
over the rows and one over all blocks of the matrix; no pivot is looked for in a positive definite one. Where the host would
solve for some directions only, it does.
"""

from typing import Any

import numpy as np

from ..backend.device_arrays import array
from ..backend.language import ti
from ..backend.rows import read, write
from .coarse import Coarse

NODES = 4  # that a launch eliminates


@ti.data_oriented
class DeviceCoarse(Coarse):
    """A_c and its inverse on a device."""

    def __init__(self, fields, operator, *others) -> None:
        self.H, self.known = fields.real(operator.model.n, 6), fields.real(operator.model.n, 6)  # now, and when last inverted
        self.other = fields.integer(1)
        super().__init__(fields, operator, *others)
        m, exchange = 3 * self.count, operator.model.exchange
        self.dtype = ti.f64 if exchange is np.float64 else ti.f32
        self.A, self.C = array(exchange, m, m), array(exchange, m, m)
        self.row, self.column, self.positive = array(exchange, 3, m), array(exchange, m, 3), array(np.int32, 1)
        self._there: tuple = (None, None)  # matrix and rows of Q of which the device has copies
        self._hats: list = []

    @property
    def pressed(self) -> np.ndarray:  # type: ignore[override]
        """H, as it was last."""
        return read(self.known).astype(np.float64) if self.span else np.zeros((self.operator.model.n, 6))

    @pressed.setter
    def pressed(self, values: np.ndarray) -> None:
        if values.any():  # resumed
            write(self.known, values.astype(self.operator.model.exchange))

    def _hold(self, contact, anew: bool) -> None:
        """See `Coarse`. The host waits for how many particles are held in another way than they were."""
        others = self._press(self.stiffness, contact is not None, self.H if contact is None else contact)
        if anew or others:
            self._bring()
            self._add_up(self.least, self.A, self.C, *self._hats)
            for first in range(0, self.count, NODES):
                self._eliminate(first, self.C, self.row, self.column, self.positive)
            if self._finish(self.C, self.positive) < self.count:
                self._invert()

    def _bring(self) -> None:
        """The device gets the matrix and Q where they have changed."""
        rows = self.hats.rows()
        if self._there[0] is not self.matrix:
            self._take(self.matrix.astype(self.operator.model.exchange), self.A)
        if self._there[1] is not rows[0]:
            first, node, weight = rows
            order, particle = np.argsort(node, kind="stable"), np.repeat(np.arange(len(first) - 1), np.diff(first))
            begins = np.searchsorted(node[order], np.arange(self.count + 1))
            self._hats = [self._moved(values) for values in (begins, particle[order], weight[order], *rows)]
        self._there = self.matrix, rows[0]

    def _moved(self, values: np.ndarray) -> Any:
        out: np.ndarray = values.astype(np.int32 if values.dtype.kind in "iu" else self.operator.model.exchange)
        there = array(out.dtype.type, len(out))
        there.from_numpy(out)
        return there

    @ti.kernel
    def _take(self, matrix: ti.types.ndarray(), to: ti.types.ndarray()):
        for i, j in ti.ndrange(matrix.shape[0], matrix.shape[1]):
            to[i, j] = matrix[i, j]

    @ti.kernel
    def _press(self, stiffness: float, touched: ti.template(), contact: ti.template()) -> int:
        """H, and how many particles have another than they had."""
        self.other[0] = 0
        for i in range(self.operator.model.rows()):
            H = ti.Vector.zero(float, 6)
            if self.jacobi.is_held[i] == 1:
                H = stiffness * (ti.Vector([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]) - self.jacobi.S[i])
            if ti.static(touched):
                H += contact[i]
            differs = 0
            for c in ti.static(range(6)):
                differs += ti.cast(H[c] != self.known[i][c], ti.i32)
            self.H[i], self.known[i] = H, H
            if differs > 0:
                ti.atomic_add(self.other[0], 1)
        return self.other[0]

    @ti.kernel
    def _add_up(self, least: float, A: ti.types.ndarray(), C: ti.types.ndarray(), begins: ti.types.ndarray(),
                particle: ti.types.ndarray(), share: ti.types.ndarray(), first: ti.types.ndarray(), node: ti.types.ndarray(),
                weight: ti.types.ndarray()):
        """A_c: each node's rows by one thread."""
        for a in range(begins.shape[0] - 1):
            for j in range(C.shape[0]):
                for r in ti.static(range(3)):
                    C[3 * a + r, j] = A[3 * a + r, j] + least * ti.cast(j == 3 * a + r, float)
            for e in range(begins[a], begins[a + 1]):
                i = particle[e]
                H = self.H[i]
                if H[0] != 0 or H[3] != 0 or H[5] != 0:
                    full = ti.Matrix([[H[0], H[1], H[2]], [H[1], H[3], H[4]], [H[2], H[4], H[5]]])
                    for f in range(first[i], first[i + 1]):
                        b, w = node[f], share[e] * weight[f]
                        for r, s in ti.static(ti.ndrange(3, 3)):
                            C[3 * a + r, 3 * b + s] = C[3 * a + r, 3 * b + s] + w * full[r, s]

    @ti.kernel
    def _eliminate(self, first: int, C: ti.types.ndarray(), row: ti.types.ndarray(), column: ti.types.ndarray(),
                   positive: ti.types.ndarray()):
        """Gauss-Jordan elimination in place, of some nodes from the first on; how many nodes' pivots were `positive` (1,)."""
        for q in ti.static(range(NODES)):
            p = first + q
            for j in range(C.shape[0]):
                for r in ti.static(range(3)):
                    if p < self.size[1]:
                        row[r, j], column[j, r] = C[3 * p + r, j], C[j, 3 * p + r]
            for n in range(self.size[1] * self.size[1]):
                if p < self.size[1]:
                    a, b = n // self.size[1], n % self.size[1]
                    D, R, L = self.block(row, 0, p), self.block(row, 0, b), self.block(column, a, 0)
                    if n == 0:
                        good = D[0, 0] > 0 and D[0, 0] * D[1, 1] - D[0, 1] ** 2 > 0 and D.determinant() > 0
                        positive[0] = ti.cast(p > 0, ti.i32) * positive[0] + ti.cast(good, ti.i32)
                    out = D.inverse()
                    if a == p and b != p:
                        out = out @ R
                    elif a != p and b == p:
                        out = -L @ out
                    elif a != p:
                        out = self.block(C, a, b) - L @ (out @ R)
                    for r, s in ti.static(ti.ndrange(3, 3)):
                        C[3 * a + r, 3 * b + s] = out[r, s]

    @ti.kernel
    def _finish(self, C: ti.types.ndarray(), positive: ti.types.ndarray()) -> int:
        """The inverse by blocks, as `Coarse.solve` reads it; how many nodes' pivots were positive."""
        for n in range(self.size[1] * self.size[1]):
            a, b = n // self.size[1], n % self.size[1]
            for r, s in ti.static(ti.ndrange(3, 3)):
                self.inverse[n][3 * r + s] = 0.5 * (C[3 * a + r, 3 * b + s] + C[3 * b + s, 3 * a + r])
        return positive[0]

    @ti.func
    def block(self, rows: ti.template(), a, b):
        """The block (3, 3) of an array at (3 a, 3 b)."""
        out = ti.Matrix.zero(self.dtype, 3, 3)
        for r, s in ti.static(ti.ndrange(3, 3)):
            out[r, s] = rows[3 * a + r, 3 * b + s]
        return out
