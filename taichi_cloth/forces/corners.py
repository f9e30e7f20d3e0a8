"""Vertices of gas volumes as arrays: corners, the faces round each, and the thread that sums each. numpy only."""

import numpy as np

from ..system.enclosures import Enclosure
from ..system.state import ParticleState


class Corners:
    """Rooms as arrays: corners, room by room, in the order of their particles.

    Attributes:
        cluster: (n,) the particle that stands for each corner's cluster.
        first, ring: of each corner the rows of `ring`, (r, 2) the other two corners of its faces, counterclockwise.
        share: row k blocks + b: the corners of room k from which on block b has its share of sums.
        own: the same for rows of `part`: (m, 2) particle of block b, and its corner; weight: (m,) of the particle in it.
    """

    def __init__(self, model: ParticleState, rooms: list[Enclosure]) -> None:
        bounds, clusters = model.blocks.bounds, model.sewn
        cluster = np.arange(model.n) if clusters is None else clusters.representative
        members = np.bincount(cluster, minlength=model.n)
        order = np.argsort(cluster, kind="stable")  # particles, cluster by cluster
        begins = np.searchsorted(cluster[order], np.arange(model.n + 1))
        cluster_ids, rings, counts, parts, share, own = [], [], [], [], [], []
        corners = mine = 0
        for room in rooms:
            faces = cluster[model.particle[room.faces]]
            here, index = np.unique(faces, return_inverse=True)
            index = index.reshape(faces.shape) + corners
            turns = np.concatenate([index, np.roll(index, -1, axis=1), np.roll(index, -2, axis=1)])
            turns = turns[np.argsort(turns[:, 0], kind="stable")]
            rings.append(turns[:, 1:])
            counts.append(np.bincount(turns[:, 0] - corners, minlength=len(here)))
            sizes = members[here]
            of = np.repeat(np.arange(len(here)), sizes)
            particle = order[np.repeat(begins[here], sizes) + np.arange(len(of)) - np.repeat(np.cumsum(sizes) - sizes, sizes)]
            rows = np.column_stack([particle, of + corners])[np.argsort(particle, kind="stable")]
            parts.append(rows)
            count = len(bounds) - 1
            share.append(corners + len(here) * np.arange(count) // count)
            own.append(mine + np.searchsorted(rows[:, 0], bounds[:-1]))
            cluster_ids.append(here)
            corners, mine = corners + len(here), mine + len(rows)
        self.cluster, self.ring, self.part = np.concatenate(cluster_ids), np.concatenate(rings), np.concatenate(parts)
        self.first = np.cumsum([0, *np.concatenate(counts)])
        self.share, self.own = np.append(np.concatenate(share), corners), np.append(np.concatenate(own), mine)
        self.weight = 1 / members[self.cluster[self.part[:, 1]]]
