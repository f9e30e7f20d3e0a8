"""Cloth against cloth: repulsion within a thickness and Coulomb friction between layers, inside the solve.

Pairs of vertex and face, edge and edge repel each other with the potential phi(d), phi'' = k from the thickness r down
to r/2 and k r^2 / 4 d^2 below: joined with two continuous derivatives, convex, growing without bound. Each is a point of
`touch`: linearised along its normal, semidefinite, in the matrix-free product and the preconditioner. The first solve of a
step linearises them where the last motion would lead, and takes in what would meet on the way there; further solves, where
the cloth then is. No solve is taken further than the way is free, so that what was apart stays apart.

Differs from [BW98 §6]: the paper's damped springs act on what is near at the beginning of a step. They are here too,
as `springs`.
"""

import functools
import time
from dataclasses import dataclass

import numpy as np

from ..fields import Fields
from ..model import Model
from ..scene import Scene
from .layer_detection import LayerDetector, Near
from .pairs import Points
from .states import rows_of, tangential

PRESS = 100.0  # stiffness of a pair over mass / h^2, h the largest step
SHALLOW = 0.02  # of a pair's distance: nearer, the force grows no more
CREEP = 2e-5  # slip [m/s] below which friction between layers is viscous
LOOSE = 0.5  # of gravity: what the forces of pairs may be off by, over the mass they act on
GIVE = 0.01  # of a pair's distance over h^2: the same where gravity is small
CLOSE, WIDE = 0.3, 0.7  # of a pair's distance: what ends nearer gets stiffer, further softer again
STIFFER, SOFTER, STIFFEST = 4.0, 0.8, 1e6  # factors from step to step, and their product at most


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


@dataclass(frozen=True)
class Pressed:
    """Pairs as a solve took them.

    Attributes:
        near: the pairs.
        stiff: (k,) stiffness [N/m]; own: (k,) mass that the pair's distance has [kg].
        force: (k,) [N] and slope: (k,) [N/m] where they were linearised, at distance `at` [m].
        drag: (k,) friction over slip [N s/m].
    """

    near: Near
    stiff: np.ndarray
    own: np.ndarray
    force: np.ndarray
    slope: np.ndarray
    at: np.ndarray
    drag: np.ndarray


