"""Cloth against triangles of solids, both on their way through the step.

Vertices of cloth meet the surfaces of mesh solids: a plane each, like those of analytic solids. Edges and corners
of solids meet edges and faces of cloth: a pair each. The places where they come near enough within the step are found by
conservative advancement: strides of the distance left over the speed left, which cannot jump over a contact.

Whether cloth passes through triangles at the end is the last word on a step. Detection follows pairs to where they come near;
cloth that slides a long way along an edge, or turns, in one step can still slip past it. A step that leaves a new crossing
behind is not accepted while it can be made smaller.
"""

import numpy as np

from ...backend.bvh import LEAF
from ...backend.fields import Fields
from ...backend.language import ti
from ...scene.scene import Scene
from ...system.state import ParticleState
from ..geometry import of_pair, of_segments, on_triangle
from .pair_candidates import PAIRS, PairCandidates, which
from .pairs import Pairs
from .tree import OFF, TriangleTree
from .vertices import HIT, KEEP, SAME_SIDE, SLOTS, WIDTH, carry, slot

STRIDES = 24
FORWARD = 0.8  # cosine between a pair's directions when it comes near and at the end for the end's to be taken
INWARD = -0.5  # cosine with a corner's or edge's outward normal below which a pair lies across the solid
COLUMNS = 18  # numbers of a pair, see `Pairs`


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
        # nearest at the start: distance, side, motion of the solid; at the end: distance, side, triangle; first hit
        d_0, side_0, moved, sure_0 = 1e30, 1.0, a * 0, 0.0
        d_1, side_1, n_1, sure_1, solid_1, near = 1e30, 1.0, a * 0, 0.0, -1, -1
        when, n_hit, at_hit, solid_hit, hit = 2.0, a * 0, a * 0, -1, -1
        closed, nearest = 0, 1e30
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
                    if info[1] >= 1:
                        wanted = self.tree.touches(t, low, high)
                    if wanted == 1:
                        thick = self.thickness[info[0]]
                        w, difference, normal = self.tree.closest(t, a, 0.0)
                        d = difference.norm()
                        up = difference.dot(normal)
                        sure = ti.abs(up) / ti.max(d, 1e-20)
                        side = 1.0 if up >= 0 else -1.0
                        c_0, c_1 = self.tree.point(t, w, 0.0), self.tree.point(t, w, 1.0)
                        if d < d_0 - 1e-7 * thick or (d < d_0 + 1e-7 * thick and sure > sure_0):
                            d_0, side_0, sure_0, moved = ti.min(d, d_0), side, sure, c_1 - c_0
                            closed = info[2]
                        w_1, difference_1, normal_1 = self.tree.closest(t, b, 1.0)
                        e = difference_1.norm()
                        up_1 = difference_1.dot(normal_1)
                        sure_e = ti.abs(up_1) / ti.max(e, 1e-20)
                        if e < d_1 - 1e-7 * thick or (e < d_1 + 1e-7 * thick and sure_e > sure_1):
                            d_1, sure_1, solid_1, near = ti.min(e, d_1), sure_e, info[0], t
                            side_1 = 1.0 if up_1 >= 0 else -1.0
                            n_1 = difference_1 / ti.max(e, 1e-20)
                            if e < 1e-3 * thick:
                                n_1 = side_1 * normal_1
                        if ti.max(d_0, d_1) < nearest:  # nothing further away than both ends' nearest counts any more
                            nearest = ti.max(d_0, d_1)
                            within = ti.min(reach, ti.max(self.margin[0], nearest + 1e-6 * self.margin[0]))
                            low, high = ti.min(a, b) - within, ti.max(a, b) + within
                        s = self.meeting(t, a, b, d, thick)
                        if s < when and (side > 0 or info[2] == 0):
                            when, solid_hit, hit = s, info[0], t
                            n_hit = side * normal_1
                            w_s, gone, normal_s = self.tree.closest(t, a + s * (b - a), s)
                            at_hit = self.tree.point(t, w_s, 1.0) + thick * n_hit
            node = self.tree.boxes.following(node)
            if node == 1:
                break
        solid, triangle, n, at = -1, near, n_1, b
        if solid_1 >= 0:
            thick = self.thickness[solid_1]
            side = 1.0 if closed == 1 else side_0
            n = n_1 * side * side_1  # out of the solid, or to the side it came from
            height = d_1 * side * side_1
            at = b - (height - thick) * n
            if d_1 <= reach and height < thick * (1 + KEEP):  # beyond reach, the nearest may not have been seen
                solid = solid_1
            if when <= 1 and (solid < 0 or (n_hit.dot(n) < SAME_SIDE and d_0 > 0.5 * thick)):
                solid, triangle, n, at = solid_hit, hit, n_hit, at_hit
        if solid >= 0 and self.tree.info[triangle][1] == OFF:
            solid = -1
        return solid, triangle, n, at, moved

    @ti.func
    def meeting(self, t, a, b, d, thick):
        """When on the way from a to b triangle t comes within the thickness; 2 if never. d: distance at the start."""
        when = 2.0
        speed = 0.0
        for k in range(3):
            speed = ti.max(speed, (b - a - self.tree.corner(t, k, 1.0) + self.tree.corner(t, k, 0.0)).norm())
        if d - thick < HIT * thick:
            when = 0.0
        elif d - thick < speed:
            s = (d - thick) / speed
            for _ in range(STRIDES):
                if when > 1 and s <= 1:
                    w, difference, normal = self.tree.closest(t, a + s * (b - a), s)
                    left = difference.norm() - thick
                    if left < HIT * thick:
                        when = s
                    else:
                        s += left / speed
        return when


