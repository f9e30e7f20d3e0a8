"""The side from which a fitted camera looks: the usual one, unless cloth is seen edge-on from there. numpy only."""

from collections.abc import Iterable, Mapping

import numpy as np

from .camera import DIRECTION
from .framing import Way

ACROSS, UP, TOWARDS = DIRECTION
WAYS: tuple[Way, ...] = (DIRECTION, (-ACROSS, UP, TOWARDS), (TOWARDS, UP, ACROSS), (-TOWARDS, UP, ACROSS))
EDGE_ON = 0.6  # of the area that is seen from the best side: with less the usual side is left


def facing(frames: Iterable[Mapping[str, np.ndarray]], faces: np.ndarray) -> Way:
    """The usual one of `WAYS` if nearly as much of the cloth is seen from there as from the best of them; else that one.

    Args:
        frames: with `x` (n, 3) of the cloth [m], and `faces` if they have their own. Where some have `hung`, (n, 3) as in
            `recording.expected`, only these count, and only that.
        faces: (m, 3) of the others.
    """
    ways, kept = np.array(WAYS) / np.linalg.norm(DIRECTION), list(frames)
    hung = [frame for frame in kept if "hung" in frame]
    seen = np.zeros(len(ways))
    for frame in hung or kept:
        x, corners = frame["hung" if hung else "x"], frame.get("faces", faces)
        a, b, c = (x[corners[:, k]].astype(np.float64) for k in range(3))
        seen += np.abs(np.cross(b - a, c - a) @ ways.T).sum(axis=0)
    return WAYS[int(np.argmax(seen))] if seen[0] < EDGE_ON * seen.max() else DIRECTION
