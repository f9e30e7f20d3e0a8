"""Which contacts hold, stick and slide, round by round of a step. [BW98 §5, §6]

A particle in contact has its normal direction held (all directions while friction holds it), moves with the
solid (z), and is brought to the surface by y, inside the solve. The solve's own constraint force then says what
must change: a contact that pulls is released, one that shears beyond Coulomb's cone slides, one that has come to
rest sticks, a particle that ends inside is added. Rounds of solves go on until what changes does not matter.

Sliding friction is -mu lambda u/|u| with the last known constraint force lambda. Where it cannot stop the slip u
that is expected within the step, it is linearised about it: constant along u, a damping across. Where it could, it
is a damping in all directions with the |u| expected: it never pushes backwards, and bounds the friction's work from
above, so that rounds go downhill. What has just begun to slide feels its cone's force against the shear.

Differs from [BW98 §6]: states are settled within the step, not in the next; y also brings a particle down to the
surface that it would otherwise have gone through, so that a solid is met inelastically, without a bounce.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..scene.scene import Scene
from ..system.constraints import Held
from ..system.state import ParticleState
from .contact_force import ContactForce
from .points import Points
from .solid.active_set import hold_together
from .solid.pairs import PAIR, Pairs, Step, left, press
from .solid.query import Scanner
from .solid.room import has_room, pinned_particles, walls
from .solid.states import EYE, States, rows_of, sym_outer, sym_times, tangential
from .solid.vertices import VertexContacts

PENETRATION = 1e-2  # of the thickness that a particle may end inside it without a further round
TOLERATED = 0.3  # of the thickness: the same after further rounds, and where little would hold it; the next step brings it out
DEEP, DEEPER = 0.5, 0.7  # of the thickness: what ends deeper is not accepted; where pairs guard faces and edges of cloth too
PULL = 1e-3  # of a particle's weight (or of the mean contact force) that a contact may pull before it is released
CONE = 1e-4  # relative excess over mu lambda before a contact slides
WEAK = 0.5  # of the cone: friction must be below it for what slides slowly to stick
SLOW = 5e-5  # slip [m/s] below which friction holds
PATIENCE = 1  # rounds after which states that still change do so in the next step
RELEASES = 4  # rounds in which contacts are released, where layers of cloth press on each other
AGREED, AGREED_SHEAR = 3e-3, 3e-2  # part of all normal forces by which contacts may pull, or lack what would hold particles
# that end inside, and shear beyond the cone, in a step: their states change in the next
SMALLER = 64  # times smaller than the usual, a step is taken though cloth ends inside or across, where there is no room
SMALLEST = 2048  # times smaller than the usual, layers that leave no way free are pinched however fast they come
SPARED = 0.1  # s for which what is pinched does not make steps small again
FALL = 0.5  # of the thickness: from higher than that and than its motion leads, nothing is brought down to a solid
LAGGED = 0.1  # relative error of the friction forces that a first round may leave


@dataclass(frozen=True)
class Verdict:
    """What a round came to.

    Attributes:
        changes: contacts whose state must change, or 0 where they do not matter within this step.
        deepest: how deep [m] anything ends inside a thickness.
        bad: whether something ends so deep that the step cannot be accepted.
    """

    changes: int
    deepest: float
    bad: bool


class Contacts:
    """The contacts of a model with a scene's solids."""

    ROUNDS = 6

    def __init__(self, fields: Fields, model: ParticleState, scene: Scene, h: float, cpu: bool,
                 tangles: str = "untangle", law: str = "repulsion") -> None:
        self.h_usual = h  # the stiffness of pairs goes with it, and stays when steps get smaller
        self.model, self.solids, self.exchange = model, scene.solids, model.exchange
        self.gravity = scene.gravity
        self.layers, self.sprung = None, False  # the latter: whether cloth is kept from cloth by springs
        self.together = False  # whether layers of cloth are part of the attempt's problem
        if any(c.contact is not None for c in scene.cloths):
            from .cloth.layers import Layers
            from .cloth.springs import Springs

            self.layers = (Springs if law == "springs" else Layers)(fields, model, scene, h, cpu, tangles)
            self.sprung = law == "springs"
        self.force = ContactForce(fields, model, self.layers is not None)
        self.friction = np.array([s.friction for s in self.solids])
        self.thickness = np.array([s.thickness for s in self.solids])
        self.scan = Scanner(fields, model, scene)
        self.deep = np.where(self.scan.pokes, DEEPER, DEEP) * self.thickness  # [m] by solid
        self.reach = 4 * self.scan.edge  # [m] that a particle may close in on a solid in one step
        self.push_limit = self.scan.edge / 4  # [m] pushed out in a usual step: more would tear at the triangles
        self.trial = self.accepted = States()
        self.warm = False
        self.crossed = self.crossed_before = np.zeros((0, 3), dtype=np.int64)
        self.spared = np.zeros(model.n)  # s for which it does not matter how deep inside solids particles end
        self.count, self.unsettled = 0, 0
        self.pressed: Pairs | None = None
        self.places = np.zeros((0, 3)), np.zeros((0, 3))
        self.found = self.active = VertexContacts.none()
        self.state, self.total = States(), np.zeros((0, 3))

    def begin(self, h: float, held: Held | None, x: np.ndarray, v: np.ndarray, together: bool = False) -> None:
        """A new attempt from the saved state (n, 3); the model is at its predicted end. With `together`, layers of cloth are
        part of its problem from the first solve on."""
        self.together = together
        self.h, self.pinned, self.x, self.v = h, held, x, v
        self.trial, self.released = self.accepted, np.zeros(0, dtype=np.int64)
        self.round, self.warm, self.crossed = 0, False, self.crossed_before
        self._look()
        if self.layers is not None:
            self.layers.begin(h, x, together)

    def commit(self) -> None:
        """The step was accepted: the next begins from its contacts."""
        self.spared = np.maximum(self.spared - self.h, 0)
        if self.small:
            self._spare()
        self.accepted, self.warm, self.crossed_before = self.trial, True, self.crossed
        if self.layers is not None:
            self.layers.commit()

    def meets(self, h: float, held: Held | None, x: np.ndarray, v: np.ndarray) -> bool:
        """Whether cloth that went from the saved state (n, 3) to where the model now is meets a solid on its way."""
        self.begin(h, held, x, v)
        layered = self.layers is not None and (self.layers.tangles.active or self.layers.meet())
        return bool((self.found.gap < 0).any()) or (self.near is not None and len(self.near.key) > 0) or layered

    def pass_by(self) -> None:
        """A step without contact was accepted."""
        self.accepted = self.trial = self.state = States()
        self.active, self.total, self.pressed = VertexContacts.none(), np.zeros((0, 3)), None
        self.warm, self.count, self.unsettled = False, 0, 0
        self.spared = np.maximum(self.spared - self.h, 0)
        if self.layers is not None:
            self.layers.pass_by()

    @property
    def touching(self) -> bool:
        """Whether the last step had contacts."""
        layered = self.layers is not None and (self.layers.count > 0 or self.layers.tangles.active)
        return self.count > 0 or (self.near is not None and len(self.near.key) > 0) or layered

    def checkpoint(self) -> dict[str, np.ndarray]:
        """What is remembered from step to step, as arrays by name."""
        states = {name: getattr(self.accepted, name) for name in ("key", "stick", "force", "push")}
        layers = {} if self.layers is None else {f"layer_{k}": a for k, a in self.layers.checkpoint().items()}
        return {**states, "warm": np.array(self.warm), "crossed": self.crossed_before, "spared": self.spared, **layers}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave."""
        self.accepted = States(*(state[name] for name in ("key", "stick", "force", "push")))
        self.warm, self.spared = bool(state["warm"]), state["spared"].copy()
        self.crossed = self.crossed_before = state["crossed"]
        if self.layers is not None:
            self.layers.resume({k[6:]: a for k, a in state.items() if k.startswith("layer_")})

    def inspect(self) -> list[str]:
        """As `Scanner.inspect`, at the beginning."""
        notes = self.scan.inspect(self.h_usual)
        self.clear()
        return notes + (self.layers.inspect() if self.layers is not None else [])

    def clear(self) -> None:
        """Forgets all contacts: the state was changed from outside."""
        self.accepted, self.warm, self.found = States(), False, VertexContacts.none()
        self.spared[:] = 0
        self.crossed = self.crossed_before = self.scan.find_crossings()
        if self.layers is not None:
            self.layers.clear()

    def _look(self) -> None:
        """What the particles meet on their way to where they now are, and how fast they slip there."""
        self.found, self.there = self.scan.detect(), self.end()
        f = self.found
        self.slip = tangential((self.there[f.index] - f.carried) / self.h, f.normal)
        self.near = self.scan.find_pairs()

    def stop_short(self) -> None:
        """The model went a part of its way only: edges and corners of solids are met as they are from there."""
        self.there, self.near = self.end(), self.scan.find_pairs()

    def end(self) -> np.ndarray:
        """(n, 3) positions at the end of the step as they now stand."""
        return self.model.read_particles()[0]

    def hold(self) -> tuple[Held | None, float]:
        """What the next solve holds, pins included, and the largest closing distance [m]; fills `force`."""
        f, old = self.found, self.trial
        known, where = old.find(f.key)
        active = known | (f.gap < 0)
        again = np.isin(f.key, self.released)
        active &= ~again | (f.gap < -PENETRATION * self.thickness[f.solid])
        if self.together:  # solves go on from each other: what had to be held again stays held
            self.released = np.setdiff1d(self.released, f.key[active])
        f, slip, known, where = f.take(active), self.slip[active], known[active], where[active]
        k, mu, mass = len(f.index), self.friction[f.solid], self.model.mass[f.index]
        stick, force, push = np.zeros(k, dtype=bool), np.zeros(k), np.zeros((k, 3))
        if known.any():
            stick[known], force[known] = old.stick[where[known]], old.force[where[known]]
            push[known] = old.push[where[known]]
        new = ~known
        if new.any():  # what stops the approach, and carries the weight
            n = f.normal[new]
            arrive = self.v[f.index[new]] - (f.carried[new] - self.x[f.index[new]]) / self.h
            force[new] = mass[new] * np.maximum(0, -np.einsum("ki,ki->k", n, arrive) / self.h
                                                - n @ self.gravity)
            stick[new] = np.linalg.norm(slip[new], axis=1) * mass[new] <= mu[new] * force[new] * self.h
        stick &= mu > 0
        self.active, self.state = f, States(f.key, stick, force, push)
        self.count = k
        nearing = np.einsum("ki,ki->k", f.normal, f.carried - self.x[f.index] - self.h * self.v[f.index])
        share = min(1.0, self.h / self.h_usual)  # small steps move as fast as large ones
        down = 2 * np.maximum(nearing, 0) + FALL * share * self.thickness[f.solid]  # no further than its own way leads
        lift = self.lift = np.clip(-f.start_gap, -down, self.push_limit * share)
        self.holding = hold_together(f, self.state.stick, lift, self.pinned, self.model.n, self.exchange)
        held = self.holding.held
        self.active_slip = slip
        self.base = self.x + self.h * self.v, self.v  # where the solve begins
        if held is not None:
            self.base[0][held.index] += held.y
        if not self.together:
            self.set_touch()
        return held, float(np.max(-lift, initial=0.0))

    def rebase(self) -> None:
        """The same contacts for a further solve that begins where the model now is."""
        self.base = self.model.read_particles()
        self.set_touch()

    def works(self) -> tuple[float, float, float]:
        """Work of points of touch on the motion of the step [J]: of friction that slides on solids, of edges and corners of
        solids, of cloth on cloth."""
        p, moved = self.points, self.h * self.model.read_particles()[1]
        layered, sliding = self.parts
        power = np.einsum("ki,ki->k", self._point_forces(p), p.of(moved))
        friction, edges = power[layered:layered + sliding].sum(), power[layered + sliding:].sum()
        layers = power[:layered].sum()
        if self.together and self.layers is not None:
            layers = np.einsum("ki,ki->", self._point_forces(self.of_layers), self.of_layers.of(moved))
        return float(friction), float(edges), float(layers)

    def rows_held(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Of rows of what `hold` gave (count,): whether solids hold them, and not pins alone; whether they are brought out of
        solids that they were inside of."""
        solids, out = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
        solids[self.holding.rows] = True
        out[self.holding.rows[self.lift > 0]] = True
        return solids, out

    def lagged(self, h: float) -> float:
        """What friction and pairs add to the incremental potential [J] where the model now is, as the last solve took them."""
        p, dv = self.points, self.points.of(self.end() - self.base[0]) / h
        own = float(np.sum((sym_times(p.block, dv) / 2 - p.rhs) * dv))
        return own + (self.layers.lagged() if self.layers is not None else 0.0)

    def _point_forces(self, p: Points) -> np.ndarray:
        """(k, 3) forces [N] on points of touch at the end of the step."""
        return (p.rhs - sym_times(p.block, p.of(self.end() - self.base[0]) / self.h)) / self.h

    def _to_go(self) -> np.ndarray:
        """(n, 3) how far what is held has to go from where pairs were looked for."""
        out, held = np.zeros_like(self.there), self.holding.held
        if held is not None:
            out[held.index] = np.einsum("kij,kj->ki", held.projector, held.target - self.there[held.index])
        return out

    def set_touch(self) -> None:
        """Friction of what slides, and pairs, as points of contact."""
        f, s, h = self.active, self.state, self.h
        mu = self.friction[f.solid]
        slides = ~s.stick & (mu * s.force > 0)
        self.slides = slides
        f, size = f.take(slides), mu[slides] * s.force[slides]
        u, push = self.active_slip[slides], s.push[slides]
        fresh, speed = push.any(axis=1), np.linalg.norm(u, axis=1)
        stopped = size * h / self.model.mass[f.index]  # slip that friction would stop in a step
        fast = ~fresh & (speed > stopped)
        push = np.where(fast[:, None], -u / np.maximum(speed, 1e-30)[:, None], push)
        speed = np.where(fresh, stopped, np.maximum(speed, SLOW))
        self.lag = np.full(len(slides), np.inf)  # slip at which friction was taken as a damping
        self.lag[np.flatnonzero(slides)[~fast & ~fresh]] = speed[~fast & ~fresh]
        block = (h * size / speed)[:, None] * (EYE - sym_outer(f.normal) - sym_outer(push))
        start = self.base[1][f.index] - (f.carried - self.x[f.index]) / h  # slip with which the solve begins
        rhs = h * size[:, None] * push - sym_times(block, start)
        points = [self.layers.points(self.base[0])] if self.sprung and self.layers is not None else []
        self.parts = sum(len(p.rhs) for p in points), len(u)
        points.append(Points(np.repeat(f.index[:, None], 4, axis=1), np.tile([1.0, 0, 0, 0], (len(u), 1)), block, rhs))
        if self.near is not None:
            self.pressed = near = self.near.moved(self._to_go(), PAIR * self.thickness[self.near.solid])
            step = Step(h, self.h_usual, self.x, *self.base)
            points.append(press(near, step, self.model.mass, self.thickness[near.solid], self.friction[near.solid]))
        self.points = every = Points.join(points)
        if self.layers is not None and self.together:
            self.of_layers = self.layers.points(self.base[0])
            every = Points.join([self.points, self.of_layers])
        self.crowded = not self.force.set(every)

    def judge(self, reaction: np.ndarray) -> Verdict:
        """What must change after a solve; `reaction` (k, 3) [N s] on the held particles, in `hold`'s order."""
        f, s, h = self.active, self.state, self.h
        F, normal = self.record_forces(reaction)
        tangent = F - normal[:, None] * f.normal
        shear = np.linalg.norm(tangent, axis=1)
        mu = self.friction[f.solid]
        pulls = normal < -PULL * np.maximum(self.model.mass[f.index] * np.linalg.norm(self.gravity),
                                            np.mean(np.abs(normal)) if len(normal) else 0.0)
        if self.together and self.round >= RELEASES:
            pulls[:] = False  # what layers press in again and again stays held until the next step
        breaks = s.stick & ~pulls & (shear > mu * np.maximum(normal, 0) * (1 + CONE))
        self._look()
        here = rows_of(self.found.key, f.key)
        slip_now = np.where((here >= 0)[:, None], self.slip[here] if len(self.slip) else 0.0, 0.0)
        speed = np.linalg.norm(slip_now, axis=1)
        turns = self.slides & ~pulls & (self.lag <= SLOW) & (speed < WEAK * SLOW)
        force = np.maximum(normal, 0)
        off = float(np.sum(mu * np.abs(force - s.force) * self.slides))
        disagree = off > LAGGED * float(np.sum(mu * force * self.slides)) and self.round == 0
        wrong = float(np.sum(-normal[pulls])) / AGREED + float(np.sum((shear - mu * force)[breaks])) / AGREED_SHEAR
        stick = (s.stick & ~breaks) | turns
        push = np.zeros_like(tangent)
        push[breaks] = tangent[breaks] / np.maximum(shear[breaks], 1e-30)[:, None]
        keep = ~pulls
        self.released = np.concatenate([self.released, f.key[pulls]])
        self.trial = States(f.key[keep], stick[keep], force[keep], push[keep])
        inside = self._inside()
        depth = -inside.gap / self.thickness[inside.solid]
        lacks = -float(np.sum(self.model.mass[inside.index] * inside.gap)) / h**2
        few = self.round > 0 or lacks < AGREED * float(np.sum(force))
        entered = int(np.sum(depth > (TOLERATED if few else PENETRATION)))
        self.round += 1
        changes = int(pulls.sum() + breaks.sum() + turns.sum()) + entered
        self.unsettled = changes
        close, bad = self._left(inside)
        entered += close
        matters = bad or entered or disagree or (wrong > float(np.sum(force)) and self.round <= PATIENCE)
        return Verdict(max(changes, 1) if matters else 0, float(np.max(depth, initial=0.0)), bad)

    def record_forces(self, reaction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What contacts bore in the last solve, which was taken whole; `reaction` as in `judge`.

        Returns:
            (forces (k, 3) [N] on what is held, their parts (k,) along the normals); sliding friction is not among them.
        """
        F, normal = self.holding.forces(self.active, reaction / self.h)
        own, pairs = self._point_forces(self.points), 0 if self.pressed is None else len(self.pressed.key)
        rubs = own[len(own) - pairs - int(self.slides.sum()): len(own) - pairs]
        self.total = np.where(self.state.stick[:, None], F, normal[:, None] * self.active.normal)
        self.total[self.slides] += rubs
        if self.pressed is not None:
            self.places = own[len(own) - pairs:], self.pressed.of(self.end())
        return F, normal

    def went_in(self) -> bool:
        """Whether something ended too deep, or through, after further solves that held the same contacts."""
        self._look()
        return (self._left(self._inside())[1] and self.may_shrink()) or self.went_through()

    @property
    def small(self) -> bool:
        """Whether the step is so small that smaller ones do not help where there is no room."""
        return self.h <= self.h_usual / SMALLER

    def may_shrink(self) -> bool:
        """Whether a step that goes wrong is to be tried smaller, and not taken as the best there is."""
        if not self.small:
            return True
        there = walls(self.found, self.near, self.there, self.thickness)
        return bool(has_room(self._wrong(), self.scan.faces, there, self.thickness, self.scan.yields,
                             pinned_particles(self.pinned, self.model.n)).any())

    @property
    def smallest(self) -> bool:
        """Whether there is hardly a smaller step to try."""
        return self.h <= self.h_usual / SMALLEST

    def went_through(self) -> bool:
        """Whether cloth passes through solids where it did not before, in a step that can still be made smaller."""
        self.crossed = self.scan.find_crossings()
        return self._crossed_more() and self.may_shrink()

    @property
    def crossings(self) -> int:
        """Pairs of triangles of cloth and solids that cross, and particles inside solids without edges or corners."""
        inside = ~self.scan.pokes[self.found.solid] & (self.found.gap < -self.thickness[self.found.solid])
        across = self.scan.find_crossings(grown=True) if self.scan.rounded else self.crossed
        return len(across) + int(inside.sum())

    @property
    def pinched(self) -> int:
        """Particles between which solids leave cloth no room."""
        return int(np.sum(self.spared > 0))

    def _minded(self, vertices: np.ndarray) -> np.ndarray:
        """Those rows (k, .) of particles none of which is pinched."""
        return vertices[(self.spared[vertices] == 0).all(axis=1)]

    def _crossed_more(self) -> bool:
        return len(self._minded(self.crossed)) > len(self._minded(self.crossed_before))

    def _wrong(self) -> np.ndarray:
        """(k, 3) particles of what ends too deep inside solids, too near to them or across."""
        inside = self._inside()
        deep = inside.index[inside.gap < -self.deep[inside.solid]]
        rows = [np.repeat(deep[:, None], 3, axis=1)]
        if self.near is not None:
            lost = left(self.near, self.pressed, self.thickness[self.near.solid])[1]
            rows.append(self._minded(self.near.own_vertices[lost]))
        if self._crossed_more():
            rows.append(self._minded(self.crossed))
        return np.concatenate(rows)

    def _spare(self) -> None:
        """What went wrong in the smallest of steps is pinched between solids, and does not keep steps small for a while."""
        self.spared[self._wrong()] = SPARED

    def _inside(self) -> VertexContacts:
        """What ends inside a solid's thickness, is not held, or held at another plane, and not pinched."""
        f, t = self.found, self.thickness[self.found.solid]
        strayed = (f.gap < -self.deep[f.solid]) & (f.gap < f.start_gap - PENETRATION * t)
        return f.take((f.gap < 0) & (~np.isin(f.key, self.active.key) | strayed) & (self.spared[f.index] == 0))

    def _left(self, inside: VertexContacts) -> tuple[int, bool]:
        """(pairs that are left closer than they should be, whether they or what is inside ended too deep)."""
        bad = bool((inside.gap < -self.deep[inside.solid]).any())
        if self.near is None:
            return 0, bad
        nearer, lost = left(self.near, self.pressed, self.thickness[self.near.solid])
        minded = (self.spared[self.near.vertices] == 0).all(axis=1)
        return int(np.sum(nearer & minded)), bad or bool((lost & minded).any())

    def counts(self) -> dict[str, Any]:
        """What a step's record says of contact, by the names of `Attempt`."""
        out = {"contacts": self.count, "unsettled": self.unsettled, "crossings": self.crossings, "pinched": self.pinched}
        if self.layers is None:
            return out
        layers, tangles = self.layers, self.layers.tangles
        return out | {"unsettled": self.unsettled + layers.off, "pinched": self.pinched + tangles.pinched,
                      "layers": layers.count, "least": layers.least, "tangled": tangles.count}

    def forces_on_particles(self) -> np.ndarray:
        """(n, 3) [N] on each particle in the last round, in particle order."""
        out = np.zeros((self.model.n, 3))
        np.add.at(out, self.active.index, self.total)
        if self.pressed is not None:
            p = self.pressed
            np.add.at(out, p.vertices, p.weights[:, :, None] * self.places[0][:, None, :])
        return out if self.layers is None else out + self.layers.forces()

    def loads(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """(force [N], torque [N m] about the origin) on each solid, by name."""
        at, force, which = self.end()[self.active.index], self.total, self.active.solid
        if self.pressed is not None:
            at, force = np.concatenate([at, self.places[1]]), np.concatenate([force, self.places[0]])
            which = np.concatenate([which, self.pressed.solid])
        out = {}
        for k, solid in enumerate(self.solids):
            mine = which == k
            arm = at[mine] - solid.pose(self.scan.time)[1] + self.model.origin
            out[solid.name] = (-force[mine].sum(axis=0), -np.cross(arm, force[mine]).sum(axis=0))
        return out
