"""Cloth against cloth: repulsion within a thickness and Coulomb friction between layers, inside the solve.

Pairs of vertex and face, edge and edge repel each other (`barrier`). Each is a point of contact: linearised along its
normal, semidefinite, in the matrix-free product and the preconditioner (`pair_kernels`, which has friction too). The first
solve of a step linearises them where the last motion would lead; further solves, where the cloth then is. Each update stops
at the first collision (`narrow_phase.collision_free_step`): layers that were apart stay apart.

A pair that approaches below its distance gets an additional stiffness that depends on h. It acts in this step only, so
nothing bounces. Friction is a damping by the slip last seen. Where that would exceed Coulomb's cone it has its full size
against the slip. The normal force is the pair's in the last solve.

Differs from [BW98 §6]: the paper's damped springs act on pairs that are near at the start of a step, and trust in coherence:
`springs`.
"""

from typing import Any

import numpy as np

from ...backend.fields import Fields
from ...backend.timing import Stopwatch, timed
from ...scene.scene import Scene
from ...system.checkpoint import Checkpointed
from ...system.place import Place
from ...system.state import ParticleState
from ..points import ContactRows, Pushes
from ..step_start import StepContext
from . import pair_kernels
from .barrier import FLOOR
from .broad_phase import ROUNDING
from .contact_pairs import CLOSE, AdaptiveStiffness, Comparison, ContactPairs, EndedPairs, LinearizedPairs, PenaltyShift
from .narrow_phase import LayerDetector
from .resident_pairs import pair_calls
from .untangle import Intersections

LATER = 3  # after so many solves, contacts with solids that still change do not prevent acceptance, nor, with pinched or
# crossing cloth, do bounds of friction. With 2 and 6 the tube on a dance four times as fast takes 63 and 67 steps for 62,
# three sheets that fall on a ball 167 and 201 solves for 168
AGREED = 0.1  # relative tolerance of the forces of pairs
BOUNDS = 0.03  # of the sum of friction's bounds; AGREED where cloth is pinched or crosses. With .1 the upper of three sheets
# gains 2.74 m/s^2 for 2.98 (2.94 by law). In steps that are not solved `layers` takes 120, 154 and 174 solves with .1, this
# and .01, two layers under an arm that closes 74, 74 and up to 157 steps
RUBBED = 0.05  # tolerance of friction above Coulomb's limit, tested after the first solve only. With .1 ten sheets at rest
# take 36 solves for 32, without it `tablecloth_pull` takes 138 for 128
LOOSE = 2.0  # absolute tolerance of a pair's force, in weights of its mass. With 0 a skirt in a kick takes 62 steps for 42, 15
# of them tried twice for 7
GIVE = 0.01  # the same in weak gravity, in parts of a pair's distance over h^2. With the earth's weight in its place two
# sheets that meet without gravity turn each other by a tenth of their forces times the distance; .05 are tested


