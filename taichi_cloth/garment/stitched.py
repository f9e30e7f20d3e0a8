"""Meshed panels with stitches from a vertex to a place on an edge, as other programs write them.

A stitch (v, a, b, t) sews v to (1 - t) a + t b. If that is within an edge, the edge is split there. If another side has a
vertex between two that are sewn, the edge opposite is split too: all layers of a seam have as many vertices.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError
from ..io import UP, read_surface, upright
from ..io.table import read_table
from ..io.text import text_of
from ..scene.garment import Garment, SewnRows
from ..scene.mesh import TriMesh
from .remesh import remesh

AT_END = 0.02  # of an edge within which a place on it is its end
NEAR_END = 0.25  # the same if no triangle is lost by it: the part split off would be a stiff sliver
LONGER = 1.25  # times as long as an edge is, at most, a side whose sewn vertices split it: not round the fold of a pleat
LONGEST = 6  # vertices on one side of a seam between two that are sewn to the ends of one edge

COLUMNS = ("vertex", "edge_a", "edge_b", "t")
MOST = 1_000_000  # stitches

Stitch = tuple[int, int, int, float]


@dataclass(frozen=True)
class StitchedPattern:
    """The pattern of an OBJ, as `load_pattern` returns it.

    Attributes:
        path, stitches, scale, up: as in `load_stitched`.
    """

    path: str | Path
    stitches: str | Path | None = None
    scale: float = 1.0
    up: str = "y"

    def mesh(self, spacing: float | None = None) -> Garment:
        """Its panels, with triangles whose edges are about `spacing` [m] long, or with its own; as `load_stitched`."""
        return load_stitched(self.path, self.stitches, self.scale, spacing=spacing, up=self.up)


def load_stitched(path: str | Path, stitches: str | Path | None = None, scale: float = 1.0,
                  positions: ArrayLike | None = None, spacing: float | None = None, up: str = "y") -> Garment:
    """A garment from an OBJ with panels, texture coordinates as its pattern, and stitches.

    Args:
        stitches: a .csv with columns vertex, edge_a, edge_b, t (vertices from 0); if None, the file's own lines
            `stitch v a b t` (from 0), or edges without a face, `l v w` (from 1).
        scale: metres per unit of the file.
        positions: (n, 3) of the file's vertices in the garment as another program draped it, in the file's units and with
            its axis up. The vertex that splits an edge is as far along it as in the pattern.
        spacing: length of edges [m] with which panels are meshed anew, as `remesh` does; None keeps the file's triangles.
        up: the file's axis that points up, "y" or "z": of the latter (x, y, z) is (x, z, -y) here.

    Raises:
        SceneError: a missing file, no stitches, or one that names no edge; positions of another shape, or not finite; panels
            that cannot be meshed anew.
        MeshError: a mesh that cannot be read.
    """
    path, scale = checks.path("path", path, SceneError), checks.number("scale", scale, positive=True)
    up = checks.choice("up", up, UP)
    x, faces, corner_uv, groups = read_surface(path)
    if corner_uv is None:
        raise SceneError(f"{path}: has no texture coordinates; they are a garment's pattern")
    found = _in_obj(path) if stitches is None else _in_csv(checks.path("stitches", stitches, SceneError))
    if not found:
        raise SceneError(f"{path if stitches is None else stitches}: has no stitches: lines 'stitch v a b t' or 'l v w' of "
                         "the OBJ, or rows of a .csv")
    hint = f": {path.name} has {len(x):,} vertices"
    if positions is not None:
        positions = scale * upright(checks.array("positions", positions, (len(x), 3), row="vertex", hint=hint), up)
    work = _Panels(upright(x, up) * scale, faces, corner_uv * scale, groups, positions)
    try:
        garment = work.sewn(found)
        return garment if spacing is None else remesh(garment, spacing)
    except SceneError as error:
        raise SceneError(f"{path if stitches is None else stitches}: {error}") from None


def _in_obj(path: Path) -> list[Stitch]:
    out: list[Stitch] = []
    for number, line in enumerate(text_of(path.read_bytes()).splitlines(), 1):
        word, *rest = line.split() or [""]
        try:
            if word == "stitch":
                v, a, b = (int(w) for w in rest[:3])
                out.append((v, a, b, float(rest[3])))
            elif word == "l":
                line_of = [int(w.split("/")[0]) - 1 for w in rest]
                out += [(v, w, w, 0.0) for v, w in zip(line_of[:-1], line_of[1:])]
        except (ValueError, IndexError) as error:
            raise SceneError(f"{path}: line {number}: {line[:60]!r}: {error}") from None
    return out


def _in_csv(path: Path) -> list[Stitch]:
    columns, lines = read_table(path, MOST)
    if set(columns) != set(COLUMNS):
        raise SceneError(f"{path}: needs four columns, {', '.join(COLUMNS)}, by these names; there are: {', '.join(columns)}")
    for name in COLUMNS[:3]:
        for line, value in zip(lines, columns[name]):
            checks.integer(f"{path}, line {line}: {name}", value, least=0)
    return [(int(v), int(a), int(b), t) for v, a, b, t in zip(*(columns[name] for name in COLUMNS))]


class _Panels:
    """Panels that are split where stitches need it; `draped` (n, 3) are their positions in the garment, if they are known."""

    def __init__(self, x: np.ndarray, faces: np.ndarray, corner_uv: np.ndarray, groups: dict[str, np.ndarray],
                 draped: np.ndarray | None) -> None:
        self.x, self.count = [*x], len(x)
        self.draped = None if draped is None else [*draped]
        self.faces: list[list[int] | None] = faces.tolist()
        self.uv: list[np.ndarray | None] = [*corner_uv]
        self.groups = {name: set(index.tolist()) for name, index in groups.items()}
        self.of: dict[tuple[int, int], set[int]] = defaultdict(set)
        for f, face in enumerate(faces.tolist()):
            self._enter(f, face)
        self.pairs: list[tuple[int, int]] = []

    def sewn(self, stitches: list[Stitch]) -> Garment:
        """The garment."""
        places: dict[tuple[int, int], list[tuple[float, int]]] = defaultdict(list)
        within: list[Stitch] = []
        for k, (v, a, b, t) in enumerate(stitches):
            if not all(0 <= i < self.count for i in (v, a, b)) or not 0 <= t <= 1:
                raise SceneError(f"stitch {k}: ({v}, {a}, {b}, {t:g}): vertices go from 0 to {self.count - 1}, t from 0 to 1")
            if a == b or t <= AT_END or t >= 1 - AT_END:
                self.pairs.append((v, b if a != b and t > 0.5 else a))
            elif _key(a, b) not in self.of:
                raise SceneError(f"stitch {k}: there is no edge between vertices {a} and {b}")
            else:
                within.append((v, a, b, t) if a < b else (v, b, a, 1 - t))
        clusters = self._clusters()
        for v, a, b, t in sorted(within, key=lambda s: min(s[3], 1 - s[3])):
            end = a if t < 0.5 else b
            if min(t, 1 - t) < NEAR_END and not self._adjacent(clusters.get(v, {v}), clusters.get(end, {end})):
                self.pairs.append((v, end))
                _unite(clusters, v, end)
            else:
                places[a, b].append((t, v))
        for (a, b), on in places.items():
            self._split(a, b, sorted(on))
        self._split_opposite()
        return self._garment()

    def _enter(self, f: int, face: list[int]) -> None:
        for i, j in zip(face, face[1:] + face[:1]):
            self.of[_key(i, j)].add(f)

    def _split(self, a: int, b: int, on: list[tuple[float, int]]) -> None:
        """Splits an edge at places (t from a to b, the vertex that is sewn there); near ones share a new vertex."""
        new: list[tuple[float, int]] = []
        for t, v in on:
            if not new or t - new[-1][0] > AT_END:
                new.append((t, len(self.x)))
                for at in (self.x,) if self.draped is None else (self.x, self.draped):
                    at.append((1 - t) * at[a] + t * at[b])
                for members in self.groups.values():
                    if a in members and b in members:
                        members.add(len(self.x) - 1)
            self.pairs.append((v, new[-1][1]))
        for f in list(self.of.pop(_key(a, b))):
            face, uv = self.faces[f], self.uv[f]
            assert face is not None and uv is not None
            k = next(k for k in range(3) if {face[k], face[(k + 1) % 3]} == {a, b})
            third = (k + 2) % 3
            forward = face[k] == a
            ends = [(0.0, face[k])] + [(t if forward else 1 - t, i) for t, i in (new if forward else new[::-1])] + [
                (1.0, face[(k + 1) % 3])]
            for i, j in ((0, 1), (1, 2), (2, 0)):
                self.of[_key(face[i], face[j])].discard(f)
            self.faces[f] = self.uv[f] = None
            for (t_0, i), (t_1, j) in zip(ends[:-1], ends[1:]):
                along = [(1 - t) * uv[k] + t * uv[(k + 1) % 3] for t in (t_0, t_1)]
                self.faces.append([i, j, face[third]])
                self.uv.append(np.stack([*along, uv[third]]))
                self._enter(len(self.faces) - 1, [i, j, face[third]])

    def _clusters(self) -> dict[int, set[int]]:
        """For each sewn vertex all vertices that it is sewn together with, itself included."""
        out: dict[int, set[int]] = {}
        for v, w in self.pairs:
            _unite(out, v, w)
        return out

    def _adjacent(self, some: set[int], others: set[int]) -> bool:
        """Whether an edge joins two sets of vertices."""
        return any(_key(i, j) in self.of for i in some for j in others)

    def _border(self) -> dict[int, list[int]]:
        """Neighbours of each vertex along borders."""
        out: dict[int, list[int]] = defaultdict(list)
        for (i, j), of in self.of.items():
            if len(of) == 1:
                out[i].append(j)
                out[j].append(i)
        return out

    def _split_opposite(self) -> None:
        """Splits edges whose ends are sewn to places between which another side has vertices of its own, sewn or not."""
        before = -1
        while before < len(self.x):
            before, clusters, border = len(self.x), self._clusters(), self._border()
            for p, q in [edge for edge, of in list(self.of.items()) if len(of) == 1]:
                for start in clusters.get(p, {p}) - {p}:
                    for step in border[start]:
                        on = self._between(start, step, clusters, border, p, q)
                        if on:
                            self._split(p, q, on)
                            clusters = self._clusters()

    def _between(self, start: int, step: int, clusters: dict[int, set[int]], border: dict[int, list[int]], p: int, q: int
                 ) -> list[tuple[float, int]]:
        """The vertices along a border from `start`, sewn to p, by `step` to one sewn to q, with their places on the edge
        between p and q."""
        way, ends = [start, step], clusters.get(q, set())
        while way[-1] not in ends and len(way) <= LONGEST:
            onward = [i for i in border[way[-1]] if i not in way]
            if not onward:
                return []
            way.append(onward[0])
        if len(way) < 3 or way[-1] not in ends or not self.of[_key(p, q)]:
            return []
        length = np.cumsum([np.linalg.norm(self.x[j] - self.x[i]) for i, j in zip(way[:-1], way[1:])])
        if any(v in clusters for v in way[1:-1]) and length[-1] > LONGER * np.linalg.norm(self.x[p] - self.x[q]):
            return []
        return [(float(s / length[-1]), v) for s, v in zip(length[:-1], way[1:-1])]

    def _garment(self) -> Garment:
        clusters, notes = self._clusters(), []
        kept = [(f, u) for f, u in zip(self.faces, self.uv) if f is not None and not any(
            j in clusters.get(i, ()) for i, j in zip(f, f[1:] + f[:1]))]
        lost = sum(f is not None for f in self.faces) - len(kept)
        if lost:
            notes.append(f"{lost} triangles, two corners of which are sewn to each other, were taken out")
        faces, corner = np.array([f for f, _ in kept]), np.array([u for _, u in kept])
        uv = np.zeros((len(self.x), 2))
        uv[faces] = corner
        own = np.abs(uv[faces] - corner).max() < 1e-9
        used = np.unique(faces)
        groups = {name: np.intersect1d(np.array(sorted(members)), used) for name, members in self.groups.items()}
        mesh = TriMesh(np.array(self.x), faces, uv if own else corner, groups, tuple(notes))
        seams = tuple(self._seams(clusters, faces, set(used.tolist())))
        return Garment(mesh, seams) if self.draped is None else Garment(mesh, seams, np.array(self.draped))

    def _seams(self, clusters: dict[int, set[int]], faces: np.ndarray, used: set[int]) -> list[SewnRows]:
        """Edges that are sewn to each other, and vertices that are but belong to no such edge."""
        count: dict[tuple[int, int], int] = defaultdict(int)
        for f in faces.tolist():
            for i, j in zip(f, f[1:] + f[:1]):
                count[_key(i, j)] += 1
        edges = [edge for edge, n in count.items() if n == 1 and edge[0] in clusters and edge[1] in clusters]
        by_ends: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
        for p, q in edges:
            ends = min(clusters[p]), min(clusters[q])
            by_ends[_key(*ends)].append((p, q) if ends[0] <= ends[1] else (q, p))
        rows: list[SewnRows] = []
        joined: set[tuple[int, int]] = set()
        for same in by_ends.values():
            for (p, q), (r, s) in zip(same[:-1], same[1:]):
                if (p, q) == (r, s):
                    continue
                rows.append(SewnRows(np.array([p, q]), np.array([r, s])))
                joined |= {_key(p, r), _key(q, s)}
        rest = [(v, w) for v, w in self.pairs if v != w and v in used and w in used and _key(v, w) not in joined]
        return rows + [SewnRows(np.array([v]), np.array([w])) for v, w in rest]


def _unite(clusters: dict[int, set[int]], v: int, w: int) -> None:
    """Two vertices are sewn together."""
    both = clusters.get(v, {v}) | clusters.get(w, {w})
    for i in both:
        clusters[i] = both


def _key(i: int, j: int) -> tuple[int, int]:
    return (i, j) if i < j else (j, i)
