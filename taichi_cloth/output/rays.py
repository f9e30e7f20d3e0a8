"""Occlusion of rays by triangles: a bounding-volume tree over them in Morton order, walked without a stack.

The tree is a complete binary heap, LEAF triangles a leaf; node i has the children 2 i and 2 i + 1. f32, rebuilt for
every picture.
"""

import numpy as np
import taichi as ti

from ..backend.rows import capacity

LEAF = 4
FAR = 1e30


@ti.data_oriented
class RayTree:
    """Triangles that block rays.

    Args:
        count: number of triangles.
    """

    def __init__(self, count: int) -> None:
        room = capacity(count)
        leaves = -(-room // LEAF)  # those beyond the triangles have boxes that nothing enters
        self.first_leaf = 1 << max(1, int(np.ceil(np.log2(max(leaves, 1)))))
        self.low, self.high = (ti.Vector.field(3, ti.f32, 2 * self.first_leaf) for _ in range(2))
        self.a, self.e, self.f = (ti.Vector.field(3, ti.f32, room) for _ in range(3))  # a corner and two edges
        self.size = ti.field(ti.i32, 1)  # triangles, as kernels read them

    def build(self, x: np.ndarray, faces: np.ndarray) -> None:
        """Takes the triangles of faces (count, 3) at positions (n, 3)."""
        corners = x.astype(np.float32)[faces]
        self._fill(np.ascontiguousarray(corners[_order(corners.mean(axis=1))].reshape(-1, 9)))

    @ti.kernel
    def _fill(self, corners: ti.types.ndarray()):
        self.size[0] = corners.shape[0]
        for leaf in range(self.first_leaf):
            low, high = ti.Vector([FAR, FAR, FAR], ti.f32), ti.Vector([-FAR, -FAR, -FAR], ti.f32)
            for t in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, corners.shape[0])):
                p = ti.Vector([corners[t, 0], corners[t, 1], corners[t, 2]])
                q = ti.Vector([corners[t, 3], corners[t, 4], corners[t, 5]])
                r = ti.Vector([corners[t, 6], corners[t, 7], corners[t, 8]])
                self.a[t], self.e[t], self.f[t] = p, q - p, r - p
                low, high = ti.min(low, p, q, r), ti.max(high, p, q, r)
            self.low[self.first_leaf + leaf], self.high[self.first_leaf + leaf] = low, high
        for _ in range(1):
            for back in range(self.first_leaf - 1):
                i = self.first_leaf - 1 - back
                self.low[i] = ti.min(self.low[2 * i], self.low[2 * i + 1])
                self.high[i] = ti.max(self.high[2 * i], self.high[2 * i + 1])

    @ti.func
    def blocked(self, origin, way, reach):
        """Whether a ray (unit direction) meets a triangle nearer than `reach`."""
        inverse = 1 / ti.Vector([signed(way[0]), signed(way[1]), signed(way[2])])
        hit, node = 0, 1
        while node > 0:
            near, far = (self.low[node] - origin) * inverse, (self.high[node] - origin) * inverse
            enter, leave = ti.min(near, far).max(), ti.max(near, far).min()
            inside = leave >= ti.max(enter, 0.0) and enter < reach and self.low[node][0] <= self.high[node][0]
            if inside and node < self.first_leaf:
                node *= 2
            else:
                if inside:
                    first = (node - self.first_leaf) * LEAF
                    for t in range(first, ti.min(first + LEAF, self.size[0])):
                        if self.meets(t, origin, way, reach):
                            hit = 1
                node += 1
                while node % 2 == 0:
                    node //= 2
                if node == 1 or hit == 1:
                    node = 0
        return hit

    @ti.func
    def meets(self, t, origin, way, reach):
        """Moeller and Trumbore's test."""
        e, f = self.e[t], self.f[t]
        p = way.cross(f)
        det = e.dot(p)
        s = origin - self.a[t]
        q = s.cross(e)
        u, v, d = s.dot(p), way.dot(q), f.dot(q)
        if det < 0:
            det, u, v, d = -det, -u, -v, -d
        return det > 1e-30 and u >= 0 and v >= 0 and u + v <= det and d > 0 and d < reach * det


@ti.func
def signed(a):
    """A component that is no zero."""
    out = a
    if ti.abs(a) < 1e-9:
        out = 1e-9
    return out


def _order(points: np.ndarray) -> np.ndarray:
    """Order of points (n, 3) along a space-filling curve."""
    low = points.min(axis=0)
    cell = ((points - low) / max(float(np.ptp(points, axis=0).max()), 1e-30) * 1023).astype(np.int64)
    for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
        cell = (cell | (cell << shift)) & mask
    return np.argsort(cell[:, 0] | (cell[:, 1] << 1) | (cell[:, 2] << 2), kind="stable")
