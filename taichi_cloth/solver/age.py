"""Age of a preconditioner: how many more solves one that was made for an earlier system serves. numpy only."""

import numpy as np

from ..system.checkpoint import Checkpointed

WORTH = 15  # iterations that making the levels costs: they are made anew when age has cost as many
LONGEST = 31  # solves in which levels are made anew every time, after they have not lasted
FIRST, SLACK = 8, 0.1  # solves whose mean others are held against, and part by which these may need more


class Age(Checkpointed):
    """Whether levels that were made for an earlier system do for this one.

    Attributes:
        made_for: (k,) numbers that describe the held particles then, and the effective step c [s] last.
        cost, excess: iterations when they were new, and those beyond since; kept: solves since.
        wait, pause: solves until they may last again, and the last such pause.
    """

    STATE = ("made_for", "cost", "excess", "kept", "wait", "pause")

    def __init__(self) -> None:
        self.made_for: np.ndarray = np.zeros(0)
        self.cost = self.excess = self.kept = self.wait = self.pause = 0

    def allows(self, wanted: np.ndarray, most: float = 0.0) -> bool:
        """Whether the levels serve one more solve.

        Args:
            wanted: (k,) as `made_for`, for the new system; the last must be the same.
            most: how many of the others may differ.
        """
        if len(wanted) != len(self.made_for) or wanted[-1] != self.made_for[-1]:
            return False
        if np.count_nonzero(wanted != self.made_for) > most:
            return False
        if not self.wait and self.excess <= WORTH:
            self.kept += 1
            return True
        if self.wait:
            self.wait -= 1
        else:  # levels that did not last for two steps are not kept again at once
            self.pause = min(2 * self.pause + 1, LONGEST) if self.kept < 2 else 0
            self.wait = self.pause
        return False

    def begin(self, made_for: np.ndarray) -> None:
        """The levels are made anew."""
        self.made_for, self.cost, self.excess, self.kept = made_for, 0, 0, 0

    def count_iterations(self, iterations: int) -> None:
        """Counts the iterations of a solve."""
        self.cost = self.cost or iterations
        self.excess += max(iterations - self.cost, 0)


class Drift(Checkpointed):
    """How many iterations more solves need than they did at first, as a cumulative sum. [Page 1954]

    Contacts come and go, and solves need more or fewer iterations by them, with any preconditioner. Such changes around the
    same mean cancel in the sum; a lasting rise does not.

    Attributes:
        age: solves in all; solves, cost: so many, and the mean iterations of the first of them; excess: iterations beyond.
    """

    STATE = ("age", "solves", "cost", "excess")

    def __init__(self) -> None:
        self.age, self.solves, self.cost, self.excess = 0, 0, 0.0, 0.0

    def begin(self) -> None:
        """The next solves are the first from now on."""
        self.solves, self.cost = 0, 0.0

    def count_iterations(self, iterations: int) -> None:
        """Counts the iterations of a solve."""
        self.age += 1
        self.solves += 1
        if self.solves <= FIRST:
            self.cost += (iterations - self.cost) / self.solves
        else:
            self.excess = max(self.excess + iterations - (1 + SLACK) * self.cost, 0.0)
