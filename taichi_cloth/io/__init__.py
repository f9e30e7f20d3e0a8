"""Reading meshes: a reader a format; sizes that a file claims are held against its own before anything is made of them."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import checks
from ..errors import MeshError, near, warn
from ..scene.mesh import TriMesh
from ..scene.ownshape import twice_area
from . import blendfile
from .animation import READERS
from .animation import read as read_motion
from .animation.motion import Wanted, wanted
from .animation.surface import joined
from .floor import floor_note
from .obj import read_obj
from .off import read_off
from .pattern import fit_pattern, unlike
from .ply import read_ply
from .stl import read_stl
from .vtk import read_vtk

UP = ("y", "z")
OTHER = {".ply": read_ply, ".stl": read_stl, ".vtk": read_vtk, ".vtu": read_vtk, ".off": read_off}
KNOWN = (".obj", *OTHER, *READERS)
SEQUENCES = (".npz", ".pc2", ".mdd")  # of solids alone


class Surface(NamedTuple):
    """Content of a mesh file, in its own units.

    Attributes:
        x: (n, 3) positions; faces: (m, 3).
        corner_uv: (m, 3, 2) texture coordinates, or None if some face has none.
        groups: vertices by the names of groups.
        notes: omissions.
        unit: metres of the file's unit, 1 if it names none; up: the axis that points up, "y" where it names none.
        polygon: (m,) the polygon that each triangle was cut from, or None if that is not known.
        weights: of vertices of groups that have any below 1.
    """

    x: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray | None
    groups: dict[str, np.ndarray]
    notes: tuple[str, ...]
    unit: float = 1.0
    up: str = "y"
    polygon: np.ndarray | None = None
    weights: dict[str, np.ndarray] = {}


def load(path: str | Path, scale: float = 1.0, uv: str = "auto", up: str | None = None,
         groups: str = "touched", only: str | Sequence[str] | None = None) -> TriMesh:
    """A mesh from a file.

    Args:
        path: .obj (v, vt, f, g, o, usemtl; polygons, negative indices, seams), .ply, .stl, .vtk, .vtu, .off. From .glb, .gltf
            (extra `gltf`), .usd, .usda, .usdc, .usdz (extra `usd`), .fbx and .abc (extra `blender`): the meshes as they stand
            before any animation. From .blend (extra `blender`): one object with its own order of vertices, as shape keys and
            a rig have it at the scene's first frame.
        scale: metres per unit of the file; of a file that names its unit, a factor besides.
        uv: "auto" takes the file's texture coordinates as the pattern if they have the mesh's lengths to 3 %, in the file's
            unit, metres, centimetres or millimetres, or all scaled alike. Else the mesh's own shape is the rest shape, and
            they stay as `TriMesh.texture`, for images and exports. "pattern" takes them as the pattern as they are (times
            `scale`); "flatten" takes the mesh's own shape.
        up: the file's axis that points up, "y" or "z": of the latter (x, y, z) is (x, z, -y) here. None takes the one that
            the file names, or y.
        groups: a file has groups of faces. "touched" takes all vertices of a group's faces; "inside" only the vertices whose
            faces are all in it. The latter gives a group of vertices back that a program wrote as the faces it touches.
        only: names of the parts that are read, of a file with a scene; all if None.

    Returns:
        The mesh, with groups of the file and notes on the use of its texture coordinates. Meshes of .obj and
        .blend know the polygons that triangles were cut from; those of .blend the weights in vertex groups.

    Raises:
        MeshError: a missing or unreadable file, or a mesh that cannot be simulated.
    """
    path = checks.path("path", path, MeshError)
    checks.choice("uv", uv, ("auto", "pattern", "flatten"))
    checks.choice("groups", groups, ("touched", "inside"))
    scale, up = checks.number("scale", scale, positive=True), checks.maybe(up, checks.choice, "up", UP)
    try:
        surface = read(path, groups == "inside", wanted(None, None, only)._replace(moves=False))
        return _mesh(surface._replace(x=upright(surface.x, up or surface.up)), scale * surface.unit, uv)
    except MeshError as error:
        message = str(error)
        raise MeshError(message if str(path) in message else f"{path}: {message}") from None


def upright(x: np.ndarray, up: str) -> np.ndarray:
    """Positions (..., 3) of a file whose axis `up` points up, turned so that y does."""
    return x if up == "y" else np.stack([x[..., 0], x[..., 2], -x[..., 1]], axis=-1)


def _mesh(surface: Surface, scale: float, uv: str) -> TriMesh:
    """A mesh with a rest shape and, where the texture coordinates are not that, with these besides."""
    x = checks.array("positions", surface.x, ("n", 3), row="vertex", error=MeshError) * scale
    faces, corner_uv, groups, notes = surface[1:5]
    more = surface.polygon, surface.weights
    if corner_uv is not None and uv != "pattern":
        checks.array("texture coordinates", corner_uv, (len(faces), 3, 2), row="face", error=MeshError)
        if not twice_area(corner_uv).any():
            corner_uv, notes = None, (*notes, "the file's texture coordinates have no area and are ignored")
    if corner_uv is None or uv == "flatten":
        return TriMesh(x, faces, None, groups, notes, corner_uv, *more)
    if uv == "pattern":
        note = unlike(x, faces, corner_uv * scale)
        return TriMesh(x, faces, corner_uv * scale, groups, (*notes, note) if note else notes, None, *more)
    material, apart, note = fit_pattern(x, faces, corner_uv, scale)
    return TriMesh(x, faces, material, groups, (*notes, note) if note else notes, corner_uv if apart else None, *more)


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, np.ndarray]]:
    """Positions, triangles, texture corners or None, and groups of a mesh file, as they are; warns of omissions.

    Raises:
        MeshError: a missing, unknown or unreadable file.
    """
    surface = read(path)
    for note in surface.notes:
        warn(f"{path}: {note}")
    return surface[:4]


def read(path: Path, inside: bool = False, choice: Wanted | None = None) -> Surface:
    """A mesh file, without faces that name a vertex twice.

    Args:
        inside: whether groups are without vertices that other faces have too.
        choice: of a file with a scene, the parts that are read; all if None.

    Raises:
        MeshError: a missing, unknown or unreadable file.
    """
    refuse_absent(path)
    if path.suffix.lower() == ".blend":
        return _object(path, inside, None if choice is None else choice.only)
    if path.suffix.lower() in READERS:
        return _still(path, inside, choice or Wanted(moves=False))
    if choice is not None and choice.only is not None:
        raise MeshError(f"{path}: only: a {path.suffix} has no parts to choose from; those that have: {', '.join(READERS)}")
    x, faces, corner_uv, parts, polygon = _triangles(path)
    whole = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise MeshError(f"{path}: the mesh has no faces{' with three vertices' if len(whole) else ''}")
    groups = {name: _vertices(faces, rows[whole[rows]], whole, inside) for name, rows in parts.items()}
    groups = {name: index for name, index in groups.items() if len(index)}
    if whole.all():
        return Surface(x, faces, corner_uv, groups, (), polygon=polygon)
    note = f"triangles that name a vertex twice were left out: {int((~whole).sum())}, the first is {int(np.argmin(whole))}"
    return Surface(x, faces[whole], None if corner_uv is None else corner_uv[whole], groups, (note,),
                   polygon=None if polygon is None else polygon[whole])


def _object(path: Path, inside: bool, only: Sequence[str] | None) -> Surface:
    """An object of a .blend; groups are its vertex groups and its materials."""
    item, unit = blendfile.whole(path, only)
    places, polygon = blendfile.triangles(item)
    faces, every = item.corners[places], np.ones(len(places), dtype=bool)
    groups = {name: _vertices(faces, np.flatnonzero(item.material[polygon] == k), every, inside)
              for k, name in enumerate(item.materials) if name}
    groups |= {name: index for name, (index, _) in item.groups.items()}
    weights = {name: weight for name, (_, weight) in item.groups.items() if (weight < 1).any()}
    uv = None if item.uv is None else item.uv[places].astype(np.float64)
    groups = {name: index for name, index in groups.items() if len(index)}
    return Surface(blendfile.placed(item), faces, uv, groups, (), unit, "z", polygon, weights)


def _still(path: Path, inside: bool, choice: Wanted) -> Surface:
    """The meshes of a file with a scene, before any animation; parts stay apart."""
    motion = read_motion(path, choice)
    made = joined(motion, merge=False, weld=None)
    whole = np.ones(len(made.faces), dtype=bool)
    groups = {name: _vertices(made.faces, rows, whole, inside) for name, rows in made.groups.items()}
    groups = {name: index for name, index in groups.items() if len(index)}
    floor = floor_note(upright(made.x[:1], motion.up), groups, [part.name for part in motion.parts])
    return Surface(made.x[0], made.faces, made.corner_uv, groups, (*motion.notes, *made.notes, *floor), motion.unit, motion.up)


def _vertices(faces: np.ndarray, rows: np.ndarray, whole: np.ndarray, inside: bool) -> np.ndarray:
    """Vertices of a group of triangles; inside: without those of others."""
    mine = np.unique(faces[rows])
    if not inside:
        return mine
    others = whole.copy()
    others[rows] = False
    return np.setdiff1d(mine, faces[others])


def refuse_absent(path: Path, also: Sequence[str] = ()) -> None:
    """Refuses a path without a file, or of no known format; `also` known are others.

    Raises:
        MeshError: with the known formats.
    """
    if path.is_dir():
        raise MeshError(f"{path} is a folder: name the mesh's file in it")
    if not path.is_file():
        raise MeshError(f"no such mesh file: {path}{near(path)}")
    suffix = path.suffix.lower()
    if suffix not in (*KNOWN, *also):
        hint = f" ({suffix} is read by tc.load_solid)" if suffix in SEQUENCES else ""
        raise MeshError(f"{path}: unknown mesh format {suffix!r}{hint}; known: {', '.join((*KNOWN, *also))}")


def _triangles(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, np.ndarray], np.ndarray | None]:
    """Positions, triangles, texture corners or None, rows of triangles by the names of groups, and their polygons or None."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return read_obj(path)
    try:
        return *OTHER[suffix](path), None, {}, None
    except (OSError, ValueError, OverflowError) as error:
        raise MeshError(f"{path}: cannot be read: {error}") from None
