"""Solids from files: one mesh, a sequence of positions with one topology, or the parts of a scene as they move."""

import functools
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import checks
from ..errors import MeshError, SceneError, near, warn
from ..scene.solids import SolidMesh
from . import SEQUENCES, UP, npz, pointcache, read_surface, refuse_absent, sequence, upright
from .animation import READERS
from .animation import read as read_motion
from .animation.motion import Motion, Wanted, wanted
from .animation.surface import joined, mended, same_places
from .floor import floor_note

NAMED = 4  # clips that a sentence names
WHOLE = (".glb", ".fbx", ".usdz")  # files that need no others


class Loaded(NamedTuple):
    """A solid as its file has it.

    Attributes:
        x: (n, 3) or (frames, n, 3), in the file's units; faces: (m, 3); groups: of vertices by name.
        fps: frames a second that the file names, or None.
        first: the number of its first frame; every: how many frames are from one to the next.
        notes: sentences on the file; motion: its content, of a file with a scene.
    """

    x: np.ndarray
    faces: np.ndarray
    groups: dict[str, np.ndarray]
    fps: float | None = None
    first: float = 0.0
    every: float = 1.0
    notes: tuple[str, ...] = ()
    motion: Motion | None = None


def load_solid(path: str | Path, scale: float = 1.0, fps: float | None = None, mesh: str | Path | None = None,
               up: str | None = None, start: float | None = None, *, clip: str | int | Sequence[str | int] | None = None,
               merge: bool = True, only: str | Sequence[str] | None = None, weld: float | None = None,
               rest: float | None = None) -> SolidMesh:
    """A solid from a file or a sequence.

    Args:
        path: a mesh file, or one of these. A pattern such as "body_*.obj": its files, in the order of the numbers in their
            names, are the frames. An .npz with `positions` or `vertices` ((n, 3) or (frames, n, 3)), `faces` (m, 3), perhaps
            `fps`, and vertices `group_NAME`. A .pc2 or .mdd point cache, whose triangles are those of `mesh`. A file with a
            scene, whose skins, morph targets, transforms, instances and caches move its parts: .glb, .gltf (extra `gltf`),
            .usd, .usda, .usdc, .usdz (extra `usd`), .fbx, .abc (extra `blender`, or Blender on the PATH).
        scale: metres per unit of the file; of a file that names its unit, a factor besides.
        fps: frames a second of a sequence; None takes the file's own. A point cache may have a position every few frames. A
            scene is sampled at so many. None takes its own number; for glTF that of its keys or a multiple, 24 or more.
        up: the file's axis that points up, "y" or "z": of the latter (x, y, z) is (x, z, -y) here. None takes the one that
            the file names, or y.
        start: time [s] of a sequence's first frame; None takes the frame at which a cache says it starts, 0 for other
            files.
        clip: the animation of a scene that has several, by name or number, or a list of some that play together. None
            takes the first, with others that move nothing that it moves.
        merge: whether parts of a scene become one surface where their vertices lie at one place in every frame; else they
            stay apart. Either way each is a group by its name, and so is each material.
        only: names of the parts of a scene that are read; all if None.
        weld: distance [m] up to which vertices that stay together are made one; 0 for none. None makes
            one, in a scene, of those apart by a rounding, as at seams of its texture; in other files of none.
        rest: seconds, 60 at most, in which a character's joints go from the rest pose of its skeleton, that of its bind
            matrices, to the first frame of its clip, which begins then; arms are away from the trunk there, so that clothes
            go on. The topmost joint is where the first frame has it.

    Raises:
        MeshError: a missing or unreadable file, frames whose topology is not the first one's, or a choice that a file has not.
        SceneError: numbers that make no solid.
    """
    choice = wanted(clip, fps, only, rest)
    return loaded(path, scale, mesh, up, start, choice, checks.flag("merge", merge), weld)[0]


