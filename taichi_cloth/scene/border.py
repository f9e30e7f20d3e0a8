"""The border of an open surface, in a sentence: how many loops it has, where the widest is, and how it would be closed."""

from __future__ import annotations

import numpy as np

from .boxes import near
from .connected import components


def said(x: np.ndarray, edges: np.ndarray) -> str:
    """A half-sentence on a border.

    Args:
        x: (n, 3) positions [m].
        edges: (k, 2) edges with one triangle.
    """
    label = components(len(x), *edges.T)
    used = np.unique(edges)
    loops = np.unique(label[used])
    size = [np.ptp(x[used[label[used] == loop]], axis=0).max() for loop in loops.tolist()]
    widest = used[label[used] == loops[int(np.argmax(size))]]
    at = ", ".join(f"{v:.3g}" for v in x[widest].mean(axis=0))
    one = f"a loop {max(size):.3g} m wide" if len(loops) == 1 else f"{len(loops)} loops, the widest {max(size):.3g} m wide,"
    gap = gap_of(x, edges)
    closed = "triangles over them would close it" if gap is None else (
        f"its vertices lie {gap:.2g} m or less from others of it, and may be made one with them (tc.load_solid(weld=...))")
    return f"{len(edges)} border edges in {one} at ({at}); {closed}"


def gap_of(x: np.ndarray, edges: np.ndarray) -> float | None:
    """The distance [m] up to which every vertex of a border has another one beside it that is no neighbour along it.

    Args:
        x: (n, 3) positions [m]; edges: (k, 2) of the border.

    Returns:
        None if a vertex has none nearer than half an edge.
    """
    used = np.unique(edges)
    reach = 0.5 * float(np.median(np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)))
    boxes = x[used][:, None] + [[-reach / 2], [reach / 2]]
    nearest = np.full(len(used), np.inf)
    along = np.sort(np.searchsorted(used, edges), axis=1) @ np.array([len(used), 1])
    for i, j in near(boxes, boxes):
        own = (i == j) | np.isin(np.sort(np.column_stack([i, j]), axis=1) @ np.array([len(used), 1]), along)
        i, j = i[~own], j[~own]
        np.minimum.at(nearest, i, np.linalg.norm(x[used[i]] - x[used[j]], axis=1))
    return float(nearest.max()) if (nearest <= reach).all() else None
