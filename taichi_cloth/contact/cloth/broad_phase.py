"""Which vertices and faces, edges and edges of cloth may come near each other on a path at all.

A tree of swept boxes is traversed, and candidates are written down, thread by thread, in lists that grow. They hold every
pair that comes near on paths within a skin of those that the tree was traversed for; where some leave it, the pairs of those
are looked for again, and only theirs. A translation that most particles have in common, as in a fall, does not count as
leaving it: it brings nothing nearer.
"""

from typing import Any

import numpy as np

from ...backend.bvh import BVH, LEAF
from ...backend.dealing import Dealer
from ...backend.device_lists import lists
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import write
from ...backend.sums import Sums
from ...scene.scene import Scene
from ...system.checkpoint import Checkpointed
from ...system.state import ParticleState
from ..geometry import EDGE_EDGE, VERTEX_FACE
from ..pair_geometry import apart, between, closing, corners_of, least_between
from ..solid.pair_detector import MOST
from .barrier import REACH
from .candidate_rows import SINGLE, known_part, pair_of, rows_kind
from .collision_mesh import CollisionMesh

CHUNKS = 16  # lists of candidates on a CPU; on a GPU one for so many faces:
FACES_A_CHUNK = 8
ROOM, ROOM_ON_DEVICE = 32, 4  # candidates a face that lists have room for at first: at rest there are 23 where the thickness
# is 2.5 spacings. On a CPU only those that are written take memory
ROUNDING = 1e-4  # part by which distances may be off
MANY = 0.1  # of all particles: if more were displaced by more than the skin, the translation most have in common is looked for
SAMPLES = 256  # particles among which that is
SKIN = 0.4  # of half the thickness, or half the spacing if less: how far paths may lead from where the tree was traversed for