def loaded(path: str | Path, scale: float, mesh: str | Path | None, up: str | None, start: float | None, choice: Wanted,
           merge: bool, weld: float | None) -> tuple[SolidMesh, Loaded]:
    """The solid of `load_solid`, and the content of its file."""
    scale, up = checks.number("scale", scale, positive=True), checks.maybe(up, checks.choice, "up", UP)
    start = checks.maybe(start, checks.number, "start", "s")
    weld = checks.maybe(weld, checks.number, "weld", "m", least=0.0)
    path, mesh = str(checks.path("path", path, MeshError)), checks.maybe(mesh, checks.path, "mesh", MeshError)
    suffix = Path(path).suffix.lower()
    if suffix in READERS and (Path(path).is_file() or not _is_pattern(path)):
        read, unit, own_up = _scene(Path(path), choice, merge, weld, scale)
        fps = read.fps
    else:
        for name, given, none in (("clip", choice.clip, "animations to choose from"), ("only", choice.only, "parts to choose "
                                  "from"), ("rest", choice.rest, "skeleton")):
            if given is not None:
                raise MeshError(f"{path}: {name}: has no {none}; files that have: {', '.join(READERS)}")
        read, unit, own_up = _welded(_read(path, None if mesh is None else Path(mesh)), weld, scale), 1.0, "y"
        fps = read.fps if choice.fps is None else choice.fps
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise SceneError(f"{path}: fps = {fps!r}: must be positive")
    if start is None:
        start = read.first / fps if fps is not None else 0.0
    try:
        with np.errstate(over="ignore"):  # values that are not finite are named then
            x = upright(read.x, up or own_up)
            made = SolidMesh(x if scale * unit == 1 else x * (scale * unit), read.faces,
                             None if fps is None else fps / read.every, read.groups, start)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    floor = floor_note(made.x, made.groups, [part.name for part in read.motion.parts]) if read.motion else ()
    object.__setattr__(made, "notes", (*read.notes, *floor, *made.notes))
    return made, read


def _scene(path: Path, choice: Wanted, merge: bool, weld: float | None, scale: float) -> tuple[Loaded, float, str]:
    """A file with a scene, metres of its unit, and its axis that points up. The last file stays in memory, if all of it is
    in one: a take that blends options in, or a page with sliders, builds its scene many times."""
    if not path.is_file():
        raise MeshError(f"no such file: {path}{near(path)}")
    if path.suffix.lower() not in WHOLE:
        return _scene_of(path, choice, merge, weld, scale)
    about = path.stat()
    return _last_scene(path.resolve(), about.st_mtime_ns, about.st_size, path, choice, merge, weld, scale)


@functools.lru_cache(maxsize=1)
def _last_scene(file: Path, changed: int, size: int, path: Path, choice: Wanted, merge: bool, weld: float | None,
                scale: float) -> tuple[Loaded, float, str]:
    """`_scene_of`, of a file as it is."""
    return _scene_of(path, choice, merge, weld, scale)


def _scene_of(path: Path, choice: Wanted, merge: bool, weld: float | None, scale: float) -> tuple[Loaded, float, str]:
    motion = read_motion(path, choice)
    try:
        made = joined(motion, merge, None if weld is None else weld / (scale * motion.unit))
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    groups = {name: np.unique(made.faces[rows]) for name, rows in made.groups.items() if len(rows)}
    notes = (_found(motion, made.x, scale), *motion.notes, *_transformed(motion), *made.notes)
    motion = motion._replace(parts=[part._replace(x=part.x[:1].copy()) for part in motion.parts])  # long clips are large
    return Loaded(made.x, made.faces, groups, motion.fps, notes=notes, motion=motion), motion.unit, motion.up


def _found(motion: Motion, x: np.ndarray, scale: float) -> str:
    """A sentence on the content of a file with a scene."""
    size = np.ptp(x[0], axis=0) * motion.unit * scale
    height = size[UP.index(motion.up) + 1]
    others = [clip.name for k, clip in enumerate(motion.clips) if k not in motion.taken]
    clip = f"clip {_some(motion.clips[k].name for k in motion.taken)}, " if motion.taken else ""
    moves = f"{clip}{len(x):,} frames at {motion.fps:g} a second" if motion.fps and len(x) > 1 else f"{clip}no animation"
    parts = f"{len(motion.parts)} parts" if len(motion.parts) > 1 else f"one part, {motion.parts[0].name!r}"
    more = f"; other clips (clip=...): {_some(others)}" if others else ""
    return f"{parts}; {moves}; {height:.3g} m high, {size.max():.3g} m at most{more}"


def _transformed(motion: Motion) -> list[str]:
    """Sentences on transforms that change more than place and size."""
    mirrored, sheared = ([part.name for part in motion.parts if getattr(part, how)] for how in ("mirrored", "sheared"))
    return ([f"mirrored by its transform: {_some(mirrored)}; triangles are turned there, so that the outside stays "
             "outside"] if mirrored else []) + ([f"sheared by its transform: {_some(sheared)}; positions are those of the "
                                                 "file"] if sheared else [])