class Layers:
    """The contacts of a model's cloths with each other and with themselves.

    Attributes:
        count: pairs in contact after the last solve; energy: of their repulsion [J].
        least: smallest distance of any pair over what it should keep; 1 where none is in contact.
        off: pairs whose force was not what the last solve took it to be.
        seconds: wall time spent here.
    """

    ROUNDS = 12

    def __init__(self, fields: Fields, model: Model, scene: Scene, h: float, cpu: bool) -> None:
        self.model, self.h_usual = model, h
        self.detector = LayerDetector(fields, model, scene, cpu)
        mu = np.concatenate([np.full(c.mesh.vertex_count, c.contact.friction if c.contact else 0.0)
                             for c in scene.cloths])
        self.friction = np.sqrt(mu)[model.user]
        self.gravity = scene.gravity
        self.boost = np.ones(model.n)
        self.known: dict[str, np.ndarray] = {"key": np.zeros(0, dtype=np.int64), "force": np.zeros(0)}
        self.pressed: Pressed | None = None
        self.count, self.energy, self.least, self.off = 0, 0.0, 1.0, 0
        self.seconds, self.inside = 0.0, False

    @timed
    def begin(self, h: float, x: np.ndarray, v: np.ndarray) -> None:
        """A new attempt from the saved state (n, 3); the model is at its predicted end."""
        self.h, self.x, self.v = h, x, v
        self.first = True
        self.detector.begin()
        self.detector.cover()
        self.near = self.detector.look()

    @timed
    def points(self, base: np.ndarray) -> Points:
        """Pairs as points of `touch`, for a solve from positions base (n, 3)."""
        p, h = self.near, self.h
        stiff, own = self._stiffness(p)
        at = np.clip(p.end, np.minimum(p.start, p.radius / 2) if self.first else SHALLOW * p.radius, p.radius)
        force, slope = _law(at, p.radius)
        force, slope = stiff * force, stiff * slope
        now = np.einsum("ki,ki->k", p.normal, p.of(base))
        bears = force
        if self.first:  # a force that has not been known before stops no more than what comes
            where = rows_of(self.known["key"], p.key)
            freely = own / h**2 * np.maximum(p.radius - np.einsum(
                "ki,ki->k", p.normal, p.of(self.x + h * self.v + h**2 * self.gravity)), 0)
            bears = np.where(where >= 0, self.known["force"][where] if len(self.known["force"]) else 0.0,
                             np.minimum(force, freely))
        slip = np.linalg.norm(tangential(p.of(self.model.read_particles()[0] - self.x) / h, p.normal), axis=1)
        drag = self.friction[p.vertices[:, 0]] * self.friction[p.vertices[:, 3]] * bears / np.maximum(slip, CREEP)
        self.pressed = Pressed(p, stiff, own, force, slope, at, drag)
        normal = np.einsum("ki,kj->kij", p.normal, p.normal)
        block = (h * drag)[:, None, None] * (np.eye(3) - normal)
        rhs = (h * (force + slope * (at - now)))[:, None] * p.normal - np.einsum(
            "kij,kj->ki", block, p.of(base - self.x) / h)
        return p.vertices, p.weights, block + (h**2 * slope)[:, None, None] * normal, rhs

    @timed
    def advance(self) -> float:
        """Part of the way from where the last solve began to where the model now is that nothing passes through on."""
        self.detector.cover()
        part, self.blocking = self.detector.free_way()
        return part

    @timed
    def follow(self) -> None:
        """Pairs on the way from the start of the step to where the model now is."""
        self.detector.cover()
        self.near = self.detector.look()

    @timed
    def arrive(self) -> None:
        """The model is where the next solve begins: pairs as they are there."""
        self.detector.arrive()
        self.look()
        self.first = False

    @timed
    def look(self) -> None:
        """Pairs as they are where the model now is, on a path that was covered."""
        self.near = p = self.detector.look()
        stiff, _ = self._stiffness(p)
        self.energy = float(np.sum(stiff * _potential(p.end, p.radius)))
        self.count = len(p.end)
        self.least = float(np.min(p.end / p.radius, initial=1.0))

    @timed
    def settled(self) -> bool:
        """Whether forces are what the last solve took them to be, and nothing has come too near by it."""
        p, q = self.near, self.pressed
        assert q is not None
        x = self.model.read_particles()[0]
        keys = np.union1d(p.key, q.near.key)
        force, slip_force, own, radius = (np.zeros(len(keys)) for _ in range(4))
        here, there = np.searchsorted(keys, p.key), np.searchsorted(keys, q.near.key)
        stiff, mass = self._stiffness(p)
        now = stiff * _law(p.end, p.radius)[0]
        slip = np.linalg.norm(tangential(p.of(x - self.x) / self.h, p.normal), axis=1)
        mu = self.friction[p.vertices[:, 0]] * self.friction[p.vertices[:, 3]]
        force[here], own[here], radius[here] = now, mass, p.radius
        slip_force[here] = mu * now * np.minimum(1.0, slip / CREEP)
        taken = q.force + q.slope * (q.at - np.einsum("ki,ki->k", q.near.normal, q.near.of(x)))
        slid = np.linalg.norm(tangential(q.near.of(x - self.x) / self.h, q.near.normal), axis=1)
        force[there] -= taken
        slip_force[there] -= q.drag * slid
        own[there], radius[there] = q.own, q.near.radius
        allowed = own * np.maximum(LOOSE * np.linalg.norm(self.gravity), GIVE * radius / self.h**2)
        off = np.abs(force) + np.abs(slip_force) > allowed
        self.off = int(np.sum(off))
        return not off.any() and self.least > CLOSE / 3

    @timed
    def friction_work(self) -> float:
        """Lagged friction's part of the incremental potential [J], where the model now is."""
        q = self.pressed
        if q is None or not len(q.drag):
            return 0.0
        slip = tangential(q.near.of(self.model.read_particles()[0] - self.x) / self.h, q.near.normal)
        return float(self.h / 2 * np.sum(q.drag * np.sum(slip**2, axis=1)))

    @timed
    def commit(self) -> None:
        """The step was accepted."""
        p = self.near
        stiff, _ = self._stiffness(p)
        order = np.argsort(p.key)
        self.known = {"key": p.key[order], "force": (stiff * _law(p.end, p.radius)[0])[order]}
        part = np.full(self.model.n, np.inf)
        np.minimum.at(part, p.vertices, np.broadcast_to((p.end / p.radius)[:, None], p.vertices.shape))
        self.boost = np.where(part < CLOSE, np.minimum(STIFFER * self.boost, STIFFEST),
                              np.where(part > WIDE, np.maximum(SOFTER * self.boost, 1.0), self.boost))

    def pass_by(self) -> None:
        """A step in which nothing met was accepted."""
        self.energy, self.count, self.least, self.pressed = 0.0, 0, 1.0, None
        self.commit()

    def forces(self) -> np.ndarray:
        """(n, 3) [N] of layers on each other where the model now is, in particle order; they add up to 0."""
        out = np.zeros((self.model.n, 3))
        q = self.pressed
        if q is not None:
            x = self.model.read_particles()[0]
            p = q.near
            taken = q.force + q.slope * (q.at - np.einsum("ki,ki->k", p.normal, p.of(x)))
            pull = taken[:, None] * p.normal - q.drag[:, None] * tangential(p.of(x - self.x) / self.h, p.normal)
            np.add.at(out, p.vertices, p.weights[:, :, None] * pull[:, None, :])
        return out

    def clear(self) -> None:
        """The state was changed from outside."""
        self.known = {"key": np.zeros(0, dtype=np.int64), "force": np.zeros(0)}
        self.boost[:] = 1.0
        self.model.save()
        self.detector.begin()
        self.detector.cover()
        self.look()

    def checkpoint(self) -> dict[str, np.ndarray]:
        """What is remembered from step to step, as arrays by name."""
        return {**self.known, "boost": self.boost, "energy": np.array(self.energy)}

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave."""
        self.known = {name: state[name] for name in ("key", "force")}
        self.boost, self.energy = state["boost"].copy(), float(state["energy"])

    def _stiffness(self, p: Near) -> tuple[np.ndarray, np.ndarray]:
        """(stiffness [N/m], mass [kg]) of pairs."""
        own = 1 / np.maximum((p.weights**2 / self.model.mass[p.vertices]).sum(axis=1), 1e-300)
        return PRESS * own / self.h_usual**2 * p.factor * self.boost[p.vertices].max(axis=1), own


def _law(d: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(force, its slope) at distances d, over the stiffness."""
    d = np.maximum(d, SHALLOW * r)
    far = d >= r / 2
    return (np.where(far, np.maximum(r - d, 0.0), r**2 / (4 * d)),
            np.where(far, np.where(d <= r, 1.0, 0.0), r**2 / (4 * d**2)))


def _potential(d: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Energy at distances d, over the stiffness [m^2]."""
    shallow = SHALLOW * r
    c = np.maximum(d, shallow)
    energy = np.where(c >= r / 2, np.maximum(r - c, 0.0) ** 2 / 2, r**2 / 8 + r**2 / 4 * np.log(r / (2 * c)))
    return energy + np.maximum(shallow - d, 0.0) * r**2 / (4 * shallow)