@ti.data_oriented
class Paths(Checkpointed):
    """On which particles go from `start` to where the model is, against those for which the tree was traversed.

    A step that stops short goes on from somewhere on the path it took. Candidates for the rest of that path serve for the
    next, where that leads to the same end. `part` is how much of it lies behind.

    Attributes:
        start, known_start, known_end: (n, 3) [m] where they begin, and where those began and ended whose pairs are known.
        common: (3, 3) translations that most particles have in common [m], or 0: from where the rest of the known paths
            begins to `start`, from `known_end` to where the model is, and from `known_end` to `start`.
        part: of the way from `known_start` to `known_end` at which all begin now, as nearly as one number says; any is safe.
        displacement_now, displacement: how far [m] particles are from `known_end`, and are at most anywhere on their paths,
            without the translation in common.
        deviation: how far [m] the paths lead from the rest of those that are known, likewise.
        moved: whether a particle's pairs are looked for.
        skin: [m] that a path may lead from where the tree was traversed for.
    """

    STATE = ("known_end",)

    def __init__(self, fields: Fields, model: ParticleState, skin: float) -> None:
        self.model = model
        self.skin = fields.real(1, data=np.array([skin]))
        self.start, self.known_start, self.known_end = (fields.real(model.n, 3) for _ in range(3))
        self.displacement_now, self.displacement, self.deviation = (fields.real(model.n) for _ in range(3))
        self.part, self.common = fields.real(1), fields.real(3, 3)
        self.moved = fields.integer(model.n)
        self.sums = Sums(fields, model.blocks.pieces, 2, not model.blocks.serial)
        self._far = fields.integer(1)
        self.told: np.ndarray = np.zeros((3, 3))  # `common`, as it was written last
        self._samples = np.unique(np.linspace(0, model.n - 1, SAMPLES).astype(np.int32))
        self._taken: np.ndarray = np.zeros((4, len(self._samples), 3), dtype=model.exchange)
        self._part: np.ndarray = np.zeros(1, dtype=model.exchange)
        self._skin = float(model.exchange(skin))

    @ti.kernel
    def begin(self):
        """They begin where the model is saved, and paths before them end where the known ones do."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.start[i], self.known_start[i] = self.model.x_saved[i], self.known_end[i]

    @ti.kernel
    def arrive(self):
        """They begin where the model is."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for i in range(self.model.rows()):
            self.start[i] = self.model.x[i]

    def count_deviating(self) -> int:
        """How many particles' paths leave those on which candidates are known by more than the skin."""
        count = self._measured(np.zeros((3, 3)))
        if count > MANY * self.model.n:
            common = self._most_common()
            if common.any():
                count = self._measured(common)
        return count

    def _measured(self, common: np.ndarray) -> int:
        """Measures with the translation in common; how many deviate."""
        if not np.array_equal(common, self.told):
            write(self.common, common.astype(self.model.exchange))
            self.told = common
        return self._measure()

    def _most_common(self) -> np.ndarray:
        """`common`, by medians of some particles; 0 where no fewer of these deviate by that."""
        self._take(self._samples, self._taken, self._part)
        part = float(self._part[0])
        x, start, begun, ended = self._taken.astype(np.float64)
        ways = np.stack([start - begun - part * (ended - begun), x - ended, start - ended])
        common = np.median(ways, axis=1)
        deviate, still = (np.linalg.norm(w[:2], axis=2).max(axis=0) > self._skin for w in (ways - common[:, None], ways))
        return common if np.count_nonzero(deviate) < np.count_nonzero(still) else 0 * common

    @ti.kernel
    def _take(self, which: ti.types.ndarray(), out: ti.types.ndarray(), part: ti.types.ndarray()):
        """Where some particles are, start, and the known paths began and ended; `part` (1,)."""
        part[0] = self.part[0]
        for k in range(which.shape[0]):
            i = which[k]
            for c in ti.static(range(3)):
                out[0, k, c], out[1, k, c] = self.model.x[i][c], self.start[i][c]
                out[2, k, c], out[3, k, c] = self.known_start[i][c], self.known_end[i][c]

    @ti.func
    def walk(self, i, everything):
        """Pairs of a particle are looked for on its path, if that deviates, or `everything` is."""
        self.moved[i] = ti.max(everything, ti.cast(self.deviation[i] > self.skin[0], ti.i32))
        if self.moved[i] == 1:
            self.known_start[i], self.known_end[i] = self.start[i], self.model.x[i]
        else:  # moves on with the others: distances among those that stay are as they were
            self.known_start[i] = self.remaining_start(i) + self.common[0]
            self.known_end[i] = self.known_end[i] + self.common[1]

    @ti.func
    def remaining_start(self, i):
        """The place where the rest of the path begins on which a particle's pairs are known."""
        return self.known_start[i] + self.part[0] * (self.known_end[i] - self.known_start[i])

    @ti.kernel
    def _measure(self) -> int:
        self.measure()
        return self._far[0]

    @ti.func
    def measure(self):
        """How far particles are, and begin, from the known path's end, and from the rest of that path; how many
        deviate. At the top of a kernel."""
        ti.loop_config(serialize=self.model.blocks.serial)
        for piece in range(self.model.blocks.pieces):
            along, length = 0.0, 0.0
            for i in range(self.model.blocks.first(piece), self.model.blocks.first(piece + 1)):
                way = self.known_end[i] - self.known_start[i]
                along += way.dot(self.start[i] - self.known_start[i])
                length += way.norm_sqr()
            self.sums.of_piece[piece] = ti.Vector([along, length])
        self.sums.finish(1)
        along, length = self.sums.all[0][0], self.sums.all[0][1]
        self.part[0] = 1.0
        if along < length:
            self.part[0] = ti.max(along / length, 0.0)
        self._far[0] = 0
        ti.loop_config(serialize=self.model.blocks.serial)
        for piece in range(self.model.blocks.pieces):
            far = 0
            for i in range(self.model.blocks.first(piece), self.model.blocks.first(piece + 1)):
                here = (self.model.x[i] - self.known_end[i] - self.common[1]).norm()
                there = (self.start[i] - self.known_end[i] - self.common[2]).norm()
                self.displacement_now[i], self.displacement[i] = here, ti.max(here, there)
                self.deviation[i] = ti.max(here, (self.start[i] - self.remaining_start(i) - self.common[0]).norm())
                far += ti.cast(self.deviation[i] > self.skin[0], ti.i32)
            ti.atomic_add(self._far[0], far)  # integers: in any order


