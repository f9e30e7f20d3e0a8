"""A run's meshes cut into pieces for other tools: a mesh a cloth, a mesh a panel, or seams welded to one.

Recorded garments are panels whose sewn vertices are in one place; `sewn` is the vertex that stands for
each, `panel` and `panel_names` tell the panel of each face. Texture coordinates stay the pattern's, or the mesh's own. A frame
may have faces of its own: then it has all of `FACES` that the run's geometry has. Triangles stay as they were simulated.
Panels that are welded may face both ways, and are turned to the side that most of them face, the same at all frames.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...errors import OutputError
from ...scene.mesh import facing
from ..colors import PALETTE, to_srgb
from ..described import image_uv
from ..recording import Recording

PARTS = ("cloths", "panels", "welded")
FACES = ("faces", "uv", "image_uv", "cloth_start", "cloth_faces", "sewn", "panel", "panel_names")  # changed by tearing
Arrays = dict[str, np.ndarray]


class Frame(dict):
    """A frame's arrays as cut.

    Attributes:
        whole: the recorded ones.
        take: (n',) the recorded vertex of each vertex.
        geometry: as `Recording.geometry` for these vertices; the same object as long as the faces stay.
    """

    whole: Arrays
    take: np.ndarray
    geometry: Arrays


class Cut:
    """A recording with other meshes, as the modules of formats read it.

    Args:
        changing: whether normals may belong to other corners at every frame, as they do where seams open.

    Attributes:
        turned: (m,) whether each of the recorded triangles goes round the other way here.
    """

    def __init__(self, recording: Recording, parts: str, changing: bool = True) -> None:
        self.recording, self.parts = recording, parts
        self._names = [name for name in FACES if name != "sewn" or changing or parts == "welded"]
        self.manifest, self.path = recording.manifest, recording.path
        self._own: Arrays = {}
        g = recording.geometry
        welds = parts == "welded" and "sewn" in g
        self.turned = turned(g["sewn"][g["faces"]], g["cloth_faces"]) if welds else np.zeros(len(g["faces"]), dtype=bool)
        self._cut = cut(g, parts, self.turned)

    @property
    def fps(self) -> float:
        """Frames a second."""
        return float(self.manifest.get("fps", 24.0))

    def frames(self) -> list[int]:
        """Numbers of the recorded frames."""
        return self.recording.frames()

    def frame(self, number: int) -> Frame:
        """Moving data of a frame."""
        whole = self.recording.frame(number)
        own = {name: whole[name] for name in self._names if name in whole}
        if own.keys() != self._own.keys() or any(not np.array_equal(own[name], self._own[name]) for name in own):
            self._own, self._cut = own, cut(self.recording.geometry | own, self.parts, self.turned)
        take, geometry = self._cut
        moving = {name: a[take] if name in ("x", "v", "contact") else a for name, a in whole.items()}
        out = Frame(moving)
        out.whole, out.take, out.geometry = whole, take, geometry
        return out

    def of(self, field) -> Any:
        """A function of recorded frames as one of these."""
        return lambda frame: field(frame.whole)[frame.take]

    def checked(self) -> Iterator[Frame]:
        """Every frame.

        Raises:
            OutputError: one is missing or damaged, or has other pieces than the first.
        """
        names: list[str] = []
        for k in self.frames():
            frame = self.frame(k)
            now = frame.geometry["cloth_names"].tolist()
            names = names or now
            if now != names:
                raise OutputError(f"{self.path}: frame {k} has other pieces of cloth than the first: without --panels cloths "
                                  "stay whole")
            yield frame

    def check(self) -> None:
        """Reads every frame, so that faults are named before anything is written; see `checked`."""
        for _ in self.checked():
            pass


def at(geometry: Arrays, frame: Arrays) -> Arrays:
    """A run's geometry with the faces that a recorded frame has of its own."""
    return geometry | {name: frame[name] for name in FACES if name in frame}


def first_uv(frame: Frame) -> np.ndarray:
    """(n, 2) float32 texture coordinates of each vertex's first corner, for formats that have one a vertex."""
    faces = frame.geometry["faces"]
    uv = np.zeros((len(frame["x"]), 2), dtype=np.float32)
    uv[faces[::-1].ravel()] = image_uv(frame.geometry)[0][::-1].reshape(-1, 2)
    return uv


def first_color(frame: Frame) -> np.ndarray | None:
    """(n, 3) uint8 sRGB colours of each vertex's first face; None where no panel has a colour of its own."""
    g = frame.geometry
    if "face_colors" not in g:
        return None
    piece = np.repeat(np.arange(len(g["cloth_names"])), np.diff(g["cloth_faces"]))
    cloth = g["piece_cloth"][piece] if "piece_cloth" in g else piece
    colors = np.array(PALETTE)[cloth % len(PALETTE)]
    for own in (g["cloth_colors"][piece], g["face_colors"]):
        colors = np.where(np.isnan(own).any(axis=1, keepdims=True), colors, own)
    out = np.zeros((len(frame["x"]), 3), dtype=np.uint8)
    out[g["faces"][::-1].ravel()] = np.repeat(to_srgb(colors)[::-1], 3, axis=0)
    return out


def cut(geometry: Arrays, parts: str, turned: np.ndarray) -> tuple[np.ndarray, Arrays]:
    """(recorded vertex of each vertex, geometry) by cloths, by panels, or welded over their seams."""
    if parts == "panels" and "panel" in geometry:
        return _by(geometry, geometry["panel"], geometry["panel_names"])
    if parts == "welded" and "sewn" in geometry:
        return _welded(geometry, turned)
    return np.arange(geometry["cloth_start"][-1]), geometry


def _by(g: Arrays, panel: np.ndarray, names: np.ndarray) -> tuple[np.ndarray, Arrays]:
    """A mesh for each panel (m,) of faces."""
    takes: list[np.ndarray] = []
    faces, rows = [], []
    for k in range(len(names)):
        mine = g["faces"][panel == k]
        used = np.unique(mine)
        faces.append(np.searchsorted(used, mine) + sum(map(len, takes)))
        takes.append(used)
        rows.append(np.flatnonzero(panel == k))
    return _made(g, takes, faces, rows, names)


def turned(faces: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Triangles that face another way than most triangles connected to them.

    Args:
        faces: (m, 3) of welded vertices; starts: the first face of each cloth, and the end.

    Returns:
        (m,) bool; none of a cloth that has one side only.
    """
    out = np.zeros(len(faces), dtype=bool)
    for first, last in zip(starts[:-1], starts[1:]):
        rows = first + np.flatnonzero(_whole(faces[first:last]))
        against = facing(faces[rows])
        if against is not None:
            out[rows[against]] = True
    return out


def _whole(faces: np.ndarray) -> np.ndarray:
    """(m,) whether triangles have three corners: one with two corners sewn to each other has no area."""
    return (faces != np.roll(faces, 1, axis=1)).all(axis=1)


def _welded(g: Arrays, turned: np.ndarray) -> tuple[np.ndarray, Arrays]:
    """A mesh for each cloth, with one vertex for each cluster of sewn ones."""
    g = g | {name: np.where(turned[:, None] if g[name].ndim == 2 else turned[:, None, None], g[name][:, ::-1], g[name])
             for name in ("faces", "uv")}
    takes: list[np.ndarray] = []
    faces, rows = [], []
    for first, last in zip(g["cloth_faces"][:-1], g["cloth_faces"][1:]):
        mine = g["sewn"][g["faces"][first:last]]
        whole = _whole(mine)
        used = np.unique(mine[whole])
        faces.append(np.searchsorted(used, mine[whole]) + sum(map(len, takes)))
        takes.append(used)
        rows.append(first + np.flatnonzero(whole))
    return _made(g, takes, faces, rows, g["cloth_names"])


def _made(g: Arrays, takes: list, faces: list, rows: list, names: np.ndarray) -> tuple[np.ndarray, Arrays]:
    owner = [int(np.searchsorted(g["cloth_start"], take[0], side="right")) - 1 for take in takes]
    per_face = ("uv", "image_uv", "face_colors", "polygon", "face_group")
    of_faces = {name: g[name][np.concatenate(rows)] for name in per_face if name in g}
    return np.concatenate(takes), g | of_faces | {
        "faces": np.concatenate(faces).astype(np.int32), "cloth_names": names,
        "cloth_colors": g["cloth_colors"][owner], "piece_cloth": np.array(owner),
        "cloth_start": np.cumsum([0] + [len(t) for t in takes]), "cloth_faces": np.cumsum([0] + [len(f) for f in faces])}
