"""Cloth against cloth by the paper's springs: what is near where a step begins is pushed apart by damped springs. [BW98 §6]

For comparison with `layers`. A step has its one solve; pairs are those of its beginning, as the paper trusts in coherence,
and pairs that come near within it are not known of. Friction is that of `layers`.

Differs from [BW98 §6]: a step on whose way cloth would pass through cloth is tried smaller, and not taken.
"""

import numpy as np

from .layers import Layers
from .near import Near

STRONG = 25.0  # times as stiff as repulsion where cloth begins to touch
DAMPING = 1.0  # of a spring, over critical


class Springs(Layers):
    """The contacts of a model's cloths with each other and with themselves, as springs.

    Attributes:
        here: pairs where the step begins.
    """

    here: Near
    floor = 0.0  # a spring keeps nothing from it

    def begin(self, h: float, x: np.ndarray, v: np.ndarray, guess: bool) -> None:
        """A new attempt from the saved state (n, 3), from where the pairs are known."""
        super().begin(h, x, v, False)
        self.near = self.here

    def commit(self) -> None:
        """The step was accepted: where it ended, the next begins."""
        super().commit()
        self.boost[:] = 1.0
        self.here = self.near

    def clear(self) -> None:
        """The state was changed from outside."""
        super().clear()
        self.here = self.near

    def resume(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from what `checkpoint` gave."""
        super().resume(state)
        self.look()
        self.here = self.near

    def _where(self, p: Near) -> np.ndarray:
        """(k,) distances [m] at which pairs are linearised."""
        return p.end

    def _pull(self, p: Near, d: np.ndarray, stiff: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(force [N] of pairs at distances d, its slope [N/m] over the step, in which the damper adds to the spring)."""
        stiff = STRONG * stiff
        return stiff * np.maximum(p.radius - d, 0.0), stiff + 2 * DAMPING * np.sqrt(stiff * own) / self.h
