"""Cloth against solids: which contacts hold, stick and slide, round by round of a step. [BW98 §5, §6]

A particle in contact has its normal direction held (all directions while friction holds it), moves with the
solid (z), and is brought to the surface by y, inside the solve. The states of contacts follow from the solve's own
constraint force, within the step (`balance`).

Differs from [BW98 §6]: states are settled within the step, not in the next; y also brings a particle down to the
surface that it would otherwise have gone through, so that a solid is met inelastically, without a bounce.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...backend.fields import Fields
from ...options import USUAL
from ...scene.scene import Scene
from ...system.checkpoint import Checkpointed
from ...system.held import pinned_particles
from ...system.place import Place
from ...system.state import ParticleState
from ..points import ContactRows, Pushes, among, rows_of
from ..step_start import StepContext
from .active_set import ActiveSet, States, hold_together
from .pairs import PAIR, REPULSION, LoadStiffness, Pairs, Step, inertia, linearize_repulsion
from .penetration import Penetration
from .pinch import Flypaper
from .query import ContactCandidates, SolidCollisionDetector
from .sliding import Sliding
from .vertices import VertexContacts

EARTH = 9.81  # m/s^2: forces and speeds are compared with what weight makes there, also where gravity is less
FALL = 0.5  # of the thickness: from higher than that and than its motion leads, nothing is brought down to a solid
REACH, PUSH = 4.0, 0.25  # mean edges that a particle may close in on a solid in one step; that it is pushed out in a usual
# one: more would tear at the triangles


@dataclass(frozen=True)
class Forces:
    """Forces of solids on cloth in the last solve.

    Attributes:
        held: (k, 3) [N] on the particles of the active set, with friction of the sliding ones.
        pairs: (j, 3) [N] on the places of pairs; at: (j, 3) where these are [m].
    """

    held: np.ndarray
    pairs: np.ndarray
    at: np.ndarray


NO_FORCES = Forces(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


class SolidContacts(Checkpointed):
    """The contacts of a model's cloth with a scene's solids.

    Attributes:
        start: of the attempt; detector: looks for contacts; thickness_ramp: of the thickness that pairs go by; penetration:
            judges which particles are too deep; pinches: cloth that solids leave no room.
        reach: how far [m] a particle may close in on a solid in one step.
        accepted: states with which the last accepted step ended; trial: those of the last solve of this attempt.
        pinned: (n,) whether all directions of a particle are held anyway: solids hold nothing there.
        near: contacts and pairs when last looked; active: contacts that the last solve held; sliding, linearized, repulsion:
            friction, pairs and their points as it took them; forces: of all these.
        unsettled: contacts that do not agree with the last solve, where solves ended before all did.
    """

    STATE = ("accepted", "penetration", "pinches", "thickness_ramp", "adaptive_stiffness")

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, start: StepContext) -> None:
        self.model, self.gravity, self.start = model, scene.gravity, start
        self.detector = SolidCollisionDetector(fields, model, scene)
        self.thickness_ramp = self.detector.thickness_ramp
        self.penetration = Penetration(model.n, self.detector)
        self.pinches = Flypaper(model.n, model.particle, self.detector, scene)
        self.adaptive_stiffness = LoadStiffness()
        self.reach = REACH * self.detector.edge
        self.trial = self.accepted = States()
        self.unsettled = 0
        self.pinned = np.zeros(model.n, dtype=bool)
        nowhere = np.zeros((model.n, 3))
        self.near = ContactCandidates(nowhere, VertexContacts.none(), np.zeros((0, 3)), None, nowhere)
        self.active = ActiveSet.none()
        self.sliding, self.repulsion, self.forces = Sliding(), ContactRows.none(), NO_FORCES
        self.linearized: Pairs | None = None

    @property
    def thickness(self) -> np.ndarray:
        """(solids,) [m]"""
        return self.detector.thickness

    def begin(self, start: StepContext) -> StepContext:
        """A new attempt; the model is at its predicted end. Returns its start, with pinched particles among the pins."""
        self.trial, self.unsettled = self.accepted, 0
        self.penetration.crossed = self.penetration.before
        if self.detector.pairs is not None:
            self.adaptive_stiffness.begin()
        self.detector.seek(self.penetration.sought)
        near = self.detector.look(start.h)
        if self.pinches.possible:
            self.pinches.begin(start, near.vertices)
            start = replace(start, pins=self.pinches.with_pins(start.pins))
        self.penetration.pinched = self.pinches.around
        self.near, self.start = self._minded(near), start
        self.pinned = pinned_particles(self.start.pins, self.model.n)
        return self.start

    def let_out(self, particles: np.ndarray, depth: np.ndarray) -> None:
        """Particles (k,) start as deep [m] inside solids."""
        self.penetration.let_out(particles, self.start.h_usual * depth / (PUSH * self.detector.edge))

    def look(self) -> None:
        """Contacts and pairs of cloth on its way to where it now is, and how fast it slips there."""
        self.near = self._minded(self.detector.look(self.start.h))

    def _minded(self, near: ContactCandidates) -> ContactCandidates:
        """Without pinched particles; raised particles are measured from where they are to be."""
        return self.penetration.raise_from(near.without(self.pinches.where, self.pinches.around))

    def stop_short(self) -> None:
        """The model went a part of its way only: edges and corners of solids are met as they are from there."""
        near = replace(self.near, end_positions=self.model.read_particles()[0], pairs=self.detector.find_pairs())
        self.near = replace(near, pairs=self._minded(near).pairs)

    @property
    def push(self) -> float:
        """How far [m] a particle is pushed out in this step: small steps move as fast as large ones."""
        return PUSH * self.detector.edge * self.start.share

    @property
    def touching(self) -> bool:
        """Whether anything was met when last looked."""
        return bool((self.near.vertices.gap < 0).any()) or self.near.any_pairs

    def choose_active(self) -> float:
        """Chooses the active contacts of the next solve, pins included: `active`. Returns the largest closing distance [m]."""
        f, old, start, c = self.near.vertices, self.trial, self.start, self.start.c
        where = rows_of(old.key, f.key)
        known = where >= 0
        active = (known | (f.gap < 0)) & ~self.pinned[f.index]
        f, slip, known, where = f.take(active), self.near.slip[active], known[active], where[active]
        k, mu, mass = len(f.index), f.friction, self.model.mass[f.index]
        stick, force, push = np.zeros(k, dtype=bool), np.zeros(k), np.zeros((k, 3))
        if known.any():
            stick[known], force[known] = old.stick[where[known]], old.force[where[known]]
            push[known] = old.push[where[known]]
        new = ~known
        if new.any():  # the force that stops the approach and carries the weight
            n = f.normal[new]
            arrive = start.base_v[f.index[new]] - (f.carried[new] - start.x[f.index[new]]) / start.h
            force[new] = mass[new] * np.maximum(0, -np.einsum("ki,ki->k", n, arrive) / c
                                                - n @ self.gravity)
            stick[new] = np.linalg.norm(slip[new], axis=1) * mass[new] <= mu[new] * force[new] * c
        stick &= mu > 0
        nearing = np.einsum("ki,ki->k", f.normal, f.carried - start.coasting[f.index])
        down = 2 * np.maximum(nearing, 0) + FALL * start.share * self.thickness[f.solid]  # no further than its own way leads
        normal_shift = np.clip(-f.start_gap, -down, self.push)
        holding = hold_together(f, stick, normal_shift, start.pins, self.model.n, self.model.exchange)
        if self.model.sewn is not None:
            holding = replace(holding, held=self.model.sewn.spread(holding.held, c))
        self.active = ActiveSet(f, States(f.key, stick, force, push), slip, normal_shift, holding)
        return float(np.max(-normal_shift, initial=0.0))

    def hit(self) -> bool:
        """Whether cloth comes at a solid, along its normal, faster than it would fall in the step: an impact, and no motion
        that goes on from the step before."""
        f, start = self.near.vertices, self.start
        new = (f.gap < 0) & ~among(self.accepted.key, f.key)
        f = f.take(new & (self.pinned[f.index] == 0))
        arrive = (f.carried - start.x[f.index]) / start.h - start.v[f.index]
        return bool((np.einsum("ki,ki->k", f.normal, arrive) > EARTH * start.h).any())

    @property
    def held_keys(self) -> np.ndarray:
        """Sorted keys of contacts that were held in the last solve, by pins too."""
        mine, f = self.active.contacts.key, self.near.vertices
        by_pins = f.key[self.pinned[f.index]]
        return np.union1d(mine, by_pins) if len(by_pins) else mine

    def take_others(self, base: tuple[np.ndarray, np.ndarray], led: bool) -> list[ContactRows]:
        """Friction of pinched particles, and pairs, for a solve that begins at base: positions and velocities, each (n, 3).

        Args:
            led: whether pairs are linearized with held particles at their targets. Else they are where they are.
        """
        mass, start = self.model.mass, self.start
        if self.pinches.possible:
            self.pinches.rub(start, self.near.end_positions, base[1])
        rubbing = [self.pinches.rubbing]
        if self.near.pairs is None:
            return rubbing
        to_go = self._to_go() if led else np.zeros_like(self.near.end_positions)
        near = self.near.pairs.moved(to_go, PAIR * self.detector.kept_by(self.near.pairs))
        self.linearized = near
        step = Step(start.h, start.h_usual, start.x, base[0], start.mean(base[1]), start.c)
        self.repulsion = linearize_repulsion(near, step, mass, self.detector.kept_by(near), self.detector.friction_of(near),
                                             self.adaptive_stiffness.trial.of(near.key))
        return [*rubbing, self.repulsion]

    def holds(self) -> np.ndarray:
        """(n,) whether the last solve held a particle at a solid."""
        out = np.zeros(self.model.n, dtype=bool)
        out[self.active.contacts.index] = True
        return out

    @property
    def rubbing(self) -> ContactRows:
        """Friction of particles that slide on solids, and of those that slip between them."""
        return ContactRows.join([self.sliding.points, self.pinches.rubbing])

    def _to_go(self) -> np.ndarray:
        """(n, 3) how far held particles have to go from where pairs were looked for."""
        out, held = np.zeros_like(self.near.end_positions), self.active.holding.held
        if held is not None:
            out[held.index] = np.einsum("kij,kj->ki", held.projector, held.target - self.near.end_positions[held.index])
        return out

    def wanting(self) -> int:
        """Pairs of edges that the last solve left nearer than they should be, or that get another stiffness after it."""
        inside = self.penetration.inside(self.near.vertices, self.held_keys)
        return self.penetration.left(self.near, inside, self.linearized)[0] + self._update_stiffness()

    def _update_stiffness(self) -> int:
        """Raises the stiffness of pairs that the last solve left too near, drops that of pairs that pull; how many changed."""
        taken, near = self.linearized, self.near.pairs
        if taken is None or near is None:
            return 0
        lost = self.penetration.below_least(self.near)
        if self.start.pins is not None:  # no stiffness helps pairs that a script squeezes
            lost &= ~np.isin(near.vertices, self.start.pins.index).any(axis=1)
        lost = near.key[lost]
        return self.adaptive_stiffness.update(np.isin(taken.key, lost), taken.key, *self._loads(taken))

    def _loads(self, taken: Pairs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pairs (k,) of the last solve: (load [N], range [m], stiffness of their law [N/m])."""
        load = np.einsum("ki,ki->k", self.forces.pairs, taken.normal)
        return load, PAIR * self.detector.kept_by(taken), REPULSION / USUAL**2 * inertia(taken, self.model.mass)

    def record_forces(self, reaction: np.ndarray, base: np.ndarray) -> None:
        """Forces of contacts in the last solve, which was taken whole, to where cloth was last looked at.

        Args:
            reaction: (k, 3) impulse [N s] on the held particles, in the order in which they were held.
            base: (n, 3) positions with which the solve began [m].
        """
        f, states, h = self.active.contacts, self.active.states, self.start.c
        moved = self.near.end_positions - base
        F, normal = self.active.holding.forces(f, reaction / h)
        held = np.where(states.stick[:, None], F, normal[:, None] * f.normal)
        held[self.sliding.rows] += self.sliding.points.forces(moved, h)
        self.forces = replace(NO_FORCES, held=held)
        self._record_others(reaction, moved)

    def update_pairs(self, reaction: np.ndarray, moved: np.ndarray, solved: tuple[Pairs | None, ContactRows]) -> int:
        """Like `wanting`, after a linear solve: reaction (k, 3) on the particles that it held, motions (n, 3) [m] of all.

        Args:
            solved: the pairs that it took, and their points.
        """
        now = self.linearized, self.repulsion
        self.linearized, self.repulsion = solved
        self._record_others(reaction, moved)
        wanting = self.wanting()
        self.linearized, self.repulsion = now
        return wanting

    def _record_others(self, reaction: np.ndarray, moved: np.ndarray) -> None:
        """Forces of pinched particles, and of pairs, in a solve that moved particles by (n, 3) [m]."""
        h = self.start.c
        if self.pinches.possible:
            self.pinches.record_forces(self.active.holding.held, reaction / h, moved, h)
        if self.linearized is not None:
            self.forces = replace(self.forces, pairs=self.repulsion.forces(moved, h),
                                  at=self.linearized.of(self.near.end_positions))

    def ends_deep(self) -> bool:
        """Whether something ends too deep inside, in a step that can still be made smaller."""
        inside = self.penetration.inside(self.near.vertices, self.held_keys)
        return self.penetration.left(self.near, inside, self.linearized)[1] and self.may_shrink()

    def may_shrink(self) -> bool:
        """See `Penetration.may_shrink`."""
        return self.penetration.may_shrink(self.start, self.near, self.held_keys, self.linearized)

    def went_through(self) -> bool:
        """Whether cloth passes through solids where it did not before, in a step that can still be made smaller."""
        return self.penetration.look_across() and self.may_shrink()

    def rows_held(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Two flags for each held row (count,): whether solids hold it, and not pins alone; whether it is brought out of
        a solid that it was inside of."""
        solids, out, rows = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool), self.active.holding.rows
        solids[rows] = True
        out[rows[self.active.normal_shift > 0]] = True
        held = self.active.holding.held
        if held is not None:
            solids |= np.isin(held.index, self.pinches.trial.index[self.pinches.led])
        return solids, out

    def commit(self) -> None:
        """The step was accepted: the next begins from its contacts. Particles that end wrong in a small one are pinched."""
        self.penetration.pass_time(self.start.h, self.near.vertices)
        if self.pinches.possible:
            self.pinches.commit(self.model.read_particles()[0])
            self.penetration.spare(np.flatnonzero(self.pinches.around))
        if self.start.small:
            self.penetration.spare(self.penetration.wrong(self.near, self.held_keys, self.linearized))
        self.accepted, self.penetration.before = self.trial, self.penetration.crossed
        if self.linearized is not None:
            self.adaptive_stiffness.commit(self.linearized.key, *self._loads(self.linearized), self.start.share)
        self._grow()

    def pass_by(self) -> None:
        """A step without contact was accepted."""
        self.accepted = self.trial = States()
        self.active, self.forces, self.linearized, self.unsettled = ActiveSet.none(), NO_FORCES, None, 0
        self.penetration.pass_time(self.start.h, VertexContacts.none())
        self.adaptive_stiffness.clear()
        self._grow()

    def _grow(self) -> None:
        """Pairs that started nearer than their thickness have more of it after a step."""
        if self.thickness_ramp.active and self.near.pairs is not None:
            self.thickness_ramp.grow(self.near.pairs.vertices, self.detector.part_of(self.near.pairs))

    def clear(self) -> None:
        """Forgets all contacts: the state was changed from outside."""
        self.accepted, self.near = States(), replace(self.near, vertices=VertexContacts.none())
        self.penetration.spared[:] = self.penetration.raised[:] = self.penetration.across[:] = 0
        self.penetration.sought[:] = False
        self.pinches.clear()
        self.adaptive_stiffness.clear()
        self.detector.begin()
        self.penetration.crossed = self.penetration.before = self.detector.find_crossings()

    def nearest(self) -> Place | None:
        """The vertex or pair that is nearest to a solid, over the distance it should keep, where cloth was last looked at."""
        f, pairs, places = self.near.vertices, self.near.pairs, []
        if len(f.gap):
            gap = 1 + f.gap / self.thickness[f.solid]
            k = int(np.argmin(gap))
            places.append(Place((int(f.index[k]),), int(f.solid[k]), float(gap[k])))
        if pairs is not None and len(pairs.key):
            gap = pairs.distance / (PAIR * self.detector.kept_by(pairs))
            k = int(np.argmin(gap))
            particle = int(pairs.vertices[k, pairs.weights[k].argmax()])
            places.append(Place((particle,), int(pairs.solid[k]), float(gap[k])))
        return min(places, key=lambda p: p.gap, default=None)

    def forces_on_particles(self) -> np.ndarray:
        """(n, 3) [N] on each particle in the last solve, in particle order."""
        out = np.zeros((self.model.n, 3))
        np.add.at(out, self.active.contacts.index, self.forces.held)
        out[self.pinches.trial.index] += self.pinches.forces
        return self.pushes().add(out)

    def begun(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Contacts that the last solve held and the accepted step before did not: (particles (k,), normals (k, 3), forces
        (k, 3) [N])."""
        f = self.active.contacts
        new = ~np.isin(f.key, self.accepted.key)
        return f.index[new], f.normal[new], self.forces.held[new]

    def pushes(self) -> Pushes:
        """Forces of edges and corners in the last solve."""
        p = self.linearized
        return Pushes.none() if p is None else Pushes(p.key, p.vertices, p.weights[:, :, None] * self.forces.pairs[:, None, :])

    def loads(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """(force [N], torque [N m] about the origin) on each solid, by name."""
        f, pinched, x = self.active.contacts, self.pinches.trial, self.model.read_particles()[0]
        either = [self.pinches.forces / 2] * 2  # of pinched particles, as much on either side
        at, force = x[np.concatenate([f.index, pinched.index, pinched.index])], np.concatenate([self.forces.held, *either])
        which = np.concatenate([f.solid, pinched.solid[:, 0], pinched.solid[:, 1]])
        if self.linearized is not None:
            at, force = np.concatenate([at, self.forces.at]), np.concatenate([force, self.forces.pairs])
            which = np.concatenate([which, self.linearized.solid])
        out = {}
        for k, solid in enumerate(self.detector.solids):
            mine = which == k
            arm = at[mine] - solid.pose(self.detector.time)[1] + self.model.origin
            out[solid.name] = (-force[mine].sum(axis=0), -np.cross(arm, force[mine]).sum(axis=0))
        return out
