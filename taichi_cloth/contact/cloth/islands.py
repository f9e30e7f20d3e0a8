"""How far cloth may go where not all of its way is free: what blocks is held back where it is, the rest goes its whole way.

Pairs that would come too near tie their particles together to islands. An island moves as one by the mean motion of its
particles, and takes only a part of what they move against that mean: their distances are those of the way up to that part.
An island that would come too near to something else on its new way takes that in. So what is far from a pair that is
blocked does not wait for it. numpy only.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...backend.ordering import components

ROUNDS = 8  # of islands that grow; after these everything goes the same part


@dataclass(frozen=True)
class Blocked:
    """Pairs that do not allow all of a path.

    Attributes:
        pair: (k, 3) ids, see `ContactPairs`; vertices: (k, 4) particles.
        part: (k,) of the path that each allows.
    """

    pair: np.ndarray
    vertices: np.ndarray
    part: np.ndarray


def bound(start: np.ndarray, end: np.ndarray, blocked: Blocked, look: Callable[[np.ndarray], Blocked],
          tied: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, float]:
    """(where particles may go (n, 3) [m] on straight ways from `start` to `end`, the smallest part that any island goes).

    Args:
        blocked: pairs that do not allow all of it.
        look: function of the end (n, 3) of ways that finds such pairs.
        tied: (a, b), each (j,), particles that move as one in any case.
    """
    n, motion, ties, part, all_of_it = len(start), end - start, [tied], np.ones(len(start)), float(blocked.part.min())
    for _ in range(ROUNDS):
        v = blocked.vertices
        ties += [(v[:, 0], v[:, j]) for j in (1, 2, 3)]
        island = components(n, *(np.concatenate(side) for side in zip(*ties)))
        now = part.copy()
        np.minimum.at(now, v, (part[v].min(axis=1) * blocked.part)[:, None])
        smallest = np.ones(n)
        np.minimum.at(smallest, island, now)
        part = smallest[island]
        mean = _mean(island, motion)
        x = np.where((part < 1)[:, None], start + mean + part[:, None] * (motion - mean), end)
        blocked = look(x)
        if not len(blocked.part):
            return x, float(part.min())
    return start + all_of_it * motion, all_of_it


def _mean(group: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(n, 3) means of rows (n, 3) over groups (n,) of them."""
    n = len(rows)
    size = np.maximum(np.bincount(group, minlength=n), 1)
    return np.stack([np.bincount(group, rows[:, c], n) / size for c in range(3)], axis=1)[group]
