"""Galerkin sums of the coarsest level: nodes that couple, and sums over particles weighted by hats. numpy only."""

import numpy as np

from .lattice import Level

RINGS = 2  # of neighbours that a force may couple a vertex with


class Hats:
    """Hats Q of a level's nodes as they move sewn cloth: particles sewn together have the mean of their hats.

    Args:
        sewn: the model's clusters, which may change as seams open.

    Attributes:
        particle, node, weight: (entries,) of Q as it is without seams.
    """

    def __init__(self, level: Level, sewn) -> None:
        self.count, self.sewn, used = level.count, sewn, level.weight > 0
        self.particle = np.repeat(np.arange(len(level.node)), used.sum(axis=1))
        self.node, self.weight = level.node[used], level.weight[used]
        self._label: np.ndarray | None = None

    def entries_of(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows of (particle, node, weight) of some nodes (count,)."""
        some = np.flatnonzero(nodes[self.node])
        return self.particle[some], self.node[some], self.weight[some]

    def transposed(self, values: np.ndarray, entries: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
        """(count, 3) Q^T values by some nodes' entries, for values (n, 3) that are the same on all members of a cluster."""
        particle, node, weight = entries
        mine = values[particle]
        return np.stack([np.bincount(node, weight * mine[:, c], self.count) for c in range(3)], axis=1)

    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Q by particles, with the seams' means: (where each particle's entries begin (n + 1,), their nodes, their weights);
        the same arrays until seams open."""
        if self._label is not self.sewn.label:
            self._find_means()
        return self._first, self._node, self._weight

    def summed(self, index: np.ndarray, blocks: np.ndarray) -> np.ndarray:
        """(count, 3, count, 3) sum over particles index (p,) of Q_i^T B_i Q_i for symmetric B, blocks (p, 6)."""
        if self._label is not self.sewn.label:
            self._find_means()
        at, k = self._first[index], self.count
        lengths = self._first[index + 1] - at
        codes, values = [np.zeros(0, dtype=np.int64)], [np.zeros((6, 0))]
        for length in np.unique(lengths):  # of rows of Q
            some = np.flatnonzero(lengths == length)
            slot = at[some, None] + np.arange(length)
            node, weight = self._node[slot], self._weight[slot]
            codes.append((node[:, :, None] * k + node[:, None, :]).ravel())
            pair = (weight[:, :, None] * weight[:, None, :]).reshape(len(some), -1)
            values.append((pair * blocks[some].T[:, :, None]).reshape(6, -1))
        code, value = np.concatenate(codes), np.concatenate(values, axis=1)
        out = np.empty((k, 3, k, 3))
        for c, (a, b) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
            out[:, a, :, b] = out[:, b, :, a] = np.bincount(code, value[c], k * k).reshape(k, k)
        return out

    def _find_means(self) -> None:
        """Rows of Q in order of particles, with the seams' means."""
        label, n = self.sewn.label, len(self.sewn.label)
        self._label = label
        size = np.bincount(label[label >= 0], minlength=1)
        alone = label[self.particle] < 0
        keys = [self.particle[alone] * self.count + self.node[alone]]
        values = [self.weight[alone]]
        of = label[self.particle[~alone]]
        code, index = np.unique(of * self.count + self.node[~alone], return_inverse=True)
        mean = np.bincount(index.ravel(), self.weight[~alone], len(code)) / size[code // self.count]
        first = np.searchsorted(code // self.count, np.arange(len(size) + 1))
        members = np.flatnonzero(label >= 0)
        lengths = first[label[members] + 1] - first[label[members]]
        entry = np.repeat(first[label[members]] - np.cumsum(lengths) + lengths, lengths) + np.arange(lengths.sum())
        keys.append(np.repeat(members, lengths) * self.count + code[entry] % self.count)
        values.append(mean[entry])
        order = np.argsort(np.concatenate(keys), kind="stable")
        key = np.concatenate(keys)[order]
        self._node, self._weight = key % self.count, np.concatenate(values)[order]
        self._first = np.searchsorted(key // self.count, np.arange(n + 1))


def coupled(level: Level, faces: np.ndarray, cluster: np.ndarray) -> np.ndarray:
    """(count, count) whether Q^T A Q may have a block between two nodes: their hats meet particles within RINGS of each
    other, over seams too.

    Args:
        cluster: (n,) one particle for all that are sewn together.
    """
    here = np.zeros((len(level.node), level.count), dtype=bool)
    for node, weight in zip(level.node.T, level.weight.T):
        here[cluster[weight > 0], node[weight > 0]] = True
    wide, corner = here.copy(), cluster[faces]
    for _ in range(RINGS):
        touched = wide[corner].any(axis=1)
        for k in range(3):
            np.logical_or.at(wide, corner[:, k], touched)
    return (wide.T.astype(np.float32) @ here.astype(np.float32)) > 0


def colored(couples: np.ndarray) -> np.ndarray:
    """(count,) a color for each node, so that no node is coupled with two of the same color."""
    clash = (couples.astype(np.float32) @ couples.T.astype(np.float32)) > 0
    out = np.full(len(couples), -1)
    for n in np.argsort(-clash.sum(axis=1), kind="stable"):
        taken = set(out[clash[n]].tolist())
        out[n] = next(c for c in range(len(couples)) if c not in taken)
    return out
