"""A recorded run as scenes of other tools have it: named meshes with a colour, one camera, frame by frame.

All is read before a file is written, so that missing or damaged data are named first. y is up, lengths are in metres.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...backend.ordering import components
from ...errors import OutputError
from ...scene.view import Camera, CameraKeys, View
from ..camera import frame as axes_of
from ..camera import ground_height
from ..colors import PALETTE, STONE
from ..described import appearances_of, image_uv, view_of
from ..facing import facing
from ..framing import fit_all
from ..rig import rig_of
from .pieces import Arrays, Cut, Frame, turned
from .printed import Print, in_palette, palette, printed

ASPECT = 16 / 9  # of the pictures that the camera is made for
AROUND, HORIZON = 4.0, 60.0  # sizes of all that there is, to which the ground goes: where viewers frame it, where a camera is
SHARP = np.cos(np.radians(40.0))  # edges of solids that turn by more look sharp


class Surface(NamedTuple):
    """Data that stay as long as a mesh is not torn.

    Attributes:
        faces: (m, 3) int32 vertices.
        uv: (m, 3, 2) of corners, the pattern's [m], the mesh's own, or across its print; None if there are none.
        normal_of: (m, 3) number of each corner's normal: corners round a sharp edge have different ones.
        polygon: (m,) number of the polygon that each was cut from, or None if all are triangles.
    """

    faces: np.ndarray
    uv: np.ndarray | None
    normal_of: np.ndarray
    polygon: np.ndarray | None = None

    def equals(self, other: "Surface") -> bool:
        """Whether all of it is the same."""
        return all(np.array_equal(a, b) for a, b in zip(self, other))  # type: ignore[arg-type]


@dataclass(frozen=True)
class Mesh:
    """An object of the scene.

    Attributes:
        name: the scene's, unlike all other meshes'.
        kind: "cloth" or "solid".
        color: (3,) linear RGB.
        surfaces: one, or one a frame where the faces change.
        x: (n, 3) float32 [m], one or one a frame.
        v: the same, in metres a second of the film, or none.
        printed: its print, or None.
        thickness: of a cloth [m], or None if none is known.
        groups: (m,) names, with blanks between, of the groups that each face is in; None if it has none.
    """

    name: str
    kind: str
    color: np.ndarray
    surfaces: list[Surface]
    x: list[np.ndarray]
    v: list[np.ndarray]
    printed: Print | None = None
    thickness: float | None = None
    groups: np.ndarray | None = None

    @property
    def moves(self) -> bool:
        """Whether it is not the same at all frames."""
        return self.kind == "cloth" or len(self.x) > 1

    @property
    def steady(self) -> bool:
        """Whether its faces are the same at all frames."""
        return len(self.surfaces) == 1

    def position(self, k: int) -> np.ndarray:
        """(n, 3) float32 [m] at the k-th frame."""
        return self.x[k if len(self.x) > 1 else 0]

    def surface(self, k: int) -> Surface:
        """The surface in the k-th frame."""
        return self.surfaces[k if len(self.surfaces) > 1 else 0]

    def normals(self, k: int) -> np.ndarray:
        """(count, 3) float32 unit normals at the k-th frame, by `normal_of`."""
        surface, x = self.surface(k), self.position(k).astype(np.float64)
        corner = x[surface.faces]
        area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        index, count = surface.normal_of.ravel(), int(surface.normal_of.max()) + 1
        sums = np.stack([np.bincount(index, np.repeat(a, 3), count) for a in area.T], axis=1)
        length = np.linalg.norm(sums, axis=1, keepdims=True)
        return np.where(length > 0, sums / np.maximum(length, 1e-300), [0.0, 1.0, 0.0]).astype(np.float32)

    def normal_of_vertex(self, k: int) -> np.ndarray | None:
        """(n,) number of each vertex's normal at the k-th frame; None if a vertex has several."""
        surface = self.surface(k)
        out = np.zeros(len(self.position(k)), dtype=np.int64)
        out[surface.faces] = surface.normal_of
        return out if (out[surface.faces] == surface.normal_of).all() else None


@dataclass(frozen=True)
class Shot:
    """All of it.

    Attributes:
        numbers: of the frames; fps: frames a second; times: (count,) [s].
        meshes: cloths first.
        cameras: one, or one a frame.
        path: of the run.
        view: how pictures of it are to look.
    """

    numbers: list[int]
    fps: float
    times: np.ndarray
    meshes: list[Mesh]
    cameras: list[Camera]
    path: str
    view: View

    @property
    def clipping(self) -> tuple[float, float]:
        """(near, far) distances [m] between which cameras see."""
        low, high = bounds(self.meshes)
        corners = np.array(list(itertools.product(*zip(low, high))))
        far = max(float(np.linalg.norm(corners - np.array(c.eye), axis=1).max()) for c in self.cameras)
        near = min(axes_of(c).near for c in self.cameras)
        return near, max(2 * far, 2 * near)

    def one_topology(self, format: str) -> None:
        """Refuses faces that change, for a format that has one set of them.

        Raises:
            OutputError: where they do.
        """
        for mesh in self.meshes:
            if not mesh.steady:
                raise OutputError(f"{self.path}: the faces of {mesh.name!r} change from frame to frame, and {format} has one "
                                  "set of them: export usda, usdc, obj, ply or vtu")


