"""Inverses of small dense matrices, in tiles so small that the linear algebra library uses one thread for each. numpy only.

Several threads gain little here, and wait for each other for long where another program has their cores.
"""

import numpy as np

TILE = 48  # rows


def inverted(A: np.ndarray) -> np.ndarray:
    """Inverse of a symmetric positive definite matrix (n, n), by block Gauss-Jordan elimination.

    Raises:
        numpy.linalg.LinAlgError: it is not positive definite.
    """
    n, count = len(A), -(-len(A) // TILE)
    whole = np.eye(count * TILE)
    whole[:n, :n] = A
    tiles = np.ascontiguousarray(whole.reshape(count, TILE, count, TILE).transpose(0, 2, 1, 3))
    for p in range(count):
        np.linalg.cholesky(tiles[p, p])  # no pivot is looked for: the blocks of positive definite matrices will do
        pivot = np.linalg.inv(tiles[p, p])
        row, column = pivot @ tiles[p], tiles[:, p].copy()
        row[p], column[p] = pivot, 0
        tiles[:, p] = 0
        tiles -= column[:, None] @ row[None]
        tiles[p] = row
    out = tiles.transpose(0, 2, 1, 3).reshape(whole.shape)[:n, :n]
    return (out + out.T) / 2


def inverted_in_part(A: np.ndarray, least: float) -> tuple[np.ndarray, int]:
    """(inverse (n, n) of a symmetric matrix on the space of its eigenvalues above `least` and 0 beyond, how many are beyond).

    Raises:
        numpy.linalg.LinAlgError: it is not finite.
    """
    if not np.isfinite(A).all():
        raise np.linalg.LinAlgError("not finite")
    values, vectors = np.linalg.eigh(A)
    some = values > least
    return (vectors[:, some] / values[some]) @ vectors[:, some].T, int((~some).sum())
