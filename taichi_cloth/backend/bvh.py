"""A bounding-volume tree as a complete binary heap: node i has the children 2 i and 2 i + 1, the root is 1.

Items are in an order that keeps neighbours together, LEAF of them a leaf. Boxes are refitted, never rebuilt.
"""

from typing import Any

import numpy as np

from .fields import Fields
from .language import ti
from .runtime import for_device

LEAF = 4


@ti.data_oriented
class BVH:
    """Boxes over `count` items; who owns the items writes the boxes of leaves, and `merge` makes the others.

    Attributes:
        low, high: (2 first_leaf, 3) corners of the nodes' boxes, of type `dtype`; (1e30, -1e30) where there is no item.
        size: (1,) items.
        marks: (2 first_leaf,) integers, of an inner node the larger of its children's; None if not `marked`.
    """

    def __init__(self, fields: Fields, count: int, dtype=float, marked: bool = False) -> None:
        leaves = -(-fields.room(count) // LEAF)  # those beyond the items have boxes that meet nothing
        self.size = fields.integer(1, data=np.array([count]))  # items, as kernels read them
        self.first_leaf = 2 ** max(1, int(np.ceil(np.log2(max(leaves, 1)))))
        self.low, self.high = (fields.real(2 * self.first_leaf, 3, dtype=dtype) for _ in range(2))
        self.marked, self.level_by_level = marked, for_device()
        self.marks: Any = fields.integer(2 * self.first_leaf) if marked else None
        self.sizes = [2**k for k in range(self.first_leaf.bit_length() - 1)][::-1]  # nodes of a level, upwards from the leaves

    @ti.func
    def merge(self):
        """Boxes and marks of inner nodes from those of the leaves, at the top of a kernel."""
        if ti.static(self.level_by_level):
            for size in ti.static(self.sizes):
                for k in range(size):
                    self.join(size + k)
        else:
            ti.loop_config(serialize=True)
            for back in range(self.first_leaf - 1):
                self.join(self.first_leaf - 1 - back)

    @ti.func
    def join(self, i):
        """A node's box and mark from its children's."""
        self.low[i] = ti.min(self.low[2 * i], self.low[2 * i + 1])
        self.high[i] = ti.max(self.high[2 * i], self.high[2 * i + 1])
        if ti.static(self.marked):
            self.marks[i] = ti.max(self.marks[2 * i], self.marks[2 * i + 1])

    @ti.func
    def meets(self, node, low, high):
        """Whether a node's box meets another."""
        a, b = self.low[node], self.high[node]
        return (a[0] <= high[0] and low[0] <= b[0] and a[1] <= high[1] and low[1] <= b[1]
                and a[2] <= high[2] and low[2] <= b[2])

    @ti.func
    def following(self, node):
        """The next node of a walk that does not go below this one; 1 at its end."""
        node += 1
        while node % 2 == 0:
            node //= 2
        return node


def morton(points: np.ndarray) -> np.ndarray:
    """Order of points (n, 3) along a space-filling curve."""
    low, high = points.min(axis=0), points.max(axis=0)
    cell = ((points - low) / np.maximum((high - low).max(), 1e-30) * 1023).astype(np.int64)
    code = np.zeros(len(points), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cell[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")
