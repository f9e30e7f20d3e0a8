"""A meshed garment with triangles of another size: borders are divided anew, all layers of a seam alike. Needs SciPy.

Borders are cut into segments at corners: where they turn, where a seam or a label begins or ends, where the edges
sewn there change, and where another layer has a corner. Every segment is then sewn along its whole length to whole segments,
or not at all.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..backend.ordering import components
from ..errors import MeshError, SceneError
from ..scene.boxes import near
from ..scene.garment import Garment, SewnRows
from ..scene.mesh import TriMesh, face_edges
from .mesher import mesh_polygon, refuse_too_many

TURN = math.radians(20)  # by which a border turns at a corner, at least
TRIES = 8  # in which parts are added where a seam would close a triangle
FLAT = 0.02  # of two triangles' area that each has at least where the edge between them is flipped
INSIDE = 1e-6  # weight of a vertex in a triangle that counts

Edge = tuple[int, int]


@dataclass(eq=False)
class Segment:
    """A part of a panel's border from corner to corner.

    Attributes:
        way: vertices, both ends among them.
        sewn: key shared with the segments that are sewn to it; None if there are none.
        rows: new vertices.
    """

    way: list[int]
    sewn: tuple | None
    rows: np.ndarray

    @property
    def key(self) -> tuple | int:
        """By which those are known that have as many parts."""
        return self.sewn or id(self)


def remesh(garment: Garment, spacing: float) -> Garment:
    """The garment with triangles whose edges are about `spacing` [m] long in the pattern.

    Seams, groups, where panels hang and where a dressed garment is are kept; between vertices they are interpolated.

    Raises:
        SceneError: a panel with a hole, panels that share vertices, or a seam along a line within a panel.
        MeshError: SciPy is missing, or the spacing is too large for the shape of a panel, or makes too many vertices.
    """
    checks.instance("remesh: garment", garment, Garment)
    spacing = checks.number("remesh: spacing", spacing, "m", positive=True)
    return _Remeshed(garment).made(spacing)


class _Remeshed:
    """Borders of a garment's panels, in segments."""

    def __init__(self, garment: Garment) -> None:
        self.garment, self.mesh = garment, garment.mesh
        uv, faces = self.mesh.vertex_uv, self.mesh.faces
        if uv is None:
            raise SceneError("remesh: vertices have several places in the pattern: panels must not share vertices")
        self.uv = uv
        n = self.mesh.vertex_count
        self.panel = _panels(self.mesh)
        self.cluster = _joined(n, garment.seams)
        self.along = _joined(n, [seam for seam in garment.seams if len(seam.a) > 1])  # without single stitches
        self.members = np.bincount(self.cluster)  # of each cluster
        self.loops = self._loops(face_edges(faces)[list(self.mesh.border_edges.values())].tolist())
        self._refuse_inside()
        self.like: dict[int, SewnRows] = {}  # of a class of edges that are sewn to each other, a seam
        self.sewn = self._sewn_edges()
        self.size: dict[int, int] = defaultdict(int)
        for edge_class in self.sewn.values():
            self.size[edge_class] += 1

    def _refuse_inside(self) -> None:
        """Refuses a seam along a line within a panel: borders alone are divided anew."""
        border = {v for loop in self.loops for v in loop}
        for k, seam in enumerate(self.garment.seams):
            within = [v for row in (seam.a, seam.b) if len(row) > 1 for v in row.tolist() if v not in border]
            if within:
                raise SceneError(f"remesh: seam {k} is sewn to a line within panel {self.garment.panel_of(within[0])!r}: mesh "
                                 "its pattern with the other spacing, by Pattern.mesh")

    def made(self, spacing: float) -> Garment:
        """The garment meshed anew.

        If two corners of a triangle are sewn to each other, which would close it to a line, the edge between them is
        flipped. If it cannot be, the segments between them on the border get more parts.
        """
        corners = self._corners()
        segments = [self._segments(loop, corners) for loop in self.loops]
        border = sum(float(self._lengths(s.way).sum()) for some in segments for s in some)
        refuse_too_many("remesh", spacing, float(self.mesh.material_areas.sum()), border, sum(map(len, segments)))
        count: dict[tuple | int, int] = {}
        for segment in (s for some in segments for s in some):
            parts = math.ceil(float(self._lengths(segment.way).sum()) / spacing - 1e-6)
            count[segment.key] = max(count.get(segment.key, 1), parts)
        for _ in range(TRIES):
            made = self._meshed(segments, count, spacing)
            joined = _joined(made.mesh.vertex_count, made.seams)
            faces, pairs = _flipped(made.mesh.uv, made.mesh.faces, joined)
            if not pairs:
                m = made.mesh
                return Garment(TriMesh(m.x, faces, m.uv, m.groups, m.notes), made.seams, made.positions)
            short = {s.key for some in segments for pair in pairs for s in self._between(some, *pair)}
            for key in short:
                count[key] += 1
            if not short:
                break
        at = made.mesh.uv[list(pairs.pop())].mean(axis=0).round(4).tolist()
        raise MeshError(f"remesh: two corners of a triangle near {at} m of the pattern are sewn to each other: take a smaller "
                        "spacing")

    def _between(self, some: list[Segment], i: int, j: int) -> list[Segment]:
        """Segments of a panel on the shorter way from corner i to corner j; where they are none, those that they are on."""
        at = [int(s.rows[0]) for s in some]
        if i not in at or j not in at:
            return [s for s in some if (s.rows == i).any() or (s.rows == j).any()]
        first, last = sorted((at.index(i), at.index(j)))
        ways = some[first:last], some[last:] + some[:first]
        return min(ways, key=lambda way: sum(float(self._lengths(s.way).sum()) for s in way))

    def _meshed(self, segments: list[list[Segment]], count: dict[tuple | int, int], spacing: float) -> Garment:
        """The garment with as many parts of each segment as that."""
        x: list[np.ndarray] = []
        positions: list[np.ndarray] = []
        uv, faces, start = [], [], 0
        kept = [np.zeros((0, 2), dtype=np.int64)]  # old vertex, new one
        groups: dict[str, list[np.ndarray]] = {name: [] for name in self.mesh.groups}
        whole = {name: np.isin(np.arange(self.mesh.vertex_count), index) for name, index in self.mesh.groups.items()}
        for some in segments:
            panel = self.panel[some[0].way[0]]
            lines = [self._divided(s.way, count[s.key]) for s in some]
            border = np.concatenate([line[:-1] for line in lines])
            points, triangles = self._mesh(border, spacing, self.garment.panel_of(panel))
            at = 0
            for s, line in zip(some, lines):
                s.rows = start + (at + np.arange(len(line))) % len(border)
                kept.append(np.array([[s.way[0], s.rows[0]]]))
                at += len(line) - 1
            corner, weight = self._located(points, np.flatnonzero(self.panel[self.mesh.faces[:, 0]] == panel), spacing)
            for made, of in ((x, self.mesh.x), (positions, self.garment.positions)):
                made.append(np.einsum("nk,nkd->nd", weight, of[corner]))
            for name, has in whole.items():
                groups[name].append(start + np.flatnonzero((has[corner] | (np.abs(weight) < INSIDE)).all(axis=1)))
            uv.append(points)
            faces.append(triangles + start)
            start += len(points)
        parts = (np.concatenate(x), np.concatenate(faces), np.concatenate(uv),
                 {name: np.concatenate(index) for name, index in groups.items()})
        mesh = TriMesh(*parts)
        seams = self._rows([s for some in segments for s in some])
        single, lost = self._single(seams, dict(np.concatenate(kept).tolist()), mesh)
        if lost:
            mesh = TriMesh(*parts, (f"{lost} single stitches are left out: their vertices would be in one triangle",))
        return Garment(mesh, (*seams, *single), np.concatenate(positions))

    def _loops(self, edges: list[Edge]) -> list[list[int]]:
        """The border of each panel, its vertices in order."""
        onward: dict[int, int] = {}
        for i, j in edges:
            if i in onward:
                raise SceneError(f"remesh: the border of panel {self.garment.panel_of(i)!r} touches itself at vertex {i}")
            onward[i] = j
        loops: dict[int, list[int]] = {}
        while onward:
            start, j = onward.popitem()
            loop = [start]
            while j != start:
                loop.append(j)
                if j not in onward:
                    raise SceneError(f"remesh: triangles of panel {self.garment.panel_of(j)!r} are turned to both sides")
                j = onward.pop(j)
            panel = int(self.panel[start])
            if panel in loops:
                raise SceneError(f"remesh: panel {self.garment.panel_of(panel)!r} has a hole")
            loops[panel] = loop
        return [loops[panel] for panel in sorted(loops)]

    def _sewn_edges(self) -> dict[Edge, int]:
        """Class number of each border edge that is sewn to others."""
        edges = {_key(i, j): k for k, (i, j) in enumerate(e for loop in self.loops for e in zip(loop, loop[1:] + loop[:1]))}
        pairs, like = [], {}
        for seam in self.garment.seams:
            a, b = seam.a.tolist(), seam.b.tolist()
            for one, other in zip(zip(a[:-1], a[1:]), zip(b[:-1], b[1:])):
                k, m = edges.get(_key(*one)), edges.get(_key(*other))
                if k is not None and m is not None and k != m:
                    pairs.append((k, m))
                    like[k] = seam
        both = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        label = components(len(edges), both[:, 0], both[:, 1])
        self.like = {int(label[k]): seam for k, seam in like.items()}
        sewn = np.isin(np.arange(len(edges)), both)
        return {edge: int(label[k]) for edge, k in edges.items() if sewn[k]}

    def _corners(self) -> set[int]:
        """Vertices at which segments end."""
        labels = [np.isin(np.arange(self.mesh.vertex_count), index) for index in self.mesh.groups.values()]
        at = {int(self.cluster[v]) for seam in self.garment.seams if len(seam.a) == 1 for v in (seam.a[0], seam.b[0])
              if self.along[seam.a[0]] != self.along[seam.b[0]]}
        for loop in self.loops:
            for u, v, w in zip(loop[-1:] + loop[:-1], loop, loop[1:] + loop[:1]):
                if (self._turns(u, v, w) or self._changes(u, v, w)
                        or any((has[u] and has[v]) != (has[v] and has[w]) for has in labels)):
                    at.add(int(self.cluster[v]))
        for loop in self.loops:
            if not any(int(self.cluster[v]) in at for v in loop):
                at.add(int(self.cluster[loop[0]]))
        return at

    def _turns(self, u: int, v: int, w: int) -> bool:
        one, other = self.uv[v] - self.uv[u], self.uv[w] - self.uv[v]
        return abs(math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))) > TURN

    def _changes(self, u: int, v: int, w: int) -> bool:
        """Whether more edges are sewn to the one before v than to the one after it, or fewer. If they are as many
        others, another panel has a corner there."""
        before, after = self.sewn.get(_key(u, v)), self.sewn.get(_key(v, w))
        if before is None and after is None:
            return bool(self.members[self.cluster[v]] > 1)  # a single stitch
        return before is None or after is None or self.size[before] != self.size[after]

    def _segments(self, loop: list[int], corners: set[int]) -> list[Segment]:
        first = next(k for k, v in enumerate(loop) if int(self.cluster[v]) in corners)
        loop = loop[first:] + loop[:first + 1]
        ends = [k for k, v in enumerate(loop) if int(self.cluster[v]) in corners]
        out = []
        for i, j in zip(ends[:-1], ends[1:]):
            way = loop[i:j + 1]
            classes = tuple(self.sewn.get(_key(p, q)) for p, q in zip(way[:-1], way[1:]))
            key = None if None in classes else min(classes, classes[::-1])
            out.append(Segment(way, key, np.zeros(0, dtype=np.int64)))
        return out

    def _lengths(self, way: list[int]) -> np.ndarray:
        return np.linalg.norm(np.diff(self.uv[way], axis=0), axis=1)

    def _divided(self, way: list[int], parts: int) -> np.ndarray:
        """(parts + 1, 2) points at equal lengths along a segment."""
        along = np.concatenate([[0.0], np.cumsum(self._lengths(way))])
        at = np.linspace(0, along[-1], parts + 1)
        return np.column_stack([np.interp(at, along, self.uv[way, k]) for k in (0, 1)])

    @staticmethod
    def _mesh(border: np.ndarray, spacing: float, name: str) -> tuple[np.ndarray, np.ndarray]:
        """The mesh of `mesh_polygon`, for borders that go round to either side."""
        p, q = border, np.roll(border, -1, axis=0)
        side = np.sign((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum())
        points, faces = mesh_polygon(border * [side, 1], spacing, name)
        return points * [side, 1], faces

    def _located(self, points: np.ndarray, rows: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
        """(corners (n, 3), weights (n, 3)) of the old triangle that has a point, or that it is least outside of."""
        faces, flat = self.mesh.faces[rows], lambda p: np.insert(p, 2, 0.0, axis=-1)
        corner = self.uv[faces]
        e, f = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
        best, of = np.full(len(points), -np.inf), np.zeros(len(points), dtype=np.int64)
        weight, reach = np.zeros((len(points), 3)), 0.1 * spacing
        while np.isinf(best).any():
            boxes = np.stack([flat(points) - [reach, reach, 0], flat(points) + [reach, reach, 0]], axis=1)
            for i, t in near(boxes, flat(corner)):
                d = points[i] - corner[t, 0]
                v = (d[:, 0] * f[t, 1] - d[:, 1] * f[t, 0]) / area[t]
                w = (e[t, 0] * d[:, 1] - e[t, 1] * d[:, 0]) / area[t]
                some = np.column_stack([1 - v - w, v, w])
                least = some.min(axis=1)
                order = np.argsort(least, kind="stable")  # of several triangles the best comes last
                i, t, some, least = i[order], t[order], some[order], least[order]
                better = least > best[i]
                best[i[better]], of[i[better]], weight[i[better]] = least[better], t[better], some[better]
            reach *= 4
        return faces[of], weight

    def _rows(self, segments: list[Segment]) -> list[SewnRows]:
        """Segments that are sewn to each other, each to the next."""
        together: dict[tuple, list[Segment]] = defaultdict(list)
        for s in segments:
            if s.sewn is not None:
                together[s.sewn].append(s)
        out: list[SewnRows] = []
        for key, same in together.items():
            like = self.like[key[0]]
            for one, other in zip(same[:-1], same[1:]):
                ways = [self.cluster[s.way].tolist() for s in (one, other)]
                out.append(like._replace(a=one.rows, b=other.rows if ways[0] == ways[1] else other.rows[::-1]))
        return out

    def _single(self, seams: list[SewnRows], new: dict[int, int], mesh: TriMesh) -> tuple[list[SewnRows], int]:
        """(single stitches, which no seam joins; how many of them are left out, since both their vertices would be in one
        triangle)."""
        panel, lost = _panels(mesh), 0
        out: list[SewnRows] = []
        first = {int(self.panel[v]): panel[i] for v, i in new.items()}
        corners = face_edges(mesh.faces)
        for seam in (seam for seam in self.garment.seams if len(seam.a) == 1):
            ends = int(seam.a[0]), int(seam.b[0])
            for i in (i for i in ends if i not in new):  # within a panel: the nearest
                there = np.flatnonzero(panel == first[int(self.panel[i])])
                new[i] = int(there[np.linalg.norm(mesh.uv[there] - self.uv[i], axis=1).argmin()])
            joined = _joined(mesh.vertex_count, [*seams, *out])
            v, w = (joined[new[i]] for i in ends)
            if v != w and (np.sort(joined[corners], axis=1) == sorted((v, w))).all(axis=1).any():
                lost += 1
            elif v != w:
                out.append(seam._replace(a=np.array([new[ends[0]]]), b=np.array([new[ends[1]]])))
        return out, lost


def _flipped(uv: np.ndarray, faces: np.ndarray, joined: np.ndarray) -> tuple[np.ndarray, set[Edge]]:
    """(triangles, of whose edges between vertices that are sewn to each other those are flipped that can be; the others)."""
    faces, left = faces.copy(), set()
    i, j = face_edges(faces).T
    for p, q in {_key(*e) for e in face_edges(faces)[joined[i] == joined[j]].tolist()}:
        two = np.flatnonzero((faces == p).any(axis=1) & (faces == q).any(axis=1))
        if len(two) == 2:
            f = np.roll(faces[two[0]], -int(np.flatnonzero(~np.isin(faces[two[0]], (p, q)))[0]))  # its third corner first
            d = int(faces[two[1]][~np.isin(faces[two[1]], (p, q))][0])
            made = np.array([[f[0], f[1], d], [f[0], d, f[2]]])
            corner = uv[np.concatenate([faces[two], made])]
            e, g = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
            area = (e[:, 0] * g[:, 1] - e[:, 1] * g[:, 0]) * np.sign(e[0, 0] * g[0, 1] - e[0, 1] * g[0, 0])
            if area[2:].min() > FLAT * area[:2].sum() and joined[f[0]] != joined[d]:
                faces[two] = made
                continue
        left.add((p, q))
    return faces, left


def _panels(mesh: TriMesh) -> np.ndarray:
    """(n,) the smallest vertex of each one's panel."""
    return components(mesh.vertex_count, *face_edges(mesh.faces).T)


def _joined(n: int, seams: Sequence[SewnRows]) -> np.ndarray:
    """(n,) the smallest of all vertices that are sewn together with each."""
    none = [np.zeros(0, dtype=np.int64)]
    return components(n, np.concatenate([seam.a for seam in seams] + none), np.concatenate([seam.b for seam in seams] + none))


def _key(i: int, j: int) -> Edge:
    return (i, j) if i < j else (j, i)
