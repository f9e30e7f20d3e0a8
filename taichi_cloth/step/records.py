"""Records of the steps of a run: each step's own, the place where it was slow or rejected, and sums over all of them.

Sums are counted as steps are made: the log may be shorter than the run. A place is the cloth, its vertex, its position, and
the surface in contact.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..renamed import old_names
from ..scene.cloth import Cloth
from ..scene.solids import Solid
from ..system.held import Held
from ..system.place import Place
from ..system.state import ParticleState
from .attempt import TOUCH
from .ledger import STILL, moved, totals

OFF = 0.01  # part of all forces by which contacts with solids may be off Coulomb's law without a word
DOUBTFUL = 0.1  # part of the energy that moved: a larger part unaccounted for is reported
ADVICE = "a smaller h (--h), a tolerance (--tolerance) or the integrator newton_euler accounts for more of it"
SQUEEZED = "held hard where it is pressed: unpin it, or attach it with a stiffness and a largest force"


@dataclass(frozen=True, slots=True)
class Trouble:
    """The worst place of an attempt at a step.

    Attributes:
        name: of the rejection; "" for a step that was accepted.
        h: step that was tried [s].
        detail: more about the rejection.
        cloth, vertex: by the cloth's own numbers.
        at: (3,) where it was then [m]; speed: how fast it went [m/s].
        against: name of the solid or cloth that it is in contact with, or "".
        held: whether a pin, motion or attachment holds it in all directions.
        gap: part left there of the distance to keep, 1 is all of it; below 0 it has passed the surface.
    """

    name: str
    h: float
    detail: str
    cloth: str
    vertex: int
    at: tuple[float, float, float]
    speed: float
    against: str = ""
    gap: float = 1.0
    held: bool = False

    def __str__(self) -> str:
        at = ", ".join(f"{c:.4g}" for c in self.at)
        near = f", {self.gap:.2g} thicknesses from {self.against!r}" if self.against else ""
        squeezed = f", {SQUEEZED}" if self.held and self.against and self.gap < 1 else ""
        return f"vertex {self.vertex} of {self.cloth!r} at ({at}) m, {self.speed:.3g} m/s{near}{squeezed}"


@old_names
@dataclass(slots=True)
class StepRecord:
    """One accepted step, for the log and for telemetry.

    Attributes:
        t: time at its end [s].
        h: size [s].
        iterations: CG iterations of all its solves.
        solves: number of linear solves.
        residual: relative residual of its worst solve, preliminary ones apart.
        status: of its worst solve; "EXPLICIT" where there is none; a rejection's name in fixed-step mode.
        rejections: name -> count, of the attempts before it.
        energies: J by term at its end.
        stretch: largest |w|/b.
        seconds: wall time by part: EVAL, CG, C-C, C-S, and total, rejected attempts included; compiling: the part of it
            in first launches of kernels.
        contacts: number of contacts with solids at its end.
        unconverged_contacts: how many of them had not agreed on sticking, sliding or releasing when it was accepted, and how
            many pairs of cloth not on their forces.
        contact_error: how far contacts with solids are off, as a part of all impulses: weight, contact, pins, changes of
            momentum. Without contact_tol: impulses by Coulomb's law against those of the linear solve. With it: the same,
            of the last solve; in a step that did not converge, forces off balance if these are more. Edges, layers and
            pinched cloth do not count.
        solid_intersections: pairs of triangles of cloth and of solids with edges or corners that pass through each other.
        layers: pairs of cloth in contact with cloth; min_gap_ratio: the smallest distance of any over the distance to keep.
        known_intersections: pairs of an edge and a triangle of cloth that are known to pass through each other; contact
            ignores them, but for those beside a seam that is still apart.
        pinched: particles to which solids leave no room: layers that were let go, and those that no step gets smaller for.
        intersections: pairs of an edge and a triangle of cloth that pass through each other at its end, counted exactly; None
            where that was not asked for.
        evaluations: of the forces, by an explicit method.
        error: estimated, over the error that the tolerance allows in this step; 0 without a tolerance.
        fallback_reason: why the default method redid the step by backward Euler; "" where it did not.
        opened: stitches of seams that are open at its end, of all.
        gas: (volume [m^3], pressure over that outside [Pa]) of each gas, by name.
        ledger: J by name, works and losses of this step: see `ledger.Ledger`; a positive `unaccounted` is energy from
            nowhere.
        troubles: where attempts before it were rejected, and where it was itself slow to solve: see `records.Trouble`.
    """

    t: float
    h: float
    iterations: int
    solves: int
    residual: float
    status: str
    rejections: dict[str, int]
    energies: dict[str, float]
    stretch: float
    seconds: dict[str, float] = field(default_factory=dict)
    contacts: int = 0
    unconverged_contacts: int = 0
    solid_intersections: int = 0
    evaluations: int = 0
    error: float = 0.0
    fallback_reason: str = ""
    layers: int = 0
    min_gap_ratio: float = 1.0
    known_intersections: int = 0
    pinched: int = 0
    intersections: int | None = None
    opened: int = 0
    ledger: dict[str, float] = field(default_factory=dict)
    gas: dict[str, tuple[float, float]] = field(default_factory=dict)
    troubles: tuple[Trouble, ...] = ()
    contact_error: float = 0.0

    def __post_init__(self) -> None:
        self.troubles = tuple(t if isinstance(t, Trouble) else Trouble(**t) for t in self.troubles)  # dicts of telemetry


class Locator:
    """Finds the place of a model's state in its scene."""

    def __init__(self, model: ParticleState, cloths: Sequence[Cloth], solids: Sequence[Solid]) -> None:
        self.model, self.cloths, self.solids = model, cloths, solids
        self.starts = np.array([c.start for c in cloths])

    def find(self, name: str, h: float, detail: str, place: Place | None, pins: Held | None = None) -> Trouble:
        """At a place, or, where there is none, at the particle whose velocity changed most."""
        x, v = self.model.read_particles()
        if place is None:
            change = np.linalg.norm(v - self.model.read_saved()[1], axis=1)
            i = int(np.argmax(np.where(np.isfinite(change), change, np.inf)))
            against, gap = "", 1.0
        else:
            i, gap = place.particles[0], place.gap
            against = self.solids[place.solid].name if place.solid >= 0 else self._of(place.particles[-1])[0].name
        cloth, vertex = self._of(i)
        x_i = x[i] + self.model.origin
        held = pins is not None and bool((np.trace(pins.projector[pins.index == i], axis1=1, axis2=2) > 2.5).any())
        return Trouble(name, h, detail, cloth.name, vertex, (float(x_i[0]), float(x_i[1]), float(x_i[2])),
                       float(np.linalg.norm(v[i])), against, gap, held)

    def name(self, particle: int) -> str:
        """A particle as people know it, with where it is."""
        (cloth, vertex), x = self._of(particle), self.model.read_particles()[0][particle] + self.model.origin
        return f"vertex {vertex} of {cloth.name!r} at ({', '.join(f'{c:.4g}' for c in x)}) m"

    def _of(self, particle: int) -> tuple[Cloth, int]:
        """A particle's cloth, and its number there."""
        vertex = int(self.model.user[particle])
        k = int(np.searchsorted(self.starts, vertex, side="right")) - 1
        return self.cloths[k], vertex - self.cloths[k].start