@ti.data_oriented
class Candidates(Checkpointed):
    """Pairs of the cloths of a scene that have a `contact`.

    Attributes:
        mesh: the faces and edges that pairs are made of.
        start: (n, 3) where the path that is looked at begins; it ends where the model is.
        known_start, known_end: (n, 3) where the paths began and ended that pairs were looked for on.
        known: pairs that may be near, with their distances at `known_end`: see `candidate_rows`. On the host, as copies, they
            are candidates (k, 3), distances (k,) [m] and radii (k,) [m].
        fresh: whether they cover paths near that.
    """

    STATE = ("candidates", "distances", "radii", "paths", "fresh")
    candidates, distances, radii = (known_part(k) for k in range(3))

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, cpu: bool) -> None:
        self.model, self.exchange = model, fields.exchange
        self.mesh = CollisionMesh(fields, model, scene)
        m = len(self.mesh.faces)
        self.boxes = BVH(fields, m, marked=True)  # a box is marked if it has faces with displaced particles
        self.face_hull, self.edge_hull = fields.real(m, 12), fields.real(len(self.mesh.edges), 12)
        self.face_low, self.face_high = fields.real(m, 3), fields.real(m, 3)  # swept box, by half thickness and skin wider
        half = self.mesh.half_thickness
        skin = SKIN * min(float(half[half > 0].min()), self.mesh.spacing / 2)
        self.paths = Paths(fields, model, skin)
        self.known: Any = rows_kind().none()
        self.fresh = False
        self.chunks = CHUNKS if cpu else -(-m // FACES_A_CHUNK)
        self.dealer = Dealer(fields, model.blocks, self.chunks)
        room = ROOM if cpu else ROOM_ON_DEVICE
        self.found = lists(self.chunks, -(-room * m // self.chunks), [(2, np.int32)], stay=True)

    def cover(self) -> None:
        """Makes sure that the candidates hold every pair that comes near on the path from `start` to the model, and measures
        how far it leads."""
        count = self.paths.count_deviating() if self.fresh else self.model.n
        if not count:
            return
        everything = count > MOST * self.model.n
        found = self._look_for(everything)
        if len(found):
            self._distances(*found.arrays)
        if everything or not len(self.known):
            self.known = found
        else:
            stays = self.known.numbers()
            self._stays(self.known.arrays[0], stays)
            self.known.replace(stays, found)
        self.fresh = True

    def _look_for(self, everything: bool) -> Any:
        """Pairs of displaced particles, or all, that may come within reach, and twice the skin, on their paths."""
        self._refit(int(everything))
        self.paths.told = np.zeros((3, 3))  # it measures without a translation in common
        while True:
            self._walk(*self.found.arrays, self.found.count)
            if not self.found.grow():
                found = self.known.of(self.found.joined())
                self.found.rest()
                return found

    @ti.kernel
    def _stays(self, rows: ti.types.ndarray(), out: ti.types.ndarray()):
        """Which candidates have no displaced particle."""
        for k in range(rows.shape[0]):
            i, j, kind = pair_of(rows, k)
            out[k] = ti.cast(1 - self.stirs(self.mesh.corners(i, j, kind)), ti.i8)

    @ti.kernel
    def _distances(self, rows: ti.types.ndarray(), out: ti.types.ndarray(), radii: ti.types.ndarray()):
        """Distances of candidates where the known paths ended, and the largest that they may have to keep."""
        for k in range(rows.shape[0]):
            i, j, kind = pair_of(rows, k)
            v = self.mesh.corners(i, j, kind)
            to = ti.static(self.paths.known_end)
            difference, w = between(kind, to[v[0]], to[v[1]], to[v[2]], to[v[3]])
            out[k] = ti.cast(difference.norm() * (1 - SINGLE), ti.f32)
            radii[k] = ti.cast(self.mesh.largest_radius(kind, v) * (1 + SINGLE), ti.f32)

    @ti.func
    def may_come_near(self, kind, v):
        """1 if a pair may come nearer than its largest radius on any path within the skin of those that are known, or will
        soon: a step's first solve begins with known pairs. Neighbours in the cloth's own shape have small radii, and seldom
        may."""
        begin, end = ti.static(self.paths.known_start, self.paths.known_end)
        p, q, r, s = end[v[0]], end[v[1]], end[v[2]], end[v[3]]
        p_0, q_0, r_0, s_0 = begin[v[0]], begin[v[1]], begin[v[2]], begin[v[3]]
        speed, skins = closing(kind, p - p_0, q - q_0, r - r_0, s - s_0), 2 * self.paths.skin[0]
        difference, w = between(kind, p, q, r, s)
        d, out = difference.norm() / (1 + ROUNDING), 0
        if d - speed - skins < REACH * self.mesh.radius_bound(kind, v):
            radius = REACH * self.mesh.largest_radius(kind, v)
            if d - speed - skins < radius:
                first, w_0 = between(kind, p_0, q_0, r_0, s_0)
                d_0 = first.norm() / (1 + ROUNDING)
                least = ti.min(least_between(d_0, d, speed), 2 * d - d_0)  # there, if it goes on, in the next step
                out = ti.cast(least - skins < radius, ti.i32)
        return out

    @ti.func
    def stirs(self, v):
        """1 if one of four particles is displaced beyond the skin."""
        moved = ti.static(self.paths.moved)
        return ti.min(moved[v[0]] + moved[v[1]] + moved[v[2]] + moved[v[3]], 1)

    @ti.kernel
    def _refit(self, everything: int):
        for i in range(self.model.rows()):
            self.paths.walk(i, everything)
        for k in ti.static(range(3)):
            self.paths.common[k] = ti.Vector.zero(float, 3)
        self.paths.measure()
        for f in range(self.mesh.size[0]):
            v = self.mesh.face[f]
            self.face_hull[f] = self.hull(v[0], v[1], v[2])
        for e in range(self.mesh.size[1]):
            v = self.mesh.edge[e]
            self.edge_hull[e] = self.hull(v[0], v[1], v[1])
        for leaf in range(self.boxes.first_leaf):
            low, high, changed = ti.Vector([1e30, 1e30, 1e30]), ti.Vector([-1e30, -1e30, -1e30]), 0
            for f in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, self.mesh.size[0])):
                low_f, high_f, low_1, high_1 = corners_of(self.face_hull[f])
                margin = REACH * self.mesh.half[self.mesh.face[f][0]] + self.paths.skin[0]
                self.face_low[f], self.face_high[f] = ti.min(low_f, low_1) - margin, ti.max(high_f, high_1) + margin
                low, high = ti.min(low, self.face_low[f]), ti.max(high, self.face_high[f])
                v = self.mesh.face[f]
                changed = ti.max(changed, self.paths.moved[v[0]], self.paths.moved[v[1]], self.paths.moved[v[2]])
            self.boxes.marks[self.boxes.first_leaf + leaf] = changed
            self.boxes.low[self.boxes.first_leaf + leaf] = low
            self.boxes.high[self.boxes.first_leaf + leaf] = high
        self.boxes.merge()

    @ti.kernel
    def _walk(self, rows: ti.types.ndarray(), found: ti.types.ndarray()):
        self.dealer.begin()
        for t in range(self.dealer.tasks):
            if t % self.dealer.grain == 0:
                chunk = self.dealer.next()
                while chunk < self.chunks:
                    found[chunk] = self.of_chunk(chunk, rows)
                    chunk = self.dealer.next()

    @ti.func
    def of_chunk(self, chunk, rows: ti.template()):
        """The leaves of a chunk against those behind them, and themselves; returns how many candidates these are."""
        count, leaves = 0, (self.mesh.size[0] + LEAF - 1) // LEAF
        for leaf in range(self.dealer.first(chunk, self.chunks, leaves), self.dealer.first(chunk + 1, self.chunks, leaves)):
            node = self.boxes.first_leaf + leaf  # leaves before it have met this one already
            low, high, changed = self.boxes.low[node], self.boxes.high[node], self.boxes.marks[node]
            while True:
                if changed + self.boxes.marks[node] > 0 and self.boxes.meets(node, low, high):
                    if node < self.boxes.first_leaf:
                        node *= 2
                        continue
                    count = self.of_leaves(leaf, node, chunk, count, rows)
                node = self.boxes.following(node)
                if node == 1:
                    break
        return count

    @ti.func
    def of_leaves(self, leaf, node, chunk, count, rows: ti.template()):
        """The faces of a leaf against those of another, or its own; returns how many candidates the chunk now has."""
        first = (node - self.boxes.first_leaf) * LEAF
        for f in range(leaf * LEAF, ti.min((leaf + 1) * LEAF, self.mesh.size[0])):
            if self.boxes.meets(node, self.face_low[f], self.face_high[f]):
                for g in range(ti.max(first, f + 1), ti.min(first + LEAF, self.mesh.size[0])):
                    if apart(self.face_hull[f], self.face_hull[g], self.reach_of(f, g)) == 0:
                        count = self.against(f, g, chunk, count, rows)
        return count

    @ti.func
    def against(self, f, g, chunk, count, rows: ti.template()):
        """Writes down the pairs of two faces that may come near; returns how many the chunk now has."""
        of = ti.static(self.mesh.cluster)
        if self.mesh.can_meet(f, g):
            reach = self.reach_of(f, g)
            for way in range(2):
                a, b = f, g
                if way == 1:
                    a, b = g, f
                for k in range(self.mesh.first_vertex[a], self.mesh.first_vertex[a + 1]):
                    v, c = self.mesh.own_vertex[k], self.mesh.face[b]
                    u, c_0, c_1, c_2 = of[v], of[c[0]], of[c[1]], of[c[2]]
                    four = ti.Vector([v, c[0], c[1], c[2]])
                    if u != c_0 and u != c_1 and u != c_2 and self.stirs(four):
                        if apart(self.hull(v, v, v), self.face_hull[b], reach) == 0:
                            if self.may_come_near(VERTEX_FACE, four) == 1:
                                self.put(v, b, VERTEX_FACE, chunk, count, rows)
                                count += 1
            for p in range(self.mesh.first_edge[f], self.mesh.first_edge[f + 1]):
                for q in range(self.mesh.first_edge[g], self.mesh.first_edge[g + 1]):
                    c, d = self.mesh.edge[p], self.mesh.edge[q]
                    c_0, c_1, d_0, d_1 = of[c[0]], of[c[1]], of[d[0]], of[d[1]]
                    four = ti.Vector([c[0], c[1], d[0], d[1]])
                    if c_0 != d_0 and c_0 != d_1 and c_1 != d_0 and c_1 != d_1 and self.stirs(four):
                        if apart(self.edge_hull[p], self.edge_hull[q], reach) == 0:
                            if self.may_come_near(EDGE_EDGE, four) == 1:
                                self.put(p, q, EDGE_EDGE, chunk, count, rows)
                                count += 1
        return count

    @ti.func
    def reach_of(self, f, g):
        """Within which pairs of two faces are candidates [m]."""
        both = self.mesh.half[self.mesh.face[f][0]] + self.mesh.half[self.mesh.face[g][0]]
        return REACH * both + 2 * self.paths.skin[0]

    @ti.func
    def hull(self, p, q, r):
        """Boxes of three particles where the path begins, and where it ends, as 12 numbers."""
        a, b = ti.static(self.paths.known_start, self.paths.known_end)
        low, high, low_1, high_1 = ti.min(a[p], a[q], a[r]), ti.max(a[p], a[q], a[r]), ti.min(b[p], b[q], b[r]), ti.max(
            b[p], b[q], b[r])
        return ti.Vector([low[0], low[1], low[2], high[0], high[1], high[2], low_1[0], low_1[1], low_1[2], high_1[0],
                          high_1[1], high_1[2]])

    @ti.func
    def put(self, i, j, kind, chunk, count, rows: ti.template()):
        """Writes a candidate down if there is room; there will be."""
        if count < rows.shape[1]:
            rows[chunk, count, 0] = ti.select(kind == VERTEX_FACE, i, -1 - i)
            rows[chunk, count, 1] = j
