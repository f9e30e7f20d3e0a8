"""Points of contact handed over to a device: each crosses over once, by one launch, though several blocks have it.

Those that kernels of a device worked out stay there, and are taken from there.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..backend.language import ti


@dataclass(frozen=True)
class Resident:
    """Points that are in a device's memory too.

    Attributes:
        columns: arrays there of their vertices, weights, blocks, right-hand sides, normals and `rotation_coupling`.
        count: of them; first: their first row.
    """

    columns: tuple
    count: int
    first: int = 0


@ti.data_oriented
class DevicePoints:
    """Hands points over to the fields of a `ContactForce`.

    Args:
        force: of the points; corners: particles of each.
    """

    def __init__(self, force: Any, corners: int) -> None:
        self.force, self.corners, self.layered = force, corners, force.layered

    def put(self, p: Any, entries: np.ndarray, first: np.ndarray) -> None:
        """Rows entries (e,) of points p, `ContactRows`, into the fields, by blocks from first (blocks + 1,) on."""
        if not len(entries):
            self.force.first.fill(0)
            return
        columns = [p.weights, p.block, p.rhs]
        if self.layered:
            normal, t = p.normal, p.rotation_coupling
            if normal is None or t is None:
                normal, t = np.zeros((len(p.rhs), 3)), np.zeros((len(p.rhs), self.corners, 3))
            columns += [normal, t.reshape(-1, 3 * self.corners)]
        there, vertices = p.resident, p.vertices
        if there is not None:  # the others cross over, of which there is one at least: no array is empty
            others = np.r_[: max(there.first, 1), there.first + there.count : len(p.rhs)]
            vertices, columns = vertices[others], [column[others] for column in columns]
        numbers = np.concatenate(columns, axis=1).astype(self.force.exchange, copy=False)
        given = first.astype(np.int32), entries.astype(np.int32), vertices.astype(np.int32), numbers
        if there is None:
            self._put(*given)
        else:
            self._put_beside(*given, there.first, *there.columns)

    @ti.kernel
    def _put(self, first: ti.types.ndarray(), entries: ti.types.ndarray(), vertices: ti.types.ndarray(),
             numbers: ti.types.ndarray()):
        """Points vertices (k, 4) and numbers (k, .) into the rows of entries (e,), by blocks from first (blocks + 1,) on."""
        for block in range(first.shape[0]):
            self.force.first[block] = first[block]
        for e in range(entries.shape[0]):
            self.row(e, entries[e], vertices, numbers)

    @ti.kernel
    def _put_beside(self, first: ti.types.ndarray(), entries: ti.types.ndarray(), vertices: ti.types.ndarray(),
                    numbers: ti.types.ndarray(), begin: int, there: ti.types.ndarray(), weights: ti.types.ndarray(),
                    A: ti.types.ndarray(), rhs: ti.types.ndarray(), normal: ti.types.ndarray(), turns: ti.types.ndarray()):
        """The same where points from `begin` on are those of `Resident.columns`; vertices and numbers are the others'."""
        for block in range(first.shape[0]):
            self.force.first[block] = first[block]
        for e in range(entries.shape[0]):
            k = entries[e] - begin
            if k < 0:
                self.row(e, entries[e], vertices, numbers)
            elif k >= rhs.shape[0]:
                self.row(e, ti.max(begin, 1) + k - rhs.shape[0], vertices, numbers)
            else:
                for a in ti.static(range(self.corners)):
                    self.force.vertices[e][a], self.force.weights[e][a] = there[k, a], weights[k, a]
                    for c in ti.static(range(3)):
                        self.force.rotation_coupling[e][3 * a + c] = turns[k, a, c]
                for c in ti.static(range(6)):
                    self.force.A[e][c] = A[k, c]
                for c in ti.static(range(3)):
                    self.force.rhs[e][c], self.force.normal[e][c] = rhs[k, c], normal[k, c]

    @ti.func
    def row(self, e, k, vertices: ti.template(), numbers: ti.template()):
        """Row k of vertices and numbers into entry e."""
        at = ti.static(self.corners)
        for c in ti.static(range(self.corners)):
            self.force.vertices[e][c], self.force.weights[e][c] = vertices[k, c], numbers[k, c]
        for c in ti.static(range(6)):
            self.force.A[e][c] = numbers[k, at + c]
        for c in ti.static(range(3)):
            self.force.rhs[e][c] = numbers[k, at + 6 + c]
        if ti.static(self.layered):
            for c in ti.static(range(3)):
                self.force.normal[e][c] = numbers[k, at + 9 + c]
            for c in ti.static(range(3 * self.corners)):
                self.force.rotation_coupling[e][c] = numbers[k, at + 12 + c]
