"""Coverage of pixels by a triangle on the screen, and their places in it."""

import numpy as np

from ..backend.language import ti

PIECE = 64  # pixels of a triangle's box that one thread of a CPU tests; on a GPU they are threads


@ti.func
def wire(a, b, c, area, k, samples: ti.template()):
    """Dark along the edges of a triangle on the screen, 1 inside."""
    size = ti.abs(area)
    x = k[0] * size / ti.max((b - c).xy.norm(), 1e-6)
    y = k[1] * size / ti.max((c - a).xy.norm(), 1e-6)
    z = k[2] * size / ti.max((a - b).xy.norm(), 1e-6)
    return 0.35 + 0.65 * ti.min(1.0, ti.min(x, y, z) / (0.7 * samples))


@ti.func
def spot(x, y, n):
    """Place of sample (x, y), n samples a pixel across: one in each of the pixel's n^2 columns and rows."""
    return ti.Vector([x + (n - y % n - 0.5) / n, y + (x % n + 0.5) / n])


def pieces(p: np.ndarray, faces: np.ndarray, w: int, h: int, near: float) -> np.ndarray:
    """The work of rasterising triangles in equal pieces of PIECE pixels, so that large and small ones share threads well.

    A GPU takes a thread a pixel: Mesa's Vulkan on the CPU loses code that follows an atomic operation inside a loop.

    Args:
        p: (n, 3) columns, rows, 1/depth. Triangles with a corner behind the eye or nearer than 1/near are left out.

    Returns:
        (k, 6) int32: face, first pixel of its box, the box's first column and row, its columns, its pixels.
    """
    corners = p[faces]
    keep = ((corners[:, :, 2] > 0) & (corners[:, :, 2] < near)).all(axis=1)
    low = np.floor(np.clip(corners[:, :, :2].min(axis=1), 0, (w, h))).astype(np.int64)
    high = np.ceil(np.clip(corners[:, :, :2].max(axis=1), 0, (w, h))).astype(np.int64)
    across = high - low
    u, v = corners[:, 1, :2] - corners[:, 0, :2], corners[:, 2, :2] - corners[:, 0, :2]
    keep &= np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) > 1e-12
    count = np.where(keep, across.prod(axis=1), 0)
    share = -(-count // PIECE)
    face = np.repeat(np.arange(len(faces)), share)
    first = PIECE * (np.arange(len(face)) - np.repeat(np.cumsum(share) - share, share))
    columns = (face, first, low[face, 0], low[face, 1], across[face, 0], count[face])
    return np.stack(columns, axis=1).astype(np.int32).reshape(-1, 6)


@ti.func
def corner(p: ti.template(), i):
    """Row i of an (n, 3) array."""
    return ti.Vector([p[i, 0], p[i, 1], p[i, 2]])


@ti.func
def edge(a, b, x, y):
    """Twice the signed area of (a, b, (x, y))."""
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])


@ti.func
def weights(a, b, c, area, x, y):
    """Barycentric coordinates of a pixel; all at least 0 inside, whichever way round the triangle is."""
    return ti.Vector([edge(b, c, x, y), edge(c, a, x, y), edge(a, b, x, y)]) / area
