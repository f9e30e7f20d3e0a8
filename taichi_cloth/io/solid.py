"""Solids from files: one mesh, or a sequence of positions with one topology."""

import glob
import math
import struct
from pathlib import Path

import numpy as np

from .. import checks
from ..errors import MeshError, SceneError, near
from ..scene.solids import SolidMesh
from . import npz, read_surface


def load_solid(path: str | Path, scale: float = 1.0, fps: float | None = None, mesh: str | Path | None = None) -> SolidMesh:
    """A solid from a file or a sequence.

    Args:
        path: a mesh file; a pattern such as "body_*.obj" whose files, in the order of their names, are the frames;
            an .npz with `positions` ((n, 3) or (frames, n, 3)), `faces` (m, 3), perhaps `fps`, and vertices
            `group_NAME`; or a .pc2 point cache, whose triangles are those of `mesh`.
        scale: metres per unit of the file.
        fps: frames a second of a sequence; the file's own where None.

    Raises:
        MeshError: a missing or unreadable file, or frames whose topology is not the first one's.
        SceneError: numbers that make no solid.
    """
    scale = checks.number("scale", scale, positive=True)
    fps = checks.maybe(fps, checks.number, "fps", positive=True)
    mesh = checks.maybe(mesh, checks.path, "mesh", MeshError)
    path = str(checks.path("path", path, MeshError))
    suffix = Path(path).suffix.lower()
    if not Path(path).is_file():
        if not any(c in path for c in "*?["):
            raise MeshError(f"no such file: {path}{near(path)}")
        x, faces, groups = _frames(path)
    elif suffix == ".npz":
        x, faces, fps, groups = _npz(path, fps)
    elif suffix == ".pc2":
        if mesh is None:
            raise MeshError(f"{path}: a point cache has no triangles: name the file that has them, mesh=...")
        surface = read_surface(Path(mesh))
        x, faces, groups = _pc2(Path(path)), surface[1], surface[3]
        _refuse_other(path, x.shape[1], str(mesh), len(surface[0]))
    else:
        x, faces, _, groups = read_surface(Path(path))
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise SceneError(f"{path}: fps = {fps!r}: must be positive")
    try:
        with np.errstate(over="ignore"):  # what is not finite then is named
            return SolidMesh(x * scale, faces, fps, groups)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def _frames(pattern: str) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    files = sorted(glob.glob(pattern))
    if not files:
        raise MeshError(f"no file matches {pattern}")
    frames: list[np.ndarray] = []
    rest, first, _, groups = read_surface(Path(files[0]))
    for name in files:
        x, faces = read_surface(Path(name))[:2]
        _refuse_other(name, len(x), files[0], len(rest))
        if faces.shape != first.shape or (faces != first).any():
            raise MeshError(f"{name}: its topology is not that of {files[0]}: a sequence keeps its vertices and faces")
        frames.append(x)
    return np.stack(frames), first, groups


def _refuse_other(name: str, count: int, first: str, wanted: int) -> None:
    """Refuses frames of another mesh."""
    if count != wanted:
        raise MeshError(f"{name}: has {count:,} vertices, and {first} {wanted:,}: frames are of one mesh")


def _npz(path: str, fps: float | None) -> tuple[np.ndarray, np.ndarray, float | None, dict[str, np.ndarray]]:
    try:
        arrays = npz.read(path)
    except npz.DamagedError as error:
        raise MeshError(f"{path}: cannot be read: {error}") from None
    for name in ("positions", "faces"):
        if name not in arrays:
            raise MeshError(f"{path}: has no array {name!r}; it needs positions and faces")
        if arrays[name].dtype.kind not in ("iuf" if name == "positions" else "iu"):
            raise MeshError(f"{path}: {name} are of type {arrays[name].dtype}, not {'whole ' * (name == 'faces')}numbers")
    if fps is None and "fps" in arrays:
        if arrays["fps"].size != 1 or arrays["fps"].dtype.kind not in "iuf":
            raise MeshError(f"{path}: fps must be one number")
        fps = float(arrays["fps"].ravel()[0])
    groups = {name[6:]: index for name, index in arrays.items() if name.startswith("group_")}
    return arrays["positions"].astype(np.float64), arrays["faces"], fps, groups


def _pc2(path: Path) -> np.ndarray:
    """Frames of a PC2 point cache: a header of 32 bytes, then float32 triples."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    if len(data) < 32 or data[:12] != b"POINTCACHE2\0":
        raise MeshError(f"{path}: is no PC2 point cache")
    count, frames = struct.unpack("<i", data[16:20])[0], struct.unpack("<i", data[28:32])[0]
    if min(count, frames) < 1 or len(data) != 32 + 12 * count * frames:
        raise MeshError(f"{path}: is {len(data)} bytes long, its header says {frames} frames of {count} points")
    return np.frombuffer(data, dtype="<f4", offset=32).reshape(frames, count, 3).astype(np.float64)
