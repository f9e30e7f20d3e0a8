"""Occlusion of rays by triangles: a bounding-volume tree over them in Morton order, in f32, rebuilt for every picture."""

import numpy as np

from ..backend.bvh import BVH, LEAF, morton
from ..backend.fields import Fields
from ..backend.language import ti

FAR = 1e30


@ti.data_oriented
class RayTree:
    """Triangles that block rays.

    Args:
        fields: where its own are declared; who has them allocates.
        count: number of triangles.
    """

    def __init__(self, fields: Fields, count: int) -> None:
        self.boxes = BVH(fields, count, ti.f32)
        self.a, self.e, self.f = (fields.real(count, 3, dtype=ti.f32) for _ in range(3))  # a corner and two edges

    def build(self, x: np.ndarray, faces: np.ndarray) -> None:
        """Takes the triangles of faces (count, 3) at positions (n, 3)."""
        corners = x.astype(np.float32)[faces]
        self._fill(np.ascontiguousarray(corners[morton(corners.mean(axis=1))].reshape(-1, 9)))

    @ti.kernel
    def _fill(self, corners: ti.types.ndarray()):
        for leaf in range(self.boxes.first_leaf):
            low, high = ti.Vector([FAR, FAR, FAR], ti.f32), ti.Vector([-FAR, -FAR, -FAR], ti.f32)
            for t in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, corners.shape[0])):
                p = ti.Vector([corners[t, 0], corners[t, 1], corners[t, 2]])
                q = ti.Vector([corners[t, 3], corners[t, 4], corners[t, 5]])
                r = ti.Vector([corners[t, 6], corners[t, 7], corners[t, 8]])
                self.a[t], self.e[t], self.f[t] = p, q - p, r - p
                low, high = ti.min(low, p, q, r), ti.max(high, p, q, r)
            self.boxes.low[self.boxes.first_leaf + leaf], self.boxes.high[self.boxes.first_leaf + leaf] = low, high
        self.boxes.merge()

    @ti.func
    def blocked(self, origin, way, reach):
        """Whether a ray (unit direction) meets a triangle nearer than `reach`."""
        inverse = 1 / ti.Vector([signed(way[0]), signed(way[1]), signed(way[2])])
        hit, node = 0, 1
        while hit == 0:
            low, high = self.boxes.low[node], self.boxes.high[node]
            near, far = (low - origin) * inverse, (high - origin) * inverse
            enter, leave = ti.min(near, far).max(), ti.max(near, far).min()
            if leave >= ti.max(enter, 0.0) and enter < reach and low[0] <= high[0]:
                if node < self.boxes.first_leaf:
                    node *= 2
                    continue
                first = (node - self.boxes.first_leaf) * LEAF
                for t in range(first, ti.min(first + LEAF, self.boxes.size[0])):
                    if self.meets(t, origin, way, reach):
                        hit = 1
            node = self.boxes.following(node)
            if node == 1:
                break
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
