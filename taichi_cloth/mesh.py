"""A triangle mesh as a value: positions, triangles, material coordinates, named groups of vertices.

numpy only. Everything that is wrong with a mesh is said here, before anything is computed.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from .errors import MeshError, did_you_mean

# A triangle whose height is less than this part of its longest edge, in the material plane, has no area.
FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class TriMesh:
    """A triangle mesh in its material plane and in space.

    Args:
        x: (n, 3) positions [m]; the given shape, from which rest angles can be taken.
        faces: (m, 3) vertex indices.
        uv: material coordinates [m], (n, 2) per vertex or, where a seam cuts the pattern, (m, 3, 2) per
            corner; None flattens each triangle into a frame of its own, so that the given shape is at rest.
        groups: named vertex groups, name -> indices.
        notes: what a reader did to the data, one sentence each; a run repeats them.

    Attributes:
        flattened: whether the material coordinates were made by flattening (uv was None).

    Raises:
        MeshError: wrong shapes, no faces, an index out of range, a repeated vertex in a face, coordinates
            that are not finite, a triangle without area in uv, or an edge with more than two triangles.
    """

    x: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    flattened: bool = False

    def __init__(
        self,
        x: ArrayLike,
        faces: ArrayLike,
        uv: ArrayLike | None = None,
        groups: Mapping[str, ArrayLike] | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        x, faces = _positions(x), _faces(faces)
        _check_faces(faces, len(x))
        notes = tuple(notes)
        object.__setattr__(self, "flattened", uv is None)
        if uv is None:
            uv = flatten(x, faces)
            notes += ("no material coordinates: each triangle is flattened into its own frame, so the given "
                      "shape is the rest shape and warp and weft have no common direction",)
        uv = _material(uv, len(x), faces)
        _check_area(uv, faces)
        _check_manifold(faces)
        loose = len(x) - len(np.unique(faces))
        if loose:
            note = f"{loose} of {len(x)} vertices belong to no face and are kept out of the simulation"
            warnings.warn(note, stacklevel=2)
            notes += (note,)
        for name, value in (("x", x), ("faces", faces), ("uv", uv)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "groups", {k: _group(k, v, len(x)) for k, v in (groups or {}).items()})
        object.__setattr__(self, "notes", notes)

    @property
    def vertex_count(self) -> int:
        """Number of vertices, those without a face included."""
        return len(self.x)

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @property
    def corner_uv(self) -> np.ndarray:
        """(m, 3, 2) material coordinates of the triangles' corners [m]."""
        return self.uv if self.uv.ndim == 3 else self.uv[self.faces]

    @property
    def material_areas(self) -> np.ndarray:
        """(m,) areas in the material plane [m^2]."""
        return np.abs(_twice_area(self.corner_uv)) / 2

    @property
    def has_hinges(self) -> bool:
        """Whether any edge has two triangles."""
        return len(np.unique(np.sort(face_edges(self.faces), axis=1), axis=0)) < 3 * self.face_count

    def select(self, vertices: object) -> np.ndarray:
        """Vertex indices from an index, a list, a boolean mask or a group's name.

        Raises:
            MeshError: an unknown group, an index out of range, a mask of the wrong length or no vertex.
        """
        if isinstance(vertices, str):
            if vertices not in self.groups:
                raise MeshError(f"no vertex group {vertices!r}; {did_you_mean(vertices, self.groups)}")
            return self.groups[vertices]
        index = np.atleast_1d(np.asarray(vertices))
        if index.dtype == bool:
            if index.shape != (len(self.x),):
                raise MeshError(f"a vertex mask needs shape ({len(self.x)},), not {index.shape}")
            index = np.flatnonzero(index)
        return _group("selection", index, len(self.x))


