"""Cloth that passes through cloth where it should not: found, left alone by contact, and pulled apart. numpy only.

A scene may start with crossings, and solids may press layers through each other. Crossing pairs, and pairs near
them, are left out of repulsion and of the collision-free step, until they are apart. Meanwhile each crossing edge is led out
of its triangle, along the direction in which the contour that the two surfaces have in common gets shorter [Volino,
Magnenat-Thalmann 2006]. A small tangle that lasts, as beside seams where layers of a pleat hold each other, is led more and
more firmly.
"""

from functools import cached_property

import numpy as np

from ...backend.ordering import components
from ...errors import SceneError
from ...scene.intersections import self_crossings
from ...scene.mesh import face_edges
from ...system.checkpoint import Checkpointed
from ..points import ContactRows, sym_outer, sym_times, unit
from ..solid.penetration import SPARED
from ..step_start import StepContext
from .collision_mesh import CollisionMesh
from .contact_pairs import ContactPairs

PULL = 10.0  # stiffness over mass / h^2 by which crossings are moved by a thickness in a usual step
FEW = 20  # crossings away from seams, at most, of a tangle that is led more firmly the longer it lasts; with 0 those that
# a load holds stay: 14 crossings of 18 after .4 s
FIRMER, FIRMEST = 2.0, 1024.0  # times as stiff after each usual step; at which it begins anew; and pairs that have just come
# apart are led further

NONE = np.zeros((0, 4), dtype=np.int64), np.zeros((0, 4)), np.zeros((0, 3)), np.zeros(0)


