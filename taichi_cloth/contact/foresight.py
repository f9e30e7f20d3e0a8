"""What a step's solves are likely to come to, by the steps before: those that others will follow may be rough. numpy only."""

from ..system.checkpoint import Checkpointed

OFTEN = 2  # steps one after the other that took more solves, after which the next one is expected to


class Foresight(Checkpointed):
    """Of the steps in contact.

    Attributes:
        rounds: accepted steps, one after the other, in which contacts with solids asked for another solve, or, with layers of
            cloth in the problem, a Newton step was cut short, or changed many of them.
        mends: those whose first Newton step gained energy in contact with solids, so that others followed.
        asked, gained: whether that is so in this attempt.
    """

    STATE = ("rounds", "mends")

    def __init__(self) -> None:
        self.rounds = self.mends = 0
        self.asked = self.gained = False

    def begin(self) -> None:
        """A new attempt."""
        self.asked = self.gained = False

    def commit(self) -> None:
        """The attempt was accepted."""
        self.rounds = self.rounds + 1 if self.asked else 0
        self.mends = self.mends + 1 if self.gained else 0

    def clear(self) -> None:
        """Nothing is known of the steps before."""
        self.rounds = self.mends = 0

    @property
    def more_rounds(self) -> bool:
        """Whether a first solve will hardly be the last."""
        return self.rounds >= OFTEN

    @property
    def more_steps(self) -> bool:
        """Whether a first Newton step will hardly be the last."""
        return self.mends >= OFTEN
