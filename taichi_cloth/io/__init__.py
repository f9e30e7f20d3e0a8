"""Reading meshes: a reader a format; sizes that a file claims are held against its own before anything is made of them."""

from pathlib import Path

import numpy as np

from .. import checks
from ..errors import MeshError, near
from ..scene.mesh import TriMesh
from .obj import read_obj
from .off import read_off
from .pattern import fit_pattern
from .ply import read_ply
from .stl import read_stl
from .vtk import read_vtk

OTHER = {".ply": read_ply, ".stl": read_stl, ".vtk": read_vtk, ".vtu": read_vtk, ".off": read_off}


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
    path = checks.path("path", path, MeshError)
    checks.choice("uv", uv, ("auto", "pattern", "flatten"))
    scale = checks.number("scale", scale, positive=True)
    try:
        x, faces, corner_uv, groups = read_surface(path)
        notes: tuple[str, ...] = ()
        TriMesh(x, faces)  # positions and topology are checked first: the pattern is measured on them
        if uv == "flatten" or corner_uv is None:
            material = None
        elif uv == "pattern":
            material = corner_uv * scale
        else:
            checks.array("texture coordinates", corner_uv, (len(faces), 3, 2), row="face", error=MeshError)
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
        raise MeshError(f"no such mesh file: {path}{near(path)}")
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return read_obj(path)
    if suffix not in OTHER:
        raise MeshError(f"{path}: unknown mesh format {suffix!r}; known: .obj, {', '.join(OTHER)}")
    try:
        return *OTHER[suffix](path), None, {}
    except (OSError, ValueError, OverflowError) as error:
        raise MeshError(f"{path}: cannot be read: {error}") from None
