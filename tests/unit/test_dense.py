"""Inverses of dense matrices against LAPACK's."""

import numpy as np
import pytest

from taichi_cloth.solver.dense import TILE, inverted, inverted_in_part


@pytest.mark.parametrize("n", [1, 5, TILE, TILE + 1, 3 * TILE - 7])
def test_inverse(rng, n):
    B = rng.normal(size=(n, n))
    A = B @ B.T + n * np.eye(n)
    out = inverted(A)
    assert np.abs(out @ A - np.eye(n)).max() < 1e-11 and (out == out.T).all()


def test_inverse_of_what_is_nearly_singular(rng):
    """Eigenvalues over eight decades: to their condition."""
    n = 2 * TILE
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A = (Q * np.logspace(-8, 0, n)) @ Q.T
    A = (A + A.T) / 2
    assert np.abs(inverted(A) @ A - np.eye(n)).max() < 1e-4


def test_what_is_not_positive_definite(rng):
    for k in (0, 2 * TILE - 1):
        A = np.eye(2 * TILE)
        A[k, k] = -1.0
        with pytest.raises(np.linalg.LinAlgError):
            inverted(A)


def test_what_is_singular_is_inverted_where_it_is_not(rng):
    """The inverse on what has eigenvalues above the least, nothing on the rest: also beside large ones, and negative ones."""
    n, left = TILE, 11
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    values = np.concatenate([np.zeros(left - 1), [-0.3], np.logspace(-4, 3, n - left)])
    A = (Q * values) @ Q.T
    out, count = inverted_in_part((A + A.T) / 2, 1e-9)
    wanted = (Q[:, left:] / values[left:]) @ Q[:, left:].T
    assert count == left and np.abs(out - wanted).max() < 1e-7 * np.abs(wanted).max()
    assert np.linalg.eigvalsh(out).min() > -1e-9 * np.abs(wanted).max()
    A[3, 4] = A[4, 3] = np.nan
    with pytest.raises(np.linalg.LinAlgError):
        inverted_in_part(A, 1e-9)
