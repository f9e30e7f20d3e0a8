"""Friction of particles that slide on solids, as the last solve took it. numpy only."""

from dataclasses import dataclass, field

import numpy as np

from ..points import ContactRows


@dataclass(frozen=True)
class Sliding:
    """Contacts of an active set that slide.

    Attributes:
        rows: (k,) which contacts of the set do.
        points: one for each that slides.
    """

    rows: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    points: ContactRows = field(default_factory=ContactRows.none)
