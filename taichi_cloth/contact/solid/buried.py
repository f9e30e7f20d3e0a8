"""Triangles of closed meshes that are inside a body: where an arm enters a trunk, and all that is in there.

Cloth that comes free inside goes out through the outer surface of all solids together, so buried triangles are none of it. A
triangle is buried if a ray from each of three places of it, near its corners, leaves closed meshes more often than it enters
them. Rays go along x, so boxes that they meet are found as for a box; at edges the order of vertices decides, so that each ray
passes one of two triangles.
"""

from ...backend.bvh import LEAF
from ...backend.fields import Fields
from ...backend.language import ti
from .tree import TriangleTree

INWARD, OUT = 0.1, 1e-4  # of the way from a corner to the middle; of that distance, outwards: where rays begin
FAR = 1e30


@ti.data_oriented
class Buried:
    """Finds them in a tree, where its triangles are at the end of a step.

    Attributes:
        inside: (triangles,) whether they are.
    """

    def __init__(self, fields: Fields, tree: TriangleTree) -> None:
        self.tree, self.inside, self._refits = tree, fields.integer(tree.count), -1

    def look(self) -> None:
        """Once for each place of the solids."""
        if self._refits != self.tree.refits:
            self._look()
            self._refits = self.tree.refits

    @ti.kernel
    def _look(self):
        for t in range(self.tree.boxes.size[0]):
            count = 0
            if self.closed(t):
                a, b, c = self.tree.corner(t, 0, 1.0), self.tree.corner(t, 1, 1.0), self.tree.corner(t, 2, 1.0)
                middle, n = (a + b + c) / 3, (b - a).cross(c - a).normalized(1e-30)
                for k in range(3):
                    p = self.tree.corner(t, k, 1.0)
                    if self.winding(p + INWARD * (middle - p) + OUT * (middle - p).norm() * n) > 0:
                        count += 1
            self.inside[t] = ti.cast(count == 3, ti.i32)

    @ti.func
    def closed(self, t):
        """Whether a triangle is of the surface of a closed mesh that cloth meets."""
        info = self.tree.info[t]
        return info[1] == 1 and info[2] == 1

    @ti.func
    def winding(self, p):
        """How often a ray from p leaves closed meshes, less how often it enters them."""
        out, node = 0, 1
        high = ti.Vector([FAR, p[1], p[2]])
        while True:
            if self.tree.boxes.meets(node, p, high):
                if node < self.tree.boxes.first_leaf:
                    node *= 2
                    continue
                leaf = (node - self.tree.boxes.first_leaf) * LEAF
                for t in range(leaf, ti.min(leaf + LEAF, self.tree.boxes.size[0])):
                    if self.closed(t):
                        out += self.passes(t, p)
            node = self.tree.boxes.following(node)
            if node == 1:
                break
        return out

    @ti.func
    def passes(self, t, p):
        """1 where the ray leaves through triangle t, -1 where it enters, 0 where it passes by."""
        i, j, k = self.tree.corners[t][0], self.tree.corners[t][1], self.tree.corners[t][2]
        one, two, three = self.left(i, j, p), self.left(j, k, p), self.left(k, i, p)
        out = 0
        if one == two and two == three:
            a, b, c = self.tree.vertex(i, 1.0), self.tree.vertex(j, 1.0), self.tree.vertex(k, 1.0)
            n = (b - a).cross(c - a)
            if n.dot(a - p) * n[0] > 0:
                out = one
        return out

    @ti.func
    def left(self, i, j, p):
        """1 where p is left of the edge from i to j, seen along x, else -1; of the edge from j to i the opposite."""
        first, sign = i, 1
        if j < i:
            first, sign = j, -1
        a, b = self.tree.vertex(first, 1.0), self.tree.vertex(i + j - first, 1.0)
        area = (b[1] - a[1]) * (p[2] - a[2]) - (b[2] - a[2]) * (p[1] - a[1])
        if area < 0:
            sign = -sign
        return sign
