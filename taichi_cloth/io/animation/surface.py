"""One surface of the parts of a file: vertices at one place in all frames are made one, as far as edges get two triangles."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import MeshError
from ...scene.boxes import near as boxes_near
from ...scene.connected import components
from ...scene.mesh import face_edges
from .motion import Motion, Part

ROUNDING = 1e-6  # of the size, that positions in f32 are off by after a few products


class Joined(NamedTuple):
    """Parts in one.

    Attributes:
        x: (frames, n, 3); faces: (m, 3); corner_uv: (m, 3, 2), 0 for parts that have none, or None if none has any.
        groups: rows of `faces` by the names of parts, materials and subsets.
        notes: sentences on changes of the topology.
    """

    x: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray | None
    groups: dict[str, np.ndarray]
    notes: tuple[str, ...]


def joined(motion: Motion, merge: bool, weld: float | None) -> Joined:
    """The parts of a file as one surface.

    Args:
        merge: whether vertices of different parts are made one, too.
        weld: distance, in the file's unit, up to which vertices are made one; None for that of rounding, 0 for none.

    Raises:
        MeshError: a part that shrinks to a point.
    """
    parts = motion.parts
    for part in parts:
        _refuse_vanishing(part, motion.fps)
    start = np.cumsum([0] + [part.x.shape[1] for part in parts])
    rows = np.cumsum([0] + [len(part.faces) for part in parts])
    frames = max(len(part.x) for part in parts)
    x = np.concatenate([np.broadcast_to(part.x, (frames, *part.x.shape[1:])) for part in parts], axis=1)
    faces = np.concatenate([part.faces + k for part, k in zip(parts, start)])
    owner = np.zeros(x.shape[1], dtype=np.int64) if merge else np.repeat(np.arange(len(parts)), np.diff(start))
    near = ROUNDING * float(np.ptp(x[0], axis=0).max()) if weld is None else weld
    one = same_places(x, owner, near) if near else np.arange(x.shape[1])
    faces, rows_of, notes = mended(faces, one, weld)
    groups: dict[str, np.ndarray] = {}
    for part, first, last in zip(parts, rows, rows[1:]):
        groups[part.name] = np.arange(first, last)
    for part, first in zip(parts, rows):
        for name, mine in part.groups.items():
            if name not in {p.name for p in parts}:  # a material with a part's name is left out, as of an OBJ
                groups[name] = np.concatenate([groups.get(name, mine[:0]), mine + first])
    groups = {name: np.unique(rows_of[mine][rows_of[mine] >= 0]) for name, mine in groups.items()}
    if not len(faces):
        raise MeshError("its triangles have no area")
    uv, there = _texture(parts), np.flatnonzero(rows_of >= 0)
    first = there[np.unique(rows_of[there], return_index=True)[1]]
    used, faces = np.unique(faces, return_inverse=True)
    return Joined(x[:, used % x.shape[1]], faces.reshape(-1, 3), None if uv is None else uv[first], groups, notes)


def same_places(x: np.ndarray, owner: np.ndarray, near: float) -> np.ndarray:
    """(n,) for each vertex the first of those at its place in every frame, up to a distance; only of one owner.

    Args:
        x: (frames, n, 3); owner: (n,).
    """
    boxes = x[0][:, None] + [[-near / 2], [near / 2]]
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for i, j in boxes_near(boxes, boxes):
        i, j = (k[(i < j) & (owner[i] == owner[j])] for k in (i, j))
        for frame in x:
            i, j = (k[np.linalg.norm(frame[i] - frame[j], axis=1) <= near] for k in (i, j))
        pairs.append(np.column_stack([i, j]))
    return components(x.shape[1], *np.concatenate(pairs).T)


def mended(faces: np.ndarray, one: np.ndarray, weld: float | None) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Triangles of which no edge has more than two.

    Args:
        faces: (m, 3); one: (n,) the vertex that each is made one with.

    Returns:
        (triangles (k, 3); the row (m,) of these that each of `faces` has become, -1 for one without area; notes). Vertices
        from n on are copies: n times the copy's number, plus the vertex.
    """
    notes, n = [], len(one)
    made, row = one[faces], np.full(len(faces), -1)
    whole = np.flatnonzero((made != np.roll(made, 1, axis=1)).all(axis=1))
    _, first, back = np.unique(np.sort(made[whole], axis=1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)  # triangles stay in their order
    row[whole] = np.argsort(order)[back.reshape(-1)]
    if len(first) < len(whole):
        notes.append(f"{len(whole) - len(first):,} triangles lie on others, such as the two sides of a thin sheet: one "
                     "of them stays")
    made = made[whole[first[order]]]
    copies = cut_copies(made)
    if copies.any():
        notes.append(f"more than two triangles meet at an edge: the surface is cut open there, at {int((copies > 0).sum()):,} "
                     "corners of triangles")
    if weld:
        joined = len(np.unique(faces)) - len(np.unique(made))
        notes.append(f"{joined:,} vertices were made one with others (weld={weld:g})")
    return made + n * copies, row, tuple(notes)


def cut_copies(faces: np.ndarray) -> np.ndarray:
    """(m, 3) number of the copy of its vertex that each corner has, so that no edge has more than two triangles.

    If some edge has more, the triangles round a vertex stay together as far as edges of two triangles join them.
    """
    m, ends = len(faces), face_edges(faces)
    out = np.zeros(3 * m, dtype=np.int64)  # corner k of triangle t is k m + t, and begins edge k m + t
    _, edge, count = np.unique(np.sort(ends, axis=1), axis=0, return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    if not (count > 2).any():
        return out.reshape(3, m).T
    order = np.argsort(edge, kind="stable")
    a, b = order[count[edge[order]] == 2].reshape(-1, 2).T
    corners = np.stack([np.arange(3 * m), np.roll(np.arange(3 * m), -m)], axis=1)  # where each edge begins and ends
    crossed = ends[a, 0] != ends[b, 0]
    beside = np.where(crossed[:, None], corners[b][:, ::-1], corners[b])
    fan = components(3 * m, corners[a].ravel(), beside.ravel())
    vertex = faces.T.ravel()
    split = np.isin(vertex, ends[count[edge] > 2])
    pairs, back = np.unique(np.column_stack([vertex, fan])[split], axis=0, return_inverse=True)
    first = np.searchsorted(pairs[:, 0], pairs[:, 0])
    out[split] = (np.arange(len(pairs)) - first)[back.reshape(-1)]
    return out.reshape(3, m).T


def _texture(parts: list[Part]) -> np.ndarray | None:
    if all(part.corner_uv is None for part in parts):
        return None
    return np.concatenate([np.zeros((len(part.faces), 3, 2)) if part.corner_uv is None else part.corner_uv for part in parts])


def _refuse_vanishing(part: Part, fps: float | None) -> None:
    """Refuses a part that has no size in some frame."""
    size = np.ptp(part.x, axis=1).max(axis=1)
    gone = np.flatnonzero(size <= ROUNDING * size.max())
    if len(gone):
        when = "" if fps is None else f" at {gone[0] / fps:.3g} s"
        raise MeshError(f"part {part.name!r}: has no size{when}: leave it out (only=)")
