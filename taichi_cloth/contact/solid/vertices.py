"""Cloth vertices against analytic solids, swept over the step.

A vertex moves from x_0 to x_1 while the solid moves from one pose to the next; in the solid's frame that is taken
as a segment. It is followed in strides of the distance left, which none of these shapes can be nearer than. If
it comes within the thickness there is a contact: a plane that the vertex must be above at the end of the step. It is that of
the nearest point of the solid at the end. Only a vertex whose way leads through the solid, to another side of it, gets the
plane of the point where it came within the thickness. One that goes round an edge in a step gets none of those: the plane
of a table's top, which goes on beyond its edge, would hold it up until the next step.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...backend.fields import Fields
from ...backend.language import ti
from ...scene.scene import Scene
from ...scene.solids import MESH
from ...system.state import ParticleState
from .sdf import distance

SLOTS = 6  # contacts of one vertex; of more, those that it is deepest in
WIDTH = 10  # numbers of a contact: normal (3), gap at the end, gap at the start, carried start (3), solid, triangle or -1
STRIDES = 48  # steps of sphere tracing at most; between layers too
HIT = 1e-3  # of the thickness: nearer than this is a hit
KEEP = 0.5  # of the thickness: contacts are reported that are this far above their plane
SAME_SIDE = 0.7  # cosine between normals at the hit and at the end for the end's to be taken


@dataclass(frozen=True)
class VertexContacts:
    """Contacts of vertices with solids, sorted by particle.

    Attributes:
        index: (k,) particles.
        solid: (k,) indices of solids.
        normal: (k, 3) out of the solid.
        gap: (k,) how far above the contact plane the particle is at the end [m]; negative is inside the thickness.
        start_gap: (k,) the same of `carried`.
        carried: (k, 3) where it would be if it moved with the solid from its place at the start [m].
        friction: (k,) Coulomb's coefficient there.
        key: (k,) one number for particle and solid.
    """

    index: np.ndarray
    solid: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    start_gap: np.ndarray
    carried: np.ndarray
    friction: np.ndarray
    key: np.ndarray

    @classmethod
    def none(cls) -> "VertexContacts":
        """No contact."""
        k = np.zeros(0, dtype=np.int64)
        return cls(k, k, np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros(0), k)

    def nearer(self, by: np.ndarray) -> "VertexContacts":
        """With gaps that are less by (k,) [m]."""
        return replace(self, gap=self.gap - by, start_gap=self.start_gap - by)

    def take(self, which: np.ndarray) -> "VertexContacts":
        """Some of them."""
        return VertexContacts(*(getattr(self, name)[which] for name in self.__dataclass_fields__))


@ti.data_oriented
class VertexDetector:
    """Vertices against the analytic solids of a scene."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene) -> None:
        self.model = model
        which = [k for k, s in enumerate(scene.solids) if s.shape.kind != MESH]
        self.kinds = tuple(sorted({scene.solids[k].shape.kind for k in which}))
        self.count = len(which)
        table = np.zeros((self.count, 8))
        for row, k in zip(table, which):
            row[: len(scene.solids[k].shape.parameters)] = scene.solids[k].shape.parameters
        self.parameters = fields.real(self.count, 8, table)
        self.thickness = fields.real(self.count, data=np.array([scene.solids[k].thickness for k in which]))
        self.kind = fields.integer(self.count, data=np.array([scene.solids[k].shape.kind for k in which]))
        self.solid = fields.integer(self.count, data=np.array(which))

    @ti.kernel
    def detect(self, poses: ti.types.ndarray(), slots: ti.types.ndarray(), out: ti.types.ndarray()):
        """Contacts of every vertex on its way from x_saved to x; poses (solids, 24): R and p, at start and end."""
        for i in range(self.model.rows()):
            count = 0
            for s in range(self.count):
                R_0, p_0 = pose(poses, self.solid[s], 0)
                R_1, p_1 = pose(poses, self.solid[s], 12)
                a = R_0.transpose() @ (self.model.x_saved[i] - p_0)
                b = R_1.transpose() @ (self.model.x[i] - p_1)
                hit, n, at = self.contact(s, a, b)
                gap = n.dot(b - at)
                where = -1
                if hit == 1:
                    where = slot(out, i, count, gap)
                if where >= 0:
                    n_world = R_1 @ n
                    carried = R_1 @ a + p_1
                    row = ti.Vector([n_world[0], n_world[1], n_world[2], gap, n.dot(a - at),
                                     carried[0], carried[1], carried[2], 0.0])
                    for c in ti.static(range(WIDTH - 2)):
                        out[i, where, c] = row[c]
                    out[i, where, WIDTH - 2], out[i, where, WIDTH - 1] = self.solid[s], -1
                    count = ti.min(count + 1, SLOTS)
            slots[i] = count

    @ti.kernel
    def heights(self, poses: ti.types.ndarray(), asked: ti.types.ndarray(), rows: ti.types.ndarray(), out: ti.types.ndarray()):
        """(height, normal) out (k, 4) of points asked (k, 3) above solids, by their rows (k,) here, where a step starts."""
        for k in range(asked.shape[0]):
            R, p = pose(poses, self.solid[rows[k]], 0)
            q = ti.Vector([ti.cast(asked[k, 0], float), ti.cast(asked[k, 1], float), ti.cast(asked[k, 2], float)])
            there = self.measure(rows[k], R.transpose() @ (q - p))
            n = R @ ti.Vector([there[1], there[2], there[3]])
            out[k, 0] = there[0]
            for c in ti.static(range(3)):
                out[k, 1 + c] = n[c]

    @ti.func
    def contact(self, s, a, b):
        """Whether the way from a to b meets the thickness; its plane: normal, and a point on it, see above."""
        length, t = (b - a).norm(), self.thickness[s]
        n, at, hit = ti.Vector([0.0, 1.0, 0.0]), b, 0
        here = self.measure(s, a)
        if here[0] - t < length + KEEP * t:
            done, q = 0.0, a
            for _ in range(STRIDES):
                if hit == 0 and done <= length:
                    if here[0] - t < HIT * t:
                        hit = 1
                    else:
                        done += here[0] - t
                        if done <= length:
                            q = a + (b - a) * (done / length)
                            here = self.measure(s, q)
            n_hit = ti.Vector([here[1], here[2], here[3]])
            at_hit = q - (here[0] - t) * n_hit
            for _ in range(STRIDES):
                if hit == 1 and here[0] >= HIT * t and done <= length:
                    done += here[0]
                    if done <= length:
                        here = self.measure(s, a + (b - a) * (done / length))
            through = ti.cast(hit == 1 and done <= length, ti.i32)  # it is there, or nearer and nearer when strides run out
            end = self.measure(s, b)
            n_end = ti.Vector([end[1], end[2], end[3]])
            if hit == 0 and end[0] - t < KEEP * t:
                hit = 1
                n_hit = n_end
            n, at = n_end, b - (end[0] - t) * n_end
            if n_hit.dot(n_end) < SAME_SIDE and through == 1:
                n, at = n_hit, at_hit
        return hit, n, at

    @ti.func
    def measure(self, s, q):
        """(d, n) of a point in the frame of solid s."""
        return distance(self.kind[s], q, self.parameters[s], ti.static(self.kinds))


@ti.func
def slot(out: ti.template(), i, count, gap):
    """Slot of a further contact of vertex i: behind the others, or, where there is no room, in place of the
    one whose plane the vertex is furthest above; -1 where that is the new one."""
    where, most = count, gap
    if count == SLOTS:
        where = -1
        for k in range(SLOTS):
            if out[i, k, 3] > most:
                where, most = k, out[i, k, 3]
    return where


@ti.func
def pose(poses: ti.template(), s, first: ti.template()):
    """R (3x3) and p of a solid from 12 packed numbers."""
    R, p = ti.Matrix.zero(float, 3, 3), ti.Vector.zero(float, 3)
    for a, b in ti.static(ti.ndrange(3, 3)):
        R[a, b] = ti.cast(poses[s, first + 3 * a + b], float)
    for a in ti.static(range(3)):
        p[a] = ti.cast(poses[s, first + 9 + a], float)
    return R, p


@ti.func
def carry(poses: ti.template(), s, x):
    """Place at the end of the step of a point that is at x at its start and moves with rigid solid s."""
    R_0, p_0 = pose(poses, s, 0)
    R_1, p_1 = pose(poses, s, 12)
    return R_1 @ (R_0.transpose() @ (x - p_0)) + p_1
