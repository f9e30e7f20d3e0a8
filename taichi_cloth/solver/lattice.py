"""Lattices over the cloth's material for a multilevel preconditioner: hat functions and their supports. numpy only.

Level l has nodes 2^l edge lengths apart in the plane of the pattern, piece by piece (in space, where a cloth has
no pattern of its own), and multilinear hats. A hat whose support is in several parts, as across a slit, is as many
hats: parts that are not connected do not move together. A hat is a weighted sum of those of the level below, exactly, so
that values go from level to level.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..backend.ordering import components, distinct_numbers
from ..scene.mesh import TriMesh

SMALLEST = 12  # nodes of a level below which there is no coarser one
DEEPEST = 12
SNAP = 1e-3  # of a lattice's spacing
PART = 1 << 13  # elements, or points, that are looked at together
WIDEST = 2.0**31  # nodes along an axis, whose numbers are exact in products with those of points


class LatticeError(ValueError):
    """Points that no lattice goes over; the message says why."""


@dataclass(frozen=True)
class Gather:
    """Rows that are sums over entries: row k takes entries first[k] to first[k + 1].

    Attributes:
        first: (rows + 1,).
        source: (entries,) index of the summand.
        weight: (entries,) where sums are weighted.
    """

    first: np.ndarray
    source: np.ndarray
    weight: np.ndarray | None = None


@dataclass(frozen=True)
class Level:
    """Nodes of one lattice.

    Attributes:
        count: number of nodes.
        node: (n, c) the nodes around each particle; weight: (n, c) their hats there.
        parent, parent_weight: (count, c) the same for the nodes of this level in the next one, None on the last.
    """

    count: int
    node: np.ndarray
    weight: np.ndarray
    parent: np.ndarray | None
    parent_weight: np.ndarray | None


def coordinates(mesh: TriMesh) -> np.ndarray:
    """(n, 2) places of the vertices in the pattern, for those on a cut the first. If most corners are on a cut, the pattern
    does not tell which vertices are neighbours: then the given positions (n, 3) [m]."""
    if mesh.flattened:
        return mesh.x
    places = mesh.uv if mesh.uv.ndim == 2 else mesh.first_uv
    whole = (places[mesh.faces] == mesh.corner_uv).all(axis=2)
    return places if whole.mean() > 0.5 else mesh.x


def levels(points: np.ndarray, piece: np.ndarray, spacing: float, links: np.ndarray, most: int = 0) -> list[Level]:
    """Lattices over points (n, d) of numbered pieces (n,), the finest two spacings [m] apart.

    Args:
        links: (e, 2) pairs of points that are connected, the mesh's edges.
        most: nodes of a level that may be the coarsest; SMALLEST a piece where that is more.

    Raises:
        LatticeError: points that are too far apart for the spacing.
    """
    out: list[Level] = []
    low = np.stack([points[piece == p].min(axis=0) for p in range(piece.max() + 1)])[piece]
    where, owner = (points - low) / (2 * spacing), piece
    if not where.max() < WIDEST:
        raise LatticeError(f"the cloth is {2 * where.max():.1g} times as long as its edges are")
    for _ in range(DEEPEST):
        node, weight, keys = _around(where, owner)
        node, keys = _split(node, weight, keys, links)
        if out and len(keys) >= out[-1].count:  # as many pieces: wider hats say no more
            break
        if out:
            fine = out[-1]
            out[-1] = Level(fine.count, fine.node, fine.weight, node, weight)
            composed = _compose(fine, node, weight, len(keys))
        else:
            composed = node, weight
        out.append(Level(len(keys), *composed, None, None))
        if len(keys) <= max(most, SMALLEST * (piece.max() + 1)):
            break
        owner, where, links = keys[:, 0], keys[:, 1:] / 2, _sharing(node, weight)
    return out


def _around(where: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(indices of the nodes around each point, their weights, keys (owner, place) of all nodes)."""
    d = where.shape[1]
    cell = np.floor(where + 1e-9).astype(np.int64)
    part = where - cell
    part = np.where(part < SNAP, 0.0, np.where(part > 1 - SNAP, 1.0, part))  # no hat that only just meets a point
    keys, weights = [], []
    for corner in range(2**d):
        bits = np.array([(corner >> axis) & 1 for axis in range(d)])
        keys.append(np.column_stack([owner, cell + bits]))
        weights.append(np.where(bits, part, 1 - part).prod(axis=1))
    weight = np.stack(weights, axis=1)
    all_keys = np.stack(keys, axis=1)
    used = weight > 1e-12
    keys_used = all_keys[used]
    first, index = _distinct_rows(keys_used)
    node = np.zeros(weight.shape, dtype=np.int64)
    node[used] = index
    return node, np.where(used, weight, 0.0), keys_used[first]


