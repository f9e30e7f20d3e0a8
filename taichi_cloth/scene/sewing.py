"""Seams: rows of vertices, the strength of their stitches, opening by hand. numpy only."""

from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from .cloth import Cloth, used_vertices
from .garment import seam_angle
from .mesh import TriMesh, distinct, face_edges


@dataclass(frozen=True, eq=False)
class Seam:
    """Two rows of a cloth's vertices that are sewn to each other, one by one; made by `Scene.sew` and `Scene.stitch`.

    Attributes:
        a, b: (k,) vertices.
        rest: angle of the seam's hinges at rest [rad], or "given": that of the cloth's mesh.
        stiffness: factor of their bending stiffness.
        bears: (k,) force [N] at which each stitch gives; infinite if it never does.
        pulls: (k,) force [N] with which each stitch is drawn together while it is apart; 0 if it is led, by any force.
        tears: whether it holds the corners of triangles of cloth that may tear.
        row: whether stitches stand next to each other, as in a row, or each by itself, as buttons do.
    """

    cloth: Cloth
    a: np.ndarray
    b: np.ndarray
    rest: float | str
    stiffness: float
    bears: np.ndarray
    pulls: np.ndarray
    row: bool = True
    tears: bool = False

    def __repr__(self) -> str:
        return f"<Seam of {self.cloth.name!r}, {len(self.a):,} stitches>"

    @property
    def gives(self) -> bool:
        """Whether any of it can give."""
        return bool(np.isfinite(self.bears).any())

    def stitches(self, vertices: object = None, what: str = "unsew") -> np.ndarray:
        """(j,) numbers of the stitches that a selection of the cloth's vertices is sewn by, on either side; all if None.

        Raises:
            SceneError: none of them is.
        """
        if vertices is None:
            return np.arange(len(self.a))
        index = self.cloth.mesh.select(vertices)
        mine = np.flatnonzero(np.isin(self.a, index) | np.isin(self.b, index))
        if not len(mine):
            raise SceneError(f"{what}: the seam of {self.cloth.name!r} has no stitch at {shown(vertices)}")
        return mine


def rows_of(cloth: Cloth, a: object, b: object) -> tuple[np.ndarray, np.ndarray]:
    """Two rows (k,) of vertices that can be sewn to each other.

    Raises:
        SceneError: rows of different lengths, a vertex twice in a row, or nothing to sew.
    """
    if isinstance(a, str) or isinstance(b, str):
        raise SceneError(f"sew: vertices of {cloth.name!r} must be given in order, not as the name of a group")
    rows = [used_vertices(cloth, row) for row in (a, b)]
    if len(rows[0]) != len(rows[1]):
        raise SceneError(f"sew: {len(rows[0])} vertices of {cloth.name!r} to {len(rows[1])}: rows must be as long as each "
                         "other")
    for row in rows:
        names, count = np.unique(row[:-1] if row[0] == row[-1] and len(row) > 2 else row, return_counts=True)
        if count.max() > 1:
            raise SceneError(f"sew: vertex {names[count > 1][0]} of {cloth.name!r} is named twice in a row")
    if (rows[0] == rows[1]).all():
        raise SceneError(f"sew: the two rows of {cloth.name!r} are the same: there is nothing to sew")
    return rows[0], rows[1]


def make(cloth: Cloth, a: object, b: object, rest: object, stiffness: object, strength: object, pull: object) -> Seam:
    """The seam of `Scene.sew`."""
    rows = rows_of(cloth, a, b)
    angle = seam_angle("sew: rest", rest)
    factor = checks.number("sew: stiffness", stiffness, least=0.0)
    bears = np.full(len(rows[0]), np.inf)
    if strength is not None:
        if len(rows[0]) < 2:
            raise SceneError("sew: strength is a force a length, and a single stitch has none: use Scene.stitch(force=...)")
        bears = checks.number("sew: strength", strength, "N/m", positive=True) * lengths(cloth, *rows)
    pulls = np.zeros(len(rows[0]))
    if pull is not None:
        pulls = checks.number("sew: pull", pull, "N/m", positive=True) * lengths(cloth, *rows)
    return Seam(cloth, *rows, angle, factor, bears, pulls)


def corners(cloth: Cloth) -> Seam:
    """Holds the corners of triangles together where cloth may tear."""
    parts = cloth.split
    assert parts is not None
    n = len(parts.a)
    return Seam(cloth, parts.a, parts.b, 0.0, 0.0, np.full(n, np.inf), np.zeros(n), row=False, tears=True)


def make_stitches(cloth: Cloth, a: object, b: object, force: object) -> Seam:
    """The seam of `Scene.stitch`."""
    rows = rows_of(cloth, a, b)
    bears = np.full(len(rows[0]), np.inf if force is None else checks.number("stitch: force", force, "N", positive=True))
    return Seam(cloth, *rows, 0.0, 0.0, bears, np.zeros(len(rows[0])), row=False)


def lengths(cloth: Cloth, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k,) length [m] of a seam that each of its stitches stands for, in the cloth's material.

    That is half the way to the next stitch on either side, in the mean of the two rows. For a single stitch it is half the way
    along its borders to their next vertices, or, within the cloth, the mean length of its edges.
    """
    out = np.zeros(len(a))
    mesh = cloth.mesh
    for row in (a, b):
        way = _ways(mesh, np.stack([row[:-1], row[1:]], axis=1))
        out[:-1] += way / 4
        out[1:] += way / 4
    if len(a) > 2 and a[0] == a[-1]:  # round a hole: the last is the first
        out[[0, -1]] = out[0] + out[-1]
    if len(a) == 1:
        borders = np.array(list(mesh.border_edges)).reshape(-1, 2)
        for v in (a[0], b[0]):
            beside = borders[(borders == v).any(axis=1)]
            if not len(beside):
                edges = distinct(face_edges(mesh.faces))[0]
                beside = edges[(edges == v).any(axis=1)]
            way = _ways(mesh, beside)
            out += way.sum() / 4 if v in borders else way.mean() / 2
    return out


def _ways(mesh: TriMesh, pairs: np.ndarray) -> np.ndarray:
    """(k,) distances [m] in the material between pairs (k, 2) of vertices. If vertices have several places there, along the
    edge between them; without such an edge, in the given shape."""
    places = mesh.x if mesh.vertex_uv is None else mesh.vertex_uv
    out = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1)
    if mesh.vertex_uv is None:
        by = np.array([mesh.vertex_count, 1])
        codes, first = np.unique(np.sort(face_edges(mesh.faces), axis=1) @ by, return_index=True)
        wanted = np.sort(pairs, axis=1) @ by
        at = np.minimum(np.searchsorted(codes, wanted), len(codes) - 1)
        ends = face_edges(np.arange(3 * mesh.face_count).reshape(-1, 3))[first[at]]  # corners
        corner = mesh.corner_uv.reshape(-1, 2)[ends]
        out = np.where(codes[at] == wanted, np.linalg.norm(corner[:, 1] - corner[:, 0], axis=1), out)
    return out