def shot(pieces: Cut, floor: bool = False) -> Shot:
    """Reads a run.

    Args:
        floor: whether a scene that does not say how high its ground is has one all the same, where pictures have it.

    Raises:
        OutputError: a frame is missing or damaged.
    """
    numbers, frames = pieces.frames(), list(pieces.checked())
    g = frames[0].geometry
    prints = _prints(pieces.recording.geometry)
    speed = np.float32(pieces.recording.speed)
    meshes = [_cloth(k, frames, prints, speed) for k in range(len(g["cloth_names"]))]
    meshes += [_solid(k, g, frames) for k in range(len(g["solid_names"]))]
    times = np.array([float(f["t"]) for f in frames])
    cameras = _cameras(g, times, meshes)
    height = float(g["ground"])
    if np.isnan(height) and floor and view_of(g).drawn_floor not in ("none", "shadow"):
        height = _lowest(meshes, view_of(g))
    if not np.isnan(height):
        meshes.append(_ground(height, meshes, view_of(g), cameras[0], HORIZON if floor else AROUND))
    names = unique([mesh.name for mesh in meshes])
    meshes = [replace(mesh, name=name) for name, mesh in zip(names, meshes)]
    return Shot(numbers, pieces.fps, times, meshes, cameras, str(pieces.path), view_of(g))


def unique(names: Iterable[str]) -> list[str]:
    """The names, with _2, _3, ... after those that come again; upper and lower case count for the same."""
    out: list[str] = []
    for name in names:
        tries = itertools.chain([name], (f"{name}_{k}" for k in itertools.count(2)))
        out.append(next(t for t in tries if t.lower() not in {o.lower() for o in out}))
    return out


def bounds(meshes: list[Mesh]) -> tuple[np.ndarray, np.ndarray]:
    """(lowest, highest) (3,) coordinates [m] of all meshes at all frames."""
    every = [x for mesh in meshes for x in mesh.x]
    return np.min([x.min(axis=0) for x in every], axis=0), np.max([x.max(axis=0) for x in every], axis=0)


def _prints(g: Arrays) -> list[Print | None]:
    """The print of each cloth of a run's own geometry."""
    out: list[Print | None] = []
    units = image_uv(g)[1]
    for k, (look, first, last) in enumerate(zip(appearances_of(g), g["cloth_faces"][:-1], g["cloth_faces"][1:])):
        color = _color(g["cloth_colors"][k], PALETTE[k % len(PALETTE)])
        out.append(None if look.texture is None else printed(look.texture, color, g["uv"][first:last], units[k]))
    return out


def _cloth(k: int, frames: list[Frame], prints: list[Print | None], speed: np.float32) -> Mesh:
    owner = int(frames[0].geometry["piece_cloth"][k]) if "piece_cloth" in frames[0].geometry else k
    on, color, colors = prints[owner], *_colors_of(k, owner, frames[0].geometry)
    if on is None and len(colors) > 1:
        on = palette(colors)
    elif on is None and len(colors):
        color = colors[0]
    surfaces: list[Surface] = []
    x, v = [], []
    last: Arrays = {}
    for frame in frames:
        g = frame.geometry
        first, end = int(g["cloth_start"][k]), int(g["cloth_start"][k + 1])
        if g is not last:
            rows = slice(int(g["cloth_faces"][k]), int(g["cloth_faces"][k + 1]))
            numbers = _smooth(g["faces"][rows], g["sewn"][frame.take] if "sewn" in g else np.arange(len(frame.take)))
            if prints[owner] is None and on is not None:
                uv = in_palette(_of_faces(g, rows, color), colors)
            else:
                uv = image_uv(g)[0][rows]
                uv = uv if on is None else on.coordinates(uv)
            polygon = g["polygon"][rows] if "polygon" in g else None
            surface = Surface((g["faces"][rows] - first).astype(np.int32), uv, numbers, polygon)
            surfaces.append(surfaces[-1] if surfaces and surface.equals(surfaces[-1]) else surface)
        else:
            surfaces.append(surfaces[-1])
        last = g
        x.append(frame["x"][first:end])
        v.append(frame["v"][first:end] * speed)
    g = frames[0].geometry
    steady = all(s is surfaces[0] for s in surfaces)
    thickness = float(g["cloth_thickness"][owner]) if "cloth_thickness" in g else np.nan
    groups = None
    if "face_group" in g:
        of = g["face_group"][int(g["cloth_faces"][k]): int(g["cloth_faces"][k + 1])]
        groups = np.where(of < 0, "", g["face_groups"][of])
    return Mesh(str(g["cloth_names"][k]), "cloth", color, surfaces[:1] if steady else surfaces, x, v, on,
                None if np.isnan(thickness) else thickness, groups)


