"""Vertices of cloth against the surfaces of mesh solids, both on their way through the step.

A vertex meets a plane, like those of analytic solids. It is that of the nearest triangle at the end of the step, or, where the
way leads through the surface, of the first that the vertex comes near. That one is found by conservative advancement: strides
of the distance left over the speed left, which cannot jump over a contact. A vertex that only leaves a surface has its plane.

Near a corner or an edge, a point is outside if its heights above all faces there, weighted by the angles that these cover
around the closest point, have a positive sum [Baerentzen and Aanaes, IEEE TVCG 11(3), 2005]. No face alone tells it: a point
above the tip of a needle can be behind one of its faces.
"""

import numpy as np

from ...backend.bvh import LEAF
from ...backend.fields import Fields
from ...backend.language import ti
from ...scene.scene import Scene
from ...system.state import ParticleState
from .buried import Buried
from .tree import OFF, TriangleTree
from .vertices import HIT, KEEP, SAME_SIDE, SLOTS, WIDTH, carry, slot

STRIDES = 24
TIE = 1e-7  # of the thickness, by which distances to triangles of one edge or corner differ


@ti.data_oriented
class SurfaceDetector:
    """Vertices of cloth against the surfaces of mesh solids: the nearest contact of each."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, tree: TriangleTree) -> None:
        self.model, self.tree = model, tree
        self.thickness = fields.real(len(scene.solids), data=np.array([s.thickness for s in scene.solids]))
        self.deforms = fields.integer(len(scene.solids), data=np.array([int(s.deforms) for s in scene.solids]))
        margin = max(s.thickness for k, s in enumerate(scene.solids) if s.shape.kind == 5) * (1 + KEEP)
        self.margin = fields.real(1, data=np.array([margin]))
        self.depth = fields.real(model.n, data=np.zeros(model.n))  # how deep inside a particle may be [m]
        self.buried = Buried(fields, tree)  # particles that may be inside do not see these triangles

    @ti.kernel
    def set_depth(self, depth: ti.types.ndarray()):
        """How deep inside a mesh each particle may be (n,) [m]: so far it is looked for."""
        for i in range(self.model.rows()):
            self.depth[i] = depth[i]

    @ti.kernel
    def detect(self, poses: ti.types.ndarray(), slots: ti.types.ndarray(), out: ti.types.ndarray(), first: int):
        """Adds to each particle's slots; with `first` they are empty before."""
        for i in range(self.model.rows()):
            count = 0
            if first == 0:
                count = slots[i]
            a, b = self.model.x_saved[i], self.model.x[i]
            solid, triangle, n, at, moved = self.contact(i, a, b)
            gap, where = n.dot(b - at), -1
            if solid >= 0:
                where = slot(out, i, count, gap)
            if where >= 0:
                carried = a + moved
                if self.deforms[solid] == 0:
                    carried = carry(poses, solid, a)
                row = ti.Vector([n[0], n[1], n[2], gap, n.dot(carried - at), carried[0], carried[1], carried[2]])
                for c in ti.static(range(WIDTH - 2)):
                    out[i, where, c] = row[c]
                out[i, where, WIDTH - 2], out[i, where, WIDTH - 1] = solid, triangle
                count = ti.min(count + 1, SLOTS)
            slots[i] = count

    @ti.func
    def contact(self, i, a, b):
        """Solid (or -1), triangle, plane (normal, point) and the solid's motion there, of the way from a to b. A
        particle nearest to a part that is off meets nothing."""
        reach = self.margin[0] + self.depth[i]
        low, high = ti.min(a, b) - reach, ti.max(a, b) + reach
        # nearest at the start: distance, sums of heights, the largest, motion; at the end: the same, triangle; first hit
        d_0, up_0, sure_0, moved = 1e30, 0.0, 0.0, a * 0
        d_1, up_1, sure_1, solid_1, near, n_1, face_1 = 1e30, 0.0, 0.0, -1, -1, a * 0, a * 0
        when, n_hit, at_hit, solid_hit, hit = 2.0, a * 0, a * 0, -1, -1
        closed, nearest, pierced = 0, 1e30, 0
        node = 1
        while True:
            if self.tree.boxes.meets(node, low, high):
                if node < self.tree.boxes.first_leaf:
                    node *= 2
                    continue
                leaf = (node - self.tree.boxes.first_leaf) * LEAF
                for t in range(leaf, ti.min(leaf + LEAF, self.tree.boxes.size[0])):
                    info = self.tree.info[t]
                    wanted = 0
                    if info[1] >= 1 and (self.depth[i] == 0 or self.buried.inside[t] == 0):
                        wanted = self.tree.touches(t, low, high)
                    if wanted == 1:
                        thick = self.thickness[info[0]]
                        w, difference, normal = self.tree.closest(t, a, 0.0)
                        d = difference.norm()
                        up = difference.dot(normal)
                        side = 1.0 if up >= 0 else -1.0
                        c_0, c_1 = self.tree.point(t, w, 0.0), self.tree.point(t, w, 1.0)
                        if d < d_0 - TIE * thick:
                            up_0, sure_0 = 0.0, -1.0
                        if d < d_0 + TIE * thick:
                            up_0 += self.tree.angle(t, w, 0.0) * up
                            if ti.abs(up) > sure_0:
                                sure_0, moved, closed = ti.abs(up), c_1 - c_0, info[2]
                            d_0 = ti.min(d, d_0)
                        w_1, difference_1, normal_1 = self.tree.closest(t, b, 1.0)
                        e, height_1 = difference_1.norm(), difference_1.dot(normal_1)
                        if e < d_1 - TIE * thick:
                            up_1, sure_1 = 0.0, -1.0
                        if e < d_1 + TIE * thick:
                            up_1 += self.tree.angle(t, w_1, 1.0) * height_1
                            if ti.abs(height_1) > sure_1:
                                sure_1, solid_1, near = ti.abs(height_1), info[0], t
                                n_1, face_1 = difference_1 / ti.max(e, 1e-20), normal_1
                            d_1 = ti.min(e, d_1)
                        if ti.max(d_0, d_1) < nearest:  # nothing further away than both ends' nearest counts any more
                            nearest = ti.max(d_0, d_1)
                            within = ti.min(reach, ti.max(self.margin[0], nearest + 1e-6 * self.margin[0]))
                            low, high = ti.min(a, b) - within, ti.max(a, b) + within
                        s, through = self.meeting(t, a, b, d, thick)
                        if through == 1 and (side > 0 or info[2] == 0):
                            pierced = 1
                        if s < when and (side > 0 or info[2] == 0):
                            when, solid_hit, hit = s, info[0], t
                            n_hit, at_hit = self.plane(t, a + s * (b - a), s, side * normal_1, side, thick)
            node = self.tree.boxes.following(node)
            if node == 1:
                break
        solid, triangle, n, at = -1, near, n_1, b
        if solid_1 >= 0:
            thick = self.thickness[solid_1]
            side = 1.0  # out of the solid, or to the side it came from
            if closed == 0 and up_0 < 0:
                side = -1.0
            height = side * d_1
            if up_1 < 0:
                height = -height
            n = side * face_1
            if d_1 >= 1e-3 * thick:
                n = n_1 * height / d_1
            at = b - (height - thick) * n
            if d_1 <= reach and height < thick * (1 + KEEP):  # beyond reach, the nearest may not have been seen
                solid = solid_1
            other_side = ti.cast(solid < 0 or (n_hit.dot(n) < SAME_SIDE and d_0 > 0.5 * thick), ti.i32)
            leaves = ti.cast(solid < 0 and n_hit.dot(b - at_hit) > 0, ti.i32)
            if when <= 1 and other_side == 1 and (pierced == 1 or leaves == 1):
                solid, triangle, n, at = solid_hit, hit, n_hit, at_hit
        if solid >= 0 and self.tree.info[triangle][1] == OFF:
            solid = -1
        return solid, triangle, n, at, moved

    @ti.func
    def plane(self, t, q, s, normal, side, thick):
        """(normal, point) of the plane, at the end, of triangle t and a point q that comes within its thickness at s, on a
        side where its normal ends as `normal`. Edges are round, and turn as the face turns."""
        w, gone, normal_s = self.tree.closest(t, q, s)
        n = normal
        if gone.norm() > 1e-3 * thick:
            n = (gone.normalized() + (normal - side * normal_s)).normalized()
        return n, self.tree.point(t, w, 1.0) + thick * n

    @ti.func
    def meeting(self, t, a, b, d, thick):
        """When on the way from a to b triangle t comes within the thickness, 2 if never; whether the way goes through it. d:
        distance at the start."""
        when, speed = 2.0, 1e-30
        for k in range(3):
            speed = ti.max(speed, (b - a - self.tree.corner(t, k, 1.0) + self.tree.corner(t, k, 0.0)).norm())
        s, left = (d - thick) / speed, d
        if d - thick < HIT * thick:
            when, s = 0.0, d / speed
        for _ in range(STRIDES):
            if s <= 1 and left >= HIT * thick:
                w, difference, normal = self.tree.closest(t, a + s * (b - a), s)
                left = difference.norm()
                if when > 1 and left - thick < HIT * thick:
                    when = s
                if left >= HIT * thick:
                    s += (left - thick * ti.cast(when > 1, float)) / speed
        return when, ti.cast(when <= 1 and s <= 1, ti.i32)  # there, or nearer and nearer when strides run out