class Layers(Checkpointed):
    """The contacts of a model's cloths with each other and with themselves.

    Attributes:
        count: pairs in contact after the last solve; energy: of their repulsion [J].
        least: smallest distance of any pair over that which it should keep, 1 where none is in contact; least_before: that
            of the last step.
        unsettled: pairs whose force was not as the last solve took it.
        adaptive_stiffness: how much stiffer pairs are than their law; shift: how much further away they repel.
        waived: (n,) particles that solids pinch, whose pairs are disabled; freed: whether any is no longer pinched.
    """

    ROUNDS = 12
    STATE = ("kept", "count", "energy", "least_before", "adaptive_stiffness", "shift", "detector",
             "intersections", "opened_seams")
    floor, kind = FLOOR, pair_kernels.PairKernels

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, h: float, cpu: bool, tangles: str) -> None:
        nowhere = np.zeros((model.n, 3))
        self.model, self.start = model, StepContext(h, h, nowhere, nowhere)
        self.detector = LayerDetector(fields, model, scene, cpu, self.floor)
        d = self.detector
        self.waived, self.freed = np.zeros(model.n, dtype=bool), False
        self._were_waived = self.waived
        self.intersections = Intersections(model.n, d.mesh, tangles)
        mu = np.concatenate([np.full(c.mesh.vertex_count, c.contact.friction if c.contact else 0.0)
                             for c in scene.cloths])
        self.calls = d.calls = pair_calls(self.kind(fields, model, d.mesh, np.sqrt(mu)[model.user]), fields.exchange)
        self.gravity = scene.gravity
        self.adaptive_stiffness, self.shift = AdaptiveStiffness(model.n), PenaltyShift(d.mesh.shifts, model.n, fields.exchange)
        self._weighed: tuple[ContactPairs, np.ndarray, np.ndarray] | None = None  # of the pairs that were last asked for
        self.opened_seams: Any = None
        if model.sewn is not None:
            from .opened_seams import OpenedSeams

            self.opened_seams = OpenedSeams(model, d.mesh)
        self.kept = EndedPairs()  # in the last accepted step
        self.linearized: LinearizedPairs | None = None
        self.last_forces: np.ndarray = np.zeros(0)  # normal forces in the last solve [N]
        self._led: tuple[LinearizedPairs, np.ndarray] | None = None  # pairs, where their solve led them
        self.near = ContactPairs.none()  # where cloth was last looked at
        self.compared: Comparison | None = None  # those, and the ones that the last solve took
        self.predicted = nowhere  # positions at which an attempt's first solve has the pairs
        self.round = 0  # solves of the attempt
        self.blocking = self.detector.candidates  # pairs that a collision-free step stops at
        self.count, self.energy, self.least, self.least_before, self.unsettled = 0, 0.0, 1.0, 1.0, 0
        self.watch = Stopwatch()

    @property
    def seconds(self) -> float:
        """Wall time spent here."""
        return self.watch.seconds

    def waive(self, pinched: np.ndarray, before: np.ndarray) -> None:
        """Disables pairs of pinched particles (n,). Particles pinched before (k,), and no longer, may have crossed."""
        self.freed = not pinched[before].all()
        self._were_waived = np.zeros(self.model.n, dtype=bool)
        self._were_waived[before] = True
        if self.waived.any() or pinched.any():
            self.waived = pinched.copy()
            self._let_rest()

    def _let_rest(self) -> None:
        self.detector.let_rest(self.intersections.resting, self.waived)

    @timed
    def begin(self, start: StepContext, guess: bool) -> None:
        """A new attempt; the model is at its predicted end, with `guess` looked at there."""
        self.start = start
        self.adaptive_stiffness.begin()
        self.round, self.predicted, self.compared, self._weighed = 0, self.model.read_particles()[0], None, None
        self.detector.paths.begin()
        if guess:
            self.near = self.detector.look(swept=True)  # of those that were candidates before
            self._evaluate(self.near)  # the model is not there any more when a solve asks for them

    @timed
    def meet(self) -> bool:
        """Whether anything is in reach of anything where the model now is, or passes through it on the way there."""
        self.detector.cover()
        self.near = self.detector.look(swept=True)
        return len(self.near.end) > 0 or self.detector.collision_free_step()[0] < 1  # it finds pairs that distances missed

    @timed
    def points(self, base: np.ndarray) -> ContactRows:
        """All pairs linearized as `ContactRows`, for a solve from positions base (n, 3)."""
        p, q, k = self.near, self.linearized if self.compared is not None else None, len(self.near.end)
        weighed, rotation_coupling = self._evaluate(p)
        row = self.compared.rows if self.compared is not None else np.full(k, -1)
        before = q.taken if q is not None else np.zeros((pair_kernels.TAKEN, 1))
        there = self.predicted if self.compared is None else base
        rubbed, slipped = self.kept.rubbed(p)
        taken, block, rhs = self.calls.linearize(
            p, weighed, rotation_coupling, self.start.h, self.start.c, int(not self.round), base, there, self._last_forces(p),
            rubbed, np.where(row < 0, slipped, np.inf), row, before)
        resident = self.calls.points(p, block, rhs, rotation_coupling)
        points = ContactRows(p.vertices, p.weights, block, rhs, p.normal, rotation_coupling, resident)
        self.linearized = LinearizedPairs(p, points, weighed, taken)
        if self.compared is not None:
            self.compared = Comparison(self.linearized, p)
        self.round += 1
        if not self.intersections.active:
            return points
        return ContactRows.join([points, self.intersections.points(self.start, base, self.model.mass)])

    def _last_forces(self, p: ContactPairs) -> np.ndarray:
        """(k,) normal forces [N] of pairs in the last solve, or, where that is not known, -1."""
        if self.compared is None:
            return self.kept.forces(p)
        where, force = self.compared.rows, self.last_forces
        return np.where(where >= 0, force[where], -1.0) if len(force) else np.full(len(where), -1.0)

    @timed
    def advance(self) -> float:
        """Largest collision-free fraction of the last update."""
        self.detector.cover()
        part, self.blocking = self.detector.collision_free_step()
        if part < 1:
            self._led = None  # the model goes back
        return part

    def _energy(self, p: ContactPairs) -> float:
        return float(np.sum(self._evaluate(p)[0][pair_kernels.POTENTIAL]))

    @timed
    def look(self) -> None:
        """Pairs as they are where the model now is."""
        self.near = p = self.detector.look()
        q, led, self._led = self.linearized, self._led, None
        measured = led[1] if led is not None and led[0] is q else None if q is None else self._measure(q)
        self.compared = None if q is None or measured is None else Comparison(q, p, measured)
        self.energy = self._energy(p)
        self.count = len(p.end)
        self.least = float(np.min(p.end / p.radius, initial=1.0))

    @timed
    def record_forces(self) -> None:
        """Remembers the normal forces of the last solve; the model is at its end. `advance` follows."""
        q = self.linearized
        assert q is not None
        self._led = q, self._measure(q)
        self.last_forces = np.maximum(q.repelled(self._led[1][pair_kernels.GAP]), 0.0)

    @timed
    def settled(self) -> bool:
        """Whether forces of pairs agree with those of the last solve, and no pair is too close."""
        p, q, compared = self.near, self.linearized, self.compared
        assert q is not None and compared is not None
        weighed, row, bears = self._evaluate(p)[0], compared.rows, q.taken[pair_kernels.BEARS]
        now, taken = weighed[pair_kernels.NOW], compared.repelled
        gone = np.ones(len(taken), dtype=bool)
        gone[row[row >= 0]] = False
        force = np.concatenate([now - np.where(row >= 0, taken[row], 0.0) if len(taken) else now, taken[gone]])
        own = np.concatenate([weighed[pair_kernels.OWN], q.weighed[pair_kernels.OWN][gone]])
        radius = np.concatenate([p.radius, q.near.radius[gone]])
        allowed = own * np.maximum(LOOSE * np.linalg.norm(self.gravity), GIVE * radius / self.start.h**2)
        total = float(np.sum(now))
        wrong = np.where(np.abs(force) > allowed, np.abs(force), 0.0)
        self.unsettled = int(np.sum(wrong > 0)) if np.sum(wrong) > AGREED * total else 0
        rubs_as = float(np.sum(bears))
        lag = abs(float(np.sum(q.weighed[pair_kernels.MU] * np.maximum(taken, 0.0))) - rubs_as)
        hindered = self.intersections.active or self.waived.any()
        late = lag > (AGREED if hindered else BOUNDS) * rubs_as and not (hindered and self.round > LATER)
        beyond = np.maximum(compared.measured[pair_kernels.RUBBED] - pair_kernels.CONE * bears, 0)
        over = float(np.sum(beyond + compared.measured[pair_kernels.BACK] * bears))
        rubs = over > RUBBED * rubs_as and self.round == 1  # later, friction above it is left to the next step
        nearer = p.end < (1 - ROUNDING) * weighed[pair_kernels.BEGAN]  # rows that are pinned close together may stay so
        near = (self._too_near() & nearer).any()
        if near and not (self.unsettled or rubs or late):
            self._stiffen()
        return not (near or self.unsettled or rubs or late)

    @timed
    def stop_short(self) -> None:
        """The update was shortened: pairs with little room left get stiffer, if those that blocked it were in the solve."""
        if not len(self.blocking):
            return
        p, compared, blocks = self.near, self.compared, np.zeros(self.model.n, dtype=bool)
        assert compared is not None
        blocks[self.detector.particles_of(self.blocking).ravel()] = True
        stopped = blocks[p.vertices].all(axis=1) & (compared.rows >= 0) & (p.room < CLOSE)
        if stopped.any():
            self._stiffen()

    def _too_near(self) -> np.ndarray:
        """(k,) pairs that approached and end nearer than a step may leave them. A pair that opens may begin nearer."""
        p, was = self.near, (self.least_before - FLOOR) / (1 - FLOOR)
        allowed = FLOOR + (1 - FLOOR) * min(CLOSE / 3, was / 2, 2 * was)
        return (p.end <= allowed * p.radius) & (p.end <= self._evaluate(p)[0][pair_kernels.BEGAN])

    def _stiffen(self) -> None:
        """Pairs with little room left get stiffer within the step."""
        self.adaptive_stiffness.stiffen(self.near)
        self._weighed = None
        self.energy = self._energy(self.near)

    @timed
    def commit(self) -> None:
        """The step was accepted."""
        p, q = self.near, self.linearized
        if self.intersections.active or self.freed:
            resting = self.intersections.resting
            self.intersections.commit(self.start.h, self.start.share)
            self._let_rest()
            again = resting & ~self.intersections.resting
            if again.any():
                self._release_stuck(again)
        self.least_before = self.least
        self.kept = EndedPairs()
        if q is not None:
            slip = q.slip(self.model.read_particles()[0] - self.start.x) / self.start.h
            self.kept = EndedPairs.of(q, self.last_forces, slip)
        nearest = p.least_room(self.model.n)
        self.adaptive_stiffness.commit(nearest, self.start.share)
        self.shift.commit(nearest, self.start.share)
        self._weighed = None
        self.energy = self._energy(p)  # the next step begins with it

    @timed
    def count_tangled(self, everywhere: bool = True) -> None:
        """Counts crossings where the model now is. If not `everywhere`, after a step, only among disabled particles: each
        crossing has one on either side."""
        alone = self.intersections.resting | self.waived | self._were_waived
        all_of_it = everywhere or (self.opened_seams is not None and self.opened_seams.growing)
        self.intersections.look(self.model.read_particles()[0], None if all_of_it else alone)

    @timed
    def tangled(self, apart: np.ndarray) -> int:
        """Crossings after a step: those that are known, and those beside seams with particles (j,) that are still apart."""
        return self.intersections.count + self.intersections.beside_seams(self.model.read_particles()[0], apart)

    @timed
    def part(self, whole: np.ndarray) -> None:
        """After a step, with the stitches (k,) that are whole: both sides of broken ones repel at the distance they now have.
        Those that were in one place may pass through each other. That counts as tangled, and is left to open by itself."""
        self.detector.fresh &= not self.opened_seams.part(whole)
        if self.opened_seams.growing:
            self.opened_seams.grow(self.detector.apart())
            short = None if self.intersections.active else self.opened_seams.short
            self.intersections.look(self.model.read_particles()[0], short)

    def join(self, whole: np.ndarray) -> None:
        """Between steps, with the stitches (k,) that hold or are drawn together: their sides are one surface."""
        self.detector.fresh &= not self.opened_seams.join(whole)

    def release(self) -> bool:
        """Disables the pairs that allow no collision-free step for a while: they count as pinched. Returns whether any are."""
        four = self.detector.particles_of(self.blocking)
        self.intersections.release(four.ravel())
        self._let_rest()
        return len(four) > 0

    def release_beside(self, held: np.ndarray) -> bool:
        """Disables pairs that are too close and cannot open, if the closest pair is among them; returns whether it is.

        A pair cannot open where a tangle holds a particle of it, or where one is pinched and solids hold, `held` (n,), all.
        Where any is pinched they are led apart.
        """
        p, near = self.near, self._too_near()
        led = self.waived[p.vertices].any(axis=1) & (self.waived | held)[p.vertices].all(axis=1)
        gap, tight = p.end / p.radius, near & (led | self.intersections.resting[p.vertices].any(axis=1))
        if not tight.any() or gap[tight].min() > gap[near].min():
            return False
        if self.waived.any():
            self.intersections.lead_apart(p, tight)
        else:
            self.intersections.release(p.vertices[tight].ravel())
        self._let_rest()
        return True

    def release_around(self, particles: np.ndarray) -> None:
        """Disables the pairs of particles (k,) and their neighbours for a while, between steps."""
        near: np.ndarray = np.zeros(self.model.n, dtype=bool)
        near[particles] = True
        self.intersections.release(self.detector.mesh.around(near))
        self._let_rest()

    def release_nearest(self) -> None:
        """Disables the pairs that start so near that they are as good as tangled, for a while."""
        self._release_stuck(np.ones(self.model.n, dtype=bool))
        self.look()
        self.least_before = self.least

    def _release_stuck(self, which: np.ndarray) -> None:
        """Disables pairs of the given particles (n,) that are so close that no step could be accepted, for a while."""
        p = self.detector.look()
        stuck = p.stuck & which[p.vertices].any(axis=1)
        if stuck.any():
            self.intersections.lead_apart(p, stuck)
            self._let_rest()

    def nearest(self) -> Place | None:
        """The pair with the smallest distance over that which it should keep, where cloth was last looked at."""
        p = self.near
        if not len(p.end):
            return None
        gap = p.end / p.radius
        k = int(np.argmin(gap))
        return Place(tuple(p.vertices[k].tolist()), -1, float(gap[k]))

    def pass_without(self) -> None:
        """No layers touched in this step."""
        self.energy, self.count, self.least, self.unsettled = 0.0, 0, 1.0, 0
        self.linearized = self.compared = None

    def pass_by(self) -> None:
        """A step without contact of cloth with cloth was accepted."""
        self.pass_without()
        self.commit()

    def pushes(self) -> Pushes:
        """Forces of layers on each other where the model now is; those of each pair add up to 0."""
        q = self.linearized
        if q is None:
            return Pushes.none()
        x, p = self.model.read_particles()[0], q.near
        friction = q.friction(q.slip(x - self.start.x) / self.start.h)
        return Pushes(p.key, p.vertices, q.points.shares(q.repelled(p.along(x))[:, None] * p.normal + friction))

    def clear(self) -> None:
        """The state was changed from outside."""
        self.kept, self.linearized, self._weighed = EndedPairs(), None, None
        self.adaptive_stiffness.clear()
        self.shift.clear()
        self.model.save()
        self.intersections.until[:] = 0
        self.count_tangled()
        self.intersections.commit()
        self._let_rest()
        self.detector.paths.begin()
        self.detector.cover()
        self.look()
        self.least_before = self.least

    def resumed(self) -> None:
        """See `Checkpointed`."""
        self._weighed = None
        self._let_rest()

    def _evaluate(self, p: ContactPairs) -> tuple[np.ndarray, np.ndarray]:
        """((., k) numbers, (k, 4, 3) `rotation_coupling`) of pairs as they are, see `pair_kernels`."""
        if self._weighed is None or self._weighed[0] is not p:
            self._weighed = p, *self.calls.evaluate(p, self.adaptive_stiffness.factors, self.start.h)
        return self._weighed[1:]

    def _measure(self, q: LinearizedPairs) -> np.ndarray:
        """(., j) numbers of pairs that a solve took, where the model now is."""
        coupling = q.points.rotation_coupling
        assert coupling is not None
        return self.calls.measure(q.near, coupling, q.taken, self.start.h)
