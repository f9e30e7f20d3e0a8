"""Edges and corners of solids against edges and faces of cloth, both on their way through the step: pairs, and crossings.

A step looks for contacts several times, and from look to look cloth moves little. The tree is therefore walked for pairs that
come somewhat nearer than they need, and again only for particles that have moved further than that. The places where these
come near enough are found by conservative advancement, see `mesh`.

Whether cloth passes through triangles at the end is the last word on a step. Detection follows pairs to where they come near;
cloth that slides a long way along an edge, or turns, in one step can still slip past it. A step that leaves a new crossing
behind is not accepted while it can be made smaller.
"""

from typing import Any

import numpy as np

from ...backend.bvh import LEAF
from ...backend.device_arrays import array
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import read
from ...backend.runtime import for_device
from ...scene.mesh import face_edges
from ...scene.scene import Scene
from ...system.state import ParticleState
from ..geometry import EDGE_EDGE, VERTEX_FACE, of_pair, through, within
from .mesh import STRIDES
from .pairs import PAIR, Pairs
from .tree import OFF, TriangleTree
from .vertices import HIT, carry

SKIN = 0.5  # of the least thickness: how far paths may lead from those for which the tree was traversed
MOST = 0.5  # of all particles: if more have moved further, all pairs are looked for, between layers too
FORWARD = 0.8  # cosine between a pair's directions when it comes near and at the end for the end's to be taken
INWARD = -0.5  # cosine with a corner's or edge's outward normal below which a pair lies across the solid
COLUMNS = 18  # numbers of a pair, see `Pairs`
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
        self.known_start, self.known_end = fields.real(model.n, 3), fields.real(model.n, 3)  # paths of the traversal
        self.moved, self._far = fields.integer(model.n), fields.integer(1)  # whether a particle's path has left them; how many
        self.rows: Any = np.zeros((0, 2), dtype=np.int32)
        self._refits = 0  # of the tree, when it was traversed
        self._device = for_device()  # where rows stay, and all are looked for at once
        self._room, self._count = self._array(1024, 2), self._array(1)

    @property
    def faces_host(self) -> np.ndarray:
        """(m, 3) particles of the faces."""
        if not hasattr(self, "_faces_host"):
            self._faces_host = read(self.faces)
        return self._faces_host

    def _array(self, *shape: int) -> Any:
        """Of whole numbers, where kernels write them."""
        return array(np.int32, *shape) if self._device else np.zeros(shape, dtype=np.int32)

    def cover(self) -> Any:
        """(k, 2) rows that hold every pair which comes within range on the paths that the model now has; those with a face
        below 0 are none."""
        everything = self._refits != self.tree.refits
        if not everything:
            count = self._find_moved()
            if not count:
                return self.rows
            everything = self._device or bool(count > MOST * self.model.n)
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

    def _look_for(self) -> Any:
        """(k, 2) pairs with particles that have moved. The host of a device waits for their number."""
        while True:
            found = int(self._walk(self._count, self._room))
            if found <= self._room.shape[0]:
                break
            self._room = self._array(3 * found // 2, 2)
        if not self._device:
            return self._room[:found].copy()
        return self._room if found else np.zeros((0, 2), dtype=np.int32)

    @ti.kernel
    def _find_moved(self) -> int:
        """How many particles have. A pair's distance at the start less its speed changes by no more than 2 |dx_0| + |dx|."""
        self._far[0] = 0
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            off = 2 * (self.model.x_saved[i] - self.known_start[i]).norm() + (self.model.x[i] - self.known_end[i]).norm()
            self.moved[i] = ti.cast(off > self.skin[0], ti.i32)
            if self.moved[i] == 1:
                ti.atomic_add(self._far[0], 1)
        return self._far[0]

    @ti.kernel
    def _take_paths(self, everything: int):
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.moved[i] = ti.max(self.moved[i], everything)
            if self.moved[i] == 1:
                self.known_start[i], self.known_end[i] = self.model.x_saved[i], self.model.x[i]

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
    def _walk(self, count: ti.types.ndarray(), rows: ti.types.ndarray()) -> int:
        """Writes rows down; returns how many there are."""
        count[0] = 0
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(rows.shape[0]):
            rows[k, 0] = -1
        for f in range(self.size[0]):
            if self.has_moved(f) == 1:
                v = self.faces[f]
                low, high = self.known_end[v[0]], self.known_end[v[0]]
                for k in ti.static(range(3)):
                    low = ti.min(low, self.known_end[v[k]], self.known_start[v[k]])
                    high = ti.max(high, self.known_end[v[k]], self.known_start[v[k]])
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
        return count[0]

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
                if self.distance(kind, f, t, k, shift) - reach < self.speed(kind, f, t, k, self.known_start, self.known_end):
                    row = ti.atomic_add(count[0], 1)
                    if row < rows.shape[0]:
                        rows[row, 0], rows[row, 1] = f, PAIRS * t + pair

    @ti.func
    def distance(self, kind, f, t, k, shift):
        """Distance [m] of a pair, at the start of the paths for which the tree was traversed."""
        i, j = self.ends(kind, t, k)
        v = self.faces[f]
        x = ti.static(self.known_start)
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


@ti.data_oriented
class PairDetector:
    """Edges and corners of solids against edges and faces of cloth."""

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, tree: TriangleTree) -> None:
        self.model, self.tree = model, tree
        self.near = PairCandidates(fields, model, scene, tree)
        self.deforms = fields.integer(len(scene.solids), data=np.array([int(s.deforms) for s in scene.solids]))
        room = 64 if for_device() else 1024  # all of it crosses over both ways
        self.rows: np.ndarray = np.zeros((room, COLUMNS), dtype=fields.exchange)
        self._found: np.ndarray = np.zeros(1, dtype=np.int32)

    def find(self, poses: np.ndarray) -> Pairs:
        """All pairs that come within range in the step from x_saved to x; poses as in `VertexDetector.detect`."""
        candidates = self.near.cover()
        while True:
            self._found[0] = 0
            if candidates.shape[0]:
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
            if candidates[c, 0] >= 0:
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
def which(pair):
    """A triangle and a face as a pair: kind, the triangle's corner or edge, and by how much the face's corners are shifted."""
    kind, k, shift = VERTEX_FACE, pair, 0
    if pair >= 3:
        kind, k, shift = EDGE_EDGE, (pair - 3) // 3, (pair - 3) % 3
    return kind, k, shift
