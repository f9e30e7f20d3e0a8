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


def tangential(rows: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Rows (k, 3) without their part along the normals (k, 3)."""
    return rows - np.einsum("ki,ki->k", rows, normal)[:, None] * normal


def length(rows: np.ndarray) -> np.ndarray:
    """(k,) lengths of rows (k, 3); three times as fast as `np.linalg.norm`."""
    return np.sqrt(np.einsum("ki,ki->k", rows, rows))


EYE = np.array([1.0, 0, 0, 1, 0, 1])  # as symmetric blocks are kept: xx xy xz yy yz zz


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


def rows_of(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Where each wanted key is among sorted keys, or -1."""
    if not len(keys):
        return np.full(len(wanted), -1)
    where = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[where] == wanted, where, -1)
