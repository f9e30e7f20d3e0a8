"""A triangle mesh as a value: positions, triangles, material coordinates, named groups of vertices.

numpy only. Everything that is wrong with a mesh is said here, before anything is computed.
"""

from __future__ import annotations

import numbers
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import ClothError, MeshError, did_you_mean, shown, warn
from .ownshape import own_shape, twice_area

# A triangle whose height is less than this part of its longest edge, in the material plane, has no area.
FLAT = 1e-9


@dataclass(frozen=True, eq=False)
class TriMesh:
    """A triangle mesh in its material plane and in space.

    Args:
        x: (n, 3) positions [m]; the given shape, from which rest angles can be taken.
        faces: (m, 3) vertex indices.
        uv: material coordinates [m], (n, 2) per vertex or, where a seam cuts the pattern, (m, 3, 2) per
            corner. None takes the given shape: each triangle is flattened into a frame of its own.
        groups: named vertex groups, name -> indices.
        notes: repairs by a reader, one sentence each; a run repeats them. Borders that lie on each other and
            triangles that face opposite ways are added here.
        texture: (m, 3, 2) texture coordinates of corners, where images go, 0 to 1 across one; None: they are the material
            coordinates. If uv is None the warp runs along their u, and a flat mesh has its own plane as its pattern.
        polygon: (m,) the number of the polygon that each triangle was cut from; None: triangles are all there is.
        weights: of vertices in groups, above 0 up to 1, by the groups' names; 1 if they are not named.

    Attributes:
        flattened: whether each triangle is in a frame of its own.

    Raises:
        MeshError: wrong shapes, no faces, an index out of range, a repeated vertex in a face, coordinates
            that are not finite, a triangle without area in uv, or an edge with more than two triangles.
    """

    x: np.ndarray
    faces: np.ndarray
    uv: np.ndarray
    groups: Mapping[str, np.ndarray] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    texture: np.ndarray | None = None
    polygon: np.ndarray | None = None
    weights: Mapping[str, np.ndarray] = field(default_factory=dict)
    flattened: bool = False

    def __init__(
        self,
        x: ArrayLike,
        faces: ArrayLike,
        uv: ArrayLike | None = None,
        groups: Mapping[str, ArrayLike] | None = None,
        notes: tuple[str, ...] = (),
        texture: ArrayLike | None = None,
        polygon: ArrayLike | None = None,
        weights: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        x = checks.array("positions", x, ("n", 3), row="vertex", error=MeshError)
        faces = face_indices(faces, len(x), MeshError)
        notes = _sentences(notes)
        image: np.ndarray | None = checks.maybe(texture, checks.array, "texture coordinates", (len(faces), 3, 2), row="face",
                                                error=MeshError)
        own = uv is None
        if uv is None:
            uv = own_shape(x, faces, image)
            notes += (_own_note(uv, image),)
        else:
            uv = checks.array("material coordinates", uv, (len(x), 2), (len(faces), 3, 2), row="vertex or face",
                              error=MeshError)
        _check_area(uv, faces)
        borders = borders_of(faces)
        loose = int(np.sum(np.bincount(faces.ravel(), minlength=len(x)) == 0))
        if loose:
            note = f"{loose} of {len(x)} vertices belong to no face and are kept out of the simulation"
            warn(note)
            notes += (note,)
        notes += open_note(x, borders) + _flips(faces)
        of: np.ndarray | None = checks.maybe(polygon, checks.array, "polygons of triangles", (len(faces),), row="face",
                                             error=MeshError)
        of = None if of is None else np.unique(of, return_inverse=True)[1].reshape(-1)
        for name, value in (("x", x), ("faces", faces), ("uv", uv), ("texture", image), ("polygon", of)):
            if value is not None:
                value.setflags(write=False)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "flattened", own and uv.ndim == 3)
        object.__setattr__(self, "groups", _groups(groups, len(x)))
        object.__setattr__(self, "weights", _weights(weights, self.groups))
        object.__setattr__(self, "notes", notes)

    def __repr__(self) -> str:
        size = " x ".join(f"{length:.4g}" for length in np.ptp(self.x, axis=0))
        return (f"<TriMesh of {self.vertex_count:,} vertices, {self.face_count:,} triangles, {size} m, "
                f"{len(self.groups)} groups>")

    @property
    def vertex_count(self) -> int:
        """Number of vertices, those without a face included."""
        return len(self.x)

    @property
    def face_count(self) -> int:
        """Number of triangles."""
        return len(self.faces)

    @cached_property
    def corner_uv(self) -> np.ndarray:
        """(m, 3, 2) material coordinates of the triangles' corners [m]."""
        return _fixed(self.uv if self.uv.ndim == 3 else self.uv[self.faces])

    @cached_property
    def vertex_uv(self) -> np.ndarray | None:
        """(n, 2) material coordinates of the vertices [m]; None if one has several, or where flattening made them."""
        if self.flattened or self.uv.ndim == 2:
            return None if self.flattened else self.uv
        first = _fixed(self.first_uv)
        return first if (first[self.faces] == self.uv).all() else None

    @property
    def first_uv(self) -> np.ndarray:
        """(n, 2) material coordinates [m] of the first corner at each vertex; 0 if there is none."""
        out = np.zeros((self.vertex_count, 2))
        out[self.faces[::-1].ravel()] = self.corner_uv[::-1].reshape(-1, 2)
        return out

    @cached_property
    def material_areas(self) -> np.ndarray:
        """(m,) areas in the material plane [m^2]."""
        return _fixed(np.abs(twice_area(self.corner_uv)) / 2)

    @cached_property
    def border_edges(self) -> dict[tuple[int, int], int]:
        """Rows of `face_edges` that have one triangle only, by their two vertices, the lower first."""
        edges = np.sort(face_edges(self.faces), axis=1)
        _, first, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
        alone = first[count == 1]
        return {(int(i), int(j)): int(row) for (i, j), row in zip(edges[alone], alone)}

    @property
    def inner_edges(self) -> np.ndarray:
        """(k, 2) vertices of the edges between two triangles, the lower first, in rising order."""
        edges, count = distinct(face_edges(self.faces))
        return edges[count == 2]

    @property
    def has_hinges(self) -> bool:
        """Whether any edge has two triangles."""
        return len(self.inner_edges) > 0

    def select(self, vertices: object) -> np.ndarray:
        """(k,) vertex indices from an index, a list, a boolean mask, a group's name or a list of names.

        Raises:
            MeshError: an unknown group, an index out of range, a mask of the wrong length or no vertex.
        """
        if isinstance(vertices, str):
            if vertices not in self.groups:
                raise MeshError(f"no vertex group {shown(vertices)}; {did_you_mean(vertices, self.groups)}")
            return self.groups[vertices]
        if isinstance(vertices, (list, tuple)) and vertices and all(isinstance(v, str) for v in vertices):
            return np.unique(np.concatenate([self.select(name) for name in vertices]))
        if _is_mask(vertices):
            mask = np.array(vertices)
            if mask.shape != (len(self.x),):
                raise MeshError(f"a vertex mask needs shape ({len(self.x)},), not {mask.shape}")
            return np.flatnonzero(mask)
        one = isinstance(vertices, numbers.Real) or getattr(vertices, "ndim", None) == 0
        return checks.indices("vertices", [vertices] if one else vertices, len(self.x), error=MeshError)

    def select_weights(self, vertices: object) -> np.ndarray:
        """(k,) weights of the vertices that `select` gives: their group's, 1 if it has none or there is no group."""
        if isinstance(vertices, str) and vertices in self.weights:
            return self.weights[vertices]
        if isinstance(vertices, (list, tuple)) and any(isinstance(v, str) and v in self.weights for v in vertices):
            most = np.zeros(len(self.x))
            for name in vertices:
                np.maximum.at(most, self.select(name), self.select_weights(name))
            return most[self.select(vertices)]
        return np.ones(len(self.select(vertices)))


