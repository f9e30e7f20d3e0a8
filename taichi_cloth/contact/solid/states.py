"""What is known of contacts from round to round and from step to step. numpy only."""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class States:
    """What is known of the contacts of a step, sorted by key; kept from step to step.

    Attributes:
        key: (k,) particle and solid.
        stick: (k,) whether friction holds it.
        force: (k,) normal force [N].
        push: (k, 3) direction of friction on what has just begun to slide, 0 elsewhere.
    """

    key: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    stick: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=bool))
    force: np.ndarray = field(default_factory=lambda: np.zeros(0))
    push: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    def find(self, key: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(whether each key is there, where)."""
        if not len(self.key):
            return np.zeros(len(key), dtype=bool), np.zeros(len(key), dtype=np.int64)
        where = np.minimum(np.searchsorted(self.key, key), len(self.key) - 1)
        return self.key[where] == key, where
