"""Places where cloth is near an edge or corner of a solid, the law of their repulsion, and the stiffness that a load takes.
numpy only.

The law of pairs has a largest force: a taut edge of cloth that is pressed on an edge of a body goes to its least distance,
where no step is accepted, however small. A pair that a solve leaves there gets a stiffness of its own [N/m], by which the load
F that it bears moves it by a small part of its range r,

    k = F / (GIVE r),

and holds it where it began: it resists an approach, and hardly pushes. The next solve of the step goes by it. A pair
that pulls by it is let go. It is found within a step and forgotten by and by, so that a load that stays is borne by one solve.
"""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from ...options import USUAL
from ...system.checkpoint import Checkpointed
from ..points import EYE, ContactRows, rows_of, sym_outer, sym_times, tangential

PAIR = 0.5  # of the thickness (beyond the core's radius): distance that edges and faces of cloth keep
REPULSION = 100.0  # stiffness of a pair over mass / h^2, h the largest step
LEAST = 0.42  # of a pair's range: a nearer end takes another round; a fifth of the thickness
LOST = 0.3  # of a pair's range: nearer is not accepted
SETTLING = 0.3  # ranges a second that a pair may come nearer before it is stopped, between layers too: loads settle as fast
# whatever h is
CLOSE, CREEP = 0.55, 0.05  # of a pair's range: an end nearer than that, by so much, takes another round
HELD = 0.6  # of a pair's range: a pair that begins or comes nearer is held by any stiffness of its own
BARELY, KEPT = 0.45, 0.7  # of a pair's range: nearer than that, or than it was, a step stops it with a stiffness of its
# own; the former for small steps, which lift nearer pairs no faster than large ones do
SHALLOW = 0.05  # of the way from LEAST to the range: the law stiffens no further
DRAG_SLIP = 5e-4  # slip [m/s] below which a pair's friction is viscous
GIVE, BORNE = 0.02, 0.05  # of a pair's range, by which its load moves it, at first, and after many steps
STIFFER, SOFTER = 4.0, 0.8  # factors: at least, from solve to solve; from usual step to usual step; both of layers too
FIRMEST = 1e5  # times the stiffness that a pair has anyway: where others push against it none would do
TIMES = 3  # solves running after which a pair ended too near
PULLS = 1e-3  # of the mean force of pairs: a pair that pulls more is let go


@dataclass(frozen=True)
class Pairs:
    """Places where an edge or face of cloth is near an edge or corner of a solid, sorted by their ids.

    Attributes:
        vertices: (k, 3) particles; weights: (k, 3) of the place on the cloth.
        solid: (k,) index.
        normal: (k, 3) from the solid to the cloth.
        distance: (k,) at the end [m], along the normal, from the core's radius; negative has passed.
        carried: (k, 3) where the place would be if it moved with the solid [m].
        point: (k, 3) where it is at the end [m].
        key: (k,) one number each, the same from round to round.
    """

    vertices: np.ndarray
    weights: np.ndarray
    solid: np.ndarray
    normal: np.ndarray
    distance: np.ndarray
    carried: np.ndarray
    point: np.ndarray
    key: np.ndarray

    @property
    def own_vertices(self) -> np.ndarray:
        """(k, 3) the particles, those that carry none of the place replaced by the one that carries most."""
        most = np.take_along_axis(self.vertices, self.weights.argmax(axis=1)[:, None], axis=1)
        return np.where(self.weights > 0, self.vertices, most)

    def of(self, rows: np.ndarray) -> np.ndarray:
        """(k, 3) values of the places on the cloth, from those (n, 3) of the particles."""
        return np.einsum("ka,kai->ki", self.weights, rows[self.vertices])

    def moved(self, by: np.ndarray, reach: np.ndarray) -> "Pairs":
        """Those that are within reach (k,) [m] of each other where particles are moved by (n, 3) [m], as they are there."""
        shift = self.of(by)
        distance = self.distance + np.einsum("ki,ki->k", self.normal, shift)
        return replace(self, distance=distance, point=self.point + shift).take(distance < reach)

    def take(self, which: np.ndarray) -> "Pairs":
        """Some of them."""
        return Pairs(*(getattr(self, f.name)[which] for f in fields(self)))


@dataclass(frozen=True)
class Step:
    """From where a solve begins.

    Attributes:
        h: step; h_usual: the largest one [s].
        x_0: (n, 3) positions at the start of the step [m].
        x, v: (n, 3) where particles end if the solve changes nothing, and how fast they go in the mean, alterations apart.
        c: factor by which the method multiplies forces [s].
    """

    h: float
    h_usual: float
    x_0: np.ndarray
    x: np.ndarray
    v: np.ndarray
    c: float


def inertia(p: Pairs, mass: np.ndarray) -> np.ndarray:
    """(k,) [kg] that pairs' distances have; mass: (n,) of the particles [kg]."""
    return 1 / np.maximum((p.weights**2 / mass[p.vertices]).sum(axis=1), 1e-300)


