"""The vertices, edges and faces of cloth that can collide: whose they are, how near they may come, which of them can meet."""

import numpy as np

from ...backend.bvh import morton
from ...backend.fields import Fields
from ...backend.language import ti
from ...backend.rows import write
from ...scene.mesh import face_edges
from ...scene.scene import Scene
from ...system.state import ParticleState
from ..geometry import VERTEX_FACE
from ..pair_geometry import between
from .sewn_shape import sewn_distances

ACROSS = (0, 1), (0, 2), (0, 3), (1, 2), (1, 3)  # two of a pair's four particles, on different sides of it
LEAST = 0.01  # of a thickness: sides of an opening that have not been so far apart are one surface. With 0 a zip that closes
# stitch by stitch takes 658 steps for 25


@ti.data_oriented
class CollisionMesh:
    """Those of the cloths of a scene that have a `contact`.

    Attributes:
        faces: (m, 3) particles, in an order that keeps neighbours together; edges: (e, 2), in the order of their faces.
        spacing: median length of the edges [m].
        half_thickness: (n,) [m]; cluster_ids: (n,) the same number for particles that are sewn together.
        face, edge, half, cluster: the same as fields; cloth: (m,) of each face; size: m and e, as kernels read them.
        own_vertex: vertices in the order of faces that speak for them: face f for those from first_vertex[f] to
            first_vertex[f + 1], and for the edges from first_edge[f] to first_edge[f + 1].
    """

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene) -> None:
        meeting = [k for k, c in enumerate(scene.cloths) if c.contact is not None]
        faces = np.concatenate([model.particle[scene.cloths[k].mesh.faces + scene.cloths[k].start] for k in meeting])
        cloth = np.repeat(meeting, [scene.cloths[k].mesh.face_count for k in meeting])
        given = np.concatenate([c.mesh.x for c in scene.cloths])[model.user]
        order = morton(given[faces].mean(axis=1))
        order = order[np.argsort(cloth[order], kind="stable")]  # each cloth by itself
        self.exchange = fields.exchange
        self.faces, self._cloth_of = faces[order].astype(np.int32), cloth[order].astype(np.int32)
        m = len(self.faces)
        ends = np.sort(face_edges(self.faces), axis=1)
        code, first = np.unique(ends @ np.array([model.n, 1]), return_index=True)
        code, self.first_edge = _owned(fields, code, first % m, m)
        self.edges = np.stack([code // model.n, code % model.n], axis=1).astype(np.int32)
        self.spacing = float(np.median(np.linalg.norm(np.diff(given[self.edges], axis=1), axis=2)))
        vertices, first = np.unique(self.faces.T.ravel(), return_index=True)
        vertices, self.first_vertex = _owned(fields, vertices, first % m, m)
        self.own_vertex = fields.integer(len(vertices), data=vertices)
        self.size = fields.integer(2, data=np.array([m, len(self.edges)]))
        self.face, self.edge = fields.integer(m, 3, self.faces), fields.integer(len(self.edges), 2, self.edges)
        self.cloth, self.cloths = fields.integer(m, data=self._cloth_of), len(scene.cloths)
        self._may = _meeting(scene)
        self.meets = fields.integer(self.cloths**2, data=self._may)
        self.half_thickness = np.concatenate([np.full(c.mesh.vertex_count, c.contact.thickness / 2 if c.contact else 0.0)
                                              for c in scene.cloths])[model.user]
        self.half = fields.real(model.n, data=self.half_thickness)
        self.shifts = fields.real(model.n, data=np.zeros(model.n))  # see `PenaltyShift`
        self.cluster_ids = np.arange(model.n) if model.sewn is None else model.sewn.representative
        self.cluster = fields.integer(model.n, data=self.cluster_ids)
        self.sews, self.over_seams = model.sewn is not None, False
        if self.sews:
            self.joined = fields.integer(model.n, data=self.cluster_ids)  # particles that were one in the beginning
            self.grown = fields.real(model.n, data=2 * self.half_thickness)  # see `OpenedSeams`
            self._keep_sewn_shape(fields, given)
        owner = np.concatenate([np.full(c.mesh.vertex_count, k) for k, c in enumerate(scene.cloths)])[model.user]
        self.owners = owner
        self.owner, self.rest = fields.integer(model.n, data=owner), fields.real(model.n, 3, given)

    def _keep_sewn_shape(self, fields: Fields, given: np.ndarray) -> None:
        found = sewn_distances(given, self.edges, self.cluster_ids, 4 * float(self.half_thickness.max()))
        self.over_seams = found is not None
        if found is not None:
            self.sewn_first, self.sewn_to = (fields.integer(len(a), data=a) for a in (found.first, found.to))
            self.sewn_distance = fields.real(len(found.to), data=found.distance)

    def may_meet(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """(k,) whether faces a and b (k,) are of cloths that meet."""
        return self._may[self._cloth_of[a] * self.cloths + self._cloth_of[b]] == 1

    def particles_may_meet(self, i: np.ndarray, j: np.ndarray) -> np.ndarray:
        """(k,) whether particles i and j (k,) are of cloths that meet."""
        return self._may[self.owners[i] * self.cloths + self.owners[j]] == 1

    def around(self, some: np.ndarray) -> np.ndarray:
        """(n,) whether particles are among some (n,) or neighbours of these: of a face with one."""
        out = some.copy()
        out[self.faces[some[self.faces].any(axis=1)]] = True
        return out

    @ti.func
    def can_meet(self, f, g):
        """Whether two faces are of cloths that meet."""
        return self.meets[self.cloth[f] * self.cloths + self.cloth[g]] == 1

    @ti.func
    def corners(self, i, j, kind):
        """The four particles of a vertex i and a face j, or of two edges."""
        v = ti.Vector([i, 0, 0, 0])
        if kind == VERTEX_FACE:
            f = self.face[j]
            v = ti.Vector([i, f[0], f[1], f[2]])
        else:
            e, g = self.edge[i], self.edge[j]
            v = ti.Vector([e[0], e[1], g[0], g[1]])
        return v

    @ti.func
    def thickness(self, v):
        """Thickness [m] of the two layers of a pair with particles v."""
        return self.half[v[0]] + self.half[v[3]]

    @ti.func
    def shift_part(self, v, w):
        """How much further away than its distance a pair of particles v, weights w begins to repel, in parts of it."""
        part = 0.0
        for a in ti.static(range(4)):
            part += 0.5 * ti.abs(w[a]) * self.shifts[v[a]]
        return part

    def set_cluster_ids(self, cluster_ids: np.ndarray) -> None:
        """Sets the particles that are sewn together from now on."""
        self.cluster_ids = cluster_ids
        write(self.cluster, cluster_ids.astype(np.int32))

    def set_grown(self, grown: np.ndarray) -> None:
        """Sets the distance [m] that particles keep from those they were sewn to."""
        write(self.grown, grown.astype(self.exchange))

    @ti.func
    def were_one(self, kind, v, a, b):
        """Whether particles a and b of a pair are on different sides of it and were sewn to each other once."""
        return self.across(kind, a, b) and self.joined[v[a]] == self.joined[v[b]]

    @ti.func
    def across(self, kind, a, b):
        """Whether the a-th and b-th particle of a pair are on different sides of it."""
        out = b >= 2
        if kind == VERTEX_FACE:
            out = a == 0
        return out

    @ti.func
    def parted(self, kind, v):
        """Whether the two of a pair were sewn to each other once, and so have no distance in the cloth's own shape."""
        out = False
        if ti.static(self.sews):
            for a, b in ti.static(ACROSS):
                out = out or self.were_one(kind, v, a, b)
        return out

    @ti.func
    def came_apart(self, kind, v):
        """The distance [m] that the two of such a pair have had; negative where that is too little to keep."""
        out = self.thickness(v)
        if ti.static(self.sews):
            for a, b in ti.static(ACROSS):
                if self.were_one(kind, v, a, b):
                    out = ti.min(out, ti.max(self.grown[v[a]], self.grown[v[b]]))
        return ti.select(out < LEAST * self.thickness(v), -1.0, out)

    @ti.func
    def radius(self, kind, v):
        """The distance that a pair should keep [m]; negative where it is none."""
        out = self.largest_radius(kind, v)
        if self.owner[v[0]] == self.owner[v[3]] and self.parted(kind, v):
            out = self.came_apart(kind, v)
        return out

    @ti.func
    def largest_radius(self, kind, v):
        """The largest value of `radius` [m]: the thickness, or half of how far the two are from each other in the cloth's own
        shape, if that is less."""
        out = self.thickness(v)
        if self.has_shape(kind, v):
            rest, w = between(kind, self.rest[v[0]], self.rest[v[1]], self.rest[v[2]], self.rest[v[3]])
            out = ti.min(out, 0.5 * rest.norm())
            out = ti.min(out, 0.5 * self.distance_over_seams(kind, v))
        return out

    @ti.func
    def radius_bound(self, kind, v):
        """A bound [m] that `largest_radius` does not exceed: quicker, by the distance between the middles of the two."""
        out = self.thickness(v)
        if self.has_shape(kind, v):
            p, q, r, s = self.rest[v[0]], self.rest[v[1]], self.rest[v[2]], self.rest[v[3]]
            middles = (p + q - r - s) / 2
            if kind == VERTEX_FACE:
                middles = p - (q + r + s) / 3
            out = ti.min(out, 0.5 * middles.norm())
        return out

    @ti.func
    def has_shape(self, kind, v):
        """Whether the two of a pair have a distance in the cloth's own shape."""
        return self.owner[v[0]] == self.owner[v[3]] and not self.parted(kind, v)

    @ti.func
    def distance_over_seams(self, kind, v):
        """How far the two of a pair are from each other along edges over seams [m], where that is less than 2 thicknesses."""
        out = 2 * self.thickness(v)
        if ti.static(self.sews and self.over_seams):
            for a, b in ti.static(ACROSS):
                if self.across(kind, a, b):
                    i = self.joined[v[a]]
                    for k in range(self.sewn_first[i], self.sewn_first[i + 1]):
                        if self.sewn_to[k] == self.joined[v[b]]:
                            out = ti.min(out, self.sewn_distance[k])
        return out


def _owned(fields: Fields, things: np.ndarray, owner: np.ndarray, count: int) -> tuple:
    """Things sorted by owner, and a field of where each owner's begin."""
    order = np.argsort(owner, kind="stable")
    first = np.searchsorted(owner[order], np.arange(count + 1))
    return things[order], fields.integer(count + 1, data=first)


def _meeting(scene: Scene) -> np.ndarray:
    """(cloths^2,) 1 where two cloths meet, or one meets itself."""
    k = len(scene.cloths)
    out = np.zeros((k, k), dtype=np.int64)
    for i, a in enumerate(scene.cloths):
        for j, b in enumerate(scene.cloths):
            itself = a.contact is not None and a.contact.itself
            out[i, j] = int(itself if a is b else not scene.passes(a, b))
    return out.ravel()
