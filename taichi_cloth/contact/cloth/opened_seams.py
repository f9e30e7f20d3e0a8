"""The two sides of an opening, as contact sees them: a pair keeps the distance that its sides have had since.

When a stitch opens its sides are in one place, nearer than layers may be. They would push each other apart at once if they
were to keep a thickness; so they keep the distance they came apart by, which grows to that.
"""

import numpy as np

from ...scene.intersections import self_crossings
from ...system.checkpoint import Checkpointed
from ...system.seams import connected
from ...system.state import ParticleState
from .collision_mesh import CollisionMesh


class OpenedSeams(Checkpointed):
    """The sides of a scene's stitches.

    Attributes:
        together: (k,) stitches whose sides are one surface.
        grown: (n,) distance [m] that particles have had from all that they were sewn to and are no more, a thickness at most.
    """

    STATE = ("together", "grown")

    def __init__(self, model: ParticleState, mesh: CollisionMesh) -> None:
        self.model, self.mesh, self.a, self.b = model, mesh, model.sewn.a, model.sewn.b
        self.together = np.ones(len(self.a), dtype=bool)
        self.grown = 2 * mesh.half_thickness

    @property
    def short(self) -> np.ndarray:
        """(n,) which particles keep less than a thickness."""
        return self.grown < 2 * self.mesh.half_thickness

    @property
    def growing(self) -> bool:
        """Whether anything keeps less than a thickness."""
        return bool(self.short.any())

    def part(self, whole: np.ndarray) -> bool:
        """Sides of stitches that are not whole (k,) are two from now on. Whether any were one."""
        opened = self.together & ~whole
        if not opened.any():
            return False
        label = connected(self.model.n, self.a[self.together], self.b[self.together])
        self.grown = np.where(np.isin(label, label[self.a[opened]]), 0.0, self.grown)
        self.together = self.together & whole
        self.resumed()
        return True

    def join(self, whole: np.ndarray) -> bool:
        """Sides of stitches that are whole (k,) are one from now on. Whether any were two."""
        closed = whole & ~self.together
        if not closed.any():
            return False
        self.together = self.together | whole
        self.resumed()
        return True

    def grow(self, apart: np.ndarray) -> None:
        """Particles are so far (n,) [m] from those they were sewn to. Sides that cross, from when they were in one place, and
        their neighbours are one surface until they do not."""
        cluster_ids, most = self.mesh.cluster_ids, 2 * self.mesh.half_thickness
        faces = self.mesh.faces[self.short[self.mesh.faces].any(axis=1)]
        edges, rows = self_crossings(self.model.read_particles()[0], faces)
        self.grown = np.minimum(np.maximum(self.grown, apart), most)
        if len(rows):
            near: np.ndarray = np.zeros(self.model.n, dtype=bool)
            near[cluster_ids[edges]], near[cluster_ids[faces[rows]]] = True, True
            self.grown = np.where(self.mesh.around(near[cluster_ids]) & self.short, 0.0, self.grown)
        self.mesh.set_grown(self.grown)

    def resumed(self) -> None:
        """See `Checkpointed`."""
        cluster_ids, label = np.arange(self.model.n), connected(self.model.n, self.a[self.together], self.b[self.together])
        sewn = np.flatnonzero(label >= 0)
        _, first = np.unique(label[sewn], return_index=True)
        cluster_ids[sewn] = sewn[first][label[sewn]]
        self.mesh.set_cluster_ids(cluster_ids)
        self.mesh.set_grown(self.grown)
