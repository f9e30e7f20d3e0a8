"""From where a fitted camera looks: the usual side, unless cloth is seen edge-on from there, and down at cloth that lies flat.

numpy only.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from .camera import DIRECTION
from .framing import Way

ACROSS, UP, TOWARDS = DIRECTION
WAYS: tuple[Way, ...] = (DIRECTION, (-ACROSS, UP, TOWARDS), (TOWARDS, UP, ACROSS), (-TOWARDS, UP, ACROSS))
RAISED = 0.75  # in place of UP, for cloth that lies flat: 33 degrees for 15
EDGE_ON = 0.6  # of the area that is seen from the best side: with less the usual one is left
LYING = 0.8  # of the area that is seen from RAISED: with less the camera goes up (pile .47, fold .66, table .87, worn 1.1)


def facing(frames: Iterable[Mapping[str, np.ndarray]], faces: np.ndarray) -> Way:
    """The usual one of `WAYS` if nearly as much of the cloth is seen from there as from the best of them; else that one.
    Where far more is seen from above that, as of a cloth on a table, the same from `RAISED`.

    Args:
        frames: with `x` (n, 3) of the cloth [m], and `faces` if they have their own. Where some have `hung`, (n, 3) as in
            `recording.expected`, only these count, and only that.
        faces: (m, 3) of the others.
    """
    ways, kept = np.array([*WAYS, *map(_raised, WAYS)]), list(frames)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    hung = [frame for frame in kept if "hung" in frame]
    seen = np.zeros(len(ways))
    for frame in hung or kept:
        x, corners = frame["hung" if hung else "x"], frame.get("faces", faces)
        a, b, c = (x[corners[:, k]].astype(np.float64) for k in range(3))
        seen += np.abs(np.cross(b - a, c - a) @ ways.T).sum(axis=0)
    level, above = seen[:len(WAYS)], seen[len(WAYS):]
    k = int(np.argmax(level)) if level[0] < EDGE_ON * level.max() else 0
    return _raised(WAYS[k]) if level[k] < LYING * above[k] else WAYS[k]


def _raised(way: Way) -> Way:
    return way[0], RAISED, way[2]