@ti.data_oriented
class PairDetector:
    """Edges and corners of solids against edges and faces of cloth."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, tree: TriangleTree) -> None:
        self.model, self.tree = model, tree
        self.near = PairCandidates(fields, model, scene, tree)
        self.deforms = fields.integer(len(scene.solids), data=np.array([int(s.deforms) for s in scene.solids]))
        self.rows: np.ndarray = np.zeros((1024, COLUMNS), dtype=fields.exchange)
        self._found: np.ndarray = np.zeros(1, dtype=np.int32)

    def find(self, poses: np.ndarray) -> Pairs:
        """All pairs that come within range in the step from x_saved to x; poses as in `VertexDetector.detect`."""
        candidates = self.near.cover()
        while True:
            self._found[0] = 0
            if len(candidates):
                self._find(poses, candidates, self._found, self.rows)
            if self._found[0] <= len(self.rows):
                break
            self.rows = np.zeros((2 * int(self._found[0]), COLUMNS), dtype=self.rows.dtype)
        rows = self.rows[: self._found[0]].astype(np.float64)
        key = (rows[:, 15].astype(np.int64) << 32) + rows[:, 16].astype(np.int64)
        rows, key = rows[np.argsort(key)], np.sort(key)
        face, shift = rows[:, 15].astype(np.int64) // 4, rows[:, 15].astype(np.int64) % 4
        corner = self.near.faces_host[face]
        vertices = np.stack([corner[np.arange(len(face)), (shift + k) % 3] for k in range(3)], axis=1) if len(face) else \
            np.zeros((0, 3), dtype=np.int64)
        return Pairs(vertices, rows[:, :3], rows[:, 17].astype(np.int64), rows[:, 3:6], rows[:, 6], rows[:, 9:12],
                     rows[:, 12:15], key)

    @ti.kernel
    def _find(self, poses: ti.types.ndarray(), candidates: ti.types.ndarray(), found: ti.types.ndarray(),
              rows: ti.types.ndarray()):
        for c in range(candidates.shape[0]):
            kind, k, shift = which(candidates[c, 1] % PAIRS)
            self.test(kind, candidates[c, 0], candidates[c, 1] // PAIRS, k, shift, poses, found, rows)

    @ti.func
    def test(self, kind, f, t, k, shift, poses: ti.template(), found: ti.template(), rows: ti.template()):
        """One pair; written down where it comes within range and ends there."""
        info = self.tree.info[t]
        r_0 = self.near.radius[info[0]]
        r = r_0 + self.near.range[info[0]]
        i, j = self.near.ends(kind, t, k)
        v = self.near.faces[f]
        v_0, v_1, v_2 = v[shift], v[(shift + 1) % 3], v[(shift + 2) % 3]
        difference, w, along = self.pair(kind, i, j, v_0, v_1, v_2, 0.0)
        d = difference.norm()
        speed = self.near.speed(kind, f, t, k, self.model.x_saved, self.model.x)
        if d - r < speed:
            n = difference / ti.max(d, 1e-20)
            end, w_1, along_1 = self.pair(kind, i, j, v_0, v_1, v_2, 1.0)
            d_1 = end.norm()
            n_1 = end / ti.max(d_1, 1e-20)
            s = 0.0
            for _ in range(STRIDES):
                if d - r > HIT * r and s <= 1:
                    s += ti.max(d - r, HIT * r) / speed
                    difference, w, along = self.pair(kind, i, j, v_0, v_1, v_2, ti.min(s, 1.0))
                    d = difference.norm()
                    n = difference / ti.max(d, 1e-20)
            most = d_1 - r_0
            if s > 1 or n_1.dot(n) > FORWARD:  # else it turned a long way, or passed through: as when it came near
                n, w, along = n_1, w_1, along_1
            elif n_1.dot(n) < 0:
                most = r  # passed through: no distance at the end, but where it came near
            self.write(kind, f, t, k, shift, n, w, along, most, i, j, v_0, v_1, v_2, r_0, r, poses, found, rows)

    @ti.func
    def write(self, kind, f, t, k, shift, n, w, along, most, i, j, v_0, v_1, v_2, r_0, r, poses: ti.template(),
              found: ti.template(), rows: ti.template()):
        """Writes a pair down where it ends within range; its distance is `most` at most, that of the nearest place then."""
        x = ti.static(self.model.x)
        x_0 = ti.static(self.model.x_saved)
        at_1 = (1 - along) * self.tree.vertex(i, 1.0) + along * self.tree.vertex(j, 1.0)
        at_0 = (1 - along) * self.tree.vertex(i, 0.0) + along * self.tree.vertex(j, 0.0)
        here = w[0] * x[v_0] + w[1] * x[v_1] + w[2] * x[v_2]
        gap = ti.min(n.dot(here - at_1) - r_0, most)
        near = gap < r - r_0
        if near and self.tree.info[t][2] == 1:  # not from the far side of the solid
            out = self.tree.normal(i) + self.tree.normal(j)
            near = n.dot(out) > INWARD * out.norm() - 1e-6
        if near:
            start = w[0] * x_0[v_0] + w[1] * x_0[v_1] + w[2] * x_0[v_2]
            carried = start + at_1 - at_0
            if self.deforms[self.tree.info[t][0]] == 0:
                carried = carry(poses, self.tree.info[t][0], start)
            row = ti.atomic_add(found[0], 1)
            if row < rows.shape[0]:
                for c in ti.static(range(3)):
                    rows[row, c] = w[c]
                    rows[row, 3 + c] = n[c]
                    rows[row, 9 + c] = carried[c]
                    rows[row, 12 + c] = here[c]
                rows[row, 6] = gap
                rows[row, 15] = 4 * f + shift
                rows[row, 16] = 8 * t + 2 * k + kind
                rows[row, 17] = self.tree.info[t][0]

    @ti.func
    def pair(self, kind, i, j, v_0, v_1, v_2, s):
        """`of_pair` at the part s of the step."""
        x = ti.static(self.model.x)
        x_0 = ti.static(self.model.x_saved)
        return of_pair(kind, self.tree.vertex(i, s), self.tree.vertex(j, s), x_0[v_0] + s * (x[v_0] - x_0[v_0]),
                       x_0[v_1] + s * (x[v_1] - x_0[v_1]), x_0[v_2] + s * (x[v_2] - x_0[v_2]))


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
