"""Sums over the steps of a run, counted as they are made: the log may be shorter than the run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from ..renamed import old_names
from .ledger import STILL, moved, totals
from .stepper import StepRecord

OFF = 0.01  # part of all forces by which contacts with solids may be off Coulomb's law without a word
DOUBTFUL = 0.1  # part of the energy that moved: a larger part unaccounted for is reported
ADVICE = "a smaller h (--h), a tolerance (--tolerance) or the integrator newton_euler accounts for more of it"


@old_names
class Tally:
    """Sums, largest and smallest values over steps.

    Attributes:
        steps, solves, iterations, evaluations, not_converged: numbers of them in all; unsolved: of steps that ended with
            contacts more than 1 % off Coulomb's law.
        rejections: number of attempts by name; fallbacks: of steps by why another method redid them.
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
