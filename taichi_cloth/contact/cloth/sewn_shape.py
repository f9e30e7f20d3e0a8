"""How far particles are from each other along a sewn cloth's own shape: panels lie apart where their pattern does. numpy only.

Two places within a panel have the panel's distance in its own shape. Places on two panels have that over the seam, which is
as short as the edges there: places at either end of an edge shorter than the thickness are no two layers.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

APART = 1e-9  # m: particles sewn together and further apart in their own shape join panels that lie apart


@dataclass(frozen=True)
class SewnDistances:
    """Distances over seams, in rows, one for each particle.

    Attributes:
        first: (n + 1,) where each one's row begins.
        to: (k,) particles, by the numbers of those sewn together; distance: (k,) along edges [m].
    """

    first: np.ndarray
    to: np.ndarray
    distance: np.ndarray


def sewn_distances(rest: np.ndarray, edges: np.ndarray, cluster_ids: np.ndarray, most: float) -> SewnDistances | None:
    """Distances of less than `most` [m] along edges between places near seams whose sides lie apart; None where there are
    none.

    Args:
        rest: (n, 3) the cloth's own shape [m]; edges: (e, 2) particles.
        cluster_ids: (n,) the same number, a particle's, for particles that are sewn together.
    """
    joins = cluster_ids[np.linalg.norm(rest - rest[cluster_ids], axis=1) > APART]
    if not len(joins):
        return None
    length = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    near: dict[int, list[tuple[int, float]]] = {}
    for (i, j), d in zip(cluster_ids[edges[length < most]].tolist(), length[length < most].tolist()):
        near.setdefault(i, []).append((j, d))
        near.setdefault(j, []).append((i, d))
    rows = {i: _within(near, [i], most) for i in _within(near, joins.tolist(), most) if i in near}
    count = np.zeros(len(rest), dtype=np.int64)
    count[list(rows)] = [len(row) for row in rows.values()]
    found = [item for i in sorted(rows) for item in rows[i].items()]
    if not found:
        return None
    to, distance = zip(*found)
    return SewnDistances(np.concatenate([[0], np.cumsum(count)]), np.array(to), np.array(distance))


def _within(near: dict[int, list[tuple[int, float]]], start: Iterable[int], most: float) -> dict[int, float]:
    """Particles within a distance of any of `start` along edges, and how far they are. [Dijkstra 1959]"""
    out: dict[int, float] = {}
    ahead = [(0.0, i) for i in start]
    while ahead:
        d, i = heappop(ahead)
        if i in out:
            continue
        out[i] = d
        for j, further in near.get(i, ()):
            if d + further < most and j not in out:
                heappush(ahead, (d + further, j))
    return out
