"""Breaking of stitches: the load of each, those that still hold, and changes when one opens.

The reaction of a seam's constraint, (I - S)(A dv - b) over the step's span, is the force of its members on each other. For
two members it is the force of their stitch. For more, forces of stitches are the least ones that add up to it,

    f = B L^+ t,   L = B^T B,

B (stitches, members) having 1 and -1 in the row of a stitch.
"""

from collections.abc import Sequence

import numpy as np

from ..scene.cloth import Cloth
from ..scene.scene import Scene
from ..scene.sewing import Seam
from .checkpoint import Checkpointed
from .elements import Hinges
from .seams import TOGETHER, Clusters

CATCH = 1e-3  # m from which on a stitch that is pulled together becomes a constraint, which closes it in the next step
EVEN = 0.02  # part by which neighbours in a row may be loaded more than a stitch that opens with them


class Stitches(Checkpointed):
    """The stitches of a scene's seams, numbered through all of them.

    Args:
        forces: those that are told of openings.

    Attributes:
        whole: (k,) whether each holds; pulled: (k,) whether it is drawn together by a force, and will hold then.
        bears: (k,) [N] at which each gives; seam: (k,) number of its seam.
        firm: factor of the pull with which each is drawn.
    """

    STATE = ("whole", "pulled", "firm")

    def __init__(self, clusters: Clusters, scene: Scene, forces: Sequence) -> None:
        self.clusters, self.model, self.forces = clusters, clusters.model, forces
        count = [len(s.a) for s in scene.seams]
        self.seam = np.repeat(np.arange(len(count)), count)
        self.first = np.cumsum([0, *count])
        self.bears = np.concatenate([s.bears for s in scene.seams])
        self.breakable = bool(np.isfinite(self.bears).any())
        self._draws = np.concatenate([s.pulls for s in scene.seams]) > 0
        self.pulled = self._draws & (self._gaps() > CATCH)
        self.whole, self.firm = ~self.pulled, 1.0
        self._by_hand = np.repeat([not s.tears for s in scene.seams], count)
        row = np.repeat([s.row for s in scene.seams], count)
        if self.pulled.any():
            self.resumed()
        self._follows = row[1:] & (self.seam[1:] == self.seam[:-1])  # stitch k + 1 stands next to stitch k

    def set(self, whole: np.ndarray) -> bool:
        """Only the stitches with `whole` (k,) hold from now on. Returns whether that is a change."""
        if np.array_equal(whole, self.whole):
            return False
        self.whole = whole.copy()
        self.resumed()
        return True

    def set_by_hand(self, rows: np.ndarray, holds: bool) -> bool:
        """Opens the stitches `rows` (k,), or closes them with `holds`; whether that is a change."""
        whole, pulled = self.whole.copy(), self.pulled.copy()
        if holds:
            drawn = self._draws[rows] & (self._gaps()[rows] > CATCH)
            pulled[rows], whole[rows] = drawn, ~drawn
        else:
            pulled[rows] = whole[rows] = False
        changed = not (np.array_equal(whole, self.whole) and np.array_equal(pulled, self.pulled))
        if changed:
            self.whole, self.pulled = whole, pulled
            self.resumed()
        return changed

    def resumed(self) -> None:
        """See `Checkpointed`: everything is told which stitches are whole."""
        self.clusters.connect(self.whole)
        for force in self.forces:
            force.release(self.whole, self.firm * self.pulled)
        self.clusters.pulled = bool(self.pulled.any())

    def _gaps(self) -> np.ndarray:
        """(k,) [m] of the stitches, where the model is."""
        x = self.model.read_particles()[0]
        return np.linalg.norm(x[self.clusters.a] - x[self.clusters.b], axis=1)

    @property
    def apart(self) -> np.ndarray:
        """(j,) particles of stitches that are pulled together, and are not yet."""
        return np.concatenate([self.clusters.a[self.pulled], self.clusters.b[self.pulled]])

    @property
    def parted(self) -> np.ndarray:
        """(j,) particles of stitches that hold, or are drawn together, whose two are not in one place."""
        still = (self.whole | self.pulled) & (self._gaps() > 0)
        return np.concatenate([self.clusters.a[still], self.clusters.b[still]])

    def join(self) -> bool:
        """Stitches that are pulled together and have come near hold from now on. Whether any does."""
        if not self.pulled.any():
            return False
        near = self.pulled & (self._gaps() <= CATCH)
        self.pulled &= ~near
        return self.set(self.whole | near)

    def loads(self, tension: np.ndarray) -> np.ndarray:
        """(k,) force [N] in each stitch of seams; 0 if its ends are, or were before the step, still apart.

        Args:
            tension: (n, 3) [N] forces of members on each other.
        """
        a, b, label = self.clusters.a, self.clusters.b, self.clusters.label
        size = np.bincount(label + 1, minlength=2)[label + 1]  # of each particle's cluster
        out = np.zeros(len(self.bears))
        real = self.whole & (a != b) & self._by_hand
        alone = np.flatnonzero(real & (size[a] == 2))
        out[alone] = np.linalg.norm(tension[a[alone]], axis=1)
        several = np.flatnonzero(real & (size[a] > 2))
        for cluster in np.unique(label[a[several]]):
            mine = several[label[a[several]] == cluster]
            out[mine] = np.linalg.norm(between(a[mine], b[mine], tension), axis=1)
        x, before = self.model.read_particles()[0], self.model.read_saved()[0]
        gap = np.maximum(*(np.linalg.norm(q[a] - q[b], axis=1) for q in (x, before)))
        return np.where(gap > TOGETHER, 0.0, out)

    def overloaded(self, tension: np.ndarray) -> np.ndarray:
        """(k,) whether stitches give under a tension (n, 3) [N]: of overloaded ones in a row only the most loaded gives."""
        part = self.loads(tension) / self.bears
        most = part.copy()
        most[1:] = np.where(self._follows, np.maximum(most[1:], part[:-1]), most[1:])
        most[:-1] = np.where(self._follows, np.maximum(most[:-1], part[1:]), most[:-1])
        return (part > 1) & (part >= (1 - EVEN) * most)

    @property
    def open(self) -> int:
        """How many are open."""
        return int(np.sum(~self.whole & ~self.pulled))


