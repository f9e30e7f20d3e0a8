"""Rows of fields: how many they have room for, and numpy arrays of those that are used. numpy only."""

import numpy as np

SMALL, MIDDLE, LARGE = 1 << 10, 1 << 14, 1 << 18  # rows: two sizes, then twice as many each, then multiples


def capacity(n: int) -> int:
    """Rows that a field of n rows gets: kernels are compiled for fields, and so serve all meshes of about a size."""
    size = SMALL if n <= SMALL else MIDDLE
    while size < min(n, LARGE):
        size *= 2
    return size if n <= LARGE else -(-n // LARGE) * LARGE


def read(field) -> np.ndarray:
    """The rows of a field that `Fields` made."""
    return field.to_numpy()[: field.rows]


def write(field, data: np.ndarray) -> None:
    """Sets the rows of a field."""
    whole = np.zeros(field.shape + data.shape[1:], dtype=data.dtype)
    whole[: field.rows] = data
    field.from_numpy(whole)
