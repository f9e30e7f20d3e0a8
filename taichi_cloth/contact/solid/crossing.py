"""Whether cloth passes through triangles of solids: the last word on a step, after all rounds.

Detection follows pairs to where they come near; cloth that slides a long way along an edge, or turns, in one step can
still slip past it. A step that leaves a new crossing behind is not accepted while it can be made smaller.
"""

import numpy as np

from ...backend.bvh import LEAF
from ...backend.language import ti
from ...system.state import ParticleState
from ..geometry import of_segments, on_triangle
from .pair_candidates import PairCandidates
from .tree import OFF, TriangleTree


@ti.data_oriented
class CrossingCounter:
    """Faces of cloth against the triangles of a tree, both where they are at the end of the step."""

    def __init__(self, model: ParticleState, near: PairCandidates, tree: TriangleTree) -> None:
        self.model, self.near, self.tree = model, near, tree
        self._found: np.ndarray = np.zeros(near.count, dtype=np.int32)

    def find(self, grown: bool = False) -> np.ndarray:
        """(k, 3) particles of the face of each (face, triangle) that cross; touching is no crossing.

        Balls, tubes and rounded boxes are there as cores; `grown` counts cloth that is nearer to these than their radius.
        """
        self._find(self._found, int(grown))
        face = np.flatnonzero(self._found)
        return np.repeat(self.near.faces_host[face], self._found[face], axis=0)

    @ti.kernel
    def _find(self, found: ti.types.ndarray(), grown: int):
        for f in range(self.near.size[0]):
            found[f] = 0
            v = self.near.faces[f]
            a, b, c = self.model.x[v[0]], self.model.x[v[1]], self.model.x[v[2]]
            low, high = ti.min(a, b, c) - grown * self.near.margin[0], ti.max(a, b, c) + grown * self.near.margin[0]
            node = 1
            while True:
                if self.tree.boxes.meets(node, low, high):
                    if node < self.tree.boxes.first_leaf:
                        node *= 2
                        continue
                    leaf = (node - self.tree.boxes.first_leaf) * LEAF
                    for t in range(leaf, ti.min(leaf + LEAF, self.tree.boxes.size[0])):
                        off = self.tree.info[t][1] == OFF
                        d, e, g = self.tree.corner(t, 0, 1.0), self.tree.corner(t, 1, 1.0), self.tree.corner(t, 2, 1.0)
                        p, q = ti.min(d, e, g), ti.max(d, e, g)
                        if not off and (p <= high).all() and (q >= low).all():
                            if through(a, b, c, d, e, g) + through(d, e, g, a, b, c) > 0:
                                found[f] += 1
                            elif grown == 1 and within(self.near.radius[self.tree.info[t][0]], a, b, c, d, e, g) == 1:
                                found[f] += 1
                node = self.tree.boxes.following(node)
                if node == 1:
                    break


@ti.func
def within(radius, a, b, c, d, e, f):
    """1 if triangles (a, b, c) and (d, e, f) that do not cross are nearer to each other than a radius."""
    out = 0
    if radius > 0:
        face, core = ti.Matrix.rows([a, b, c]), ti.Matrix.rows([d, e, f])
        for k in range(3):
            p, q = row(core, k), row(core, (k + 1) % 3)
            w = on_triangle(p, a, b, c)
            if (w[0] * a + w[1] * b + w[2] * c - p).norm() < radius:
                out = 1
            for j in range(3):
                r, s = row(face, j), row(face, (j + 1) % 3)
                along, t = of_segments(p, q, r, s)
                if (p + along * (q - p) - r - t * (s - r)).norm() < radius:
                    out = 1
    return out


@ti.func
def through(a, b, c, d, e, f):
    """Number of edges of triangle (a, b, c) that pass through triangle (d, e, f)."""
    n = (e - d).cross(f - d)
    corners = ti.Matrix.rows([a - d, b - d, c - d])
    count = 0
    for k in range(3):
        p, q = row(corners, k), row(corners, (k + 1) % 3)
        if n.dot(p) * n.dot(q) < 0:
            way, u, w = q - p, e - d, f - d
            one = way.dot((-p).cross(u - p))
            two = way.dot((u - p).cross(w - p))
            three = way.dot((w - p).cross(-p))
            if (one > 0 and two > 0 and three > 0) or (one < 0 and two < 0 and three < 0):
                count += 1
    return count


@ti.func
def row(m, k):
    """Row k, not known when compiling."""
    out = ti.Vector([m[2, 0], m[2, 1], m[2, 2]])
    if k == 0:
        out = ti.Vector([m[0, 0], m[0, 1], m[0, 2]])
    if k == 1:
        out = ti.Vector([m[1, 0], m[1, 1], m[1, 2]])
    return out
