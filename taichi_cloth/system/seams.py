"""Seams as constraints of the solve: sewn particles move as one.

Sewn vertices form clusters. On a cluster the filter S takes the mean over its members,

    (S q)_i = 1/k sum_j q_j,

an orthogonal projector: S A S is the matrix of the welded cloth, on the panels' own particles. The part outside S,
(I - S) A dv, is the seam's tension. Members that are apart are led together by z: their velocities against the mean
closes the gap, at most `CLOSING`.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.ordering import components
from ..backend.rows import write
from ..errors import SceneError
from ..scene.scene import Scene
from .held import Held, kernel_array

CLOSING = 0.5  # m/s at most at which a seam closes
TOGETHER = 1e-7  # m within which sewn vertices are put into one place
RESTING = 1e-6  # m/s within which it then moves as one
SPANNED = 1e-9  # part of the largest below which a direction of a cluster's constraints is none
APART = 1e-4  # m by which constraints on two members may disagree without a word


@ti.data_oriented
class Clusters:
    """The clusters of a model's particles.

    Attributes:
        a, b: (k,) the particles that each stitch joins, seam by seam.
        label: (n,) cluster of each particle, or -1.
        member: (m,) the members, cluster by cluster; first: (clusters + 1,) where each one's begin.
        led: whether the last solve closed gaps.
        notes: sentences for the user, of the simulation.
    """

    def __init__(self, fields: Fields, model, scene: Scene) -> None:
        self.model = model
        self.a, self.b = (np.concatenate([model.particle[getattr(s, name) + s.cloth.start] for s in scene.seams])
                          for name in "ab")
        self._gather(np.ones(len(self.a), dtype=bool))
        self._refuse_collapsed(scene)
        self.of = fields.integer(model.n, data=self.label)
        most = len(self.member) // 2 + 1
        self.begins = fields.integer(most, data=_padded(self.first, most))
        self.size = fields.integer(1, data=np.array([self.count]))  # clusters, as kernels read them
        self.members = fields.integer(len(self.member), data=self.member)
        self.led = self.pulled = False  # pulled: whether some stitches are drawn together by a force, and hold nothing yet
        self._cloths, self._script, self._told = scene.cloths, scene.script, False
        self.notes: list[str] = []

    def _gather(self, whole: np.ndarray) -> None:
        """Clusters by the stitches (k,) that are whole."""
        model = self.model
        self.label = connected(model.n, self.a[whole], self.b[whole])
        self.member = np.flatnonzero(self.label >= 0)[np.argsort(self.label[self.label >= 0], kind="stable")]
        self.count = int(self.label.max(initial=-1)) + 1
        self.first = np.searchsorted(self.label[self.member], np.arange(self.count + 1))
        total = np.bincount(self.label[self.member], model.mass[self.member], self.count)
        self.mass_fraction = model.mass[self.member] / total[self.label[self.member]]

    def connect(self, whole: np.ndarray) -> None:
        """Only the stitches (k,) that are whole hold anything from now on."""
        self._gather(whole)
        write(self.of, self.label.astype(np.int32))
        write(self.begins, _padded(self.first, self.begins.rows).astype(np.int32))
        write(self.size, np.array([self.count], dtype=np.int32))
        write(self.members, np.concatenate([self.member, np.zeros(self.members.rows - len(self.member))]).astype(np.int32))

    @property
    def _cluster(self) -> np.ndarray:
        """(m,) cluster of each member."""
        return self.label[self.member]

    @property
    def representative(self) -> np.ndarray:
        """(n,) one particle of each cluster for all of them; itself where nothing is sewn."""
        out = np.arange(self.model.n)
        out[self.member] = self.member[self.first[self._cluster]]
        return out

    @property
    def open(self) -> bool:
        """Whether anything that is sewn is apart, or moves apart, where the model is."""
        apart = self._measure()
        return bool(apart[0] > 0 or apart[1] > 0)

    @property
    def gap(self) -> float:
        """Largest distance [m] of a particle from the mean of its cluster."""
        return float(self._measure()[0])

    def _refuse_collapsed(self, scene: Scene) -> None:
        for cloth in scene.cloths:
            corner = self.label[self.model.particle[cloth.mesh.faces + cloth.start]]
            twice = (corner >= 0) & (corner == np.roll(corner, 1, axis=1))
            if twice.any():
                f = int(np.flatnonzero(twice.any(axis=1))[0])
                raise SceneError(f"the seams of {cloth.name!r} sew two corners of face {f} to each other: "
                                 f"vertices {cloth.mesh.faces[f].tolist()}")

    def _mean(self, rows: np.ndarray) -> np.ndarray:
        """(clusters, 3) means of rows (m, 3) of the members."""
        size = np.diff(self.first)[:, None]
        return np.add.reduceat(rows, self.first[:-1], axis=0) / size

    # in kernels

    @ti.func
    def mean(self, i, q: ti.template()):
        """(S q)_i, the same bits for all members."""
        out = q[i]
        k = self.of[i]
        if k >= 0:
            lo, hi = self.begins[k], self.begins[k + 1]
            first = q[self.members[lo]]
            rest = first * 0
            for j in range(lo + 1, hi):
                rest += q[self.members[j]] - first
            out = first + rest / (hi - lo)
        return out

    def lead(self, dv, h: float, zero: bool, moved: bool) -> bool:
        """Whether anything is apart; if so, dv becomes S dv + z (S dv = 0 with `zero`).

        Args:
            moved: the model is no longer at the start of the step: x + h dv is where it goes, and not x + h (v + dv).
        """
        self.led = self.open
        if self.led:
            self._lead(dv, h, int(zero), int(moved))
        return self.led

    @ti.kernel
    def _lead(self, dv: ti.template(), h: float, zero: int, moved: int):
        """dv = S dv + z. z changes the members' velocities against their mean, so that the gap at the start of the step is
        closed in h, or as much of it as CLOSING allows."""
        for k in range(self.size[0]):
            lo, hi = self.begins[k], self.begins[k + 1]
            some = self.members[lo]
            x, v, change = self.mean(some, self.model.x), self.mean(some, self.model.v), (1 - zero) * self.mean(some, dv)
            began, widest = self.mean(some, self.model.x_saved), self.spread_of(k, self.model.x_saved)
            kept = 0.0  # of the gap
            if widest > CLOSING * h:
                kept = 1 - CLOSING * h / widest
            for j in range(lo, hi):
                i = self.members[j]
                dv[i] = change + (kept * (self.model.x_saved[i] - began) - (self.model.x[i] - x)) / h
                if moved == 0:
                    dv[i] -= self.model.v[i] - v

    @ti.func
    def spread_of(self, k, q: ti.template()):
        """Largest distance of a member's q from the mean of its cluster k."""
        widest = 0.0
        for j in range(self.begins[k], self.begins[k + 1]):
            i = self.members[j]
            widest = ti.max(widest, (q[i] - self.mean(i, q)).norm())
        return widest

    @ti.kernel
    def _measure(self) -> ti.types.vector(2, float):
        """Largest distances of positions [m] and velocities [m/s] from their means."""
        x, v = 0.0, 0.0
        ti.loop_config(serialize=self.model.blocks.serial)
        for k in range(self.size[0]):
            ti.atomic_max(x, self.spread_of(k, self.model.x))
            ti.atomic_max(v, self.spread_of(k, self.model.v))
        return ti.Vector([x, v])

    @ti.kernel
    def _settle(self, near: float, slow: float):
        """Members within `near` [m] of each other are put into one place, bit for bit; so are velocities within `slow`
        [m/s]."""
        for k in range(self.size[0]):
            if self.spread_of(k, self.model.x) < near:
                same = self.spread_of(k, self.model.v) < slow
                some = self.members[self.begins[k]]
                x, v = self.mean(some, self.model.x), self.mean(some, self.model.v)
                for j in range(self.begins[k], self.begins[k + 1]):
                    self.model.x[self.members[j]] = x
                    if same:
                        self.model.v[self.members[j]] = v

    # for a step

    def settle(self, resolution: float) -> None:
        """Members that came together are put into one place; `resolution` [m] is the rounding of positions."""
        if self.led:
            self.model.moved()
            self._settle(max(TOGETHER, 8 * resolution), RESTING)

    def spread(self, held: Held | None, h: float) -> Held | None:
        """A constraint of a member holds for its cluster: adds rows for the other members. Members that are held at
        several places are led to the middle between these, which a note tells.

        Args:
            h: step [s] in which members that are apart come nearer.
        """
        if held is None or not (mine := self.label[held.index] >= 0).any():
            return held
        groups, group = np.unique(self.label[held.index[mine]], return_inverse=True)
        left = self._left(h)
        P = held.projector[mine].astype(np.float64)
        goal = held.target[mine] - left[held.index[mine]]
        total, asked, y = np.zeros((len(groups), 3, 3)), np.zeros((len(groups), 3)), np.zeros((len(groups), 3))
        np.add.at(total, group, P)
        np.add.at(asked, group, np.einsum("kij,kj->ki", P, goal))
        np.add.at(y, group, np.einsum("kij,kj->ki", P, held.y[mine]))
        values, vectors = np.linalg.eigh(total)
        spans = values > SPANNED * values[:, -1:]
        inverse = np.einsum("gij,gj,gkj->gik", vectors, np.where(spans, 1 / np.where(spans, values, 1), 0), vectors)
        projector = np.einsum("gij,gj,gkj->gik", vectors, spans.astype(float), vectors)
        if not self._told and (np.bincount(group) > 1).any():
            self._tell(held.index[mine], P, held.target[mine], group, inverse)
        target, y = (np.einsum("gij,gj->gi", inverse, b) for b in (asked, y))
        whole = spans.all(axis=1)
        projector[whole] = np.eye(3)
        full = np.trace(P, axis1=1, axis2=2) > 2.5
        target[group[full]] = goal[full]  # as it is, bit for bit
        row = np.full(self.count, -1)
        row[groups] = np.arange(len(groups))
        missing = self.member[(row[self._cluster] >= 0) & ~np.isin(self.member, held.index)]
        index = np.concatenate([held.index, missing])
        at = np.concatenate([np.flatnonzero(mine), np.arange(len(held.index), len(index))])
        of = row[self.label[index[at]]]
        new = (projector[of], target[of] + left[index[at]], y[of])
        P, goal, y = (_replaced(old, at, value, len(index)) for old, value in zip((held.projector, held.target, held.y), new))
        return Held(kernel_array(index, np.int32), P, goal, held.moving or self.open, y)

    def _tell(self, index: np.ndarray, P: np.ndarray, target: np.ndarray, group: np.ndarray, inverse: np.ndarray) -> None:
        """A note, once, where members, index (k,) of groups (k,), are held at places that are not one, by pins or motions.
        Where solids alone hold them, as an armpit does, there is nothing to do."""
        by_hand = np.concatenate([np.zeros(0, dtype=int), *(a.cloth.start + a.vertices for a in self._script.attachments)])
        said = np.zeros(len(inverse), dtype=bool)
        np.logical_or.at(said, group, np.isin(self.model.user[index], by_hand))
        asked = np.zeros((len(inverse), 3))
        np.add.at(asked, group, np.einsum("kij,kj->ki", P, target))
        off = np.einsum("kij,kj->ki", P, np.einsum("gij,gj->gi", inverse, asked)[group] - target)
        far = np.linalg.norm(off, axis=1) * said[group]
        if far.max() > APART:
            worst = int(far.argmax())
            vertex = int(self.model.user[index[worst]])
            cloth = next(c for c in reversed(self._cloths) if c.start <= vertex)
            self._told = True
            self.notes.append(f"vertex {vertex - cloth.start} of {cloth.name!r} is held, and sewn to vertices held elsewhere: "
                              f"both are led to one place, it by {far[worst]:.2g} m; unpin one, or give the seam a pull")

    def _left(self, h: float) -> np.ndarray:
        """(n, 3) where particles will be against the mean of their clusters after a step of h [s]."""
        out = np.zeros((self.model.n, 3))
        if self.open:
            x = self.model.read_particles()[0][self.member]
            away = x - self._mean(x)[self._cluster]
            widest = np.maximum.reduceat(np.linalg.norm(away, axis=1), self.first[:-1])
            kept = 1 - np.minimum(1.0, CLOSING * h / np.maximum(widest, 1e-300))
            out[self.member] = kept[self._cluster, None] * away
        return out

    def shared(self, index: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """External part of impulses (k, 3) on constrained particles, index (k,) with all members of their clusters: shared out
        by the members' masses, without their forces on each other."""
        mine = np.flatnonzero(self.label[index] >= 0)
        if not len(mine):
            return rows
        own = self.label[index[mine]]
        total = np.stack([np.bincount(own, rows[mine, c], self.count) for c in range(3)], axis=1)
        share = np.zeros(self.model.n)
        share[self.member] = self.mass_fraction
        out = rows.copy()
        out[mine] = share[index[mine], None] * total[own]
        return out

    def tension(self, residual: np.ndarray) -> np.ndarray:
        """(n, 3) the part of A dv - b (n, 3) that members put on each other."""
        rows = residual[self.member]
        total = np.stack([np.bincount(self._cluster, rows[:, c], self.count) for c in range(3)], axis=1)
        out = np.zeros_like(residual)
        out[self.member] = rows - self.mass_fraction[:, None] * total[self._cluster]
        return out


def _replaced(old: np.ndarray, at: np.ndarray, value: np.ndarray, n: int) -> np.ndarray:
    """Rows of an array, n of them, some of which are replaced."""
    out = np.zeros((n, *old.shape[1:]), dtype=old.dtype)
    out[:len(old)] = old
    out[at] = value
    return out


def _padded(first: np.ndarray, rows: int) -> np.ndarray:
    """The array with `rows` rows: its last row is repeated."""
    return np.concatenate([first, np.full(rows - len(first), first[-1])])


def connected(n: int, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n,) a number from 0 for each component that pairs a, b (k,) connect, -1 for particles without a partner."""
    _, index, size = np.unique(components(n, a, b), return_inverse=True, return_counts=True)
    several = size > 1
    return np.where(several[index], (np.cumsum(several) - 1)[index], -1)
