"""Which vertices and faces, edges and edges of cloth may come near each other on a path at all.

A tree of swept boxes is walked, and what may be near is written down, thread by thread, in lists that grow.
"""

import numpy as np
import taichi as ti

from ..fields import Fields
from ..mesh import face_edges
from ..model import Model
from ..scene import Scene
from .closest import EDGE_EDGE, VERTEX_FACE
from .heap import LEAF, BoxHeap, morton
from .pair_geometry import apart, corners_of

CHUNKS = 16  # lists of candidates on a CPU; on a GPU one for so many faces:
FACES_A_CHUNK = 8
SKIN = 0.75  # of half the thickness: how far paths may stray from the one that was walked


@ti.data_oriented
class Candidates:
    """Pairs of the cloths of a scene that have a `contact`.

    Attributes:
        edges: (e, 2) particles; faces: (m, 3); both in an order of their own.
        start: (n, 3) where the path that is looked at begins; it ends where the model is.
        walked: (n, 3) where the one ended that was walked.
    """

    def __init__(self, fields: Fields, model: Model, scene: Scene, cpu: bool) -> None:
        self.model, self.exchange = model, fields.exchange
        meeting = [k for k, c in enumerate(scene.cloths) if c.contact is not None]
        faces = np.concatenate([model.particle[scene.cloths[k].mesh.faces + scene.cloths[k].start] for k in meeting])
        cloth = np.repeat(meeting, [scene.cloths[k].mesh.face_count for k in meeting])
        given = np.concatenate([c.mesh.x for c in scene.cloths])[model.user]
        order = morton(given[faces].mean(axis=1))
        order = order[np.argsort(cloth[order], kind="stable")]  # each cloth by itself
        self.faces, cloth = faces[order], cloth[order]
        m = len(self.faces)
        ends = np.sort(face_edges(self.faces), axis=1)
        code, first = np.unique(ends @ np.array([model.n, 1]), return_index=True)
        self.edges = np.stack([code // model.n, code % model.n], axis=1)
        # each edge and each vertex is spoken for by one face
        self.own_edge, self.first_edge = _owned(fields, np.arange(len(self.edges)), first % m, m)
        vertices, first = np.unique(self.faces.T.ravel(), return_index=True)
        self.own_vertex, self.first_vertex = _owned(fields, vertices, first % m, m)
        self.boxes = BoxHeap(fields, m)
        self.count, self.edge_count, self.leaves = m, len(self.edges), -(-m // LEAF)
        self.face = fields.integer(m, 3, self.faces)
        self.face_hull, self.edge_hull = fields.real(m, 12), fields.real(len(self.edges), 12)
        self.cloth = fields.integer(m, data=cloth)
        self.edge = fields.integer(len(self.edges), 2, self.edges)
        self.cloths = len(scene.cloths)
        self._may = _meeting(scene)
        self.meets = fields.integer(self.cloths**2, data=self._may)
        half = np.concatenate([np.full(c.mesh.vertex_count, c.contact.thickness / 2 if c.contact else 0.0)
                               for c in scene.cloths])[model.user]
        self.host_half, self._cloth_of = half, cloth
        self.half = fields.real(model.n, data=half)  # of the thickness [m]
        self.skin = SKIN * float(half[half > 0].min())  # [m] that a path may stray from the one that was walked
        self.start, self.walked = fields.real(model.n, 3), fields.real(model.n, 3)
        self.chunks = CHUNKS if cpu else -(-m // FACES_A_CHUNK)
        self.grain = 512 if cpu else 1
        self.rows: np.ndarray = np.zeros((self.chunks, -(-4 * m // self.chunks), 3), dtype=np.int32)
        self._found: np.ndarray = np.zeros(self.chunks, dtype=np.int32)

    def may_meet(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(k,) whether faces a and b (k,) are of cloths that meet."""
        return self._may[self._cloth_of[a] * self.cloths + self._cloth_of[b]] == 1

    def walk(self) -> np.ndarray:
        """(k, 3) pairs that may come within reach, and twice the skin, on the path from `start` to the model."""
        self._refit()
        while True:
            self._walk(self.rows, self._found)
            if self._found.max(initial=0) <= self.rows.shape[1]:
                break
            self.rows = np.zeros((self.chunks, int(self._found.max()) * 3 // 2, 3), dtype=np.int32)
        return np.concatenate([rows[:k] for rows, k in zip(self.rows, self._found.tolist())])

    @ti.kernel
    def _refit(self):
        for i in range(self.model.n):
            self.walked[i] = self.model.x[i]
        for f in range(self.count):
            v = self.face[f]
            self.face_hull[f] = self.hull(v[0], v[1], v[2])
        for e in range(self.edge_count):
            v = self.edge[e]
            self.edge_hull[e] = self.hull(v[0], v[1], v[1])
        for leaf in range(self.boxes.first_leaf):
            low, high = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30])
            for f in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, self.count)):
                low_f, high_f = self.box(f)
                low, high = ti.min(low, low_f), ti.max(high, high_f)
            self.boxes.low[self.boxes.first_leaf + leaf] = low
            self.boxes.high[self.boxes.first_leaf + leaf] = high
        for _ in range(1):
            self.boxes.merge()

    @ti.func
    def box(self, f):
        """Swept box of a face, with what belongs to it round it."""
        low, high, low_1, high_1 = corners_of(self.face_hull[f])
        margin = self.half[self.face[f][0]] + self.skin
        return ti.min(low, low_1) - margin, ti.max(high, high_1) + margin

    @ti.kernel
    def _walk(self, rows: ti.types.ndarray(), found: ti.types.ndarray()):
        for t in range(self.chunks * self.grain):
            if t % self.grain == 0:
                chunk = t // self.grain
                count = 0
                for leaf in range(chunk * self.leaves // self.chunks, (chunk + 1) * self.leaves // self.chunks):
                    node = self.boxes.first_leaf + leaf  # leaves before it have met this one already
                    low, high = self.boxes.low[node], self.boxes.high[node]
                    while True:
                        if self.boxes.meets(node, low, high):
                            if node < self.boxes.first_leaf:
                                node *= 2
                                continue
                            count = self.of_leaves(leaf, node, chunk, count, rows)
                        node = self.boxes.following(node)
                        if node == 1:
                            break
                found[chunk] = count

    @ti.func
    def of_leaves(self, leaf, node, chunk, count, rows: ti.template()):
        """The faces of a leaf against those of another, or its own; returns how many candidates the chunk now has."""
        first = (node - self.boxes.first_leaf) * LEAF
        for f in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, self.count)):
            low, high = self.box(f)
            if self.boxes.meets(node, low, high):
                for g in range(ti.max(first, f + 1), ti.min(first + LEAF, self.count)):
                    if apart(self.face_hull[f], self.face_hull[g], self.reach_of(f, g)) == 0:
                        count = self.against(f, g, chunk, count, rows)
        return count

    @ti.func
    def against(self, f, g, chunk, count, rows: ti.template()):
        """Writes down the pairs of two faces that may come near; returns how many the chunk now has."""
        if self.meets[self.cloth[f] * self.cloths + self.cloth[g]] == 1:
            reach = self.reach_of(f, g)
            for way in range(2):
                a, b = f, g
                if way == 1:
                    a, b = g, f
                for k in range(self.first_vertex[a], self.first_vertex[a + 1]):
                    v, c = self.own_vertex[k], self.face[b]
                    if v != c[0] and v != c[1] and v != c[2]:
                        if apart(self.hull(v, v, v), self.face_hull[b], reach) == 0:
                            self.put(v, b, VERTEX_FACE, chunk, count, rows)
                            count += 1
            for k in range(self.first_edge[f], self.first_edge[f + 1]):
                for j in range(self.first_edge[g], self.first_edge[g + 1]):
                    p, q = self.own_edge[k], self.own_edge[j]
                    c, d = self.edge[p], self.edge[q]
                    if c[0] != d[0] and c[0] != d[1] and c[1] != d[0] and c[1] != d[1]:
                        if apart(self.edge_hull[p], self.edge_hull[q], reach) == 0:
                            self.put(p, q, EDGE_EDGE, chunk, count, rows)
                            count += 1
        return count

    @ti.func
    def reach_of(self, f, g):
        """Within which pairs of two faces are candidates [m]."""
        return self.half[self.face[f][0]] + self.half[self.face[g][0]] + 2 * self.skin

    @ti.func
    def hull(self, p, q, r):
        """Boxes of three particles where the path begins, and where it ends, as 12 numbers."""
        a = ti.static(self.start)
        b = ti.static(self.model.x)
        low, high, low_1, high_1 = ti.min(a[p], a[q], a[r]), ti.max(a[p], a[q], a[r]), ti.min(b[p], b[q], b[r]), ti.max(
            b[p], b[q], b[r])
        return ti.Vector([low[0], low[1], low[2], high[0], high[1], high[2], low_1[0], low_1[1], low_1[2], high_1[0],
                          high_1[1], high_1[2]])

    @ti.func
    def put(self, i, j, kind, chunk, count, rows: ti.template()):
        """Writes a candidate down if there is room; there will be."""
        if count < rows.shape[1]:
            rows[chunk, count, 0] = i
            rows[chunk, count, 1] = j
            rows[chunk, count, 2] = kind


def _owned(fields: Fields, things: np.ndarray, owner: np.ndarray, count: int) -> tuple:
    """Fields of things sorted by owner, and of where each owner's begin."""
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], np.arange(count + 1))
    return fields.integer(len(things), data=things[order]), fields.integer(count + 1, data=first)


def _meeting(scene: Scene) -> np.ndarray:
    """(cloths^2,) 1 where two cloths meet, or one meets itself."""
    k = len(scene.cloths)
    out = np.zeros((k, k), dtype=np.int64)
    for i, a in enumerate(scene.cloths):
        for j, b in enumerate(scene.cloths):
            itself = a.contact is not None and a.contact.itself
            out[i, j] = int(itself if a is b else not scene.passes(a, b))
    return out.ravel()
