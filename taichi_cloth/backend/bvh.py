"""A bounding-volume tree as a complete binary heap: node i has the children 2 i and 2 i + 1, the root is 1.

Items are in an order that keeps neighbours together, LEAF of them a leaf. Boxes are refitted, never rebuilt.
"""

import numpy as np

from .fields import Fields
from .language import ti

LEAF = 4


@ti.data_oriented
class BVH:
    """Boxes over `count` items; who owns the items writes the boxes of leaves, and `merge` makes the others.

    Attributes:
        low, high: (2 first_leaf, 3) corners of the nodes' boxes, of type `dtype`; (1e30, -1e30) where there is no item.
        size: (1,) items.
    """

    def __init__(self, fields: Fields, count: int, dtype=float) -> None:
        leaves = -(-fields.room(count) // LEAF)  # those beyond the items have boxes that meet nothing
        self.size = fields.integer(1, data=np.array([count]))  # items, as kernels read them
        self.first_leaf = 2 ** max(1, int(np.ceil(np.log2(max(leaves, 1)))))
        self.low, self.high = (fields.real(2 * self.first_leaf, 3, dtype=dtype) for _ in range(2))

    @ti.func
    def merge(self):
        """Boxes of inner nodes from those of the leaves, on one thread."""
        for back in range(self.first_leaf - 1):
            i = self.first_leaf - 1 - back
            self.low[i] = ti.min(self.low[2 * i], self.low[2 * i + 1])
            self.high[i] = ti.max(self.high[2 * i], self.high[2 * i + 1])

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
