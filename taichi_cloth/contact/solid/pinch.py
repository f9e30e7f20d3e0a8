"""Cloth between two surfaces of solids that leave it no room: it is held midway between them, and rubs along them. [BWK03 §5,
flypaper] numpy only.

An arm may close on a trunk, or a body pass through itself: no place is outside both. A particle there has a height
above either surface; their sum is the room. If it ends below the need of both thicknesses, the particle is pinched: the
direction across is held (S = I - n n^T), z leads it by the mean of both surfaces' motions, and towards its share of the room
at a bounded speed. Along them both rub it, as if pressed by PRESSURE. It has no contacts, and crossings there do not
count. Once there is a quarter more room than needed, and it is outside both, it is free again.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ...scene.scene import Scene
from ...system.checkpoint import Checkpointed
from ...system.elements import lumped_mass
from ...system.held import Held
from ..points import EYE, ContactRows, length, rows_of, sym_outer, sym_times, tangential, unit
from ..stack_order import StackOrder
from ..step_start import StepContext
from .facing import SURE, FacingSurfaces, Sides
from .query import SolidCollisionDetector
from .room import FACING
from .vertices import VertexContacts

WHOLE, WEDGE = 0.0, 0.5  # below which they need all of their room, next to pinched particles, and above which none
SAME = 0.5  # cosine between the normals of one side from step to step
FREE = 1.25  # times the room needed: with more, a pinched particle is free
SLOWLY = 0.05  # m/s by which pinched particles go to their share of the room, besides the surfaces' own motions
SHARE = 0.2  # of the room that is kept from either side
CLEAR = 0.1  # of the room that the order of layers leaves on either side. Without, three sheets pass through plates (`pinch`)
PRESSURE = 2000.0  # Pa with which surfaces without room between them press, as far as friction goes: flesh yields
LAGGED = 0.1  # relative error of friction that a first solve may leave
CREEP = 0.0005  # m/s against the surfaces below which friction is less, and proportional to it
SQUEEZED = 0.5  # of the room needed: layers that are pinched are led apart as if there were so much


@dataclass(frozen=True)
class Pinched:
    """Particles between two surfaces.

    Attributes:
        index: (k,) particles, sorted.
        solid: (k, 2) of either side; normal: (k, 2, 3) out of it; height: (k, 2) above it when last looked [m].
        share: (k,) of the room that is below the particle, from the first side.
        friction: (k, 3) [N] with which the last accepted step ended.
    """

    index: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    solid: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), dtype=np.int64))
    normal: np.ndarray = field(default_factory=lambda: np.zeros((0, 2, 3)))
    height: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    share: np.ndarray = field(default_factory=lambda: np.zeros(0))
    friction: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True)
class Between:
    """Particles index (k,) between two sides each, in a step."""

    index: np.ndarray
    a: Sides
    b: Sides

    @property
    def opening(self) -> np.ndarray:
        """(k,) by how much [m] there is more room at the end of the step."""
        return np.einsum("ki,ki->k", self.a.normal - self.b.normal, self.b.motion - self.a.motion) / 2

    @property
    def room(self) -> np.ndarray:
        """(k,) [m] at the end of the step, where a particle goes with the mean of both."""
        return self.a.height + self.b.height + self.opening

    @property
    def cosine(self) -> np.ndarray:
        """(k,) between the normals."""
        return np.einsum("ki,ki->k", self.a.normal, self.b.normal)

    def take(self, which: np.ndarray) -> "Between":
        """Some of them."""
        return Between(self.index[which], self.a.take(which), self.b.take(which))


class Flypaper(Checkpointed):
    """The pinched particles of a model.

    Args:
        particle: (n,) of a vertex.

    Attributes:
        between: (n,) [m] distance that its cloth keeps from cloth; 0 where it meets none. area: (n,) of cloth [m^2].
        possible: whether a scene's solids can close on each other, or on themselves, at all: two of which one moves, or one
            that deforms.
        accepted: as of the last accepted step; trial: of this attempt.
        order: of layers of cloth between the surfaces, or None where cloth does not meet cloth.
        where: (n,) whether a particle is pinched in this attempt; around: whether it is, or shares a face with one that is.
        target: (k, 3) where they are led [m]; led: (k,) whether they are, and not held by a script; forces: (k, 3) [N] that it
            took in the last solve.
        contacts: k of them as one contact with both surfaces each, with the normal across; slip: (k, 3) [m/s] that
            the last solve expected against them; rubbing: its friction.
    """

    STATE = ("accepted", "order")

    def __init__(self, n: int, particle: np.ndarray, detector: SolidCollisionDetector, scene: Scene) -> None:
        self.detector, self.thickness = detector, detector.thickness
        self.between, self.area = np.zeros(n), np.zeros(n)
        for c in scene.cloths:
            mine = particle[c.start: c.start + c.mesh.vertex_count]
            self.area[mine] = lumped_mass(c.mesh, 1.0)
            if c.contact is not None:
                self.between[mine] = c.contact.thickness
        self.possible = bool(detector.yields.any() or (len(scene.solids) > 1 and detector.moves.any()))
        tree = detector.tree if self.possible and detector.meshes.any() else None
        self.surfaces = FacingSurfaces(tree) if tree is not None else None
        self.accepted = self.trial = Pinched()
        self.order: StackOrder | None = None
        self.where, self.around = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self.target = self.forces = np.zeros((0, 3))
        self.led = np.zeros(0, dtype=bool)
        self.contacts, self.rubbing = VertexContacts.none(), ContactRows.none()
        self.slip = self.before = self.rubs = np.zeros((0, 3))

    def resumed(self) -> None:
        """See `Checkpointed`."""
        self.trial = self.accepted
        self.target = self.forces = np.zeros((len(self.trial.index), 3))
        self.led = np.zeros(len(self.trial.index), dtype=bool)
        self.contacts, self.rubbing, self.rubs = VertexContacts.none(), ContactRows.none(), self.trial.friction
        self._mark()

    def _mark(self) -> None:
        self.where = np.zeros(len(self.where), dtype=bool)
        self.where[self.trial.index] = True
        self.around = self.where.copy()
        self.around[self.detector.faces[self.where[self.detector.faces].any(axis=1)]] = True

    def clear(self) -> None:
        """Nothing is pinched: the state was changed from outside."""
        self.accepted = Pinched()
        if self.order is not None:
            self.order.clear()
        self.resumed()

    def begin(self, start: StepContext, found: VertexContacts) -> None:
        """A new attempt, with the contacts that were found on the predicted way."""
        if not self.possible:
            return
        known, share = self._known(start)
        new = self._entering(start, found)
        new = new.take(~np.isin(new.index, known.index))
        new = new.take(self._grows(known.index, new))
        both = Between(np.concatenate([known.index, new.index]), Sides.join([known.a, new.a]), Sides.join([known.b, new.b]))
        height = np.maximum(np.stack([new.a.height, new.b.height], axis=1), 1e-12)
        share = np.concatenate([share, np.clip(height[:, 0] / height.sum(axis=1), SHARE, 1 - SHARE)])
        order = np.argsort(both.index, kind="stable")
        both, share = both.take(order), share[order]
        self.trial = Pinched(both.index, np.stack([both.a.solid, both.b.solid], axis=1),
                             np.stack([both.a.normal, both.b.normal], axis=1),
                             np.stack([both.a.height, both.b.height], axis=1), share, self._rubbed(both.index))
        self.target, self.contacts = self._lead(start, both, share), self._as_contacts(start, both)
        self.forces, self.rubbing, self.rubs = np.zeros_like(self.target), ContactRows.none(), self.trial.friction
        self._mark()

    def _rubbed(self, index: np.ndarray) -> np.ndarray:
        """(k, 3) friction [N] on particles (k,) at the end of the last step; 0 where they were not pinched."""
        row = rows_of(self.accepted.index, index)
        if not len(self.accepted.index):
            return np.zeros((len(row), 3))
        return np.where((row >= 0)[:, None], self.accepted.friction[row], 0.0)

    def _as_contacts(self, start: StepContext, both: Between) -> VertexContacts:
        """One contact with both surfaces for each: it is carried by the mean of their motions, and they rub together."""
        nothing, a, b = np.zeros(len(both.index)), both.a, both.b
        carried = start.x[both.index] + (a.motion + b.motion) / 2
        return VertexContacts(both.index, a.solid, unit(a.normal - b.normal), nothing, nothing, carried,
                              a.friction + b.friction, both.index)

    def _grows(self, known: np.ndarray, new: Between) -> np.ndarray:
        """(k,) which candidates are pinched: where surfaces face each other, and next to that. In a corner by itself, of
        a floor and a wall that moves for example, cloth is pushed along."""
        faces, out, inside = self.detector.faces, new.cosine < FACING, np.zeros(len(self.where), dtype=bool)
        inside[known] = True
        while True:
            inside[new.index[out]] = True
            around = inside.copy()
            around[faces[inside[faces].any(axis=1)]] = True
            more = around[new.index] & ~out
            if not more.any():
                return out
            out = out | more

    def _needed(self, both: Between) -> np.ndarray:
        """(k,) room [m] that both thicknesses take, and two layers of cloth that meets cloth; less between the sides of a
        wedge, out of which cloth can be pushed."""
        whole = self.thickness[both.a.solid] + self.thickness[both.b.solid] + self.between[both.index]
        return whole * np.clip((WEDGE - both.cosine) / (WEDGE - WHOLE), 0, 1)

    def _lead(self, start: StepContext, both: Between, share: np.ndarray) -> np.ndarray:
        """(k, 3) where particles are at the end of the step [m]."""
        a, b = both.a, both.b
        mean, apart = (a.motion + b.motion) / 2, a.normal - b.normal
        size = np.maximum(np.linalg.norm(apart, axis=1), 1e-30)
        across = apart / size[:, None]
        height = [s.height + np.einsum("ki,ki->k", s.normal, mean - s.motion) for s in (a, b)]
        wanted = (2 * share - 1) * np.maximum(both.room, SQUEEZED * self._needed(both))
        most = SLOWLY * start.h + np.abs(np.einsum("ki,ki->k", across, b.motion - a.motion)) / 2
        shift = np.clip((wanted - (height[0] - height[1])) / size, -most, most)
        out = start.x[both.index] + mean + shift[:, None] * across
        if self.order is None or not len(both.index):
            return out
        further = np.clip(self.order.shift(start.x, both.index, out, across), -most, most)
        low, high = ((h - CLEAR * both.room) * 2 / size for h in (height[0] + shift * size / 2, height[1] - shift * size / 2))
        kept = np.clip(further, np.minimum(-low, 0), np.maximum(high, 0))  # within the room, where there is any
        return out + np.where(both.room > 0, kept, further)[:, None] * across

    def _known(self, start: StepContext) -> tuple[Between, np.ndarray]:
        """Particles that were pinched and still are, and their shares."""
        old = self.accepted
        a, b = (self._side(start, old, k) for k in range(2))
        both = Between(old.index, a, b)
        there = (a.solid >= 0) & (b.solid >= 0) & (both.cosine < WEDGE)  # else it came out of the wedge, at either end
        inside = np.minimum(a.height, b.height) < 0
        keep = there & ((both.room < FREE * self._needed(both)) | inside)
        for side in (a, b):
            keep &= self._below(start.x[old.index], side)
        return both.take(keep), old.share[keep]

    def _below(self, x: np.ndarray, side: Sides) -> np.ndarray:
        """(k,) whether points x (k, 3) [m] that are inside the plane of a mesh's surface are below that surface, and not past
        its border: as an arm leaves a trunk sideways, or where cloth slips through the edge of both."""
        inside = (side.solid >= 0) & (side.height < -self.thickness[side.solid])
        deep = np.flatnonzero(inside & self.detector.meshes[side.solid])
        out = np.ones(len(x), dtype=bool)
        if len(deep) and self.surfaces is not None:
            reach = -side.height[deep] / SURE
            out[deep] = self.surfaces.find(x[deep], side.normal[deep], SAME, reach, np.full(len(deep), -np.inf),
                                           side.solid[deep], np.full(len(deep), -1)).solid >= 0
        return out

    def _side(self, start: StepContext, old: Pinched, k: int) -> Sides:
        """One side of pinched particles, where it is now; of a mesh next to where its foot was: not of another part of it."""
        solid, x = old.solid[:, k], start.x[old.index]
        sides, analytic = self._above(x, solid), ~self.detector.meshes[solid]
        if analytic.all() or self.surfaces is None:
            return sides
        part = np.flatnonzero(~analytic)
        above = old.height[part, k, None] * old.normal[part, k]
        reach = 2 * self.detector.fastest + self.thickness[solid[part]]
        foot = self.surfaces.find(x[part] - above, old.normal[part, k], SAME, reach, np.full(len(part), -np.inf), solid[part],
                                  np.full(len(part), -1), sure=0.0)
        _fill(sides, part, replace(foot, height=foot.height + np.einsum("ki,ki->k", above, foot.normal)))
        return sides

    def _above(self, x: np.ndarray, solid: np.ndarray) -> Sides:
        """Solids (k,) as sides of points x (k, 3) [m]; of meshes nothing."""
        nothing = np.zeros(len(x))
        sides = Sides(np.full(len(x), -1), np.zeros((len(x), 3)), nothing, np.zeros((len(x), 3)), nothing.copy())
        rows = np.flatnonzero(~self.detector.meshes[solid])
        height, normal, motion = self.detector.above(x[rows], solid[rows])
        _fill(sides, rows, Sides(solid[rows], normal, height, motion, self.detector.friction[solid[rows]]))
        return sides

    def _entering(self, start: StepContext, found: VertexContacts) -> Between:
        """Particles that get pinched in this step: between a solid in contact, and another solid or another part of a mesh
        that deforms."""
        detector, sides, parts = self.detector, self._above(start.x[found.index], found.solid), []
        if self.surfaces is not None:
            thick, nothing = self.thickness[found.solid], np.full(len(found.solid), -1)
            reach = thick + self.thickness.max() + self.between[found.index] + 2 * detector.fastest
            least = np.where(detector.closed[found.solid], -thick, 0.0)  # a sheet has its other side there
            on = np.flatnonzero(detector.meshes[found.solid])
            _fill(sides, on, self.surfaces.find(start.x[found.index[on]], found.normal[on], SAME, reach[on], least[on],
                                                found.solid[on], nothing[on]))
            on = np.flatnonzero((sides.solid >= 0) & (detector.moves[found.solid] | detector.moves[detector.meshes].any()))
            a, index = sides.take(on), found.index[on]
            b = self.surfaces.find(start.x[index], -a.normal, -WEDGE, reach[on] + np.linalg.norm(a.motion, axis=1), least[on],
                                   nothing[on], np.where(detector.yields[a.solid], -1, a.solid))
            parts.append(Between(index, a, b))
        for other in np.flatnonzero(~detector.meshes):
            rows = np.flatnonzero((found.solid != other) & (detector.moves[found.solid] | detector.moves[other]))
            index = found.index[rows]
            parts.append(Between(index, sides.take(rows), self._above(start.x[index], np.full(len(rows), other))))
        all_ = Between(np.concatenate([p.index for p in parts]), Sides.join([p.a for p in parts]),
                       Sides.join([p.b for p in parts]))
        all_ = all_.take((all_.a.solid >= 0) & (all_.b.solid >= 0))
        room = all_.room
        outside = (all_.a.height > -self.thickness[all_.a.solid]) & (all_.b.height > -self.thickness[all_.b.solid])
        pinched = outside & (room < self._needed(all_)) & (all_.opening < 0)
        rows = np.flatnonzero(pinched)
        rows = rows[np.lexsort((room[rows], all_.index[rows]))]  # the narrowest of each particle
        _, first = np.unique(all_.index[rows], return_index=True)
        return all_.take(rows[first])

    def with_pins(self, pins: Held | None) -> Held | None:
        """Particles held by scripts, and pinched ones. Scripts have their way with particles held in all directions."""
        index, target = self.trial.index, self.target
        self.led = np.ones(len(index), dtype=bool)
        if not len(index):
            return pins
        projector, y = np.einsum("ki,kj->kij", self.contacts.normal, self.contacts.normal), np.zeros_like(target)
        if pins is not None:  # particles they hold in part are held whole
            projector[np.isin(index, pins.index)] = np.eye(3)
            whole = pins.index[np.trace(pins.projector, axis1=1, axis2=2) > 2.5]
            self.led = ~np.isin(index, whole)
            other = ~np.isin(pins.index, index[self.led])
            index, projector, target, y = (np.concatenate([mine[other], part[self.led]]) for mine, part in zip(
                (pins.index, pins.projector, pins.target, pins.y), (index, projector, target, y)))
        return Held.of(index, projector, target, True, y, self.detector.exchange)

    def rub(self, start: StepContext, there: np.ndarray, v: np.ndarray) -> ContactRows:
        """Friction of the surfaces on both sides, with where particles are expected at the end, there (n, 3) [m], in a solve
        that begins with velocities v (n, 3) [m/s]: a damping F / max(|u|, CREEP) along them, u the expected slip. It counts
        from that at which friction would be what it was at the end of the last step: pinched cloth does not creep."""
        f, c = self.contacts, start.c
        if len(f.index):
            bearable = self._bearable()
            before = -CREEP * tangential(self.trial.friction, f.normal) / np.maximum(bearable, 1e-300)[:, None]
            self.before = before * np.minimum(1.0, CREEP / np.maximum(length(before), 1e-300))[:, None]
            self.slip = self._slip(start, there)
            size = c * bearable / np.maximum(length(self.slip), CREEP)
            block = size[:, None] * (EYE - sym_outer(f.normal))
            against = start.mean(v)[f.index] - (f.carried - start.x[f.index]) / start.h + self.before
            self.rubbing = ContactRows.at(f.index, c / start.h * block, -sym_times(block, against))
        return self.rubbing

    def _slip(self, start: StepContext, there: np.ndarray) -> np.ndarray:
        """(k, 3) velocities [m/s] against the surfaces, of particles that end there (n, 3) [m], as friction counts them."""
        f = self.contacts
        return tangential((there[f.index] - f.carried) / start.h, f.normal) + self.before

    def _bearable(self) -> np.ndarray:
        """(k,) friction [N] of the surfaces on both sides at most."""
        f = self.contacts
        return f.friction * PRESSURE * self.area[f.index] * self.led

    def lags(self, start: StepContext, there: np.ndarray) -> bool:
        """Whether friction of the last solve differs from that by the slip at its end (n, 3) [m] by more than LAGGED."""
        if not len(self.contacts.index):
            return False
        size, now = self._bearable(), length(self._slip(start, there))
        taken, wanted = (now / np.maximum(u, CREEP) for u in (length(self.slip), now))
        return float(np.sum(size * np.abs(taken - wanted))) > LAGGED * float(np.sum(size))

    def record_forces(self, held: Held | None, reaction: np.ndarray, moved: np.ndarray, c: float) -> None:
        """Remembers forces of the last solve: `reaction` (k, 3) [N] on held particles, and friction where particles moved by
        (n, 3) [m]; c: the factor by which the method multiplies forces [s]."""
        if held is not None and len(self.trial.index):
            whole = np.zeros((len(self.where), 3))
            whole[held.index] = reaction
            self.forces = whole[self.trial.index] * self.led[:, None]
            self.rubs = self.rubbing.forces(moved, c)
            self.forces += self.rubs

    def commit(self, x: np.ndarray) -> None:
        """The step was accepted, and ended at x (n, 3)."""
        self.accepted = replace(self.trial, friction=self.rubs)
        if self.order is not None:
            self.order.commit(x, self.accepted.index)


def _fill(sides: Sides, rows: np.ndarray, part: Sides) -> None:
    """Writes a part of sides down."""
    for name in sides.__dataclass_fields__:
        getattr(sides, name)[rows] = getattr(part, name)
