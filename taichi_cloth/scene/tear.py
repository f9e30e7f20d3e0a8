"""Cloth that may tear: its strength, the places, and its mesh with the corners of triangles apart there. numpy only.

Cloth that may tear has corners of its own for each triangle, and the corners at a vertex are sewn together across the edges
between their triangles. Sewn, they move as the whole mesh does, exactly; tearing opens stitches, and changes no mesh.
"""

import numbers
from dataclasses import dataclass
from typing import Any

import numpy as np

from .. import checks
from ..errors import SceneError
from .fabric import pair
from .mesh import TriMesh, face_edges

MOST_VERTICES = 1 << 31  # that any mesh has


@dataclass(frozen=True)
class Tear:
    """How a piece of cloth tears.

    Args:
        strength: force a width [N/m] across which it separates, one number or (along warp, along weft).
        length: [m] over which the stress ahead of a tip is averaged; cloth that is meshed finer tears at the same force.
        where: vertices or groups at which it may tear; None is everywhere.

    Raises:
        SceneError: a strength or length that is not positive, or vertices that are not there.
    """

    strength: float | tuple[float, float]
    length: float = 0.01
    where: object = None

    def __post_init__(self) -> None:
        values = self.strength if checks.is_sequence(self.strength) else (self.strength,)
        if len(values) not in (1, 2):  # type: ignore[arg-type]
            raise SceneError(f"tear: strength has {len(values)} numbers: one, or one along warp and one along weft")  # type: ignore[arg-type]
        checked = tuple(checks.number("tear: strength", v, "N/m", positive=True) for v in values)  # type: ignore[union-attr]
        object.__setattr__(self, "strength", checked if len(checked) == 2 else checked[0])
        object.__setattr__(self, "length", checks.number("tear: length", self.length, "m", positive=True))
        object.__setattr__(self, "where", _vertices(self.where))

    @property
    def strengths(self) -> np.ndarray:
        """(2,) along warp and weft [N/m]."""
        return np.array(pair(self.strength))


def _vertices(where: object) -> object:
    """A selection of vertices, checked as far as possible without the mesh."""
    names = isinstance(where, str) or (isinstance(where, (list, tuple)) and len(where) > 0
                                       and all(isinstance(name, str) for name in where))
    mask = isinstance(where, np.ndarray) and where.dtype == bool and where.ndim == 1
    if where is None or names or mask:
        return where
    one = isinstance(where, numbers.Real) or getattr(where, "ndim", None) == 0
    return checks.indices("tear: where", [where] if one else where, MOST_VERTICES, error=SceneError)