def face_indices(faces: ArrayLike, count: int, error: type[ClothError]) -> np.ndarray:
    """(m, 3) vertex indices of triangles, at least one, each of three different vertices of `count`.

    Raises:
        error: with the number of the first bad face.
    """
    out = checks.indices("faces", faces, count, width=3, row="face", error=error)
    if not len(out):
        raise error("the mesh has no faces")
    a, b, c = out.T
    twice = np.flatnonzero((a == b) | (b == c) | (a == c))
    if len(twice):
        raise error(f"faces: face {twice[0]} repeats a vertex: {out[twice[0]].tolist()} ({len(twice)} such faces)")
    return out


def _check_area(uv: np.ndarray, faces: np.ndarray) -> None:
    corner = uv if uv.ndim == 3 else uv[faces]
    longest = np.max([np.sum((corner[:, i] - corner[:, i - 1]) ** 2, axis=1) for i in range(3)], axis=0)
    flat = np.flatnonzero(np.abs(twice_area(corner)) <= FLAT * longest)
    if len(flat):
        raise MeshError(f"triangle {flat[0]} (vertices {faces[flat[0]].tolist()}) has no area in the material "
                        f"plane ({len(flat)} such triangles): remove it or give it material coordinates")


def face_edges(faces: np.ndarray) -> np.ndarray:
    """(3 m, 2) the edges (0, 1), (1, 2), (2, 0) of every triangle, one block of m rows after the other."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def distinct(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """((e, 2) pairs of vertices (k, 2), each once, the lower first, in rising order; (e,) how often each is there)."""
    ends, size = np.sort(ends, axis=1).astype(np.int64), int(ends.max(initial=0)) + 1
    code, count = np.unique(ends[:, 0] * size + ends[:, 1], return_counts=True)
    return np.stack([code // size, code % size], axis=1), count


def borders_of(faces: np.ndarray) -> np.ndarray:
    """(k, 2) edges with one triangle.

    Raises:
        MeshError: an edge with more than two.
    """
    edges, count = distinct(face_edges(faces))
    bad = np.flatnonzero(count > 2)
    if len(bad):
        i, j = edges[bad[0]].tolist()
        raise MeshError(f"edge ({i}, {j}) is shared by {count[bad[0]]} triangles ({len(bad)} such edges): cloth "
                        "has at most two triangles at an edge; split the mesh there")
    return edges[count == 1]


def open_note(x: np.ndarray, borders: np.ndarray, joined: np.ndarray | None = None) -> tuple[str, ...]:
    """A note where edges of the border lie on each other: vertices that were to be one, most often.

    Args:
        borders: (k, 2) vertices of edges.
        joined: (n,) a number of each vertex that those have in common that are sewn to each other; none are if None.
    """
    ends = borders if joined is None else joined[borders]
    ends = distinct(ends)[0]  # two that are sewn are one
    names, first = np.unique(np.arange(len(x)) if joined is None else joined, return_index=True)
    used = np.unique(ends)
    place = _places(x[first[np.searchsorted(names, used)]])
    merged = np.sort(place[np.searchsorted(used, ends)], axis=1)
    count = np.unique(merged[merged[:, 0] != merged[:, 1]], axis=0, return_counts=True)[1]
    pairs = int((count == 2).sum())
    if not pairs:
        return ()
    vertices = len(used) - len(np.unique(place))
    return (f"the border lies on itself in {pairs} pairs of edges, with {vertices} vertices where there is another one: the "
            "cloth is open there, unless they are made one or sewn",)


def _places(x: np.ndarray) -> np.ndarray:
    """(n,) a number of each point's place, the same for points that differ by rounding."""
    close, of = 1e-9 * float(np.ptp(x, axis=0).max(initial=0.0)) if len(x) else 0.0, np.zeros(x.shape, dtype=np.int64)
    for d, values in enumerate(x.T):
        order = np.argsort(values)
        of[order[1:], d] = np.cumsum(np.diff(values[order]) > close)
    return np.unique(of, axis=0, return_inverse=True)[1].reshape(-1)