class Intersections(Checkpointed):
    """The crossings of a model's cloths.

    Args:
        n: particles; mesh: of the cloth that meets cloth.
        policy: "untangle", "ignore" or "abort".

    Attributes:
        count: crossing (edge, triangle) pairs where cloth was last looked at; pinched: particles that were let go, as no way
            was free for them, and still rest.
        resting: (n,) whether pairs of a particle with another such rest; active: whether any does.
        until: (n,) time [s] for which a particle that was pinched rests.
        edges, rows: (k, 2) particles and (k,) rows of faces that crossed where the step begins.
        firm: (n,) how much stiffer particles of crossings are led than at first.
        parting: pairs that have just come apart, too near to count: particles (k, 4), weights (k, 4), normals (k, 3) from the
            second to the first, distances (k,) that they should keep [m].
    """

    STATE = ("until", "edges", "rows", "firm", "parting")

    def __init__(self, n: int, mesh: CollisionMesh, policy: str) -> None:
        self.n, self.mesh, self.policy = n, mesh, policy
        self.faces, self.half = mesh.faces, mesh.half_thickness
        self.until, self.firm = np.zeros(n), np.ones(n)
        self.parting: tuple[np.ndarray, ...] = NONE
        self.resting, self.active = np.zeros(n, dtype=bool), False
        self.edges, self.rows = np.zeros((0, 2), dtype=np.int64), np.zeros(0, dtype=np.int64)  # where the step begins
        self.found = self.edges, self.rows  # where cloth was last looked at
        self.count = self.pinched = 0

    @cached_property
    def _sides(self) -> tuple[np.ndarray, np.ndarray]:
        """(a number for each edge of each face (3 m,), sorted; where it is in `face_edges`). Few runs ever need them."""
        code = np.sort(face_edges(self.faces), axis=1) @ np.array([self.n, 1])
        order = np.argsort(code, kind="stable")
        return code[order], order

    def resumed(self) -> None:
        """See `Checkpointed`."""
        self.found, self.count = (self.edges, self.rows), len(self.rows)
        self._rest()

    def inspect(self) -> list[str]:
        """Notes on crossings at the start.

        Raises:
            SceneError: cloth passes through cloth, and the policy is "abort".
        """
        if not self.count:
            return []
        what = f"{self.count} pairs of an edge and a triangle of cloth pass through each other at the start"
        if self.policy == "abort":
            raise SceneError(f"{what}; tangles='untangle' pulls them apart, 'ignore' leaves them")
        pulled = self.policy == "untangle"
        return [f"{what}: they are " + ("pulled apart" if pulled else "left alone until apart")]

    def look(self, x: np.ndarray, among: np.ndarray | None = None) -> None:
        """Finds the crossings at positions (n, 3), where a step may end.

        Args:
            among: (n,) particles; where given, only faces with one of them, and their edges, are looked at.
        """
        edges, rows, sewn = self._crossing_at(x, among)
        self.found = edges[~sewn], rows[~sewn]
        self.count = len(self.found[1])

    def beside_seams(self, x: np.ndarray, apart: np.ndarray) -> int:
        """How many cross at positions (n, 3) that share a corner by a seam: contact leaves such pairs alone, since they are to
        be in one place, and while they are not, one may pass through the other.

        Args:
            apart: (j,) particles that are not yet where those are that they are sewn to.
        """
        among = np.zeros(self.n, dtype=bool)
        among[apart] = True
        return int(self._crossing_at(x, among)[2].sum()) if len(apart) else 0

    def _crossing_at(self, x: np.ndarray, among: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(edges (k, 2), rows of faces (k,) that cross at positions (n, 3), (k,) whether by a seam they share a corner);
        `among` as in `look`."""
        some = np.arange(len(self.faces)) if among is None else np.flatnonzero(among[self.faces].any(axis=1))
        edges, rows = self_crossings(x, self.faces[some])
        cluster_ids = self.mesh.cluster_ids
        rows = some[rows]
        meet = self.mesh.may_meet(self._faces_of(edges)[:, 0], rows)
        edges, rows = edges[meet], rows[meet]
        return edges, rows, (cluster_ids[edges][:, :, None] == cluster_ids[self.faces[rows]][:, None, :]).any(axis=(1, 2))

    def commit(self, h: float = 0.0, share: float = 0.0) -> None:
        """The next step begins where cloth was last looked at, h [s] later; that was so much of a usual step."""
        before, (self.edges, self.rows) = self._in_small_tangles(), self.found
        lasts = before & self._in_small_tangles() & (self.firm < FIRMEST)
        self.firm = np.where(lasts, FIRMER**share * self.firm, 1.0)
        self.until = np.maximum(self.until - h, 0)
        rests = (self.until[self.parting[0]] > 0).any(axis=1)
        self.parting = tuple(values[rests] for values in self.parting)
        self._rest()

    def _in_small_tangles(self) -> np.ndarray:
        """(n,) whether a particle is of an edge or a face that crosses, in a tangle of at most FEW crossings away from seams:
        beside one, tangles of neighbouring pleats are one."""
        out, four = np.zeros(self.n, dtype=bool), np.column_stack([self.edges, self.faces[self.rows]])
        if len(four):
            one = components(self.n, four[:, :1].repeat(4, axis=1).ravel(), four[:, 1:].ravel())[four[:, 0]]
            sewn = np.bincount(self.mesh.cluster_ids)[self.mesh.cluster_ids] > 1
            out[four[np.bincount(one, ~sewn[four].any(axis=1))[one] <= FEW]] = True
        return out

    def _rest(self) -> None:
        """Particles of a crossing rest, their neighbours, and those that were pinched.

        With two rings of neighbours tangles grew. With none, cloth that is well through meets the other from the wrong side.
        """
        near = np.zeros(self.n, dtype=bool)
        near[self.edges.ravel()] = True
        near[self.faces[self.rows].ravel()] = True
        self.resting = self.mesh.around(near)
        self.release(np.zeros(0, dtype=np.int64))

    def release(self, particles: np.ndarray) -> None:
        """Lets pairs of particles, by numbers or as a mask (n,), rest for a while."""
        self.until[particles] = SPARED
        pinched = self.until > 0
        self.resting, self.pinched = self.resting | pinched, int(np.sum(pinched))
        self.active = bool(self.resting.any())

    def lead_apart(self, p: ContactPairs, stuck: np.ndarray) -> None:
        """Lets the particles of some pairs (k,) rest for a while. All pairs that rest by that are led apart meanwhile."""
        self.release(p.vertices[stuck].ravel())
        mine = self.resting[p.vertices]
        rests = (mine & (p.weights > 0)).any(axis=1) & (mine & (p.weights < 0)).any(axis=1)
        more = p.vertices[rests], p.weights[rests], p.normal[rests], p.radius[rests]
        self.parting = tuple(np.concatenate(both) for both in zip(self.parting, more))

    def points(self, start: StepContext, base: np.ndarray, mass: np.ndarray) -> ContactRows:
        """Points of contact that lead edges out of triangles, and pairs apart."""
        if self.policy != "untangle":
            return ContactRows.none()
        return ContactRows.join([self._crossing(start, base, mass), self._parting(start, base, mass)])

    def _parting(self, start: StepContext, base: np.ndarray, mass: np.ndarray) -> ContactRows:
        """Points that lead pairs further that have just come apart: on their way, by a thickness in a usual step."""
        vertices, weights, normal, radius = self.parting
        gap, gone = (np.einsum("ki,ka,kai->k", normal, weights, rows[vertices]) for rows in (start.x, base - start.x))
        step = np.clip(radius - gap, 0.0, radius * start.share)
        stiff = np.where(step > 0, PULL * FIRMEST / (weights**2 / mass[vertices]).sum(axis=1), 0.0)
        return ContactRows(vertices, weights, stiff[:, None] * sym_outer(normal),
                           (stiff * (step - gone) / start.c)[:, None] * normal)

    def _crossing(self, start: StepContext, base: np.ndarray, mass: np.ndarray) -> ContactRows:
        """Points that lead edges out of triangles."""
        k, x_0 = len(self.rows), start.x
        face = self.faces[self.rows]
        p, q = x_0[self.edges[:, 0]], x_0[self.edges[:, 1]]
        a, b, c = (x_0[face[:, j]] for j in range(3))
        normal = unit(np.cross(b - a, c - a))
        s = np.einsum("ki,ki->k", a - p, normal) / np.einsum("ki,ki->k", q - p, normal)
        w = _barycentric(p + s[:, None] * (q - p), a, b, c)
        way = self._shorter(x_0, normal, unit(q - p))
        zero = np.zeros(k)
        vertices = np.concatenate([np.column_stack([self.edges, self.edges[:, :1], self.edges[:, :1]]),
                                   np.column_stack([face, face[:, 0]])])
        weights = np.concatenate([np.column_stack([1 - s, s, zero, zero]), np.column_stack([w, zero])])
        way = np.concatenate([way, -way])
        step = 2 * np.tile(self.half[face[:, 0]], 2) * start.share
        own = 1 / np.maximum((weights**2 / mass[vertices]).sum(axis=1), 1e-300)
        firm = np.tile(np.maximum(self.firm[self.edges].max(axis=1), self.firm[face].max(axis=1)), 2)
        block = (PULL * firm * own)[:, None] * sym_outer(way)
        gone = np.einsum("ka,kai->ki", weights, (base - x_0)[vertices])
        rhs = sym_times(block, (step[:, None] * way - gone) / start.c)
        return ContactRows(vertices, weights, block, rhs)

    def _shorter(self, x: np.ndarray, normal: np.ndarray, along: np.ndarray) -> np.ndarray:
        """(k, 3) unit directions for edges along which their triangles' contours with the faces get shorter."""
        total = np.zeros_like(normal)
        of = self._faces_of(self.edges)
        for side in range(2):
            f = of[:, side]
            corner = self.faces[np.maximum(f, 0)]
            third = corner[np.arange(len(f)), np.argmin((corner == self.edges[:, :1]) | (corner == self.edges[:, 1:]), axis=1)]
            other = np.cross(x[corner[:, 1]] - x[corner[:, 0]], x[corner[:, 2]] - x[corner[:, 0]])
            contour = unit(np.cross(normal, other))
            inward = x[third] - x[self.edges[:, 0]]
            inward = inward - np.einsum("ki,ki->k", inward, along)[:, None] * along
            contour *= np.sign(np.einsum("ki,ki->k", contour, inward))[:, None]
            across = np.einsum("ki,ki->k", along, normal)
            across = np.where(np.abs(across) < 0.05, np.copysign(0.05, across), across)
            part = contour - 2 * (np.einsum("ki,ki->k", along, contour) / across)[:, None] * normal
            total += np.where((f >= 0)[:, None], part, 0.0)
        return unit(total)

    def _faces_of(self, edges: np.ndarray) -> np.ndarray:
        """(k, 2) the one or two faces at edges, -1 where there is no second."""
        if not len(edges):
            return np.zeros((0, 2), dtype=np.int64)
        codes, order = self._sides
        code, m = edges @ np.array([self.n, 1]), len(self.faces)
        first = np.searchsorted(codes, code)
        second = np.minimum(first + 1, len(codes) - 1)
        there = (codes[second] == code) & (second > first)
        return np.stack([order[first] % m, np.where(there, order[second] % m, -1)], axis=1)


def _barycentric(p: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """(k, 3) weights of points in the planes of triangles."""
    n = np.cross(b - a, c - a)
    size = np.maximum(np.einsum("ki,ki->k", n, n), 1e-300)
    u = np.einsum("ki,ki->k", np.cross(p - a, c - a), n) / size
    v = np.einsum("ki,ki->k", np.cross(b - a, p - a), n) / size
    return np.stack([1 - u - v, u, v], axis=1)
