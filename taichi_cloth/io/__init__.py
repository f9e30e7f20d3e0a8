"""Reading meshes: a reader of our own for OBJ, meshio for the rest."""

from pathlib import Path

import numpy as np

from ..errors import MeshError, SceneError, check_choice
from ..mesh import TriMesh
from .obj import read_obj
from .pattern import fit_pattern

OTHER = (".ply", ".stl", ".vtk", ".vtu", ".off")


def load(path: str | Path, scale: float = 1.0, uv: str = "auto") -> TriMesh:
    """A mesh from a file.

    Args:
        path: .obj (v, vt, f, g, o; polygons, negative indices, seams) or .ply, .stl, .vtk, .vtu, .off.
        scale: metres per unit of the file.
        uv: "auto" takes the file's texture coordinates as the pattern where they are one in metres, scales them
            to the mesh's area where they are not, and flattens each triangle where there are none; "pattern"
            takes them as they are (times `scale`); "flatten" ignores them.

    Returns:
        The mesh, with groups of the file and notes that say what was done with its texture coordinates.

    Raises:
        MeshError: a missing or unreadable file, or a mesh that cannot be simulated.
    """
    path = Path(path)
    check_choice("uv", uv, ("auto", "pattern", "flatten"))
    if not (np.isfinite(scale) and scale > 0):
        raise SceneError(f"scale = {scale!r}: must be positive")
    try:
        x, faces, corner_uv, groups = read_surface(path)
        notes: tuple[str, ...] = ()
        TriMesh(x, faces)  # positions and topology are checked first: the pattern is measured on them
        if uv == "flatten" or corner_uv is None:
            material = None
        elif uv == "pattern":
            material = corner_uv * scale
        else:
            material, note = fit_pattern(x * scale, faces, corner_uv, scale)
            notes = (note,) if note else ()
        return TriMesh(x * scale, faces, material, groups, notes)
    except MeshError as error:
        message = str(error)
        raise MeshError(message if str(path) in message else f"{path}: {message}") from None


def read_surface(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, np.ndarray]]:
    """Positions, triangles, texture corners or None, and groups of a mesh file, as they are.

    Raises:
        MeshError: a missing, unknown or unreadable file.
    """
    if not path.is_file():
        raise MeshError(f"no such mesh file: {path}")
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return read_obj(path)
    if suffix in OTHER:
        return *_read_other(path), None, {}
    raise MeshError(f"{path}: unknown mesh format {suffix!r}; known: .obj, {', '.join(OTHER)}")


def _read_other(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import meshio

    try:
        mesh = meshio.read(path)
    except SystemExit:  # meshio's way of saying that it cannot read a file
        raise MeshError(f"{path}: cannot be read") from None
    except Exception as error:
        raise MeshError(f"{path}: cannot be read: {type(error).__name__}: {error}") from None
    faces = [np.asarray(c.data) for c in mesh.cells if c.type == "triangle"]
    for quads in (np.asarray(c.data) for c in mesh.cells if c.type == "quad"):
        faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    if not faces:
        raise MeshError(f"{path}: the mesh has no faces")
    x = np.asarray(mesh.points, dtype=np.float64)
    if x.shape[1] == 2:
        x = np.column_stack([x, np.zeros(len(x))])
    x, faces_all = _weld(x, np.concatenate(faces)) if path.suffix.lower() == ".stl" else (x, np.concatenate(faces))
    return x, faces_all


def _weld(x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """STL has three vertices of its own for every triangle: equal ones become one."""
    unique, inverse = np.unique(x, axis=0, return_inverse=True)
    return unique, inverse.reshape(-1)[faces]
