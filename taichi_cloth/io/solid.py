"""Solids from files: one mesh, or a sequence of positions with one topology."""

import math
import struct
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import checks
from ..errors import MeshError, SceneError, near
from ..scene.solids import SolidMesh
from . import UP, npz, read_surface, sequence, upright


class _Read(NamedTuple):
    """A solid as its file has it.

    Attributes:
        x: (n, 3) or (frames, n, 3), in the file's units; faces: (m, 3); groups: of vertices by name.
        fps: frames a second that the file names, or None.
        first: the number of its first frame; every: how many frames are from one to the next.
    """

    x: np.ndarray
    faces: np.ndarray
    groups: dict[str, np.ndarray]
    fps: float | None = None
    first: float = 0.0
    every: float = 1.0


def load_solid(path: str | Path, scale: float = 1.0, fps: float | None = None, mesh: str | Path | None = None,
               up: str = "y", start: float | None = None) -> SolidMesh:
    """A solid from a file or a sequence.

    Args:
        path: a mesh file; a pattern such as "body_*.obj" whose files, in the order of the numbers in their names, are the
            frames; an .npz with `positions` ((n, 3) or (frames, n, 3)), `faces` (m, 3), perhaps `fps`, and vertices
            `group_NAME`; or a .pc2 point cache, whose triangles are those of `mesh`.
        scale: metres per unit of the file.
        fps: frames a second of a sequence; the file's own where None. A point cache may have a position every few frames.
        up: the file's axis that points up, "y" or "z": of the latter (x, y, z) is (x, z, -y) here.
        start: time [s] of a sequence's first frame; where None that of the frame at which a point cache says it starts, 0 of
            other files.

    Raises:
        MeshError: a missing or unreadable file, or frames whose topology is not the first one's.
        SceneError: numbers that make no solid.
    """
    scale, up = checks.number("scale", scale, positive=True), checks.choice("up", up, UP)
    fps = checks.maybe(fps, checks.number, "fps", positive=True)
    start = checks.maybe(start, checks.number, "start", "s")
    path = str(checks.path("path", path, MeshError))
    read = _read(path, checks.maybe(mesh, checks.path, "mesh", MeshError))
    fps = read.fps if fps is None else fps
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise SceneError(f"{path}: fps = {fps!r}: must be positive")
    if start is None:
        start = read.first / fps if fps is not None else 0.0
    try:
        with np.errstate(over="ignore"):  # what is not finite then is named
            return SolidMesh(upright(read.x, up) * scale, read.faces, None if fps is None else fps / read.every, read.groups,
                             start)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _read(path: str, mesh: Path | None) -> _Read:
    suffix = Path(path).suffix.lower()
    if not Path(path).is_file():
        if not any(c in path for c in "*?["):
            raise MeshError(f"no such file: {path}{near(path)}")
        return _frames(path)
    if suffix == ".npz":
        return _npz(path)
    if suffix != ".pc2":
        x, faces, _, groups = read_surface(Path(path))
        return _Read(x, faces, groups)
    if mesh is None:
        raise MeshError(f"{path}: a point cache has no triangles: name the file that has them, mesh=...")
    surface = read_surface(mesh)
    x, first, every = _pc2(Path(path))
    _refuse_other(path, x.shape[1], str(mesh), len(surface[0]))
    return _Read(x, surface[1], surface[3], None, first, every)


def _frames(pattern: str) -> _Read:
    files = sequence.frames(pattern)
    said = sequence.missing(files)
    if said:
        warnings.warn(said, stacklevel=4)  # with the line that asks for the solid
    frames: list[np.ndarray] = []
    rest, first, _, groups = read_surface(Path(files[0]))
    for name in files:
        x, faces = read_surface(Path(name))[:2]
        _refuse_other(name, len(x), files[0], len(rest))
        if faces.shape != first.shape or (faces != first).any():
            raise MeshError(f"{name}: its topology is not that of {files[0]}: a sequence keeps its vertices and faces")
        frames.append(x)
    return _Read(np.stack(frames), first, groups)


def _refuse_other(name: str, count: int, first: str, wanted: int) -> None:
    """Refuses frames of another mesh."""
    if count != wanted:
        raise MeshError(f"{name}: has {count:,} vertices, and {first} {wanted:,}: frames are of one mesh")


def _npz(path: str) -> _Read:
    try:
        arrays = npz.read(path)
    except npz.DamagedError as error:
        raise MeshError(f"{path}: cannot be read: {error}") from None
    for name in ("positions", "faces"):
        if name not in arrays:
            raise MeshError(f"{path}: has no array {name!r}; it needs positions and faces")
        if arrays[name].dtype.kind not in ("iuf" if name == "positions" else "iu"):
            raise MeshError(f"{path}: {name} are of type {arrays[name].dtype}, not {'whole ' * (name == 'faces')}numbers")
    fps = None
    if "fps" in arrays:
        if arrays["fps"].size != 1 or arrays["fps"].dtype.kind not in "iuf":
            raise MeshError(f"{path}: fps must be one number")
        fps = float(arrays["fps"].ravel()[0])
    groups = {name[6:]: index for name, index in arrays.items() if name.startswith("group_")}
    return _Read(arrays["positions"].astype(np.float64), arrays["faces"], groups, fps)


def _pc2(path: Path) -> tuple[np.ndarray, float, float]:
    """(positions (frames, n, 3), number of the first frame, frames from one to the next) of a PC2 point cache: a header of 32
    bytes, then float32 triples."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) < 32 or data[:12] != b"POINTCACHE2\0":
        raise MeshError(f"{path}: is no PC2 point cache")
    count, first, every, frames = struct.unpack("<iffi", data[16:32])
    if min(count, frames) < 1 or len(data) != 32 + 12 * count * frames:
        raise MeshError(f"{path}: is {len(data)} bytes long, its header says {frames} frames of {count} points")
    if not (math.isfinite(first) and 0 < every < math.inf):
        raise MeshError(f"{path}: its header says that it starts at frame {first:g} and has one every {every:g} frames")
    return np.frombuffer(data, dtype="<f4", offset=32).reshape(frames, count, 3).astype(np.float64), first, every