@dataclass(frozen=True, eq=False)
class Split:
    """A mesh with the corners of its triangles apart where it may tear.

    Attributes:
        whole: the mesh that it was made of; mesh: as simulated: vertices of `whole`, then the corners that were added.
        of: (n,) the vertex of `whole` of each.
        edges, sides: (e, 2) ends, and triangles, of the edges between two triangles.
        a, b: (k,) corners that a stitch joins; edge: (k,) the edge that it is across; at: (k,) 0 or 1, the end of that edge.
    """

    whole: TriMesh
    mesh: TriMesh
    of: np.ndarray
    edges: np.ndarray
    sides: np.ndarray
    a: np.ndarray
    b: np.ndarray
    edge: np.ndarray
    at: np.ndarray

    def spread(self, values: Any) -> Any:
        """(n, 3) values on the vertices of `whole`, or of the mesh, on those of the mesh."""
        same = np.ndim(values) == 2 and len(values) == self.whole.vertex_count
        return np.asarray(values)[self.of] if same else values

    def corners(self, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
        """(k,) the corners of faces (k,) at vertices (k,) of `whole`."""
        return self.mesh.faces[faces, (self.whole.faces[faces] == vertices[:, None]).argmax(axis=1)]

    def on_line(self, edges: np.ndarray) -> np.ndarray:
        """(k,) whether stitches are across edges (j, 2) of `whole`."""
        by = np.array([self.whole.vertex_count, 1])
        return np.isin(np.sort(self.edges, axis=1)[self.edge] @ by, np.sort(edges, axis=1) @ by)


def split(name: str, mesh: TriMesh, tear: Tear) -> Split:
    """The mesh of a cloth that may tear.

    Raises:
        SceneError: a mesh without a pattern of one coordinate a vertex, or nothing that may tear.
    """
    uv = mesh.vertex_uv
    if uv is None:
        raise SceneError(f"tear of {name!r}: its mesh needs a pattern, with one material coordinate a vertex")
    n, m = mesh.vertex_count, mesh.face_count
    may = np.zeros(n, dtype=bool)
    may[np.arange(n) if tear.where is None else mesh.select(tear.where)] = True
    _refuse_coarse(name, mesh, may, tear.length)
    corner = mesh.faces.ravel()
    first = np.zeros(3 * m, dtype=bool)
    first[np.unique(corner, return_index=True)[1]] = True
    new = may[corner] & ~first
    faces = corner.copy()
    faces[new] = n + np.arange(new.sum())
    of = np.concatenate([np.arange(n), corner[new]])
    groups = {key: np.concatenate([index, n + np.flatnonzero(np.isin(of[n:], index))]) for key, index in mesh.groups.items()}
    weights = {key: np.zeros(n) for key in mesh.weights}
    for key, whole in weights.items():
        whole[mesh.groups[key]] = mesh.weights[key]
    weights = {key: whole[of[groups[key]]] for key, whole in weights.items()}
    made = TriMesh(mesh.x[of], faces.reshape(m, 3), uv[of], groups, texture=mesh.texture, weights=weights)
    object.__setattr__(made, "notes", mesh.notes)
    edges, sides = _inner(mesh)
    out = Split(mesh, made, of, edges, sides, *(np.zeros(0, dtype=np.int64),) * 4)
    ends = [(out.corners(edges[:, k], sides[:, 0]), out.corners(edges[:, k], sides[:, 1])) for k in (0, 1)]
    apart = np.stack([a != b for a, b in ends], axis=1)
    edge, at = np.nonzero(apart)
    if not len(edge):
        raise SceneError(f"tear of {name!r}: no edge between two triangles is where it may tear")
    a, b = (np.stack([end[side] for end in ends], axis=1)[edge, at] for side in (0, 1))
    return Split(mesh, made, of, edges, sides, a, b, edge, at)


def _refuse_coarse(name: str, mesh: TriMesh, may: np.ndarray, length: float) -> None:
    """Refuses a length within which no vertex has a point of its triangles that stands for a third of one."""
    corners = mesh.corner_uv
    nearest = np.full(mesh.vertex_count, np.inf)
    for k in range(3):
        away = corners[:, (k + 1) % 3] + corners[:, (k + 2) % 3] - 2 * corners[:, k]
        np.minimum.at(nearest, mesh.faces[:, k], np.linalg.norm(away, axis=1) / 6)
    mine = nearest[may & np.isfinite(nearest)]
    if len(mine) and mine.min() >= length:
        raise SceneError(f"tear of {name!r}: length = {length:g} m is shorter than its triangles resolve: give it "
                         f"{2 * mine.min():.2g} m at least, or smaller triangles where it may tear")


def _inner(mesh: TriMesh) -> tuple[np.ndarray, np.ndarray]:
    """((e, 2) ends, (e, 2) triangles) of edges between two triangles, in the order of `TriMesh.inner_edges`, running as in
    the first."""
    ends, m = face_edges(mesh.faces), mesh.face_count
    low, high = ends.min(axis=1), ends.max(axis=1)
    order = np.lexsort((np.arange(3 * m), high, low))
    inner = np.flatnonzero((low[order][1:] == low[order][:-1]) & (high[order][1:] == high[order][:-1]))
    a, b = order[inner], order[inner + 1]
    return ends[a], np.stack([a % m, b % m], axis=1)
