"""Points of contact: weighted sums of particles that a solve pushes and brakes; and arithmetic on rows of them: vectors
(k, 3), symmetric blocks (k, 6), sorted keys. numpy only."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

CORNERS = 4
EYE = np.array([1.0, 0, 0, 1, 0, 1])  # as symmetric blocks are kept: xx xy xz yy yz zz


@dataclass(frozen=True)
class Points:
    """Places on cloth, or differences of two, that contacts add to the system of a step.

    A point moves by J p = sum_a (w_a I + t_a n^T) p_a where its particles move by p_a. The turns t, at right angles to n, take
    off its motion by the turning of the cloth round it.

    Attributes:
        vertices: (k, 4) particles; weights: (k, 4) w.
        block: (k, 6) symmetric A [kg]: J^T A J is added to the system's matrix.
        rhs: (k, 3) r [kg m/s]: J^T r is added to its right-hand side.
        normal: (k, 3) n; turns: (k, 4, 3) t. None for points that do not turn.
    """

    vertices: np.ndarray
    weights: np.ndarray
    block: np.ndarray
    rhs: np.ndarray
    normal: np.ndarray | None = None
    turns: np.ndarray | None = None

    def of(self, rows: np.ndarray) -> np.ndarray:
        """(k, 3) how the points move where the particles move by rows (n, 3)."""
        mine = rows.take(self.vertices, axis=0)
        out = np.einsum("ka,kai->ki", self.weights, mine)
        if self.turns is None or self.normal is None:
            return out
        return out + np.einsum("kai,ka->ki", self.turns, np.einsum("kai,ki->ka", mine, self.normal))

    def spread(self, forces: np.ndarray, to: np.ndarray) -> None:
        """Adds to (n, 3) forces on the particles their shares of forces (k, 3) on the points."""
        push = self.weights[:, :, None] * forces[:, None, :]
        if self.turns is not None and self.normal is not None:
            push += np.einsum("kai,ki->ka", self.turns, forces)[:, :, None] * self.normal[:, None, :]
        for c in range(3):  # a fifth of the time of np.add.at
            to[:, c] += np.bincount(self.vertices.ravel(), push[:, :, c].ravel(), len(to))

    def forces(self, moved: np.ndarray, h: float) -> np.ndarray:
        """(k, 3) [N] on the points, where particles moved by (n, 3) [m] in a solve of a step of h [s]: (r - A J dv)/h."""
        return (self.rhs - sym_times(self.block, self.of(moved) / h)) / h

    def work(self, moved: np.ndarray, h: float, way: np.ndarray) -> float:
        """Work [J] of those forces where the particles go by way (n, 3) [m]."""
        return float(np.einsum("ki,ki->k", self.forces(moved, h), self.of(way)).sum())

    def potential(self, moved: np.ndarray, h: float) -> float:
        """Their part of the incremental potential [J] there: sum 1/2 (J dv)^T A J dv - r . J dv."""
        dv = self.of(moved) / h
        return float(np.sum((sym_times(self.block, dv) / 2 - self.rhs) * dv))

    @staticmethod
    def at(particles: np.ndarray, block: np.ndarray, rhs: np.ndarray) -> "Points":
        """Points that are particles (k,)."""
        vertices, weights = np.repeat(particles[:, None], CORNERS, axis=1), np.tile(np.eye(CORNERS)[0], (len(rhs), 1))
        return Points(vertices, weights, block, rhs)

    @staticmethod
    def none() -> "Points":
        """No points."""
        return Points(np.zeros((0, CORNERS), dtype=np.int64), np.zeros((0, CORNERS)), np.zeros((0, 6)), np.zeros((0, 3)))

    @staticmethod
    def join(parts: Sequence["Points"]) -> "Points":
        """Points one after the other."""
        vertices, weights, block, rhs = (np.concatenate([getattr(p, name) for p in parts])
                                         for name in ("vertices", "weights", "block", "rhs"))
        if all(p.turns is None for p in parts):
            return Points(vertices, weights, block, rhs)
        zero = [np.zeros((len(p.rhs), CORNERS + 1, 3)) for p in parts]
        return Points(vertices, weights, block, rhs,
                      np.concatenate([z[:, 0] if p.normal is None else p.normal for p, z in zip(parts, zero)]),
                      np.concatenate([z[:, 1:] if p.turns is None else p.turns for p, z in zip(parts, zero)]))


def tangential(rows: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Rows (k, 3) without their part along the normals (k, 3)."""
    return rows - np.einsum("ki,ki->k", rows, normal)[:, None] * normal


def length(rows: np.ndarray) -> np.ndarray:
    """(k,) lengths of rows (k, 3); three times as fast as `np.linalg.norm`."""
    return np.sqrt(np.einsum("ki,ki->k", rows, rows))


def sym_outer(rows: np.ndarray) -> np.ndarray:
    """(k, 6) symmetric blocks r r^T of rows (k, 3)."""
    x, y, z = np.ascontiguousarray(rows.T)
    return np.stack([x * x, x * y, x * z, y * y, y * z, z * z], axis=1)


def sym_times(blocks: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(k, 3) symmetric blocks (k, 6) times rows (k, 3)."""
    return np.einsum("kij,kj->ki", blocks[:, [0, 1, 2, 1, 3, 4, 2, 4, 5]].reshape(-1, 3, 3), rows)


def unit(rows: np.ndarray) -> np.ndarray:
    """Rows (k, 3) of length 1, or 0 where they are 0."""
    return rows / np.maximum(length(rows), 1e-30)[:, None]


def among(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Whether each wanted key is among sorted keys; an eighth of the time of `np.isin`."""
    return rows_of(keys, wanted) >= 0


def rows_of(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Row of each wanted key among sorted keys, or -1."""
    if not len(keys):
        return np.full(len(wanted), -1)
    where = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[where] == wanted, where, -1)
