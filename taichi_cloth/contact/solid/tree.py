"""Triangles of mesh solids, and the cores of the others, in one bounding-volume tree that is refitted every step.

Its boxes hold the triangles at the start and at the end of a step, and so on all the way between.
"""

import math

import numpy as np

from ...backend.bvh import BVH, LEAF, morton
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import write
from ...scene.mesh import face_edges
from ...scene.primitives import Cylinder
from ...scene.scene import Scene
from ...scene.solids import MESH, SolidMesh
from ..geometry import on_triangle

FLAT, RIM = 0.01, 0.5  # angles [rad] that an edge must have to be one, on any solid and on a smooth cylinder
OFF = 2  # in `TriangleTree.info`: cloth passes through it


@ti.data_oriented
class TriangleTree:
    """Triangles of solids on their way through a step.

    Attributes:
        x: (vertices, 6) positions at the start and at the end, relative to the model's origin [m].
        corners: (triangles, 3).
        info: (triangles, 4): solid, whether it is the surface of a mesh (1, or OFF), whether that is closed, and which of
            its corners (bits 0 to 2) and edges (bits 3 to 5) it speaks for.
        due: whether the next step has to place them: not where all solids stand still.
        fastest: how far any vertex goes in the step [m].
        refits: how often triangles were placed.
    """

    def __init__(self, fields: Fields, scene: Scene, wanted: list[int], origin: np.ndarray, edge: float) -> None:
        self.exchange = fields.exchange
        self.solids = [(k, scene.solids[k]) for k in wanted]
        self.origin = origin
        locals_, corners, info, friction = [], [], [], []
        start = 0
        self.ranges = []
        for k, solid in self.solids:
            x, faces, radius = solid.shape.core()
            mesh = solid.shape.kind == MESH
            rigid = not isinstance(solid.shape, SolidMesh) or (solid.shape.closed and len(solid.shape.x) == 1)
            round_side = isinstance(solid.shape, Cylinder) and smooth(solid.shape.radius, solid.thickness, edge)
            owned = _owned(x, faces, rigid, RIM if round_side else FLAT)
            closed = int(mesh and solid.shape.closed)  # type: ignore[union-attr]
            mu = solid.face_friction() if mesh else np.full(len(faces), solid.friction)
            off = np.isnan(mu)
            friction.append(mu)
            locals_.append(x)
            corners.append(faces + start)
            info.append(np.column_stack([np.full(len(faces), k), np.where(off, OFF, int(mesh)),
                                         np.full(len(faces), closed), np.where(off, 0, owned)]))
            self.ranges.append(slice(start, start + len(x)))
            start += len(x)
        self.local = np.concatenate(locals_)
        all_corners, all_info = np.concatenate(corners), np.concatenate(info)
        order = morton(np.concatenate([s.pose(0.0)[1] + x @ s.pose(0.0)[0].T
                                        for (_, s), x in zip(self.solids, locals_)])[all_corners].mean(axis=1))
        self.friction = np.concatenate(friction)[order]  # (triangles,)
        self.vertex_count = start
        self.count = len(order)
        self.boxes = BVH(fields, self.count)
        self.x = fields.real(start, 6)
        self.corners = fields.integer(self.count, 3, all_corners[order])
        self.info = fields.integer(self.count, 4, all_info[order])
        self.still = all(not s.moves for _, s in self.solids)
        self.due, self.fastest, self.refits = True, 0.0, 0
        self._known: dict[tuple, np.ndarray] = {}  # positions by time and poses
        owner = all_corners[order].ravel()
        at = np.argsort(owner, kind="stable")
        self.first = fields.integer(start + 1, data=np.searchsorted(owner[at], np.arange(start + 1)))
        self.around = fields.integer(3 * self.count, data=at // 3)  # the triangles at each vertex

    def set_time(self, t: float, h: float) -> None:
        """Places the triangles at the two ends of a step, and refits."""
        known, self._known = self._known, {}  # a step begins where the one before it ended
        ends = []
        for time in (t, t + h):
            poses = [solid.pose(time) for _, solid in self.solids]
            key = time, *(R.tobytes() + p.tobytes() for R, p in poses)
            self._known[key] = known[key] if key in known else self._at(time, poses)
            ends.append(self._known[key])
        self.fastest = float(np.sqrt(np.max(np.sum((ends[1] - ends[0]) ** 2, axis=1))))
        write(self.x, np.concatenate(ends, axis=1).astype(self.exchange, copy=False))
        self._place()
        self.due, self.refits = not self.still, self.refits + 1

    def _at(self, time: float, poses: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
        """(vertices, 3) at a time [s], from the local origin [m]."""
        out = np.empty((self.vertex_count, 3))
        for (_, solid), rows, (R, p) in zip(self.solids, self.ranges, poses):
            shape = solid.shape.shape_at(time) if isinstance(solid.shape, SolidMesh) else self.local[rows]
            out[rows] = shape @ R.T + p - self.origin
        return out

    @ti.kernel
    def _place(self):
        for leaf in range(self.boxes.first_leaf):
            low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
            for t in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, self.boxes.size[0])):
                for k in range(3):
                    both = self.x[self.corners[t][k]]
                    for c in ti.static(range(3)):
                        low[c] = ti.min(low[c], both[c], both[c + 3])
                        high[c] = ti.max(high[c], both[c], both[c + 3])
            self.boxes.low[self.boxes.first_leaf + leaf], self.boxes.high[self.boxes.first_leaf + leaf] = low, high
        self.boxes.merge()

    @ti.func
    def corner(self, triangle, k, s):
        """Position of corner k at the part s of the step."""
        return self.vertex(self.corners[triangle][k], s)

    @ti.func
    def vertex(self, i, s):
        """Position of a vertex at the part s of the step."""
        both = self.x[i]
        a, b = ti.Vector([both[0], both[1], both[2]]), ti.Vector([both[3], both[4], both[5]])
        return a + s * (b - a)

    @ti.func
    def touches(self, triangle, low, high):
        """Whether a box meets that of a triangle on its way."""
        out = 1
        corner = self.corners[triangle]
        p, q, r = self.x[corner[0]], self.x[corner[1]], self.x[corner[2]]
        for d in ti.static(range(3)):
            if ti.min(p[d], p[d + 3], q[d], q[d + 3], r[d], r[d + 3]) > high[d]:
                out = 0
            if ti.max(p[d], p[d + 3], q[d], q[d + 3], r[d], r[d + 3]) < low[d]:
                out = 0
        return out

    @ti.func
    def normal(self, i):
        """Unit normal at a vertex where the step starts, by the angles of its triangles; 0 where these are degenerate."""
        out = ti.Vector.zero(float, 3)
        for k in range(self.first[i], self.first[i + 1]):
            c = self.corners[self.around[k]]
            a, b = c[1], c[2]
            if c[1] == i:
                a, b = c[2], c[0]
            elif c[2] == i:
                a, b = c[0], c[1]
            p, q = self.vertex(a, 0.0) - self.vertex(i, 0.0), self.vertex(b, 0.0) - self.vertex(i, 0.0)
            n = p.cross(q)
            out += ti.atan2(n.norm(), p.dot(q)) * n.normalized(1e-30)
        return out.normalized(1e-30)

    @ti.func
    def closest(self, t, p, s):
        """Weights of the closest point of triangle t at the part s of the step, difference to it, unit normal."""
        a, b, c = self.corner(t, 0, s), self.corner(t, 1, s), self.corner(t, 2, s)
        w = on_triangle(p, a, b, c)
        return w, p - w[0] * a - w[1] * b - w[2] * c, (b - a).cross(c - a).normalized(1e-30)

    @ti.func
    def angle(self, t, w, s):
        """Angle [rad] that triangle t covers around its point with weights w: pi on an edge, at a corner its own."""
        out = math.pi
        for k in range(3):
            if w[k] == 1:
                at = self.corner(t, k, s)
                one, two = self.corner(t, (k + 1) % 3, s) - at, self.corner(t, (k + 2) % 3, s) - at
                out = ti.atan2(one.cross(two).norm(), one.dot(two))
        return out

    @ti.func
    def point(self, t, w, s):
        """The point with weights w of triangle t."""
        return w[0] * self.corner(t, 0, s) + w[1] * self.corner(t, 1, s) + w[2] * self.corner(t, 2, s)


