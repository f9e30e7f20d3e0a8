"""Expected places of cloth and solids, from prescribed motion alone: for a camera that is placed before the run."""

from collections.abc import Iterator

import numpy as np

from ..scene.attachment import Attachment
from ..scene.scene import Scene
from .record import drawn_solids, is_ground

LINE = 0.1  # spread of held vertices across a line, by that along it, up to which they are on it
TIMES = 13  # at which prescribed motion is evaluated, from the first drawn frame to the last


def expected(scene: Scene, last: float, first: float = 0.0) -> Iterator[dict[str, np.ndarray]]:
    """Yields frames with positions that a run will perhaps come near between two times [s].

    Solids and led vertices are at the places of their functions. A cloth follows a motion that leads it as a whole. Held cloth
    hangs down by its length from there; free cloth falls to the ground, if there is one. The last frame has `hung`, (n, 3):
    cloth that is held along a line as it will hang from it, the rest as it is.
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
        hung = _hung(scene, x)
        yield {"x": np.concatenate([_hanging(scene, x, grounds), hung]), "hung": hung}


def _hung(scene: Scene, x: np.ndarray) -> np.ndarray:
    """(n, 3) positions; each vertex of a cloth that is held along a line as far below that as it is away from it."""
    down, out = scene.gravity / np.linalg.norm(scene.gravity), x.copy()
    for cloth in scene.cloths:
        start, held = cloth.positions, [a.vertices for a in scene.script.attachments if a.cloth is cloth]
        ends = start[np.unique(np.concatenate(held))] if held else start[:0]
        centre = ends.mean(axis=0) if len(ends) else np.zeros(3)
        _, size, axes = np.linalg.svd(ends - centre, full_matrices=False)
        if len(size) > 1 and size[0] > 0 and size[1] <= LINE * size[0]:
            on = centre + ((start - centre) @ axes[0])[:, None] * axes[0]
            out[cloth.start: cloth.start + len(start)] = on + np.linalg.norm(start - on, axis=1)[:, None] * down
    return out


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
