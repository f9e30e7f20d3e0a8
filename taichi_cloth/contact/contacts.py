"""Interface of contact to a step: constrained particles, contact forces, test of convergence, checkpoints."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.base import Base
from ..system.checkpoint import Checkpointed
from ..system.cones import Cones
from ..system.held import Held
from ..system.place import Place
from ..system.state import ParticleState
from .points import ContactForce, ContactRows, Pushes
from .settle import Moved, move_apart
from .solid.balance import MET, Balance, Found
from .solid.sliding import Sliding
from .solid.solid_contacts import SolidContacts
from .stack_order import StackOrder
from .step_start import ForcingTerms, StepContext

AGREED = 0.001  # tolerance of the residual of contacts, in parts of all impulses (weight, contacts, pins, changes of
# momentum). With .002 and .0005 `sphere_drape` takes 385 and 404 solves for 390 in 1 s
NEAR = 0.03  # above this residual, states of contacts come from the proximal gradient method. With layers, friction is viscous
# in the next solve instead. With 0, .01, this and .1 `sphere_drape` takes 372, 370, 381, 397 solves
STRICT = 3  # solves with the tolerance AGREED; it doubles in each later one. With 2 and 7 385 and 472 solves for 390


class Linearization(NamedTuple):
    """Contact as a solve takes it.

    Attributes:
        base: positions and velocities (n, 3) with which it begins.
        near: pairs of edges of cloth and solids; repulsion: theirs; sliding: friction of particles on solids.
        between: of layers; layers: the pairs of these.
    """

    base: tuple[np.ndarray, np.ndarray]
    near: Any
    repulsion: ContactRows
    sliding: Sliding
    between: ContactRows
    layers: Any


class Contacts(Checkpointed):
    """The contacts of a model's cloth with a scene's solids, and of its cloths with each other.

    Attributes:
        solids: against solids; detector: that of these; layers: cloth against cloth, or None; sprung: whether by the
            paper's springs.
        force: the terms of contacts in the system of a solve.
        start: of the attempt at a step; base: positions and velocities (n, 3) with which its last solve began.
        balance: the contacts with solids from solve to solve of the attempt; found: by the last of `rounds`.
        between: points of layers in that solve; others: friction of pinched particles, and edges and corners of solids.
        forcing_terms: prediction of whether a step's first solve will be its last.
        warm: whether the last step ended in contact, so that its last solve predicts the next.
        crowded: whether there are more points than there is room for.
    """

    STATE = ("solids", "warm", "layers", "forcing_terms")

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, h: float, cpu: bool,
                 tangles: str = "untangle", law: str = "repulsion") -> None:
        self.model, self.gravity = model, scene.gravity
        self.layers, self.sprung = None, law == "springs"
        if any(c.contact is not None for c in scene.cloths):
            from .cloth.layers import Layers
            from .cloth.springs import Springs

            self.layers = (Springs if self.sprung else Layers)(fields, model, scene, h, cpu, tangles)
        self.force = ContactForce(fields, model, self.layers is not None)
        nowhere = np.zeros((model.n, 3))
        self.start, self.base = StepContext(h, h, nowhere, nowhere), (nowhere, nowhere)
        self.solids = SolidContacts(fields, model, scene, self.start)
        if self.layers is not None and self.solids.pinches.possible:
            self.solids.pinches.order = StackOrder(self.layers.detector.mesh, model.n)
        self.detector = self.solids.detector
        self.balance = Balance(self.solids, nowhere)
        self.found: Found | None = None
        self.rounds = 0
        self.between, self.others, self.forcing_terms = ContactRows.none(), ContactRows.none(), ForcingTerms()
        self.warm = self.crowded = False

    @property
    def layered(self) -> bool:
        """Whether layers of cloth are part of the solves of this attempt."""
        return self.layers is not None and (self.sprung or self.start.together)

    @property
    def linearization(self) -> Linearization:
        """As contact is linearized now."""
        s, layers = self.solids, None if self.layers is None else self.layers.linearized
        return Linearization(self.base, s.linearized, s.repulsion, s.sliding, self.between, layers)

    @linearization.setter
    def linearization(self, as_before: Linearization) -> None:
        """Goes back to an earlier one, but for the system's points."""
        s = self.solids
        self.base, s.linearized, s.repulsion, s.sliding, self.between, pairs = as_before
        if self.layers is not None:
            self.layers.linearized = pairs

    def begin(self, h: float, pins: Held | None, x: np.ndarray, v: np.ndarray, together: bool = False,
              base: Base | None = None) -> None:
        """A new attempt from the saved state (n, 3); the model is at its predicted end. With `together`, layers of cloth are
        part of its problem from the first solve on. base: where the method starts, if not from the saved state."""
        self.warm = False
        self.forcing_terms.begin()
        size = h if base is None else base.h
        self.start = self.solids.begin(StepContext(size, self.start.h_usual, x, v, pins, together, base))
        self.balance, self.found, self.rounds = Balance(self.solids, self.start.base_v), None, 0
        if self.layers is not None:
            self.layers.waive(self.solids.pinches.where, self.solids.pinches.accepted.index)
            self.layers.begin(self.start, together)

    def constrain(self, smooth: bool = True) -> tuple[Held | None, float]:
        """(particles that the next solve from the saved state holds, pins included; the largest closing distance [m])

        Args:
            smooth: whether friction may be smooth in it, see `Balance.go_on`.
        """
        balance, closing = self.balance, 0.0
        if self.found is None:
            balance.begin()
            closing = balance.closing
        else:
            balance.take(self.found)
            if smooth:
                balance.go_on(self.found.residual.relative <= NEAR)
            balance.constrain()
        self.base = self.start.initial_iterate
        if balance.held is not None:
            self.base[0][balance.held.index] += balance.held.y
        return balance.held, closing

    def rebase(self) -> None:
        """The same contacts for a further solve that begins where the model now is."""
        self.base = self.model.read_particles()
        self.set_points()

    def set_points(self) -> None:
        """Friction of sliding contacts, pairs, and layers where they are part of the problem, as points of contact."""
        self.take(self.balance.rubs(self.base[1]), True)

    def take(self, rubs: ContactRows | None, led: bool, again: bool = False) -> bool:
        """Linearizes contact for a solve that begins at `base`. Returns whether there is room for all of its points.

        The points are those of friction of pinched particles, of pairs of edges, and of layers where these are part of the
        problem.

        Args:
            rubs: further points, of friction of particles that slide on solids.
            led: whether pairs of edges are linearized with held particles at their targets. Else they are where they are.
            again: whether layers are linearized there already.
        """
        self.others = ContactRows.join(self.solids.take_others(self.base, led))
        points = [self.others] + ([] if rubs is None else [rubs])
        if self.layered and self.layers is not None:
            self.between = self.between if again else self.layers.points(self.base[0])
            points = [self.between, *points]
        self.crowded = not self.force.set(ContactRows.join(points))
        return not self.crowded

    def judge(self, reaction: np.ndarray, inertia: Callable[[np.ndarray], np.ndarray], left: float = 0.0) -> bool:
        """Assesses the contacts of a linear solve. Returns whether they agree with its solution.

        Args:
            reaction: (k, 3) [N s] on the held particles, in `constrain`'s order.
            inertia: `System.inertia` of the system that was solved.
            left: norm [N s] of that solve's residual, where it is not to be made smaller: contacts need not be more exact
                than that.
        """
        solids, balance = self.solids, self.balance
        self.rounds += 1
        solids.look()
        solids.record_forces(reaction, self.base[0])
        balance.inertia = balance.unrubbed(inertia(balance.near))
        self.found = balance.assess_linear(solids.near.end_velocities, reaction, self.base[0])
        others = solids.wanting() + int(solids.pinches.possible and solids.pinches.lags(self.start, solids.near.end_positions))
        r = self.found.residual
        agrees = r.relative <= max(self.enough, left / r.acting) and not balance.smoothed and not others
        solids.unsettled = 0 if agrees else max(r.changed, 1)
        solids.trial = balance.next_states(self.found)
        return agrees

    def cones(self) -> Cones | None:
        """The cones of friction of the contacts found, if their residual is large and their planes still follow; else None:
        then their states follow from the law alone. If there are any, the last solve's friction on solids is taken out of the
        system."""
        if self.found is None or self.found.residual.relative <= NEAR or self.rounds > MET:
            return None
        cones = self.balance.cones(self.found)
        if cones is not None:
            self.force.set(self.others)
        return cones

    def stop_short(self) -> None:
        """After `judge`, the update was shortened: contacts that were not reached are dropped."""
        ended = self.solids.near.end_positions
        self.solids.stop_short()
        if self.found is not None:
            self.found = self.balance.reached(self.found, self.solids.near.end_positions - ended)

    @property
    def enough(self) -> float:
        """Part of all that acts by which contacts may now be off."""
        return AGREED * 2.0 ** max(0, self.rounds - STRICT)

    def accept(self, lacks: np.ndarray, balance_reaction: np.ndarray) -> bool:
        """Whether contacts agree with the forces where a linear solve led. If so, contact forces are set to these.

        Args:
            lacks: (n, 3) [N s] that the step lacks there, without friction of particles that slide on solids.
            balance_reaction: (k, 3) [N s] that balances it on the held particles.
        """
        solids, balance, active = self.solids, self.balance, self.solids.active
        bear = active.holding.forces(active.contacts, balance_reaction)
        found = balance.assess(lacks, self.model.read_particles()[1], bear, bear)
        if found.residual.relative > self.enough:
            return False
        self.found, solids.unsettled, solids.trial = found, 0, balance.next_states(found)
        solids.record_forces(balance_reaction, self.base[0])
        return True

    def record(self, reaction: np.ndarray) -> None:
        """Records the forces of contacts in a further solve that held the same; `reaction` as in `judge`."""
        self.solids.look()
        self.solids.record_forces(reaction, self.base[0])

    def went_in(self, reaction: np.ndarray) -> bool:
        """Whether something ended too deep in solids, or through, after further solves that held the same contacts; `reaction`
        as in `judge`."""
        self.record(reaction)
        return self.solids.ends_deep() or self.solids.went_through()

    def works(self, x: np.ndarray, v: np.ndarray) -> tuple[float, float]:
        """Work on the motion of the step [J], which ends at x with v (n, 3): of friction that slides on solids, of edges and
        corners of solids."""
        h, moved, solids = self.start.c, x - self.base[0], self.solids
        return solids.rubbing.work(moved, h, h * v), solids.repulsion.work(moved, h, h * v)

    def between_layers(self, x: np.ndarray) -> np.ndarray:
        """(n, 3) [N] of cloth on cloth on each particle in the last solve, which ended at x (n, 3)."""
        out = np.zeros_like(x)
        if self.layered:
            self.between.spread(self.between.forces(x - self.base[0], self.start.c), out)
        return out

    def lagged(self, h: float) -> float:
        """Terms of friction, pairs and springs in the incremental potential [J] where the model now is, as the last solve
        took them."""
        moved, solids = self.model.read_particles()[0] - self.base[0], self.solids
        points = [*([self.between] if self.sprung else []), solids.rubbing, solids.repulsion]
        return sum(p.potential(moved, h) for p in points)

    def commit(self) -> None:
        """The step was accepted: the next begins from its contacts."""
        self.solids.commit()
        self.forcing_terms.commit()
        self.warm = True
        if self.layers is not None:
            self.layers.commit()

    def meets(self, h: float, pins: Held | None, x: np.ndarray, v: np.ndarray) -> bool:
        """Whether cloth that went from the saved state (n, 3) to where the model now is meets anything on its way."""
        self.begin(h, pins, x, v)
        layered = self.layers is not None and (self.layers.intersections.active or self.layers.meet())
        return self.solids.touching or bool(self.solids.pinches.where.any()) or layered

    def pass_by(self) -> None:
        """A step without contact was accepted."""
        self.solids.pass_by()
        self.forcing_terms.clear()
        self.warm = False
        if self.layers is not None:
            self.layers.pass_by()

    @property
    def meeting(self) -> bool:
        """Whether cloth met anything in this attempt's last solve."""
        layered = self.layered and self.layers is not None and self.layers.count > 0
        return self.count > 0 or self.solids.near.any_pairs or layered

    @property
    def touching(self) -> bool:
        """Whether the last step had contacts."""
        layered = self.layers is not None and (self.layers.count > 0 or self.layers.intersections.active)
        return self.count > 0 or self.solids.near.any_pairs or len(self.solids.pinches.accepted.index) > 0 or layered

    @property
    def hindered(self) -> bool:
        """Whether cloth was pinched, or crossed itself, where the step begins."""
        layers, solids = self.layers, self.solids
        pinched = len(solids.pinches.accepted.index) > 0 or bool(solids.penetration.spared.any())
        return pinched or (layers is not None and (layers.intersections.active or layers.freed))

    @property
    def count(self) -> int:
        """Particles that solids hold."""
        return len(self.solids.active.contacts.index)

    @property
    def crossings(self) -> int:
        """Pairs of triangles of cloth and solids that cross, and particles inside solids without edges or corners."""
        return self.solids.penetration.crossings(self.solids.near.vertices)

    def counts(self) -> dict[str, Any]:
        """The counts of contact in a step's record, by the names of `Attempt`."""
        pinched = int(np.sum(self.solids.penetration.spared > 0))
        led = self.solids.pinches.where
        out = {"contacts": self.count, "unconverged_contacts": self.solids.unsettled, "pinched": pinched,
               "solid_intersections": self.crossings, "place": self.place(), "led": led if led.any() else None,
               "contact_error": self.found.residual.relative if self.found is not None and self.meeting else 0.0}
        if self.layers is None:
            return out
        layers, tangles = self.layers, self.layers.intersections
        return out | {"unconverged_contacts": self.solids.unsettled + layers.unsettled, "pinched": pinched + tangles.pinched,
                      "layers": layers.count, "min_gap_ratio": layers.least, "known_intersections": tangles.count}

    def place(self) -> Place | None:
        """The place of the smallest distance in contact, over the distance that should be kept there."""
        places = [self.solids.nearest(), self.layers.nearest() if self.layered and self.layers is not None else None]
        return min((p for p in places if p is not None), key=lambda p: p.gap, default=None)

    def inspect(self) -> list[str]:
        """See `SolidCollisionDetector.inspect`; called at the beginning."""
        notes = self.detector.inspect()
        self.clear()
        return notes + (self.layers.intersections.inspect() if self.layers is not None else [])

    def settle(self, fixed: np.ndarray) -> Moved:
        """Moves cloth apart that starts nearer to solids, or to itself, than it can go on from, but for particles (k,) that
        are fixed. Particles that start inside solids are let out over the first steps."""
        moved = move_apart(self.detector, self.model, self.layers, fixed)
        if len(moved.near):
            self.clear()
            if self.layers is not None:
                self.layers.release_nearest()
        self.solids.let_out(self.detector.inside.particles, self.detector.inside.depth)
        return moved

    def clear(self) -> None:
        """Forgets all contacts: the state was changed from outside."""
        self.warm = False
        self.solids.clear()
        self.forcing_terms.clear()
        if self.layers is not None:
            self.layers.clear()

    def pushes(self) -> tuple[Pushes, Pushes]:
        """Forces of repulsion in the last solve: by edges and corners of solids, and between layers of cloth."""
        return self.solids.pushes(), Pushes.none() if self.layers is None else self.layers.pushes()

    def forces_on_particles(self) -> np.ndarray:
        """(n, 3) [N] on each particle in the last solve, in particle order."""
        out = self.solids.forces_on_particles()
        return out if self.layers is None else self.layers.pushes().add(out)
