"""Cloth against cloth: repulsion within a thickness and Coulomb friction between layers, inside the solve.

Pairs of vertex and face, edge and edge repel each other (`repulsion`). Each is a point of `touch`: linearised along its
normal, semidefinite, in the matrix-free product and the preconditioner. The first solve of a step linearises them where
the last motion would lead; further solves, where the cloth then is. No solve is taken further than the way is free, so
that what was apart stays apart.

What comes nearer than at the start of the step, and than it should, is stopped by a stiffness of the step's own h,
which gives no speed back. Friction is a damping by the slip that was last seen, or, where that would be more than
Coulomb's cone, its full size against the slip; the normal force is what the pair bore in the last solve.

Differs from [BW98 §6]: the paper's damped springs act on what is near at the start of a step, and trust in coherence:
`springs`.
"""

import functools
import time

import numpy as np

from ..errors import SceneError
from ..fields import Fields
from ..model import Model
from ..scene import Scene
from .closest import VERTEX_FACE
from .layer_detection import LayerDetector
from .near import Near
from .pairs import Points
from .pressed import Met, Pressed
from .repulsion import FLOOR, SHALLOW, height, law, room
from .states import EYE, length, rows_of, sym_outer, sym_times, tangential
from .tangles import Tangles

PRESS = 12.0  # stiffness of a pair over mass / h^2, h the largest step
STOP = 30.0  # the same of what stops an approach, h this step
CREEP = 2e-5  # slip [m/s] below which friction between layers is viscous
CONE = 1.02  # times the most that friction can be, above which what it damps slides
PATIENCE = 3  # solves after which normal forces that friction goes by, and that still change, do so in the next step
LAGGED = 0.1  # relative error of all friction that a first solve may leave
AGREED = 0.1  # part of all forces of pairs by which what solves take them to be may be off
RUBBED = 0.05  # the same of friction beyond its cone
LOOSE = 2.0  # of gravity: what the forces of pairs may be off by, over the mass they act on
GIVE = 0.01  # of a pair's distance over h^2: the same where gravity is small
CLOSE, WIDE = 0.3, 0.7  # of a pair's room: what ends with less gets stiffer, with more softer again
STIFFER, SOFTER, STIFFEST = 4.0, 0.8, 64.0  # factors from usual step to usual step, and their product at most


NOTHING: dict[str, np.ndarray] = {"key": np.zeros(0, dtype=np.int64), "force": np.zeros(0)}


def timed(method):
    """Adds a method's wall time to `seconds` of its object; those it calls in turn are not counted again."""

    @functools.wraps(method)
    def inner(self, *args):
        if self.inside:
            return method(self, *args)
        self.inside, began = True, time.perf_counter()
        try:
            return method(self, *args)
        finally:
            self.inside = False
            self.seconds += time.perf_counter() - began

    return inner


