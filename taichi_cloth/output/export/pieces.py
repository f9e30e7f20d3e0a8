"""What a run's meshes are cut into for other tools: a mesh a cloth, a mesh a panel, or what is sewn welded to one.

Recorded garments are panels whose sewn vertices are in one place; they say which belong together (`sewn`) and which face is
of which panel (`panel`, `panel_names`). Texture coordinates stay the pattern's.
"""

from typing import Any

import numpy as np

from ..recording import Recording

PARTS = ("cloths", "panels", "welded")


class Frame(dict):
    """A frame's arrays as cut, and `whole`, the recorded ones."""

    whole: dict[str, np.ndarray]


class Cut:
    """A recording with other meshes: what the modules of formats read.

    Attributes:
        take: (n',) the recorded vertex of each vertex.
        geometry: as `Recording.geometry` for these.
    """

    def __init__(self, recording: Recording, take: np.ndarray, geometry: dict[str, np.ndarray]) -> None:
        self.recording, self.take, self.geometry = recording, take, geometry
        self.manifest, self.path = recording.manifest, recording.path

    def frames(self) -> list[int]:
        """As `Recording.frames`."""
        return self.recording.frames()

    def frame(self, number: int) -> Frame:
        """What moves, at a frame."""
        whole = self.recording.frame(number)
        n = len(self.recording.geometry["x"])
        out = Frame({name: a[self.take] if name in ("x", "v", "contact") and len(a) == n else a for name, a in whole.items()})
        out.whole = whole
        return out

    def of(self, field) -> Any:
        """A function of recorded frames as one of these."""
        return lambda frame: field(frame.whole)[self.take]


def cut(recording: Recording, parts: str) -> Cut:
    """A recording's meshes by cloths, by panels, or welded over their seams."""
    g = recording.geometry
    if parts == "panels" and "panel" in g:
        return _by(recording, g["panel"], g["panel_names"])
    if parts == "welded" and "sewn" in g:
        return _welded(recording)
    return Cut(recording, np.arange(len(g["x"])), g)


def _by(recording: Recording, panel: np.ndarray, names: np.ndarray) -> Cut:
    """A mesh for each panel (m,) of faces."""
    g = recording.geometry
    takes: list[np.ndarray] = []
    faces, uvs = [], []
    for k in range(len(names)):
        mine = g["faces"][panel == k]
        used = np.unique(mine)
        faces.append(np.searchsorted(used, mine) + sum(map(len, takes)))
        takes.append(used)
        uvs.append(g["uv"][panel == k])
    return _made(recording, takes, faces, uvs, names)


def _welded(recording: Recording) -> Cut:
    """A mesh for each cloth, what is sewn together one vertex of it."""
    g = recording.geometry
    takes: list[np.ndarray] = []
    faces, uvs = [], []
    for first, last in zip(g["cloth_faces"][:-1], g["cloth_faces"][1:]):
        mine = g["sewn"][g["faces"][first:last]]
        whole = (mine != np.roll(mine, 1, axis=1)).all(axis=1)  # what has two corners sewn to each other has no area
        used = np.unique(mine[whole])
        faces.append(np.searchsorted(used, mine[whole]) + sum(map(len, takes)))
        takes.append(used)
        uvs.append(g["uv"][first:last][whole])
    return _made(recording, takes, faces, uvs, g["cloth_names"])


def _made(recording: Recording, takes: list, faces: list, uvs: list, names: np.ndarray) -> Cut:
    take = np.concatenate(takes)
    g = dict(recording.geometry)
    g |= {"faces": np.concatenate(faces).astype(np.int32), "uv": np.concatenate(uvs), "x": g["x"][take], "cloth_names": names,
          "cloth_start": np.cumsum([0] + [len(t) for t in takes]), "cloth_faces": np.cumsum([0] + [len(f) for f in faces])}
    return Cut(recording, take, g)