def _distinct_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distinct rows of (k, q) whole numbers, found column by column: many times as fast as by rows.

    Returns:
        (first row of each, in order; the number (k,) of each row's among them).
    """
    first, index = np.zeros(1, dtype=np.int64), np.zeros(len(rows), dtype=np.int64)
    for column in rows.T:
        _, first, index = np.unique(index * (np.ptp(column) + 1) + column, return_index=True, return_inverse=True)
    return first, index.ravel()


def _split(node: np.ndarray, weight: np.ndarray, keys: np.ndarray, links: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes (n, c) and keys with one node for each connected part of the points that a node's hat meets."""
    n, c = node.shape
    i, j = links.T
    used = weight > 0
    ends = [np.flatnonzero((node[i, a] == node[j, b]) & used[i, a] & used[j, b]) for a in range(c) for b in range(c)]
    slots = [(a, b) for a in range(c) for b in range(c)]
    u = np.concatenate([i[e] * c + a for e, (a, _) in zip(ends, slots)])
    v = np.concatenate([j[e] * c + b for e, (_, b) in zip(ends, slots)])
    label = components(n * c, u, v)  # of each point's place in each of its hats
    flat = used.ravel()
    first, index = np.unique(label[flat], return_inverse=True)
    out = np.zeros(n * c, dtype=np.int64)
    out[flat] = index.ravel()
    return out.reshape(n, c), keys[node.ravel()[first]]


def _sharing(node: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(e, 2) pairs of nodes whose hats meet a point in common."""
    c = node.shape[1]
    pairs = [np.sort(node[:, [a, b]][(weight[:, a] > 0) & (weight[:, b] > 0)], axis=1) for a in range(c) for b in range(a)]
    size = int(node.max()) + 1
    code = distinct_numbers(np.concatenate([p @ np.array([size, 1]) for p in pairs]))
    return np.stack([code // size, code % size], axis=1)


def _compose(fine: Level, node: np.ndarray, weight: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes around, and hats at, the particles of the level above `fine`."""
    n, c = len(fine.node), node.shape[1]
    out_node, out_weight, node = np.zeros((n, c), dtype=np.int64), np.zeros((n, c)), node.astype(np.int32)
    for first in range(0, n, PART):
        below = fine.node[first:first + PART]
        value = (fine.weight[first:first + PART, :, None] * weight[below]).reshape(len(below), -1)
        value[value <= 1e-12] = 0.0
        for place, (row, here, total) in enumerate(_by_node(node[below].reshape(len(below), -1), value)):
            out_node[first + row, place], out_weight[first + row, place] = here, total
    return out_node, out_weight


def _by_node(node: np.ndarray, value: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Sums of values (m, k) that are not 0 by node (m, k) within each row, a row's nodes in rising order.

    Yields:
        (rows, nodes, sums) for the first node of each row, then for the second of each row that has more, and so on.
    """
    last, row = np.iinfo(node.dtype).max, np.arange(len(node))
    node = np.where(value != 0, node, last).T.copy()  # a row of values is a column: sums over few numbers are slow
    value = value.T.copy()
    while True:
        here = node.min(axis=0, initial=last)
        some = here < last
        if not some.any():
            return
        if not some.all():
            row, here, node, value = row[some], here[some], node[:, some], value[:, some]
        mine = node == here
        yield row, here, (value * mine).sum(axis=0)
        node[mine] = last


def gather(node: np.ndarray, weight: np.ndarray, count: int) -> Gather:
    """The transpose of weights (n, c) on nodes (n, c): the entries of each of `count` nodes."""
    used = weight > 0
    source = np.repeat(np.arange(len(node)), used.sum(axis=1))
    target, value = node[used], weight[used]
    order = np.argsort(target, kind="stable")
    return Gather(np.searchsorted(target[order], np.arange(count + 1)), source[order], value[order])


def squares(level: Level, vertices: np.ndarray, weights: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """(count, q) sums over elements (m, k) of factors (m, q) times the square of the weighted sum (m, k) of a node's hat."""
    out, given = np.zeros((factor.shape[1], level.count)), np.flatnonzero(factor.any(axis=0))
    nodes, width = level.node.astype(np.int32), vertices.shape[1] * level.node.shape[1]
    for first in range(0, len(vertices), PART):
        part = slice(first, first + PART)
        node, value, f = nodes[vertices[part]], level.weight[vertices[part]] * weights[part, :, None], factor[part]
        inside = (node == node[:, :1]).all(axis=(1, 2))  # a cell of the lattice: most are, on coarse levels
        rows = np.flatnonzero(inside)
        for k, total in enumerate(value[rows].sum(axis=1).T):
            for q in given:
                out[q] += np.bincount(node[rows, 0, k], f[rows, q] * total**2, level.count)
        rows = np.flatnonzero(~inside)
        for row, there, total in _by_node(node[rows].reshape(-1, width), value[rows].reshape(-1, width)):
            for q in given:
                out[q] += np.bincount(there, f[rows[row], q] * total**2, level.count)
    return out.T


def meeting(level: Level, vertices: np.ndarray) -> Gather:
    """For each node the elements (m, k) that its hat meets."""
    node = np.where(level.weight > 0, level.node, -1).astype(np.int32)[vertices].reshape(len(vertices), -1)
    node.sort(axis=1)
    new = node >= 0
    new[:, 1:] &= node[:, 1:] != node[:, :-1]
    of = node[new]
    element = np.repeat(np.arange(len(vertices), dtype=np.int32), new.sum(axis=1))
    order = np.argsort(of, kind="stable")
    return Gather(np.searchsorted(of, np.arange(level.count + 1), sorter=order), element[order])
