"""Cloth against cloth by the paper's springs: pairs near where a step begins are pushed apart by damped springs. [BW98 §6]

For comparison with `layers`. A step has its one solve; pairs are those of its beginning, as the paper trusts in coherence,
and pairs that come near within it are not known of. Friction is that of `layers`.

Differs from [BW98 §6]: a step on whose way cloth would pass through cloth is tried smaller, and not taken.
"""

from ...backend.language import ti
from ..step_start import StepContext
from .contact_pairs import ContactPairs
from .layers import Layers
from .pair_kernels import PairKernels

STRONG = 25.0  # times as stiff as repulsion where cloth begins to touch


@ti.data_oriented
class SpringKernels(PairKernels):
    """Pairs of a model's cloths with springs between them."""

    @ti.func
    def where(self, end, radius, shift, began, first):
        """Distance [m] at which a pair is linearised."""
        return end

    @ti.func
    def pull(self, d, radius, shift, began, stiff, own, factor, h):
        """(force [N] of a pair at a distance d, its slope [N/m] over the step, in which a critical damper adds to it)."""
        spring = STRONG * stiff
        return spring * ti.max(radius - d, 0.0), spring + 2 * ti.sqrt(spring * own) / h


class Springs(Layers):
    """The contacts of a model's cloths with each other and with themselves, as springs.

    Attributes:
        here: pairs where the step begins.
    """

    here: ContactPairs
    floor, kind = 0.0, SpringKernels  # a spring keeps nothing from it

    def begin(self, start: StepContext, guess: bool) -> None:
        """A new attempt, from where the pairs are known."""
        super().begin(start, False)
        self.near = self.here

    def commit(self) -> None:
        """The step was accepted: where it ended, the next begins."""
        super().commit()
        self.adaptive_stiffness.clear()
        self.shift.clear()
        self.here = self.near

    def clear(self) -> None:
        """The state was changed from outside."""
        super().clear()
        self.here = self.near

    def resumed(self) -> None:
        """See `Checkpointed`: the next step begins with the pairs near where the last one ended."""
        super().resumed()
        self.look()
        self.here = self.near