def smooth(radius: float, thickness: float, edge: float) -> bool:
    """Whether cloth with edges of this length [m], bent round a radius, leaves room within the thickness.

    A triangle whose corners keep the thickness from a ball dips into it by its circumradius^2 / 2 R; stretched
    by a fifth, that is 0.24 edge^2 / R.
    """
    return 0.24 * edge**2 <= 0.4 * thickness * radius


def _owned(x: np.ndarray, faces: np.ndarray, closed: bool, angle: float) -> np.ndarray:
    """(m,) bits of corners and edges: each is spoken for by one triangle, but those of `closed` that are hollow, or
    flatter than the angle [rad], by none."""
    m = len(faces)
    bits = np.zeros(m, dtype=np.int64)
    edges = face_edges(faces)
    real = edges[:, 0] != edges[:, 1]
    code = np.sort(edges, axis=1) @ np.array([len(x), 1])
    sharp = np.ones(len(edges), dtype=bool)
    if closed and len(faces) > 1:
        sharp = _sharp(x, faces, edges, code, angle)
    _, first = np.unique(np.where(real & sharp, code, -1), return_index=True)
    for row in first:
        if real[row] and sharp[row]:
            bits[row % m] |= 8 << (row // m)
    corner_sharp = np.zeros(len(x), dtype=bool)
    corner_sharp[edges[sharp].ravel()] = True
    flat = faces.T.ravel()  # corner k of triangle t at k m + t
    _, first = np.unique(flat, return_index=True)
    for row in first:
        if corner_sharp[flat[row]]:
            bits[row % m] |= 1 << (row // m)
    return bits


def _sharp(x: np.ndarray, faces: np.ndarray, edges: np.ndarray, code: np.ndarray, angle: float) -> np.ndarray:
    """(3 m,) whether an edge of a closed mesh sticks out by more than an angle [rad]."""
    m = len(faces)
    normal = np.cross(x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    order = np.argsort(code, kind="stable")
    pairs = np.flatnonzero(code[order][1:] == code[order][:-1])
    a, b = order[pairs], order[pairs + 1]
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    rise = np.einsum("ij,ij->i", normal[a % m], x[opposite[b]] - x[edges[a, 0]])
    sharp = np.ones(3 * m, dtype=bool)
    sharp[a] = sharp[b] = (rise < 0) & (np.einsum("ij,ij->i", normal[a % m], normal[b % m]) < np.cos(angle))
    return sharp
