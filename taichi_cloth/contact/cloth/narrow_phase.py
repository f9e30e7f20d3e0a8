"""Cloth near cloth: how near vertices and faces, edges and edges come to each other on a path, and how far everything may go
along it.

Candidates come from `broad_phase`; distances and the collision-free step are taken pair by pair.
"""

from typing import Any

import numpy as np

from ...backend.device_lists import lists
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import write
from ...scene.scene import Scene
from ...system.state import ParticleState
from ..geometry import VERTEX_FACE
from ..pair_geometry import between, closing, fading, gap, least_between
from ..solid.vertices import STRIDES
from .barrier import REACH
from .broad_phase import ROUNDING, Candidates
from .candidate_rows import pair_of
from .collision_mesh import ACROSS
from .contact_pairs import ContactPairs

KEEP = 0.2  # of a pair's distance above its floor that a path must leave
NEAR_END = 0.05  # of it: a path may end so much before it must
PINCHED = 1.02  # times its floor: a pair so near is pressed by more than forces hold, and has no floor. With 1 sheets that are
# pinned at their floor fly at 15 m/s (the law `near_20_pinned`); pins that lead cloth through it take 153 solves for 270
TURNED = 0.5  # cosine between a pair's directions when it came near and at the end for the end's to be taken
PIECES, ROOM = 2048, 16  # of the candidates at most; pairs in reach of each, to begin with
LED, RESTS = 1, 2  # in `LayerDetector.tangled`
FAINT = 1e-6  # factor of a pair of edges that is not reckoned with: vertices are as near there