class Layers:
    """The contacts of a model's cloths with each other and with themselves.

    Attributes:
        count: pairs in contact after the last solve; energy: of their repulsion [J].
        least: smallest distance of any pair over what it should keep; 1 where none is in contact.
        off: pairs whose force was not what the last solve took it to be.
        seconds: wall time spent here.
    """

    ROUNDS = 12
    agreed, floor = AGREED, FLOOR

    def __init__(self, fields: Fields, model: Model, scene: Scene, h: float, cpu: bool, tangles: str) -> None:
        self.model, self.h_usual = model, h
        self.detector = LayerDetector(fields, model, scene, cpu, self.floor)
        self.tangles = Tangles(model.n, self.detector.faces, self.detector.host_half, self.detector.may_meet, tangles)
        mu = np.concatenate([np.full(c.mesh.vertex_count, c.contact.friction if c.contact else 0.0)
                             for c in scene.cloths])
        self.friction = np.sqrt(mu)[model.user]
        self.gravity = scene.gravity
        self.boost = np.ones(model.n)
        self._stiff: tuple[Near, np.ndarray, np.ndarray] | None = None  # of the pairs that were last asked for
        self._gaps: tuple[Near, np.ndarray] | None = None
        self.kept = NOTHING  # what pairs bore in the last accepted step
        self.pressed: Pressed | None = None
        self.borne: np.ndarray = np.zeros(0)  # what they bore in the last solve [N]
        self.met: Met | None = None  # the last pairs, and those that the last solve took
        self.count, self.energy, self.least, self.was, self.off = 0, 0.0, 1.0, 1.0, 0
        self.seconds, self.inside = 0.0, False

    @timed
    def begin(self, h: float, x: np.ndarray, v: np.ndarray, guess: bool) -> None:
        """A new attempt from the saved state (n, 3); the model is at its predicted end, and with `guess` looked at there."""
        self.h, self.x, self.v = h, x, v
        self.round, self.there, self.met, self._gaps = 0, self.model.read_particles()[0], None, None
        self.detector.begin()
        if guess:
            self.near = self.detector.look(swept=True)  # of those that were candidates before

    @timed
    def meet(self) -> bool:
        """Whether anything is in reach of anything where the model now is, or passes through it on the way there."""
        self.detector.cover()
        self.near = self.detector.look(swept=True)
        return len(self.near.end) > 0 or self.detector.free_way()[0] < 1  # the free way misses nothing

    @timed
    def points(self, base: np.ndarray) -> Points:
        """Pairs as points of `touch`, for a solve from positions base (n, 3)."""
        p, h = self.near, self.h
        stiff, own = self._stiffness(p)
        at = self._where(p)
        force, slope = self._pull(p, at, stiff, own)
        moved = p.of(base - self.x)
        slip = tangential(moved / h, p.normal) if self.met is not None else p.slip(self.there - self.x, h)
        speed = length(slip)
        bears = self._mu(p) * self._expected(p, own, stiff * law(at, p.radius)[0])
        slides = self._slides(p, slip) & (bears > 0)
        way = np.where(slides[:, None], slip / np.maximum(speed, 1e-300)[:, None], 0.0)
        drag = bears / np.maximum(speed, CREEP)
        self.pressed = Pressed(p, own, force, slope, at, self._limit(p), bears, way, drag)
        if self.met is not None:
            self.met = Met(self.pressed, p, self.met.x, self.x, h)
        self.round += 1
        normal, ahead = sym_outer(p.normal), np.einsum("ki,ki->k", moved, p.normal)
        block = (h * drag)[:, None] * (EYE - normal - sym_outer(way))
        pull = force + slope * (at - self._began(p) - ahead)
        rhs = (h * pull)[:, None] * p.normal - sym_times(block, moved / h) - (h * bears)[:, None] * way
        points = p.vertices, p.weights, block + (h**2 * slope)[:, None] * normal, rhs
        if not self.tangles.active:
            return points
        more = self.tangles.points(self.x, base, self.model.mass, h, self.h_usual)
        vertices, weights, block, rhs = (np.concatenate(parts) for parts in zip(points, more))
        return vertices, weights, block, rhs

    def _where(self, p: Near) -> np.ndarray:
        """(k,) distances [m] at which pairs are linearised: where they are, and in a first solve no nearer than they began, or
        than half of what they should keep."""
        least = SHALLOW * p.radius
        if not self.round:
            least = np.clip(self._began(p), height(SHALLOW, p.radius), height(0.5, p.radius))
        return np.clip(p.end, least, p.radius)

    def _pull(self, p: Near, d: np.ndarray, stiff: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(force [N], slope [N/m]) of pairs at distances d: repulsion, and what stops their approach.

        What comes nearer than at the start of the step, and than it should, is stopped by a stiffness that goes with this
        step's own h. It acts within the step alone, and so gives no speed back.
        """
        force, slope = law(d, p.radius)
        limit = self._limit(p)
        stop = np.where(d < limit, STOP * own * p.factor / self.h**2, 0.0)
        return stiff * force + stop * (limit - d), stiff * slope + stop

    def _limit(self, p: Near) -> np.ndarray:
        """(k,) distance [m] below which pairs are stopped."""
        return np.clip(self._began(p), height(2 * SHALLOW, p.radius), p.radius)

    def _began(self, p: Near) -> np.ndarray:
        """(k,) what their distances were where the step began, along their normals [m]."""
        if self._gaps is None or self._gaps[0] is not p:
            self._gaps = p, p.along(self.x)
        return self._gaps[1]

    def _slides(self, p: Near, slip: np.ndarray) -> np.ndarray:
        """(k,) whether friction is taken as its full size against the slip, and not as a damping.

        A damping, by the slip that was last seen, never pushes backwards, and bounds friction's work from above. What was
        damped by more than friction can do slides, until it turns round.
        """
        q = self.pressed
        if self.met is None or q is None or not len(q.bears):
            return np.zeros(len(p.end), dtype=bool)
        where = self.met.rows
        known = where >= 0
        slid = q.way[where].any(axis=1)
        forward = np.einsum("ki,ki->k", slip, q.way[where]) > 0
        over = q.drag[where] * length(slip) > CONE * q.bears[where]
        return known & np.where(slid, forward, over)

    def _expected(self, p: Near, own: np.ndarray, force: np.ndarray) -> np.ndarray:
        """(k,) [N] what pairs will bear: what they bore in the last solve, or what stops those that are new, and no more."""
        if self.met is None:
            where, bore = rows_of(self.kept["key"], p.key), self.kept["force"]
        else:
            where, bore = self.met.rows, self.borne
        freely = self._began(p) + self.h * p.along(self.v)
        stops = np.minimum(force, own / self.h**2 * np.maximum(p.radius - freely, 0))
        return np.where(where >= 0, bore[where], stops) if len(bore) else stops

    def _mu(self, p: Near) -> np.ndarray:
        """(k,) coefficients of friction."""
        return self.friction.take(p.vertices[:, 0]) * self.friction.take(p.vertices[:, 3])

    @timed
    def advance(self) -> float:
        """Part of the way from where the last solve began to where the model now is that nothing passes through on."""
        self.detector.cover()
        part, self.blocking = self.detector.free_way()
        return part

    @timed
    def energy_here(self) -> float:
        """Of the repulsion [J] where the model now is, for an attempt at a state that no step led to."""
        return self._energy(self.detector.look())

    def _energy(self, p: Near) -> float:
        return float(np.sum(self._stiffness(p)[0] * p.potential))

    @timed
    def look(self) -> None:
        """Pairs as they are where the model now is."""
        self.near = p = self.detector.look()
        self.met = None if self.pressed is None else Met(self.pressed, p, self.model.read_particles()[0], self.x, self.h)
        self.energy = self._energy(p)
        self.count = len(p.end)
        self.least = float(np.min(p.end / p.radius, initial=1.0))

    @timed
    def bore(self) -> None:
        """Remembers what pairs bore in the last solve, which the model now shows the end of."""
        q = self.pressed
        assert q is not None
        d = q.near.along(self.model.read_particles()[0])
        self.borne = np.maximum(q.force + q.slope * (q.at - d), 0.0)

    @timed
    def settled(self) -> bool:
        """Whether forces are what the last solve took them to be, and nothing has come too near by it."""
        p, q, met = self.near, self.pressed, self.met
        assert q is not None and met is not None
        stiff, own = self._stiffness(p)
        now = self._pull(p, p.end, stiff, own)[0]
        taken, row = q.force + q.slope * (q.at - met.gap), met.rows
        gone = np.ones(len(taken), dtype=bool)
        gone[row[row >= 0]] = False
        force = np.concatenate([now - np.where(row >= 0, taken[row], 0.0) if len(taken) else now, taken[gone]])
        own, radius = np.concatenate([own, q.own[gone]]), np.concatenate([p.radius, q.near.radius[gone]])
        allowed = own * np.maximum(LOOSE * np.linalg.norm(self.gravity), GIVE * radius / self.h**2)
        total = float(np.sum(now))
        wrong = np.where(np.abs(force) > allowed, np.abs(force), 0.0)
        self.off = int(np.sum(wrong > 0)) if np.sum(wrong) > AGREED * total else 0
        lag = abs(float(np.sum(self._mu(p) * now)) - float(np.sum(q.bears)))
        late = lag > LAGGED * float(np.sum(q.bears)) and self.round <= PATIENCE
        rubbed = length(q.friction(met.slip))
        back = np.einsum("ki,ki->k", met.slip, q.way) < 0  # pushed the wrong way
        over = float(np.sum(np.maximum(rubbed - CONE * q.bears, 0) + back * q.bears))
        rubs = over > RUBBED * float(np.sum(q.bears)) and self.round == 1  # what it still is then, it is in the next step
        left, was = room(np.array([self.least, self.was]), np.ones(2)).tolist()
        return not self.off and not rubs and not late and left > min(CLOSE / 3, was / 2, 2 * was)

    @timed
    def lagged(self) -> float:
        """What layers add to the incremental potential [J] besides `energy`, now, as the last solve took it.

        Friction, and the stop of approaches, of the pairs of that solve; and what repulsion would be with their factors:
        factors change from place to place and have no force.
        """
        q, p, met = self.pressed, self.near, self.met
        if q is None or met is None or not len(q.own):
            return 0.0
        speed = length(met.slip)
        rub = float(self.h * np.sum(q.bears * np.where(speed < CREEP, speed**2 / (2 * CREEP), speed - CREEP / 2)))
        stop = STOP * q.own * q.near.factor / self.h**2 * np.maximum(q.limit - met.gap, 0) ** 2 / 2
        row = met.rows
        stiff, _ = self._stiffness(p)
        change = np.where(row >= 0, q.near.factor[row] / p.factor - 1, 0.0)
        return rub + float(np.sum(stop)) + float(np.sum(change * stiff * p.potential))

    @timed
    def commit(self) -> None:
        """The step was accepted."""
        p, q = self.near, self.pressed
        part = np.full(self.model.n, np.inf)
        np.minimum.at(part, p.vertices, np.broadcast_to(room(p.end, p.radius)[:, None], p.vertices.shape))
        if self.tangles.active:
            self.tangles.find(self.model.read_particles()[0], self.h)
            self.detector.let_rest(self.tangles.resting)
        self.was = self.least
        self.kept = NOTHING if q is None else {"key": q.near.key[q.near.order], "force": self.borne[q.near.order]}
        share = min(self.h / self.h_usual, 1.0)
        self.boost = np.where(part < CLOSE, np.minimum(STIFFER**share * self.boost, STIFFEST),
                              np.where(part > WIDE, np.maximum(SOFTER**share * self.boost, 1.0), self.boost))
        self._stiff = None
        self.energy = self._energy(p)  # what the next step begins with

    def let_go(self) -> None:
        """What leaves no way free is pinched, and rests for a while."""
        for i, j, kind in self.blocking.tolist():
            both = [i, *self.detector.faces[j]] if kind == VERTEX_FACE else [*self.detector.edges[i], *self.detector.edges[j]]
            self.tangles.let_go(np.array(both))
        self.detector.let_rest(self.tangles.resting)

    def pass_without(self) -> None:
        """Nothing met in the step as it was made."""
        self.energy, self.count, self.least = 0.0, 0, 1.0
        self.pressed = self.met = None

    def pass_by(self) -> None:
        """A step in which nothing met was accepted."""
        self.pass_without()
        self.commit()

    def forces(self) -> np.ndarray:
        """(n, 3) [N] of layers on each other where the model now is, in particle order; they add up to 0."""
        out = np.zeros((self.model.n, 3))
        q = self.pressed
        if q is not None:
            x = self.model.read_particles()[0]
            p = q.near
            taken = q.force + q.slope * (q.at - p.along(x))
            pull = taken[:, None] * p.normal + q.friction(p.slip(x - self.x, self.h))
            np.add.at(out, p.vertices, p.weights[:, :, None] * pull[:, None, :])
        return out

    def clear(self) -> None:
        """The state was changed from outside."""
        self.kept, self.pressed = NOTHING, None
        self.boost[:], self._stiff = 1.0, None
        self.model.save()
        self.tangles.until[:] = 0
        self.tangles.find(self.model.read_particles()[0])
        self.detector.let_rest(self.tangles.resting)
        self.detector.begin()
        self.detector.cover()
        self.look()

    def inspect(self) -> list[str]:
        """What is wrong from the start, in words.

        Raises:
            SceneError: cloth passes through cloth, and the policy is "abort".
        """
        count = self.tangles.count
        if not count:
            return []
        what = f"{count} pairs of an edge and a triangle of cloth pass through each other at the start"
        if self.tangles.policy == "abort":
            raise SceneError(f"{what}; tangles='untangle' pulls them apart, 'ignore' leaves them")
        return [f"{what}: they are " + ("pulled apart" if self.tangles.policy == "untangle" else "left alone until apart")]

    def checkpoint(self) -> dict[str, np.ndarray]:
        """What is remembered from step to step, as arrays by name."""
        numbers = {name: np.array(getattr(self, name)) for name in ("count", "energy", "was")}
        d = self.detector
        return {**self.kept, **numbers, "boost": self.boost, "candidates": d.candidates, "distances": d.distances,
                "walked": d.walked.to_numpy(), "fresh": np.array(d.fresh),
                "until": self.tangles.until, "tangled": np.array(self.tangles.active)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave."""
        self.kept = {name: state[name] for name in ("key", "force")}
        self.count = int(state["count"])
        self._stiff = None
        self.boost, self.energy, self.was = state["boost"].copy(), float(state["energy"]), float(state["was"])
        self.detector.walked.from_numpy(state["walked"])
        self.detector.candidates, self.detector.distances = state["candidates"], state["distances"]
        self.detector.fresh = bool(state["fresh"])
        self.tangles.until = state["until"].copy()
        if state["tangled"]:
            self.tangles.find(self.model.read_particles()[0])
        self.detector.let_rest(self.tangles.resting)

    def _stiffness(self, p: Near) -> tuple[np.ndarray, np.ndarray]:
        """(stiffness [N/m], mass [kg]) of pairs."""
        if self._stiff is None or self._stiff[0] is not p:
            light = (1 / self.model.mass).take(p.vertices)
            own = 1 / np.maximum(np.einsum("ka,ka,ka->k", p.weights, p.weights, light), 1e-300)
            a, b, c, d = self.boost.take(p.vertices.T)
            stiff = PRESS * own / self.h_usual**2 * p.factor * np.maximum(np.maximum(a, b), np.maximum(c, d))
            self._stiff = p, stiff, own
        return self._stiff[1:]
