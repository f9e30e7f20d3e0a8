"""Expected places of cloth and solids, from prescribed motion alone: for a camera that is placed before the run."""

from collections.abc import Iterator

import numpy as np

from ..scene.attachment import Attachment
from ..scene.scene import Scene
from .record import drawn_solids, is_ground

TIMES = 13  # at which prescribed motion is evaluated, from the first drawn frame to the last


def expected(scene: Scene, last: float, first: float = 0.0) -> Iterator[dict[str, np.ndarray]]:
    """Yields frames with positions that a run will perhaps come near between two times [s].

    Solids and led vertices are at the places of their functions. A cloth follows a motion that leads it as a whole. Held cloth
    hangs down by its length from there; free cloth falls to the ground, if there is one.
    """
    x = np.concatenate([np.zeros((0, 3)), *(c.positions for c in scene.cloths)])
    solids = drawn_solids(scene)
    grounds = [float(s.pose(0.0)[1][1]) for s in scene.solids if is_ground(s)]
    moving = any(s.moves for s in solids)
    for t in np.linspace(first, last, TIMES):
        shifted = x.copy()
        for a in scene.script.attachments:
            if a.leads:
                start = a.cloth.positions
                rows = slice(a.cloth.start, a.cloth.start + len(start))
                shifted[rows] = start + (a.target(float(t), start) - start[a.vertices]).mean(axis=0)
        frame = {"x": shifted}
        if moving:
            frame["solid_x"] = np.concatenate([s.surface_at(float(t)) for s in solids])
        yield frame
    if scene.gravity.any():
        yield {"x": _hanging(scene, x, grounds)}


def _hanging(scene: Scene, x: np.ndarray, grounds: list[float]) -> np.ndarray:
    """Points that cloth reaches at rest below its supports, or on the ground below it; itself where neither is known."""
    down = scene.gravity / np.linalg.norm(scene.gravity)
    out = [x]
    for cloth in scene.cloths:
        start = cloth.positions
        held: list[Attachment] = [a for a in scene.script.attachments if a.cloth is cloth]
        for a in held:
            centre = start[a.vertices].mean(axis=0)
            drop = (np.linalg.norm(start - centre, axis=1).max() - np.ptp(start[a.vertices], axis=0).max() / 2)
            out.append(start[a.vertices] + max(drop, 0.0) * down)
        if not held and grounds and down[1] < -0.9:
            out.append(np.column_stack([start[:, 0], np.full(len(start), max(grounds)), start[:, 2]]))
    return np.concatenate(out)