def linearize_repulsion(p: Pairs, step: Step, mass: np.ndarray, thickness: np.ndarray, friction: np.ndarray,
                        firm: np.ndarray | None = None) -> ContactRows:
    """Repulsion of pairs, linearised where they now are, and friction as a damping.

    Within the range r the force is k (r - d) down to halfway between r and the least distance d_0, and
    k (r - d_0)^2/4(d - d_0) below, with k = REPULSION m/h^2, h = USUAL whatever the step: it bears resting cloth. A pair that
    comes nearer in this step than it was is stopped by as much again, of this step's own h, and given no speed by it.

    Args:
        mass: (n,) of the particles [kg]; thickness, friction: of each pair's solid.
        firm: (k,) further stiffness [N/m] by which it is held where it began, or at CLOSE: see `LoadStiffness`.
    """
    h, c = step.h, step.c
    own = inertia(p, mass)
    r = PAIR * thickness
    room = (1 - LEAST) * r
    u = np.maximum((p.distance - LEAST * r) / room, SHALLOW)
    d = LEAST * r + u * room
    stiff = REPULSION * own / USUAL**2
    far = u >= 0.5
    f = stiff * room * np.where(far, 1 - u, 1 / (4 * u))
    k = stiff * np.where(far, 1.0, 1 / (4 * u**2))
    normal_step = np.einsum("ki,ki->k", p.normal, p.point - p.of(step.x))
    f0 = f + k * (normal_step + d - p.distance)
    stop = REPULSION * own / h**2
    kept = (BARELY + (KEPT - BARELY) * min(1.0, h / step.h_usual)) * r
    began = p.distance - np.einsum("ki,ki->k", p.normal, p.point - p.carried)
    limit = np.clip(began - SETTLING * h * r, kept, r)
    nearing = p.distance < limit
    f0 += np.where(nearing, stop * (limit - p.distance + normal_step), 0.0)
    k = k + np.where(nearing, stop, 0.0)
    if firm is not None:
        least = (BARELY + (CLOSE - BARELY) * min(1.0, h / step.h_usual)) * r
        limit = np.clip(began - SETTLING * h * r, least, CLOSE * r)
        firm = np.where(np.minimum(p.distance, began) < HELD * r, firm, 0.0)
        f0 += firm * (limit - p.distance + normal_step)
        k = k + firm
    slip = np.linalg.norm(tangential((p.point - p.carried) / h, p.normal), axis=1)
    drag = c * friction * f / np.maximum(slip, DRAG_SLIP)
    normal = sym_outer(p.normal)
    block = drag[:, None] * (EYE - normal)
    start = p.of(step.v) + (p.of(step.x_0) - p.carried) / h  # slip with which the solve begins
    rhs = (c * f0)[:, None] * p.normal - sym_times(block, start)
    return ContactRows(np.column_stack([p.vertices, p.vertices[:, 0]]), np.column_stack([p.weights, np.zeros(len(r))]),
                       c / h * block + (c**2 * k)[:, None] * normal, rhs)


def left(p: Pairs, before: Pairs | None, thickness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(whether pairs (k,) are left nearer than they should be, and than before or than LEAST; whether they are too near to be
    accepted)."""
    r = PAIR * thickness
    now, was = p.distance / r, np.full(len(r), np.inf)
    if before is not None and len(before.key):
        where = rows_of(before.key, p.key)
        was = np.where(where >= 0, before.distance[where] / r, np.inf)
    return ((now < CLOSE) & (now < was - CREEP)) | (now < LEAST), now < LOST


@dataclass
class Firm:
    """Stiffness [N/m] of pairs, sorted by key."""

    key: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def of(self, key: np.ndarray) -> np.ndarray:
        """(k,) [N/m] of pairs; 0 where there is none."""
        row = rows_of(self.key, key)
        return np.where(row >= 0, self.stiffness[row], 0.0) if len(self.key) else np.zeros(len(key))


class LoadStiffness(Checkpointed):
    """Further stiffness of pairs of a model's cloth with solids, by their loads.

    Attributes:
        accepted: with which the last accepted step ended; trial: in this attempt.
    """

    STATE = ("accepted",)

    def __init__(self) -> None:
        self.accepted = self.trial = Firm()
        self.missed: dict[int, int] = {}

    def begin(self) -> None:
        """A new attempt."""
        self.trial, self.missed = self.accepted, {}

    def update(self, lost: np.ndarray, key: np.ndarray, load: np.ndarray, reach: np.ndarray, least: np.ndarray) -> int:
        """After a solve: stiffens pairs (k,) that ended too near; lets go of those that pull. How many these are.

        Args:
            lost: (k,) whether it ended too near; load: (k,) [N] that it bore; reach: (k,) its range [m].
            least: (k,) stiffness [N/m] that it has anyway.
        """
        firm = self.trial.of(key)
        self.missed = {k: self.missed.get(k, 0) + 1 for k in key[lost].tolist()}
        lost = lost & ((firm > 0) | np.array([self.missed.get(k, 0) >= TIMES for k in key.tolist()], dtype=bool))
        pulls = (firm > 0) & (load < -PULLS * np.mean(np.abs(load))) & ~lost if len(load) else lost
        if not (lost.any() or pulls.any()):
            return 0
        needed = np.maximum(load / (GIVE * reach), STIFFER * np.maximum(firm, least))
        firm = np.where(lost, np.minimum(needed, FIRMEST * least), np.where(pulls, 0.0, firm))
        absent = ~np.isin(self.trial.key, key)
        key, firm = np.concatenate([self.trial.key[absent], key]), np.concatenate([self.trial.stiffness[absent], firm])
        order = np.argsort(key)
        order = order[firm[order] > 0]
        self.trial = Firm(key[order], firm[order])
        return int(pulls.sum())

    def commit(self, key: np.ndarray, load: np.ndarray, reach: np.ndarray, least: np.ndarray, share: float) -> None:
        """The step, so much of a usual one, was accepted; of its last solve's pairs (k,), arguments as in `update`."""
        firm = self.trial.of(key)
        firm = np.maximum(SOFTER**share * firm, np.minimum(firm, load / (BORNE * reach)))
        keep = firm > least
        self.accepted = Firm(key[keep], firm[keep])

    def clear(self) -> None:
        """The state was changed from outside."""
        self.accepted = self.trial = Firm()
