"""Surfaces of mesh solids near points, by the direction they face.

The surface nearest to a particle between an arm and a trunk is one of them; the other is found by where it faces, inside a
body that passes through itself too.
"""

from dataclasses import dataclass, fields

import numpy as np

from ...backend.bvh import LEAF
from ...backend.language import ti
from .tree import TriangleTree

SURE = 0.5  # part of the distance to a triangle that the height above it should be: else it is seen past its border
COLUMNS = 9  # of a found surface: solid or -1, height, normal (3), motion (3), triangle


@dataclass(frozen=True)
class Sides:
    """Surfaces of solids that k points are near.

    Attributes:
        solid: (k,) index, or -1 where there is none.
        normal: (k, 3) out of the solid.
        height: (k,) of the point above it at the start of the step [m]; negative inside.
        motion: (k, 3) of the solid there in the step [m].
        friction: (k,) Coulomb's coefficient there.
    """

    solid: np.ndarray
    normal: np.ndarray
    height: np.ndarray
    motion: np.ndarray
    friction: np.ndarray

    def take(self, which: np.ndarray) -> "Sides":
        """Some of them."""
        return Sides(*(getattr(self, f.name)[which] for f in fields(self)))

    @classmethod
    def join(cls, parts: "list[Sides]") -> "Sides":
        """One after the other."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))


@ti.data_oriented
class FacingSurfaces:
    """Looks for them in a tree of triangles, where these are at the start of a step."""

    def __init__(self, tree: TriangleTree) -> None:
        self.tree = tree

    def find(self, at: np.ndarray, way: np.ndarray, cosine: float, reach: np.ndarray, least: np.ndarray, only: np.ndarray,
             but: np.ndarray, sure: float = SURE) -> Sides:
        """The nearest surface to each point that faces it.

        Args:
            at: (k, 3) points, relative to the model's origin [m].
            way: (k, 3) unit vectors; cosine: the least that a surface's normal must have with them.
            reach: (k,) how far away it may be; least: (k,) height above it that the point must have [m].
            only: (k,) solid that it must be of; but: (k,) solid that it must not be of; -1 for any.
            sure: part of the distance that the height must be.
        """
        exchange = self.tree.exchange
        asked: np.ndarray = np.ascontiguousarray(np.column_stack([at, way, reach, least, only, but]), dtype=exchange)
        out: np.ndarray = np.zeros((len(at), COLUMNS), dtype=exchange)
        if len(at):
            self._find(asked, cosine, sure, out)
        rows = out.astype(np.float64)
        friction = self.tree.friction[rows[:, 8].astype(np.int64)]
        return Sides(rows[:, 0].astype(np.int64), rows[:, 2:5], rows[:, 1], rows[:, 5:8], friction)

    @ti.kernel
    def _find(self, asked: ti.types.ndarray(), cosine: float, sure: float, out: ti.types.ndarray()):
        for k in range(asked.shape[0]):
            p = ti.Vector([asked[k, 0], asked[k, 1], asked[k, 2]])
            way = ti.Vector([asked[k, 3], asked[k, 4], asked[k, 5]])
            nearest, least = asked[k, 6], asked[k, 7]
            only, but = ti.cast(asked[k, 8], ti.i32), ti.cast(asked[k, 9], ti.i32)
            solid, triangle, height, facing, motion = -1, 0, 0.0, way, 0 * p
            low, high = p - nearest, p + nearest
            node = 1
            while True:
                if self.tree.boxes.meets(node, low, high):
                    if node < self.tree.boxes.first_leaf:
                        node *= 2
                        continue
                    leaf = (node - self.tree.boxes.first_leaf) * LEAF
                    for t in range(leaf, ti.min(leaf + LEAF, self.tree.boxes.size[0])):
                        info, wanted = self.tree.info[t], 0
                        if info[1] == 1 and info[0] != but and (only < 0 or info[0] == only):
                            wanted = self.tree.touches(t, low, high)
                        if wanted == 1:
                            w, gone, normal = self.tree.closest(t, p, 0.0)
                            up, d = gone.dot(normal), gone.norm()
                            if normal.dot(way) > cosine and d < nearest and ti.abs(up) >= sure * d and up >= least:
                                nearest, solid, triangle, height, facing = d, info[0], t, up, normal
                                motion = self.tree.point(t, w, 1.0) - self.tree.point(t, w, 0.0)
                                low, high = p - nearest, p + nearest
                node = self.tree.boxes.following(node)
                if node == 1:
                    break
            out[k, 0], out[k, 1], out[k, 8] = ti.cast(solid, float), height, ti.cast(triangle, float)
            for j in ti.static(range(3)):
                out[k, 2 + j], out[k, 5 + j] = facing[j], motion[j]