def _own_note(uv: np.ndarray, texture: np.ndarray | None) -> str:
    """How the given shape became the rest shape."""
    if uv.ndim == 2:
        return ("no material coordinates: the mesh is flat and its own plane is its pattern, with the warp along the texture "
                "coordinates' u")
    warp = "warp and weft have no common direction" if texture is None else "the warp runs along the texture coordinates' u"
    return ("no material coordinates: each triangle is flattened into its own frame, so the given shape is the rest shape and "
            f"{warp}")


def _flips(faces: np.ndarray) -> tuple[str, ...]:
    """A note where neighbouring triangles face opposite ways."""
    turned = facing(faces)
    if turned is None:
        return ("the mesh has one side only, like a Moebius strip: somewhere its triangles face opposite ways",)
    count = int(turned.sum())
    return (f"{count} triangles are turned against their neighbours (the first is {int(np.argmax(turned))})",) if count else ()


def facing(faces: np.ndarray) -> np.ndarray | None:
    """(m,) whether a triangle is turned against most of its piece; None for a surface that has one side only.

    Args:
        faces: (m, 3); those at an edge of more than two are no neighbours there.
    """
    m, ends = len(faces), face_edges(faces)
    order = np.lexsort(np.sort(ends, axis=1).T)
    same = (np.sort(ends[order[1:]], axis=1) == np.sort(ends[order[:-1]], axis=1)).all(axis=1)
    two = same & ~np.append(False, same[:-1]) & ~np.append(same[1:], False)
    a, b = order[:-1][two], order[1:][two]
    against = ends[a, 0] == ends[b, 0]  # neighbours that agree run along their edge in opposite ways
    turned = np.zeros(m, dtype=bool)
    if not against.any():
        return turned
    return _spread(m, a % m, b % m, against)