def _some(names: Iterable[str]) -> str:
    """Names in a sentence, the first of them where there are many: some programs write a clip for each joint."""
    told = [repr(name) for name in names]
    if len(told) > NAMED + 1:
        told = [*told[:NAMED], f"{len(told) - NAMED} more"]
    return " and ".join([", ".join(told[:-1]), told[-1]]) if len(told) > 1 else told[0]


def _welded(read: Loaded, weld: float | None, scale: float) -> Loaded:
    """The same with vertices made one that are up to so far [m] from each other in every frame."""
    if not weld:
        return read
    x = read.x[None] if read.x.ndim == 2 else read.x
    one = same_places(x, np.zeros(x.shape[1], dtype=np.int64), weld / scale)
    faces, _, notes = mended(read.faces, one, weld)
    used, faces = np.unique(faces, return_inverse=True)
    n = x.shape[1]
    groups = {name: np.flatnonzero(np.isin(used % n, one[index])) for name, index in read.groups.items()}
    return read._replace(x=x[:, used % n], faces=faces.reshape(-1, 3), groups=groups, notes=notes)


def _is_pattern(path: str) -> bool:
    """Whether a path may be one of several files."""
    return any(c in path for c in "*?[")


def _read(path: str, mesh: Path | None) -> Loaded:
    suffix = Path(path).suffix.lower()
    if not Path(path).is_file():
        if not _is_pattern(path):
            raise MeshError(f"no such file: {path}{near(path)}")
        return _frames(path)
    refuse_absent(Path(path), SEQUENCES)
    if suffix == ".npz":
        return _npz(path)
    if suffix not in pointcache.SUFFIXES:
        x, faces, _, groups = read_surface(Path(path))
        return Loaded(x, faces, groups)
    if mesh is None:
        raise MeshError(f"{path}: a point cache has no triangles: name the file that has them, mesh=...")
    surface, cache = read_surface(mesh), pointcache.read(Path(path))
    _refuse_other(path, cache.x.shape[1], str(mesh), len(surface[0]))
    return Loaded(cache.x, surface[1], surface[3], cache.fps, cache.first, cache.every)


def _frames(pattern: str) -> Loaded:
    files = sequence.frames(pattern)
    said = sequence.missing(files)
    if said:
        warn(said)
    frames: list[np.ndarray] = []
    rest, first, _, groups = read_surface(Path(files[0]))
    for name in files:
        x, faces = read_surface(Path(name))[:2]
        _refuse_other(name, len(x), files[0], len(rest))
        if faces.shape != first.shape or (faces != first).any():
            raise MeshError(f"{name}: its topology is not that of {files[0]}: a sequence keeps its vertices and faces")
        frames.append(x)
    return Loaded(np.stack(frames), first, groups)


def _refuse_other(name: str, count: int, first: str, wanted: int) -> None:
    """Refuses frames of another mesh."""
    if count != wanted:
        raise MeshError(f"{name}: has {count:,} vertices, and {first} {wanted:,}: frames are of one mesh")


def _npz(path: str) -> Loaded:
    try:
        arrays = npz.read(path)
    except npz.DamagedError as error:
        raise MeshError(f"{path}: cannot be read: {error}") from None
    if "vertices" in arrays:  # as exports of body models name them
        arrays.setdefault("positions", arrays["vertices"])
    for name in ("positions", "faces"):
        if name not in arrays:
            body = "; poses and shapes of a body model need the model that makes vertices of them" if "poses" in arrays else ""
            raise MeshError(f"{path}: has no array {name!r}; it needs positions (or vertices) and faces{body}")
        if arrays[name].dtype.kind not in ("iuf" if name == "positions" else "iu"):
            raise MeshError(f"{path}: {name} are of type {arrays[name].dtype}, not {'whole ' * (name == 'faces')}numbers")
    fps = None
    if "fps" in arrays:
        if arrays["fps"].size != 1 or arrays["fps"].dtype.kind not in "iuf":
            raise MeshError(f"{path}: fps must be one number")
        fps = float(arrays["fps"].ravel()[0])
    groups = {name[6:]: index for name, index in arrays.items() if name.startswith("group_")}
    return Loaded(arrays["positions"].astype(np.float64), arrays["faces"], groups, fps)