def _smooth(faces: np.ndarray, sewn: np.ndarray) -> np.ndarray:
    """(m, 3) numbers of corners' normals: the same round vertices that are sewn together (n,), but where triangles face
    other ways."""
    corners = sewn[faces]
    against = turned(corners, np.array([0, len(corners)]))
    return np.unique(2 * corners + against[:, None], return_inverse=True)[1].reshape(-1, 3)


def _colors_of(k: int, owner: int, g: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """(3,) a piece's colour, and (c, 3) all those that its faces have where panels have their own, else none."""
    color = _color(g["cloth_colors"][k], PALETTE[owner % len(PALETTE)])
    rows = slice(int(g["cloth_faces"][k]), int(g["cloth_faces"][k + 1]))
    if "face_colors" not in g or np.isnan(g["face_colors"][rows]).all():
        return color, np.zeros((0, 3))
    return color, np.unique(_of_faces(g, rows, color), axis=0)


def _of_faces(g: Arrays, rows: slice, color: np.ndarray) -> np.ndarray:
    """(m, 3) colours of a piece's faces."""
    own = g["face_colors"][rows]
    return np.where(np.isnan(own), color, own)


def _solid(k: int, g: Arrays, frames: list[Frame]) -> Mesh:
    first, end = g["solid_start"][k], g["solid_start"][k + 1]
    mine = (g["solid_faces"][:, 0] >= first) & (g["solid_faces"][:, 0] < end)
    faces = g["solid_faces"][mine] - first
    x = [f.get("solid_x", g["solid_x"])[first:end].astype(np.float32) for f in frames]
    if all(np.array_equal(y, x[0]) for y in x):
        x = x[:1]
    surface = Surface(faces.astype(np.int32), None, _creased(x[0], faces))
    return Mesh(str(g["solid_names"][k]), "solid", _color(g["solid_colors"][k], STONE), [surface], x, [])


def _creased(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(m, 3) numbers of corners' normals: the same for corners of faces that meet in an edge that is not sharp."""
    corner = x.astype(np.float64)[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    here = np.arange(3 * len(faces)).reshape(-1, 3)
    start, end = here.ravel(), np.roll(here, -1, axis=1).ravel()  # corners at the two ends of each face's edges
    a, b = faces.ravel()[start], faces.ravel()[end]
    order = np.lexsort((np.maximum(a, b), np.minimum(a, b)))
    low, high = np.minimum(a, b)[order], np.maximum(a, b)[order]
    twins = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
    p, q = order[twins], order[twins + 1]
    flat = np.einsum("ij,ij->i", normal[p // 3], normal[q // 3]) >= SHARP
    p, q = p[flat], q[flat]
    turned = a[p] != a[q]  # neighbours that agree on their outside go through their edge in opposite directions
    pairs = [(start[p], np.where(turned, end[q], start[q])), (end[p], np.where(turned, start[q], end[q]))]
    label = components(3 * len(faces), *(np.concatenate(side) for side in zip(*pairs)))
    return np.unique(label, return_inverse=True)[1].reshape(-1, 3)


def _color(own: np.ndarray, other: tuple[float, float, float]) -> np.ndarray:
    """(3,) the scene's colour, or another where it names none."""
    return np.array(other) if np.isnan(own).any() else own


def _cameras(g: Arrays, times: np.ndarray, meshes: list[Mesh]) -> list[Camera]:
    """The scene's, one a frame where it moves, or one that has all meshes in its picture at all frames."""
    camera = view_of(g).camera
    if isinstance(camera, CameraKeys):
        return [camera.at(float(t)) for t in times]
    if isinstance(camera, Camera):
        return [camera]
    shapes = ({"x": x, "faces": surface.faces} for mesh in meshes if mesh.kind == "cloth"
              for x, surface in zip(mesh.x, mesh.surfaces * len(mesh.x)))
    way = facing(shapes, np.zeros((0, 3), dtype=int))
    return [fit_all((x.astype(np.float64) for mesh in meshes for x in mesh.x), 0.0, ASPECT, way)]


def _lowest(meshes: list[Mesh], view: View) -> float:
    """Height [m] of the ground below all meshes at all frames, as pictures have it: solids that are the lowest stand on it."""
    low = {kind: min((float(x[:, 1].min()) for m in meshes if m.kind == kind for x in m.x), default=np.inf)
           for kind in ("cloth", "solid")}
    first = np.concatenate([mesh.position(0) for mesh in meshes]).astype(np.float64)
    return ground_height(first, view, low["cloth"] - view.reach, low["solid"])


def _ground(height: float, meshes: list[Mesh], view: View, camera: Camera, wide: float) -> Mesh:
    """A square under everything, of the floor's colour in pictures; wide: half of its side, in sizes of all that there is."""
    rig, floor = rig_of(view.light, axes_of(camera)), view.drawn_floor
    color = rig.floor if isinstance(floor, str) else floor
    low, high = bounds(meshes)
    (a, _, c), r = (low + high) / 2, wide * float(np.linalg.norm(high - low))
    x = np.array([[a - r, height, c + r], [a + r, height, c + r], [a + r, height, c - r], [a - r, height, c - r]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    return Mesh("ground", "solid", np.array(color), [Surface(faces, None, faces)], [x.astype(np.float32)], [])