def _spread(m: int, a: np.ndarray, b: np.ndarray, against: np.ndarray) -> np.ndarray | None:
    """Colours of m triangles so that neighbours a, b have different ones where `against`, the rarer colour True."""
    near: list[list[tuple[int, bool]]] = [[] for _ in range(m)]
    for i, j, other in zip(a.tolist(), b.tolist(), against.tolist()):
        near[i].append((j, other))
        near[j].append((i, other))
    colour = np.full(m, -1)
    for start in range(m):
        if colour[start] >= 0:
            continue
        colour[start], piece = 0, [start]
        for i in piece:  # grows
            for j, other in near[i]:
                if colour[j] < 0:
                    colour[j] = colour[i] ^ other
                    piece.append(j)
                elif colour[j] != colour[i] ^ other:
                    return None
        if 2 * colour[piece].sum() > len(piece):
            colour[piece] = 1 - colour[piece]
    return colour == 1


def _groups(groups: Mapping[str, ArrayLike] | None, count: int) -> dict[str, np.ndarray]:
    out = {}
    if not isinstance(groups, (Mapping, type(None))):
        raise MeshError(f"groups = {shown(groups)}: must be a dict of names and vertex indices")
    for name, index in (groups or {}).items():
        key = checks.name("a vertex group's name", name, MeshError)
        out[key] = checks.indices(f"vertex group {key!r}", index, count, error=MeshError)
        out[key].setflags(write=False)
    return out


def _weights(weights: Mapping[str, ArrayLike] | None, groups: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    out = {}
    if not isinstance(weights, (Mapping, type(None))):
        raise MeshError(f"weights = {shown(weights)}: must be a dict of names and weights")
    for name, values in (weights or {}).items():
        if name not in groups:
            raise MeshError(f"weights: no vertex group {shown(name)}; {did_you_mean(name, groups)}")
        out[name] = checks.array(f"weights of group {name!r}", values, (len(groups[name]),), row="vertex", error=MeshError)
        bad = np.flatnonzero((out[name] <= 0) | (out[name] > 1))
        if len(bad):
            vertex, weight = groups[name][bad[0]], out[name][bad[0]]
            raise MeshError(f"weights of group {name!r}: vertex {vertex} has {weight:g}: they are above 0, up to 1")
        out[name].setflags(write=False)
    return out


def _fixed(array: np.ndarray) -> np.ndarray:
    """An array that is handed out more than once, and so must not be written to."""
    array.setflags(write=False)
    return array


def _sentences(notes: object) -> tuple[str, ...]:
    if not (isinstance(notes, (tuple, list)) and all(isinstance(n, str) for n in notes)):
        raise MeshError(f"notes = {shown(notes)}: must be texts in a tuple")
    return tuple(notes)


def _is_mask(vertices: object) -> bool:
    """Whether a selection is made of truth values."""
    if isinstance(vertices, np.ndarray):
        return bool(vertices.dtype == bool)
    several = isinstance(vertices, (list, tuple)) and len(vertices) > 0
    return all(isinstance(v, (bool, np.bool_)) for v in (vertices if several else [vertices]))  # type: ignore[attr-defined]
