"""The levels of a multilevel preconditioner in fields: their hats, and how values pass from level to level. [Bramble, Pasciak,
Xu 1990]

Hats nest: a node's hat is a sum of hats of the level below. Restriction to a level, and prolongation from it, therefore go by
way of the next finer one.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..scene.mesh import distinct, face_edges
from ..scene.scene import Scene
from .lattice import Gather, Level, coordinates, gather, meeting, squares


@ti.data_oriented
class Rows:
    """A `Gather` of several levels in fields."""

    def __init__(self, fields: Fields, parts: list[Gather]) -> None:
        starts = np.cumsum([0] + [len(p.source) for p in parts])
        first = np.concatenate([p.first[:-1] + s for p, s in zip(parts, starts)] + [starts[-1:]])
        self.first = fields.integer(len(first), data=first)
        self.source = fields.integer(int(starts[-1]), data=np.concatenate([p.source for p in parts]))


class LevelFields:
    """The levels as a force sees them that prepares its part.

    Args:
        threads: levels that are worked on at once.

    Attributes:
        count: of nodes of all levels.
    """

    def __init__(self, fields: Fields, made: list[Level], threads: int) -> None:
        self._fields, self._made, self.count = fields, made, sum(level.count for level in made)
        self._threads = min(threads, len(made))

    def _of_each(self, what: Callable[[Level], Any]) -> list:
        with ThreadPoolExecutor(self._threads) as pool:
            return list(pool.map(what, self._made))

    def meeting(self, elements) -> Rows:
        """For each node the `Elements`, as entries, that its hat meets."""
        primary = np.flatnonzero(elements.entries.primary).astype(np.int32)
        vertices = elements.host_vertices[primary]
        parts = self._of_each(lambda level: meeting(level, vertices))
        return Rows(self._fields, [Gather(p.first, primary[p.source]) for p in parts])

    def squares(self, vertices: np.ndarray, weights: np.ndarray, factor: np.ndarray) -> np.ndarray:
        """(count, q) sums over elements of factors (m, q) times the square of the hat at vertices (m, k), weighted (m, k)."""
        return np.concatenate(self._of_each(lambda level: squares(level, vertices, weights, factor)))


@ti.data_oriented
class Hierarchy:
    """The hats of all levels, whose nodes are numbered from the finest to the coarsest.

    Attributes:
        start: the first node of each level, and behind them how many nodes there are.
        size: as kernels read them: nodes of the finest level, of all but the coarsest, of all.
        width: hats of a level that may be round a particle.
        particles: of every node, the particles that its hat meets; particle_weight: its hat at these.
        r, z: the residual restricted to nodes, and the values of nodes.
    """

    def __init__(self, fields: Fields, made: list[Level], n: int) -> None:
        self.start = np.cumsum([0] + [level.count for level in made]).tolist()
        nodes, inner = self.start[-1], self.start[-2]
        self.size = fields.integer(3, data=np.array([self.start[1], inner, nodes]))
        self.width = width = made[0].node.shape[1]
        self.r, self.z = fields.real(nodes, 3), fields.real(nodes, 3)
        # row l n + i: the nodes of level l around particle i, and their hats there
        self.node = fields.integer(len(made) * n, width, np.concatenate([v.node + s for v, s in zip(made, self.start)]))
        self.weight = fields.real(len(made) * n, width, np.concatenate([v.weight for v in made]))
        self.row = fields.integer(nodes, data=np.repeat(n * np.arange(len(made)), [level.count for level in made]))
        # of particle 0 at the level of each node
        takes = [gather(made[0].node, made[0].weight, made[0].count)] + [
            gather(a.parent, a.parent_weight, b.count) for a, b in zip(made[:-1], made[1:])]  # type: ignore[arg-type]
        self.takes = Rows(fields, [Gather(t.first, t.source + s) for t, s in zip(takes, [0, *self.start])])
        self.take_weight = fields.real(sum(len(t.source) for t in takes), data=np.concatenate([t.weight for t in takes]))
        parents = [a.parent + s for a, s in zip(made[:-1], self.start[1:])]  # type: ignore[operator]
        self.parent = fields.integer(max(inner, 1), width, np.concatenate(parents) if parents else np.zeros((1, width)))
        self.parent_weight = fields.real(max(inner, 1), width, np.concatenate(
            [a.parent_weight for a in made[:-1]]) if parents else np.zeros((1, width)))
        met = [gather(v.node, v.weight, v.count) for v in made]
        self.particles = Rows(fields, met)
        self.particle_weight = fields.real(sum(len(g.source) for g in met), data=np.concatenate([g.weight for g in met]))

    @ti.func
    def hat(self, n, i):
        """The hat of node n at particle i."""
        out, row = 0.0, self.row[n] + i
        for k in ti.static(range(self.width)):
            if self.node[row][k] == n:
                out += self.weight[row][k]
        return out

    @ti.func
    def restrict(self, n, values: ti.template()):
        """A node's sum of values below it."""
        total = ti.Vector.zero(float, 3)
        for k in range(self.takes.first[n], self.takes.first[n + 1]):
            total += self.take_weight[k] * values[self.takes.source[k]]
        self.r[n] = total

    @ti.func
    def interpolated(self, i):
        """The levels' values at particle i."""
        z = ti.Vector.zero(float, 3)
        for k in ti.static(range(self.width)):
            z += self.weight[i][k] * self.z[self.node[i][k]]
        return z


def material(scene: Scene, model) -> tuple[np.ndarray, np.ndarray]:
    """(coordinates (n, d), pieces (n,)) of the particles; d = 3 where any cloth needs it."""
    parts = [coordinates(c.mesh) for c in scene.cloths]
    d = max(p.shape[1] for p in parts)
    points = np.concatenate([np.pad(p, ((0, 0), (0, d - p.shape[1]))) for p in parts])
    piece = np.repeat(np.arange(len(parts)), [len(p) for p in parts])
    return points[model.user], piece[model.user]


def links(scene: Scene, model) -> np.ndarray:
    """(e, 2) particles at the ends of the mesh's edges."""
    ends = np.concatenate([model.particle[face_edges(c.mesh.faces) + c.start] for c in scene.cloths])
    if any(c.split is not None for c in scene.cloths):  # cloth that may tear is still connected
        joined = [model.particle[np.stack([s.a, s.b], axis=1) + s.cloth.start] for s in scene.seams if s.tears]
        ends = np.concatenate([ends, *joined])
    return distinct(ends)[0]
