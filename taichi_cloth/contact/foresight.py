"""Whether a step's first solve is likely to be its last, by the steps before: one that others follow may be rough."""

from ..system.checkpoint import Checkpointed

OFTEN = 2  # steps one after the other that took more solves, after which the next one is expected to


class Foresight(Checkpointed):
    """Foresight of the steps with layers of cloth in their problem.

    Attributes:
        rounds: accepted steps, one after the other, in which a Newton step was cut short, or changed many contacts.
        asked: whether that is so in this attempt.
    """

    STATE = ("rounds",)

    def __init__(self) -> None:
        self.rounds = 0
        self.asked = False

    def begin(self) -> None:
        """A new attempt."""
        self.asked = False

    def commit(self) -> None:
        """The attempt was accepted."""
        self.rounds = self.rounds + 1 if self.asked else 0

    def clear(self) -> None:
        """Nothing is known of the steps before."""
        self.rounds = 0

    @property
    def more_rounds(self) -> bool:
        """Whether a first solve will hardly be the last."""
        return self.rounds >= OFTEN
