"""Cloth with its thickness, for pictures only: two sheets, half of it to each side, and a wall along the borders."""

import numpy as np

from ..system.quantities import vertex_normals
from .hems import half_edges


class Shell:
    """Sheets and walls over a mesh.

    Args:
        faces: (m, 3) of n vertices; thickness: (n,) [m], 0 if a single sheet stays.

    Attributes:
        faces: (k, 3) of `count` vertices: the m front ones, those behind, walls.
        source: (k,) the face that each comes from; turn: (k, 3) the corner of it that each corner has.
    """

    def __init__(self, faces: np.ndarray, n: int, thickness: np.ndarray) -> None:
        self.sheet, self.half = faces, thickness[:, None] / 2
        thick = np.flatnonzero(thickness[faces[:, 0]] > 0)
        edge = np.flatnonzero(half_edges(faces) == -1)
        edge = edge[thickness[faces.ravel()[edge]] > 0]
        face, k = edge // 3, edge % 3
        i, j = faces[face, k], faces[face, (k + 1) % 3]
        self.rim, at = np.unique(np.concatenate([i, j]), return_inverse=True)
        i, j = 2 * n + at.reshape(2, -1)
        low = len(self.rim)
        walls = np.stack([i, i + low, j + low, i, j + low, j], axis=1).reshape(-1, 3)
        first, second = k, (k + 1) % 3
        self.faces = np.concatenate([faces, faces[thick] + n, walls]).astype(np.int32)
        self.source = np.concatenate([np.arange(len(faces)), thick, np.repeat(face, 2)])
        self.turn = np.concatenate([np.tile([0, 1, 2], (len(faces) + len(thick), 1)),
                                    np.stack([first, first, second, first, second, second], axis=1).reshape(-1, 3)])
        self.count = 2 * (n + low)

    def points(self, x: np.ndarray) -> np.ndarray:
        """(count, 3) vertices of positions x (n, 3) [m]."""
        across = self.half * vertex_normals(x, self.sheet)
        return self.linear(x, across)

    def linear(self, values: np.ndarray, across: np.ndarray | float = 0.0) -> np.ndarray:
        """(count, d) values (n, d) at the vertices, and by how much more the front has and the back less."""
        front, back = values + across, values - across
        return np.concatenate([front, back, front[self.rim], back[self.rim]])