@ti.data_oriented
class LayerDetector(Candidates):
    """Cloth against cloth, for the cloths of a scene that have a `contact`.

    Args:
        floor: hard minimum gap, as a part of the distance to keep; collision detection lets no pair cross it.
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, cpu: bool, floor: float) -> None:
        super().__init__(fields, model, scene, cpu)
        self.floor = floor
        self.tangled = fields.integer(model.n, data=np.zeros(model.n))  # particles whose pairs rest, or that solids lead
        self.resting = False
        self.calls: Any = None  # the layers' `resident_pairs.PairCalls`
        real = fields.exchange
        kinds = [(3, np.int32), (4, np.int32), (4, real), (3, real), (4, real)]
        self.reached = lists(min(self.chunks, PIECES), ROOM, kinds)

    def let_rest(self, resting: np.ndarray, waived: np.ndarray | None = None) -> None:
        """Particles (n,) whose pairs with other such particles are left alone; and those that are led (n,), of which pairs are
        left alone that have no others."""
        state = np.where(resting, RESTS, 0 if waived is None else LED * waived)
        if self.resting or state.any():
            write(self.tangled, state.astype(np.int32))
        self.resting = bool(state.any())

    def collision_free_step(self) -> tuple[float, np.ndarray]:
        """(collision-free part of the path that `cover` has seen, 0 to 1; the pairs (k, 3) that limit it)."""
        if not len(self.known):
            return 1.0, self.candidates
        part = self.known.numbers(self.exchange)
        self._free(*self.known.arrays, part)
        return self.known.least(part)

    def particles_of(self, pairs: np.ndarray) -> np.ndarray:
        """(k, 4) particles of pairs (k, 3), see `ContactPairs.pair`."""
        i, j, faces = pairs[:, 0], pairs[:, 1], pairs[:, 2] == VERTEX_FACE
        out = np.empty((len(pairs), 4), dtype=np.int64)
        out[faces] = np.column_stack([i[faces], self.mesh.faces[j[faces]]])
        out[~faces] = np.concatenate([self.mesh.edges[i[~faces]], self.mesh.edges[j[~faces]]], axis=1)
        return out

    def look(self, swept: bool = False) -> ContactPairs:
        """Pairs that are in reach of each other where the model is; with `swept` also those that went through on the path."""
        if not len(self.known):
            return ContactPairs.none()
        self.paths.count_deviating()
        while True:
            self._look(*self.known.arrays, int(swept), *self.reached.arrays, self.reached.count)
            if not self.reached.grow():
                break
        pair, vertices, weights, normal, numbers = self.reached.handed_over()
        start, end, factor, radius = np.ascontiguousarray(numbers.T, dtype=np.float64)
        found = ContactPairs(pair.astype(np.int64), vertices.astype(np.int64), weights.astype(np.float64),
                             start, end, normal.astype(np.float64), factor, radius)
        if self.calls is not None and self.calls.resident:
            self.calls.took(found, self.reached.joined())
        self.reached.rest()
        return found

    def apart(self) -> np.ndarray:
        """(n,) how far [m] particles are, where the model is, from those they were sewn to and are no more, a thickness
        at most; paths begin there."""
        self.paths.arrive()
        self.cover()
        out: np.ndarray = (2 * self.mesh.half_thickness).astype(self.exchange)
        if len(self.known):
            self._apart(self.known.arrays[0], out)
        return out.astype(np.float64)

    @ti.func
    def path(self, v, swept):
        """Start of four particles' path and how far it leads; of one that is not swept, its end and zeros."""
        p, q, r, s = self.model.x[v[0]], self.model.x[v[1]], self.model.x[v[2]], self.model.x[v[3]]
        dp, dq, dr, ds = 0 * p, 0 * q, 0 * r, 0 * s
        if swept:
            start = ti.static(self.paths.start)
            dp, dq, dr, ds = p - start[v[0]], q - start[v[1]], r - start[v[2]], s - start[v[3]]
            p, q, r, s = start[v[0]], start[v[1]], start[v[2]], start[v[3]]
        return p, q, r, s, dp, dq, dr, ds

    @ti.func
    def slack(self, kind, v, swept):
        """By how much a pair's distance may differ from that on the known path, now or, swept, anywhere on the path."""
        now, most = ti.static(self.paths.displacement_now, self.paths.displacement)
        s = ti.Vector([now[v[0]], now[v[1]], now[v[2]], now[v[3]]])
        if swept:
            s = ti.Vector([most[v[0]], most[v[1]], most[v[2]], most[v[3]]])
        out = ti.max(s[0], s[1]) + ti.max(s[2], s[3])
        if kind == VERTEX_FACE:
            out = s[0] + ti.max(s[1], s[2], s[3])
        return out

    @ti.func
    def rests(self, kind, v):
        """Whether a pair is left alone: a particle of either side is tangled, or solids lead all of them."""
        t = ti.Vector([self.tangled[v[0]], self.tangled[v[1]], self.tangled[v[2]], self.tangled[v[3]]])
        a, b = t[0], ti.max(t[2], t[3])
        if kind == VERTEX_FACE:
            b = ti.max(b, t[1])
        else:
            a = ti.max(a, t[1])
        return ti.min(a, b) == RESTS or t.min() >= LED

    @ti.kernel
    def _free(self, rows: ti.types.ndarray(), distances: ti.types.ndarray(), radii: ti.types.ndarray(),
              part: ti.types.ndarray()):
        for k in range(rows.shape[0]):
            i, j, kind = pair_of(rows, k)
            v = self.mesh.corners(i, j, kind)
            part[k] = 1.0
            floor, slack = self.floor * radii[k], self.slack(kind, v, 1)
            if (1 - KEEP) * (distances[k] - floor) > (1 + KEEP) * (1 + ROUNDING) * slack + ROUNDING * floor:
                continue  # it began no further away than by its slack, and ends no nearer
            p, q, r, s, dp, dq, dr, ds = self.path(v, 1)
            speed = closing(kind, dp, dq, dr, ds)
            if (1 - KEEP) * (gap(kind, p, q, r, s) - floor) < speed and not self.rests(kind, v):
                difference, w = between(kind, p, q, r, s)
                d = difference.norm()
                if d > 0 and (1 - KEEP) * (d - floor) < speed:
                    radius = self.mesh.radius(kind, v)
                    if radius < 0:
                        continue  # sides of a new opening
                    floor = self.floor * radius
                    if d <= PINCHED * floor:
                        floor = 0.0
                    keep = KEEP * (d - floor)
                    left = floor + keep
                    done = 0.0
                    if d - left >= speed:
                        done = 1.0
                    for _ in range(STRIDES):
                        if done < 1 and (d - left > NEAR_END * keep or done == 0.0):
                            done = ti.min(done + (d - left) / speed, 1.0)
                            difference, w = between(kind, p + done * dp, q + done * dq, r + done * dr, s + done * ds)
                            d = difference.norm()
                    part[k] = done

    @ti.kernel
    def _apart(self, rows: ti.types.ndarray(), out: ti.types.ndarray()):
        for k in range(rows.shape[0]):
            i, j, kind = pair_of(rows, k)
            v = self.mesh.corners(i, j, kind)
            if self.mesh.parted(kind, v):
                p, q, r, s, dp, dq, dr, ds = self.path(v, 0)
                difference, w = between(kind, p, q, r, s)
                d = difference.norm()
                for a, b in ti.static(ACROSS):
                    if self.mesh.were_one(kind, v, a, b):
                        ti.atomic_min(out[v[a]], d)
                        ti.atomic_min(out[v[b]], d)

    @ti.kernel
    def _look(self, rows: ti.types.ndarray(), distances: ti.types.ndarray(), radii: ti.types.ndarray(), swept: int,
              pair: ti.types.ndarray(), vertices: ti.types.ndarray(), weights: ti.types.ndarray(), normal: ti.types.ndarray(),
              numbers: ti.types.ndarray(), count: ti.types.ndarray()):
        """Writes down, piece by piece, the candidates that are in reach."""
        self.dealer.begin()
        for t in range(self.dealer.tasks):
            if t % self.dealer.grain == 0:
                piece, pieces, all_rows = self.dealer.next(), count.shape[0], rows.shape[0]
                while piece < pieces:
                    found = 0
                    for k in range(self.dealer.first(piece, pieces, all_rows), self.dealer.first(piece + 1, pieces, all_rows)):
                        i, j, kind = pair_of(rows, k)
                        v = self.mesh.corners(i, j, kind)
                        near, w, n, others = self.in_reach(kind, v, distances[k], REACH * radii[k] + 1e-12, swept)
                        if near and found < pair.shape[1]:
                            pair[piece, found, 0], pair[piece, found, 1], pair[piece, found, 2] = i, j, kind
                            for c in ti.static(range(3)):
                                normal[piece, found, c] = n[c]
                            for c in ti.static(range(4)):
                                vertices[piece, found, c] = v[c]
                                weights[piece, found, c] = w[c]
                                numbers[piece, found, c] = others[c]
                        found += ti.cast(near, ti.i32)
                    count[piece] = found
                    piece = self.dealer.next()

    @ti.func
    def in_reach(self, kind, v, distance, reach, swept):
        """Whether a candidate is in reach, its weights and its direction. Its distance where the path begins and, along
        that direction, where it ends; the part that it counts, and the distance it should keep."""
        start, end, counts, radius = 0.0, 0.0, 0.0, -1.0
        n, w = ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 0.0, 0.0, 0.0])
        near = self.may_reach(kind, v, distance, reach, swept)
        if near:
            p, q, r, s, dp, dq, dr, ds = self.path(v, swept)
            speed = closing(kind, dp, dq, dr, ds)
            first, w_0 = between(kind, p, q, r, s)
            start, exact = first.norm(), REACH * self.mesh.largest_radius(kind, v) + 1e-12
            near = start < exact + speed
            last, w_1 = first, w_0
            if near and swept == 1:
                last, w_1 = between(kind, p + dp, q + dq, r + dr, s + ds)
                near = least_between(start, last.norm(), speed) < exact or speed == 0
            if near:
                radius, n, w = self.mesh.radius(kind, v), first / ti.max(start, 1e-20), w_0
                if swept == 1:
                    d, difference, done = start, first, 0.0
                    for _ in range(STRIDES):
                        if d > radius * 1.001 and done < 1:
                            done = ti.min(done + ti.max(d - radius, 1e-3 * radius) / speed, 1.0)
                            difference, w = between(kind, p + done * dp, q + done * dq, r + done * dr, s + done * ds)
                            d = difference.norm()
                    n = difference / ti.max(d, 1e-20)
                    n_1 = last / ti.max(last.norm(), 1e-20)
                    if n_1.dot(n) > TURNED or done >= 1:
                        n, w = n_1, w_1
                end = n.dot(w[0] * (p + dp) + w[1] * (q + dq) + w[2] * (r + dr) + w[3] * (s + ds))
                counts = fading(kind, w, p + dp, q + dq, r + dr, s + ds)
                near = end < radius * (1 + self.mesh.shift_part(v, w)) and radius >= 0 and counts > FAINT
        return near, w, n, ti.Vector([start, end, counts, radius])

    @ti.func
    def may_reach(self, kind, v, distance, reach, swept):
        """Whether a candidate may be in reach at all: quicker."""
        out = False
        if distance - self.slack(kind, v, swept) <= (1 + ROUNDING) * reach:
            p, q, r, s, dp, dq, dr, ds = self.path(v, swept)
            out = gap(kind, p, q, r, s) < reach + closing(kind, dp, dq, dr, ds) and not self.rests(kind, v)
        return out