@old_names
class Tally:
    """Sums, largest and smallest values over steps.

    Attributes:
        steps, solves, iterations, evaluations, not_converged: numbers of them in all; unsolved: of steps that ended with
            contacts more than 1 % off Coulomb's law.
        rejections: number of attempts by name; fallbacks: of steps by why another method redid them.
        damped: (first, last) time [s] of steps that were redone though nothing touches, None without; damped_at: where cloth
            was fastest in one of these, if that is known.
        seconds: [s] by part.
        ledger: J by name, in all.
        moved: energy [J] that moved, see `ledger.moved`; astray: sizes of the energy unaccounted for in each step [J].
        worst: largest of these.
        size: largest sum of the sizes of energies [J] at the end of a step.
        smallest_h, largest_h: [s]; residual, stretch, contacts, contact_error, solid_intersections, layers, min_gap_ratio,
            known_intersections, pinched, intersections: the worst of any step, None where there is none.
    """

    def __init__(self) -> None:
        self.steps = self.solves = self.iterations = self.evaluations = self.not_converged = self.unsolved = 0
        self.rejections: Counter[str] = Counter()
        self.fallbacks: Counter[str] = Counter()
        self.damped: tuple[float, float] | None = None
        self.damped_at: Trouble | None = None
        self.seconds: Counter[str] = Counter()
        self.ledger = totals([])
        self.moved = self.astray = self.worst = self.size = 0.0
        self.contact_error = 0.0
        self.contacts = self.solid_intersections = self.layers = self.known_intersections = self.pinched = 0
        self.min_gap_ratio = 1.0
        self.smallest_h: float | None = None
        self.largest_h: float | None = None
        self.residual: float | None = None
        self.stretch: float | None = None
        self.intersections: int | None = None

    @classmethod
    def of(cls, records: Iterable[StepRecord]) -> Tally:
        """The tally of steps that were made before."""
        out = cls()
        for record in records:
            out.add(record)
        return out

    def add(self, r: StepRecord) -> None:
        """One more step."""
        self.steps += 1
        for name in ("solves", "iterations", "evaluations"):
            setattr(self, name, getattr(self, name) + getattr(r, name))
        self.not_converged += r.status not in ("CONVERGED", "EXPLICIT")
        self.unsolved += r.contact_error > OFF
        self.rejections.update(r.rejections)
        self.fallbacks.update([r.fallback_reason] if r.fallback_reason else [])
        if r.fallback_reason not in ("", TOUCH):
            self.damped = (self.damped[0] if self.damped else r.t - r.h, r.t)
            places = [place for place in (self.damped_at, *r.troubles) if place]
            self.damped_at = max(places, key=lambda place: place.speed, default=None)
        self.seconds.update(r.seconds)
        self.ledger = totals([self.ledger, r.ledger])
        lost = abs(r.ledger["unaccounted"]) if "unaccounted" in r.ledger else 0.0
        self.moved, self.astray, self.worst = self.moved + moved(r.ledger), self.astray + lost, max(self.worst, lost)
        self.size = max(self.size, sum(abs(e) for e in r.energies.values()))
        for name in ("residual", "stretch", "contacts", "contact_error", "solid_intersections", "layers",
                     "known_intersections", "pinched", "intersections"):
            setattr(self, name, _larger(getattr(self, name), getattr(r, name)))
        self.min_gap_ratio = min(self.min_gap_ratio, r.min_gap_ratio)
        self.smallest_h = r.h if self.smallest_h is None else min(self.smallest_h, r.h)
        self.largest_h = _larger(self.largest_h, r.h)

    @property
    def share(self) -> float:
        """Part of the energy that moved that is unaccounted for, step by step; of a run in which as good as none moved 0."""
        return self.astray / (self.moved + STILL * self.size) if self.astray else 0.0

    def doubt(self) -> str:
        """The warning, with its advice, if too much is unaccounted for; else ""."""
        if self.share <= DOUBTFUL:
            return ""
        return (f"{self.share:.0%} of the energy that moved is unaccounted for: {self.astray:.2g} of {self.moved:.2g} J, "
                f"summed over steps; {ADVICE}")


def _larger(a, b):
    return b if a is None else a if b is None else max(a, b)