def between(a: np.ndarray, b: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """(j, 3) forces of stitches between particles a and b (j,) of one cluster that put `tension` (n, 3) on them."""
    members, at = np.unique(np.concatenate([a, b]), return_inverse=True)
    B = np.zeros((len(a), len(members)))
    rows = np.arange(len(a))
    B[rows, at[: len(a)]], B[rows, at[len(a):]] = 1.0, -1.0
    return B @ np.linalg.pinv(B.T @ B, hermitian=True) @ tension[members]


def ends_of(scene: Scene, parts: Sequence[tuple[Cloth | Seam, Hinges]]) -> np.ndarray:
    """(hinges, 2) the stitches at the ends of hinges that go over seams or may tear, numbered through all of a scene; -1 for
    none.

    Args:
        parts: hinges, and the cloth or seam that they are of.
    """
    out = [np.zeros((0, 2), dtype=np.int64)]
    first = dict(zip(scene.seams, np.cumsum([0, *(len(s.a) for s in scene.seams)]).tolist()))
    for of, h in parts:
        ends = np.full((len(h.vertices), 2), -1)
        if isinstance(of, Seam):
            by = np.array([of.cloth.mesh.vertex_count, 1])
            pairs = np.sort(np.stack([of.a[:-1], of.a[1:]], axis=1), axis=1) @ by
            order = np.argsort(pairs)
            k = order[np.searchsorted(pairs, np.sort(h.vertices[:, :2], axis=1) @ by, sorter=order)]
            ends = first[of] + np.stack([k, k + 1], axis=1)
        elif of.split is not None:
            seam = next(s for s in scene.seams if s.tears and s.cloth is of)
            ends[of.split.edge, of.split.at] = first[seam] + np.arange(len(of.split.a))
        out.append(ends)
    return np.concatenate(out)