def flatten(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(m, 3, 2) coordinates [m] of each triangle in a frame of its own: corner 0 at the origin, edge 0-1 along u."""
    a, b = x[faces[:, 1]] - x[faces[:, 0]], x[faces[:, 2]] - x[faces[:, 0]]
    length = np.linalg.norm(a, axis=1)
    unit = a / np.where(length > 0, length, 1)[:, None]
    along = np.einsum("ij,ij->i", b, unit)
    across = np.linalg.norm(b - along[:, None] * unit, axis=1)
    zero = np.zeros(len(faces))
    return np.stack([np.stack([zero, zero], 1), np.stack([length, zero], 1), np.stack([along, across], 1)], 1)


def _positions(x: ArrayLike) -> np.ndarray:
    x = np.array(x, dtype=np.float64)
    if x.ndim != 2 or x.shape[1] != 3:
        raise MeshError(f"positions need shape (n, 3), not {x.shape}")
    bad = np.flatnonzero(~np.isfinite(x).all(axis=1))
    if len(bad):
        raise MeshError(f"vertex {bad[0]} has a coordinate that is not finite: {x[bad[0]].tolist()}"
                        f" ({len(bad)} such vertices)")
    return x


def _faces(faces: ArrayLike) -> np.ndarray:
    faces = np.array(faces)
    if faces.size == 0:
        raise MeshError("the mesh has no faces")
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"faces need shape (m, 3), not {faces.shape}")
    if not np.issubdtype(faces.dtype, np.integer):
        raise MeshError(f"faces need integer vertex indices, not {faces.dtype}")
    return faces.astype(np.int64)


def _check_faces(faces: np.ndarray, n: int) -> None:
    out = np.flatnonzero(((faces < 0) | (faces >= n)).any(axis=1))
    if len(out):
        raise MeshError(f"face {out[0]} {faces[out[0]].tolist()} names a vertex out of range: there are {n}")
    a, b, c = faces.T
    twice = np.flatnonzero((a == b) | (b == c) | (a == c))
    if len(twice):
        raise MeshError(f"face {twice[0]} repeats a vertex: {faces[twice[0]].tolist()} ({len(twice)} such faces)")


def _material(uv: ArrayLike, n: int, faces: np.ndarray) -> np.ndarray:
    uv = np.array(uv, dtype=np.float64)
    if uv.shape not in ((n, 2), (len(faces), 3, 2)):
        raise MeshError(f"material coordinates need shape ({n}, 2) per vertex or ({len(faces)}, 3, 2) per "
                        f"corner, not {uv.shape}")
    bad = np.flatnonzero(~np.isfinite(uv).reshape(len(uv), -1).all(axis=1))
    if len(bad):
        what = "vertex" if uv.ndim == 2 else "face"
        raise MeshError(f"{what} {bad[0]} has a material coordinate that is not finite")
    return uv


def _twice_area(corner_uv: np.ndarray) -> np.ndarray:
    """(m,) signed."""
    a, b = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _check_area(uv: np.ndarray, faces: np.ndarray) -> None:
    corner = uv if uv.ndim == 3 else uv[faces]
    longest = np.max([np.sum((corner[:, i] - corner[:, i - 1]) ** 2, axis=1) for i in range(3)], axis=0)
    flat = np.flatnonzero(np.abs(_twice_area(corner)) <= FLAT * longest)
    if len(flat):
        raise MeshError(f"triangle {flat[0]} (vertices {faces[flat[0]].tolist()}) has no area in the material "
                        f"plane ({len(flat)} such triangles): remove it or give it material coordinates")


def face_edges(faces: np.ndarray) -> np.ndarray:
    """(3 m, 2) the edges (0, 1), (1, 2), (2, 0) of every triangle, one block of m rows after the other."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _check_manifold(faces: np.ndarray) -> None:
    edges, count = np.unique(np.sort(face_edges(faces), axis=1), axis=0, return_counts=True)
    bad = np.flatnonzero(count > 2)
    if len(bad):
        i, j = edges[bad[0]].tolist()
        raise MeshError(f"edge ({i}, {j}) is shared by {count[bad[0]]} triangles ({len(bad)} such edges): cloth "
                        "has at most two triangles at an edge; split the mesh there")


def _group(name: str, index: ArrayLike, n: int) -> np.ndarray:
    index = np.array(index)
    if index.ndim != 1 or not (index.size == 0 or np.issubdtype(index.dtype, np.integer)):
        raise MeshError(f"vertex group {name!r} needs a list of vertex indices, not {index.dtype} {index.shape}")
    index = index.astype(np.int64)
    out = index[(index < 0) | (index >= n)]
    if len(out):
        raise MeshError(f"vertex group {name!r} names vertex {out[0]}, but there are {n} vertices")
    index.setflags(write=False)
    return index
