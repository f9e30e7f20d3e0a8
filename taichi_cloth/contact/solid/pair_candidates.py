"""Pairs of edges and corners of solids with edges and faces of cloth that may come within range, kept from look to look.

A step looks for contacts several times, and from look to look cloth moves little. The tree is therefore walked for pairs that
come somewhat nearer than they need, and again only for particles that have moved further than that.
"""

import numpy as np

from ...backend.bvh import LEAF
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import read
from ...scene.mesh import face_edges
from ...scene.scene import Scene
from ...system.state import ParticleState
from ..geometry import EDGE_EDGE, VERTEX_FACE, of_pair
from .pairs import PAIR
from .tree import TriangleTree

SKIN = 0.5  # of the least thickness: how far paths may lead from those for which the tree was walked
MOST = 0.5  # of all particles: if more have moved further, all pairs are looked for, between layers too
PAIRS = 12  # of a triangle and a face: its corners with the face, its edges with the face's edges


@ti.data_oriented
class PairCandidates:
    """The pairs that may come within range on the way from the saved to the current positions.

    Attributes:
        rows: (k, 2) face, and PAIRS times the triangle plus which of their pairs, see `which`.
        faces: (m, 3) particles; owned: which of their edges (bits 0 to 2) a face speaks for; size: how many there are.
        radius, range: (solids,) of cores, and within which pairs are contacts [m]; margin: the largest sum of both.
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, tree: TriangleTree) -> None:
        self.model, self.tree = model, tree
        faces = np.concatenate([model.particle[c.mesh.faces + c.start] for c in scene.cloths])
        edges = np.sort(face_edges(faces), axis=1) @ np.array([model.n, 1])
        _, first = np.unique(edges, return_index=True)
        owned = np.zeros(3 * len(faces), dtype=np.int64)
        owned[first] = 1
        owned = owned.reshape(3, -1).T @ np.array([1, 2, 4])
        order = np.argsort(faces.min(axis=1), kind="stable")
        self.count = len(faces)
        self.size = fields.integer(1, data=np.array([self.count]))  # faces, as kernels read them
        self.faces = fields.integer(self.count, 3, faces[order])
        self.owned = fields.integer(self.count, data=owned[order])
        radius = np.array([s.shape.core()[2] for s in scene.solids])
        self.radius = fields.real(len(scene.solids), data=radius)
        self.range = fields.real(len(scene.solids), data=PAIR * np.array([s.thickness for s in scene.solids]))
        margin = max(radius[k] + PAIR * s.thickness for k, s in tree.solids)
        self.margin = fields.real(1, data=np.array([margin]))
        self.skin = fields.real(1, data=np.array([SKIN * min(s.thickness for _, s in tree.solids)]))
        self.left, self.walked = fields.real(model.n, 3), fields.real(model.n, 3)  # paths for which the tree was walked
        self.moved = fields.integer(model.n)  # whether a particle's path has left them
        self.rows: np.ndarray = np.zeros((0, 2), dtype=np.int32)
        self._refits = 0  # of the tree, when it was walked
        self._room: np.ndarray = np.zeros((1024, 2), dtype=np.int32)
        self._count: np.ndarray = np.zeros(1, dtype=np.int32)

    @property
    def faces_host(self) -> np.ndarray:
        """(m, 3) particles of the faces."""
        if not hasattr(self, "_faces_host"):
            self._faces_host = read(self.faces)
        return self._faces_host

    def cover(self) -> np.ndarray:
        """(k, 2) rows that hold every pair which comes within range on the paths that the model now has."""
        everything = self._refits != self.tree.refits
        if not everything:
            self._count[0] = 0
            self._find_moved(self._count)
            if not self._count[0]:
                return self.rows
            everything = bool(self._count[0] > MOST * self.model.n)
        self._take_paths(int(everything))
        found = self._look_for()
        if not everything and len(self.rows):
            stays: np.ndarray = np.empty(len(self.rows), dtype=np.int32)
            self._stays(self.rows, stays)
            found = np.concatenate([self.rows.take(np.flatnonzero(stays), axis=0), found])
        self.rows, self._refits = found, self.tree.refits
        return self.rows

    def forget(self) -> None:
        """All pairs are looked for when they are next asked for."""
        self._refits = 0

    def _look_for(self) -> np.ndarray:
        """(k, 2) pairs with particles that have moved."""
        while True:
            self._count[0] = 0
            self._walk(self._count, self._room)
            found = int(self._count[0])
            if found <= len(self._room):
                return self._room[:found].copy()
            self._room = np.zeros((3 * found // 2, 2), dtype=np.int32)

    @ti.kernel
    def _find_moved(self, count: ti.types.ndarray()):
        """A pair's distance at the start less its speed changes by no more than 2 |dx_0| + |dx|."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            off = 2 * (self.model.x_saved[i] - self.left[i]).norm() + (self.model.x[i] - self.walked[i]).norm()
            self.moved[i] = ti.cast(off > self.skin[0], ti.i32)
            if self.moved[i] == 1:
                ti.atomic_add(count[0], 1)

    @ti.kernel
    def _take_paths(self, everything: int):
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.moved[i] = ti.max(self.moved[i], everything)
            if self.moved[i] == 1:
                self.left[i], self.walked[i] = self.model.x_saved[i], self.model.x[i]

    @ti.kernel
    def _stays(self, rows: ti.types.ndarray(), out: ti.types.ndarray()):
        """Which rows have no particle that has moved."""
        for k in range(rows.shape[0]):
            out[k] = 1 - self.has_moved(rows[k, 0])

    @ti.func
    def has_moved(self, f):
        """1 if a corner of face f has."""
        v = self.faces[f]
        return ti.max(self.moved[v[0]], self.moved[v[1]], self.moved[v[2]])

    @ti.kernel
    def _walk(self, count: ti.types.ndarray(), rows: ti.types.ndarray()):
        for f in range(self.size[0]):
            if self.has_moved(f) == 1:
                v = self.faces[f]
                low, high = self.walked[v[0]], self.walked[v[0]]
                for k in ti.static(range(3)):
                    low = ti.min(low, self.walked[v[k]], self.left[v[k]])
                    high = ti.max(high, self.walked[v[k]], self.left[v[k]])
                reach = self.margin[0] + self.skin[0]
                low, high = low - reach, high + reach
                node = 1
                while True:
                    if self.tree.boxes.meets(node, low, high):
                        if node < self.tree.boxes.first_leaf:
                            node *= 2
                            continue
                        leaf = (node - self.tree.boxes.first_leaf) * LEAF
                        for t in range(leaf, ti.min(leaf + LEAF, self.tree.boxes.size[0])):
                            if self.tree.touches(t, low, high) == 1:
                                self.add(f, t, count, rows)
                    node = self.tree.boxes.following(node)
                    if node == 1:
                        break

    @ti.func
    def add(self, f, t, count: ti.template(), rows: ti.template()):
        """Writes down pairs of face f and triangle t that may come within range."""
        bits, solid = self.tree.info[t][3], self.tree.info[t][0]
        reach = self.radius[solid] + self.range[solid] + self.skin[0]
        for pair in range(PAIRS):
            kind, k, shift = which(pair)
            wanted = (bits >> pair) & 1
            if kind == EDGE_EDGE:
                wanted = ((bits >> (3 + k)) & 1) * ((self.owned[f] >> shift) & 1)
            if wanted == 1:
                if self.distance(kind, f, t, k, shift) - reach < self.speed(kind, f, t, k, self.left, self.walked):
                    row = ti.atomic_add(count[0], 1)
                    if row < rows.shape[0]:
                        rows[row, 0], rows[row, 1] = f, PAIRS * t + pair

    @ti.func
    def distance(self, kind, f, t, k, shift):
        """Distance [m] of a pair, at the start of the paths for which the tree was walked."""
        i, j = self.ends(kind, t, k)
        v = self.faces[f]
        x = ti.static(self.left)
        difference, w, along = of_pair(kind, self.tree.vertex(i, 0.0), self.tree.vertex(j, 0.0), x[v[shift]],
                                       x[v[(shift + 1) % 3]], x[v[(shift + 2) % 3]])
        return difference.norm()

    @ti.func
    def speed(self, kind, f, t, k, x_0: ti.template(), x: ti.template()):
        """How far a pair can close in at most on paths from x_0 to x [m]."""
        i, j = self.ends(kind, t, k)
        v = self.faces[f]
        u_i = self.tree.vertex(i, 1.0) - self.tree.vertex(i, 0.0)
        u_j = self.tree.vertex(j, 1.0) - self.tree.vertex(j, 0.0)
        drift, cloth = 0.5 * (u_i + u_j), 0.0
        for c in ti.static(range(3)):
            cloth = ti.max(cloth, (x[v[c]] - x_0[v[c]] - drift).norm())
        return cloth + 0.5 * (u_i - u_j).norm()

    @ti.func
    def ends(self, kind, t, k):
        """Vertices of triangle t's edge k, or twice its corner k."""
        c = self.tree.corners[t]
        i, j = c[k], c[(k + 1) % 3]
        if kind == VERTEX_FACE:
            j = i
        return i, j


@ti.func
def which(pair):
    """A triangle and a face as a pair: kind, the triangle's corner or edge, and by how much the face's corners are shifted."""
    kind, k, shift = VERTEX_FACE, pair, 0
    if pair >= 3:
        kind, k, shift = EDGE_EDGE, (pair - 3) // 3, (pair - 3) % 3
    return kind, k, shift
