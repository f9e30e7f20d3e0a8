"""The two sides of what has opened, as contact sees them: one surface until they are a thickness apart, two from then on.

Where a stitch opens its sides are in one place, nearer than layers may be. They would push each other apart at once if they
were layers then; so they meet as layers do when they have come apart once.
"""

import numpy as np

from ...system.checkpoint import Checkpointed
from ...system.seams import connected
from ...system.state import ParticleState
from .collision_mesh import CollisionMesh


class Lips(Checkpointed):
    """The sides of a scene's stitches.

    Attributes:
        together: (k,) stitches whose sides are one surface: those that are whole, and what they were a moment ago.
    """

    STATE = ("together",)

    def __init__(self, model: ParticleState, mesh: CollisionMesh) -> None:
        self.model, self.mesh, self.a, self.b = model, mesh, model.sewn.a, model.sewn.b
        self.together = np.ones(len(self.a), dtype=bool)
        corner, face = mesh.faces.T.ravel(), np.tile(np.arange(len(mesh.faces)), 3)
        order = np.argsort(corner, kind="stable")
        self._face, self._first = face[order], np.searchsorted(corner[order], np.arange(model.n + 1))

    def part(self, whole: np.ndarray) -> bool:
        """Sides of open stitches that have come apart are two from now on. Whether any have."""
        waits = self.together & ~whole
        if not waits.any():
            return False
        label = connected(self.model.n, self.a[self.together], self.b[self.together])
        particle, face, knot = self._across(np.unique(label[self.a[waits]]), label)
        x, half = self.model.read_particles()[0], self.mesh.half_thickness
        near = distances(x[particle], x[self.mesh.faces[face]]) < half[particle] + half[self.mesh.faces[face, 0]]
        apart = waits & ~np.isin(label[self.a], knot[near])
        if not apart.any():
            return False
        self.together = self.together & ~apart
        self.resumed()
        return True

    def _across(self, knots: np.ndarray, label: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(particle, face, knot) (j,): particles of knots, and the faces at what of the same knot holds them no more."""
        held, rows = self.model.sewn.knot, []
        for knot in knots.tolist():
            members = np.flatnonzero(label == knot)
            for i in members.tolist():
                for j in members[held[members] != held[i]].tolist():
                    rows += [(i, f, knot) for f in self._face[self._first[j]: self._first[j + 1]].tolist()]
        particle, face, knot = np.array(rows, dtype=np.int64).reshape(-1, 3).T
        return particle, face, knot

    def resumed(self) -> None:
        """See `Checkpointed`."""
        knots, label = np.arange(self.model.n), connected(self.model.n, self.a[self.together], self.b[self.together])
        sewn = np.flatnonzero(label >= 0)
        _, first = np.unique(label[sewn], return_index=True)
        knots[sewn] = sewn[first][label[sewn]]
        self.mesh.set_knots(knots)


def distances(p: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(k,) [m] of points (k, 3) from triangles (k, 3, 3)."""
    out = np.full(len(p), np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):  # from its edges
        way, to = corners[:, b] - corners[:, a], p - corners[:, a]
        t = np.clip(np.einsum("ki,ki->k", to, way) / np.maximum(np.einsum("ki,ki->k", way, way), 1e-300), 0, 1)
        out = np.minimum(out, np.linalg.norm(to - t[:, None] * way, axis=1))
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside = np.all([np.einsum("ki,ki->k", np.cross(corners[:, b] - corners[:, a], p - corners[:, a]), normal) >= 0
                     for a, b in ((0, 1), (1, 2), (2, 0))], axis=0)
    height = np.abs(np.einsum("ki,ki->k", p - corners[:, 0], normal)) / np.maximum(np.linalg.norm(normal, axis=1), 1e-300)
    return np.where(inside, height, out)
