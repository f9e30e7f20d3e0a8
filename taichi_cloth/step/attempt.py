"""The step that an integrator proposes to step control, and the names of reasons to reject it."""

from dataclasses import dataclass, replace

import numpy as np

from ..solver.pcg import Solution
from ..system.assembler import Measures
from ..system.place import Place
from .ledger import Ledger

STRETCH, ENERGY, SOLVER, NOT_FINITE = "STRETCH", "ENERGY", "SOLVER", "NOT_FINITE"
CONTACT, APPROACH, NEWTON, ACCURACY = "CONTACT", "APPROACH", "NEWTON", "ACCURACY"
TOUCH = "TOUCH"  # cloth touches something, is still being sewn, or tears: no fault, another method makes the step


@dataclass(frozen=True)
class Attempt:
    """A proposed step.

    Attributes:
        rejection: None, or the name of the reason to reject it.
        detail: more about the rejection, for people.
        measures: of the proposed state; None where it was not reached.
        solutions: of its linear solves, in order.
        seconds: wall time by part, EVAL, CG and C-S.
        contacts: number of contacts with solids.
        unconverged_contacts: how many of them, and of pairs of cloth, had not agreed.
        contact_error: how far contacts with solids are from Coulomb's law, over all that acts.
        solid_intersections: triangles of cloth and solids that pass through each other.
        layers: pairs of cloth in contact with cloth; min_gap_ratio: their smallest distance over the distance to keep.
        known_intersections: pairs of an edge and a triangle of cloth that pass through each other.
        pinched: particles that were let go.
        evaluations: of the forces, by explicit methods.
        error: estimated, over the error that the tolerance allows in this step; None if not estimated.
        order: of the method, which says how the error goes with the step.
        fallback_reason: why the step was redone by a more robust method, or "".
        ledger: of its energy; None where the step was not finished.
        place: where contact is nearest; None without any.
        led: (n,) whether solids that leave a particle no room lead it; None where they lead none.
    """

    rejection: str | None
    detail: str
    measures: Measures | None
    solutions: tuple[Solution, ...]
    seconds: dict[str, float]
    contacts: int = 0
    unconverged_contacts: int = 0
    contact_error: float = 0.0
    solid_intersections: int = 0
    layers: int = 0
    min_gap_ratio: float = 1.0
    known_intersections: int = 0
    pinched: int = 0
    evaluations: int = 0
    error: float | None = None
    order: int = 1
    fallback_reason: str = ""
    ledger: Ledger | None = None
    place: Place | None = None
    led: np.ndarray | None = None

    def instead_of(self, other: "Attempt", why: str) -> "Attempt":
        """This one, made where another one failed, with the cost of both."""
        seconds = {k: other.seconds.get(k, 0.0) + self.seconds.get(k, 0.0) for k in other.seconds | self.seconds}
        return replace(self, solutions=other.solutions + self.solutions, seconds=seconds,
                       fallback_reason=self.fallback_reason or why)
