"""The stiffness that pairs with solids need to bear their load, found within a step and forgotten by and by. numpy only.

The law of pairs has a largest force: a taut edge of cloth that is pressed on an edge of a body goes to its least distance,
where no step is accepted, however small. A pair that a solve leaves there gets a stiffness of its own [N/m], by which the load
F that it bears moves it by a small part of its range r,

    k = F / (GIVE r),

and holds it where it began: it resists an approach, and hardly pushes. The next solve of the step goes by it. A pair
that pulls by it is let go. It lasts from step to step, so that a load that stays is borne by one solve.
"""

from dataclasses import dataclass, field

import numpy as np

from ...system.checkpoint import Checkpointed
from ..points import rows_of

GIVE, BORNE = 0.02, 0.05  # of a pair's range, by which its load moves it, at first, and after many steps
STIFFER, SOFTER = 4.0, 0.8  # factors: at least, from solve to solve; from usual step to usual step; both of layers too
FIRMEST = 1e5  # times the stiffness that a pair has anyway: where others push against it none would do
TIMES = 3  # solves running after which a pair ended too near
PULLS = 1e-3  # of the mean force of pairs: a pair that pulls more is let go


@dataclass
class Firm:
    """Stiffness [N/m] of pairs, sorted by key."""

    key: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def of(self, key: np.ndarray) -> np.ndarray:
        """(k,) [N/m] of pairs; 0 where there is none."""
        row = rows_of(self.key, key)
        return np.where(row >= 0, self.stiffness[row], 0.0) if len(self.key) else np.zeros(len(key))


class Firmness(Checkpointed):
    """Firmness of the pairs of a model's cloth with solids.

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

    def bear(self, lost: np.ndarray, key: np.ndarray, load: np.ndarray, reach: np.ndarray, least: np.ndarray) -> int:
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
        """The step, so much of a usual one, was accepted; of its last solve's pairs (k,), arguments as in `bear`."""
        firm = self.trial.of(key)
        firm = np.maximum(SOFTER**share * firm, np.minimum(firm, load / (BORNE * reach)))
        keep = firm > least
        self.accepted = Firm(key[keep], firm[keep])

    def clear(self) -> None:
        """The state was changed from outside."""
        self.accepted = self.trial = Firm()
