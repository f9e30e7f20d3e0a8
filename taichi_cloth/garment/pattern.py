"""A sewing pattern: panels in the plane, their places round the body, and stitches between their edges."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from .. import checks
from ..errors import SceneError, shown
from ..scene.garment import Garment, SewnRows
from ..scene.mesh import TriMesh
from ..scene.units import TYPICAL
from .curves import Curve
from .mesher import contains, crossing, mesh_polygon, near_line, pieces_of, refuse_too_many, signed_area
from .stitch import End, Line, Stitch, is_point, line_divided, line_length, place_of

MOST_RATIO = 3.0  # of the lengths of two edges that are sewn to each other
LEAST, MOST = 0.02, 10.0  # m that a pattern may be wide or tall where it hangs
UNITS = {10: ("millimetres", "centimetres"), 100: ("centimetres", "metres"), 1000: ("millimetres", "metres")}  # by their ratio
NO_AREA = 1e-9  # of the square of a panel's size
PIECES = 48  # of a curve, where panels are looked at for crossings
SAME = 9  # digits of coordinates [m] of places that are one


@dataclass(frozen=True)
class Panel:
    """A piece of cloth, cut out along a closed line.

    Attributes:
        corners: (k, 2) [m].
        edges: k curves, each from the end of the one before.
        translation: (3,) [m]; rotation: (3, 3): where (u, v, 0) hangs.
        round_radius: [m] the panel is bent round its v axis, as a sleeve round an arm; 0 leaves it flat.
        grain: [rad] from its u axis to the warp, to the left: pi / 2 where the warp runs down.
    """

    name: str
    corners: np.ndarray
    edges: tuple[Curve, ...]
    translation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    round_radius: float = 0.0
    grain: float = 0.0

    def __post_init__(self) -> None:
        what, set_ = f"panel {checks.name('panel name', self.name)!r}: ", object.__setattr__
        set_(self, "corners", checks.array(what + "corners", self.corners, ("n", 2), row="corner"))
        if not isinstance(self.edges, (list, tuple)):
            raise SceneError(f"{what}edges = {shown(self.edges)}: must be Curve objects in a tuple")
        set_(self, "edges", tuple(checks.instance(what + "edge", e, Curve) for e in self.edges))
        set_(self, "translation", checks.vector(what + "translation", self.translation, "m"))
        R = checks.array(what + "rotation", self.rotation, (3, 3))
        if not (np.allclose(R @ R.T, np.eye(3), atol=1e-6) and np.linalg.det(R) > 0):
            raise SceneError(f"{what}the matrix is not a rotation")
        set_(self, "rotation", R)
        set_(self, "round_radius", checks.number(what + "round_radius", self.round_radius, "m", least=0.0))
        set_(self, "grain", checks.number(what + "grain", self.grain, "rad"))
        last = max((max(e.start, e.end) for e in self.edges), default=-1)
        if last >= len(self.corners):
            raise SceneError(f"{what}an edge ends at corner {last}; there are {len(self.corners)}")
        for k, edge in enumerate(self.edges):
            if self.edges[k - 1].end != edge.start:
                raise SceneError(f"panel {self.name!r}: edge {k} begins at corner {edge.start}, and the edge before ends at "
                                 f"corner {self.edges[k - 1].end}: edges go round, each from where the last one ends")
        if len(self.edges) < 2 or len({e.start for e in self.edges}) < len(self.edges):
            raise SceneError(f"panel {self.name!r}: its edges are not a closed line through {len(self.edges)} corners")
        self._refuse_crossings()

    def __repr__(self) -> str:
        return f"<Panel {self.name!r} with {len(self.edges)} edges>"

    def outline(self) -> tuple[np.ndarray, np.ndarray]:
        """(k, 2) [m] points of the border as it is drawn, and (k,) number of the edge that goes on from each."""
        lines = [e.drawn(self.corners, PIECES)[:-1] for e in self.edges]
        return np.concatenate(lines), np.repeat(np.arange(len(lines)), [len(line) for line in lines])

    def refuse_outside(self, what: str, line: Line) -> None:
        """Refuses points, or a line through them, that are not within the panel; corners are."""
        border = self.outline()[0]
        size = float(np.ptp(border, axis=0).max())
        points = np.array(line)
        corner = (np.abs(points[:, None] - self.corners).max(axis=2) < 10.0**-SAME).any(axis=1)
        within = contains(border, points) & ~near_line(pieces_of(border), points, 1e-6 * size)
        if not (corner | within).all():
            u, v = points[~(corner | within)][0]
            raise SceneError(f"{what}: ({u:.4g}, {v:.4g}) m is not within panel {self.name!r}, nor a corner of it: it reaches "
                             f"from {border.min(axis=0).round(4).tolist()} to {border.max(axis=0).round(4).tolist()} m")
        fine = line_divided(line, PIECES * len(line))[1:-1]
        out = fine[~contains(border, fine)]
        if len(out):
            raise SceneError(f"{what}: the line leaves panel {self.name!r} near {out[0].round(4).tolist()} m")

    def _refuse_crossings(self) -> None:
        points, edge = self.outline()
        crossed = crossing(points)
        if crossed is not None:
            one, other = (int(edge[i]) for i in crossed)
            what = f"edge {one} crosses itself" if one == other else f"edges {one} and {other} cross or touch"
            raise SceneError(f"panel {self.name!r}: {what} near {points[crossed[0]].round(4).tolist()} m: the border must "
                             "not meet itself")
        if abs(signed_area(points)) <= NO_AREA * float(np.ptp(points, axis=0).max()) ** 2:
            raise SceneError(f"panel {self.name!r}: its border encloses no area")

    def placed(self, uv: np.ndarray) -> np.ndarray:
        """(n, 3) [m] of pattern coordinates (n, 2)."""
        flat = np.insert(uv, 2, 0.0, axis=1)
        if self.round_radius > 0:
            angle = uv[:, 0] / self.round_radius
            flat[:, 0], flat[:, 2] = self.round_radius * np.sin(angle), self.round_radius * np.cos(angle)
        return flat @ self.rotation.T + self.translation


    def material(self, uv: np.ndarray) -> np.ndarray:
        """(n, 2) [m] along warp and weft, of pattern coordinates (n, 2)."""
        if self.grain == 0:
            return uv
        c, s = math.cos(self.grain), math.sin(self.grain)
        return uv @ np.array([[c, -s], [s, c]])


@dataclass(frozen=True)
class Pattern:
    """Panels and stitches.

    Attributes:
        notes: remarks of the reader on the file, one sentence each; meshes repeat them.

    Raises:
        SceneError: a stitch that names no edge, an edge that is sewn twice, or edges whose lengths do not fit.
    """

    panels: tuple[Panel, ...]
    stitches: tuple[Stitch, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, kind in (("panels", Panel), ("stitches", Stitch), ("notes", str)):
            several = getattr(self, name)
            if not isinstance(several, (list, tuple)):
                raise SceneError(f"pattern: {name} = {shown(several)}: must be {kind.__name__} objects in a tuple")
            object.__setattr__(self, name, tuple(checks.instance(f"pattern: {name}", one, kind) for one in several))
        if not self.panels:
            raise SceneError("pattern: has no panels")
        by_name = {p.name: p for p in self.panels}
        if len(by_name) < len(self.panels):
            twice = next(name for name, many in Counter(p.name for p in self.panels).items() if many > 1)
            raise SceneError(f"pattern: two panels have one name, {twice!r}")
        seen: dict[End, int] = {}
        for k, stitch in enumerate(self.stitches):
            if stitch.a == stitch.b:
                raise SceneError(f"stitch {k}: sews {place_of(stitch.a)} to itself")
            for end in (stitch.a, stitch.b):
                self._refuse_end(k, end, by_name)
                if end in seen and not is_point(end):
                    raise SceneError(f"{place_of(end)} is sewn twice, by stitches {seen[end]} and {k}")
                seen[end] = k
            one, other = (self._long(end) for end in (stitch.a, stitch.b))
            if max(one, other) > MOST_RATIO * min(one, other):
                raise SceneError(f"stitch {k}: {place_of(stitch.a)} is {one:.4g} m long and {place_of(stitch.b)} {other:.4g} "
                                 f"m: more than {MOST_RATIO:g} to 1 is not a gathering")
            self._refuse_folded(k, stitch)
        self._refuse_units()

    def __repr__(self) -> str:
        return f"<Pattern of {len(self.panels)} panels, {len(self.stitches)} stitches>"

    def _refuse_end(self, k: int, end: End, by_name: dict[str, Panel]) -> None:
        """Refuses an end of a stitch that names no panel, no edge of it, or no place within it."""
        name, place = end
        if name not in by_name:
            raise SceneError(f"stitch {k}: there is no panel {name!r}; there are {', '.join(by_name)}")
        if isinstance(place, tuple):
            by_name[name].refuse_outside(f"stitch {k}", place)
        elif not 0 <= place < len(by_name[name].edges):
            raise SceneError(f"stitch {k}: panel {name!r} has no edge {place}; it has {len(by_name[name].edges)}")

    def _long(self, end: End) -> float:
        """Length [m] of an edge or a line; of a point 0."""
        name, place = end
        return line_length(place) if isinstance(place, tuple) else self.length(name, place)

    def _refuse_folded(self, k: int, stitch: Stitch) -> None:
        """Refuses a stitch that sews the corner that two edges share to both their other ends."""
        (name, a), (also, b) = stitch.a, stitch.b
        if stitch.together and name == also and not isinstance(a, tuple) and not isinstance(b, tuple):
            edges = next(p for p in self.panels if p.name == name).edges
            one, other = edges[a], edges[b]
            if one.end == other.start or other.end == one.start:
                raise SceneError(f"stitch {k}: edges {a} and {b} of panel {name!r} share a corner and are "
                                 "sewn the same way round, which closes each onto itself: sew them start to end")

    def _refuse_units(self) -> None:
        size = float(np.ptp(np.concatenate([p.placed(p.outline()[0]) for p in self.panels]), axis=0).max())
        if LEAST <= size <= MOST:
            return
        ratio = min(UNITS, key=lambda r: abs(math.log((size / r if size > MOST else size * r) / TYPICAL)))
        meant, taken = UNITS[ratio] if size > MOST else UNITS[ratio][::-1]
        raise SceneError(f"the pattern is {size:.3g} m large where it hangs: are its units right? It looks like {meant} taken "
                         f"for {taken}")

    def length(self, panel: str, edge: int) -> float:
        """Length of an edge [m]."""
        p = next(p for p in self.panels if p.name == panel)
        return p.edges[edge].length(p.corners)

    def with_panel(self, panel: Panel) -> Pattern:
        """The pattern with a panel in the place of the one of its name."""
        return replace(self, panels=tuple(panel if p.name == panel.name else p for p in self.panels))

    def wrap(self, panel: str, around: ArrayLike, radius: float | None = None, turn: float = 0.0,
             gap: float = 0.02) -> Pattern:
        """The pattern with a panel bent round a part of the body, as a sleeve round an arm.

        Its middle comes to the middle of the axis, its v axis along it, upward.

        Args:
            around: (2, 3) ends of the axis [m], or (n, 3) points of the part, more than two, whose axis and radius are taken.
            radius: at which it is bent [m]; of the points, if None, the farthest's from their axis and `gap` more.
            turn: where round the axis its middle is [rad]; 0 is the side of +z.

        Raises:
            SceneError: no such panel, no radius with an axis, or a panel wider than the way round.
        """
        old = next((p for p in self.panels if p.name == panel), None)
        if old is None:
            raise SceneError(f"wrap: there is no panel {panel!r}; there are {', '.join(p.name for p in self.panels)}")
        points = checks.array("wrap: around", around, ("n", 3), row="point")
        low, high, reach = axis_of(points)
        if radius is None and len(points) == 2:
            raise SceneError("wrap: an axis needs a radius")
        r = reach + checks.number("wrap: gap", gap, "m", least=0.0) if radius is None else checks.number(
            "wrap: radius", radius, "m", positive=True)
        border = old.outline()[0]
        (left, bottom), (right, top) = border.min(axis=0), border.max(axis=0)
        if right - left > 2 * math.pi * r:
            raise SceneError(f"wrap: panel {panel!r} is {right - left:.3g} m wide, and the way round is "
                             f"{2 * math.pi * r:.3g} m")
        v = (high - low) / np.linalg.norm(high - low)
        front = np.array([0.0, 0.0, 1.0]) if abs(v[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
        front = front - (front @ v) * v
        front /= np.linalg.norm(front)
        frame = np.column_stack([np.cross(v, front), v, front])
        a = checks.number("wrap: turn", turn, "rad") - (left + right) / (2 * r)
        own = np.array([[math.cos(a), 0, math.sin(a)], [0, 1, 0], [-math.sin(a), 0, math.cos(a)]])
        at = (low + high) / 2 - v * (bottom + top) / 2
        return self.with_panel(replace(old, rotation=frame @ own, translation=at, round_radius=r))

    def _in_one_place(self) -> tuple[str, ...]:
        """A note on the first two panels that hang in the same plane at the same place, in each other."""
        for k, b in enumerate(self.panels):
            for a in self.panels[:k]:
                if (a.translation == b.translation).all() and (a.rotation == b.rotation).all():
                    low, high = (np.stack([f(p.outline()[0], axis=0) for p in (a, b)]) for f in (np.min, np.max))
                    if (low.max(axis=0) < high.min(axis=0)).all():
                        return (f"panels {a.name!r} and {b.name!r} hang in one place, in each other: place them, in the "
                                "side file of a drawing, or by their `translation` and `rotation`",)
        return ()

    def mesh(self, spacing: float) -> Garment:
        """The garment in triangles with edges about `spacing` [m] long.

        Edges and lines that are sewn to each other have as many points, and the mesh has vertices and edges there.

        Raises:
            MeshError: a panel that crosses itself, or has no triangles of that size; a spacing that makes too many.
        """
        spacing = checks.number("spacing", spacing, "m", positive=True)
        length: dict[End, float] = {(p.name, k): e.length(p.corners) for p in self.panels for k, e in enumerate(p.edges)}
        length |= {end: self._long(end) for s in self.stitches for end in (s.a, s.b)}
        area = sum(abs(signed_area(p.outline()[0])) for p in self.panels)
        refuse_too_many("the pattern", spacing, area, sum(length.values()), len(length))
        count = {edge: max(1, math.ceil(long / spacing - 1e-6)) for edge, long in length.items()}
        for stitch in self.stitches:
            count[stitch.a] = count[stitch.b] = max(count[stitch.a], count[stitch.b])
        x, uv, faces, start = [], [], [], 0
        labels: dict[str, list[np.ndarray]] = {}
        groups: dict[str, np.ndarray] = {}
        rows: dict[End, np.ndarray] = {}
        for panel in self.panels:
            lines = [edge.divided(panel.corners, count[panel.name, k]) for k, edge in enumerate(panel.edges)]
            border = np.concatenate([line[:-1] for line in lines])
            within = {end: line_divided(end[1], count[end]) for end in count
                      if end[0] == panel.name and isinstance(end[1], tuple)}
            numbers, inside, pieces = _numbered(border, list(within.values()))
            points, triangles = mesh_polygon(border, spacing, panel.name, inside, pieces)
            rows |= {end: start + row for end, row in zip(within, numbers)}
            at = start
            for k, (edge, line) in enumerate(zip(panel.edges, lines)):
                row = start + (at - start + np.arange(len(line))) % len(border)
                rows[panel.name, k] = row
                at += len(line) - 1
                if edge.label:
                    labels.setdefault(edge.label, []).append(row)
            groups[panel.name] = start + np.arange(len(points))
            uv.append(panel.material(points))
            x.append(panel.placed(points))
            faces.append(triangles + start)
            start += len(points)
        for label, index in labels.items():
            groups[label] = np.unique(np.concatenate([*index, groups.get(label, index[0])]))
        seams = tuple(SewnRows(rows[s.a], rows[s.b] if s.together else rows[s.b][::-1], s.rest, s.stiffness, s.strength)
                      for s in self.stitches)
        parts = np.concatenate(x), np.concatenate(faces), np.concatenate(uv), groups
        notes = self.notes + self._in_one_place() + Garment(TriMesh(*parts), seams).loose()
        return Garment(TriMesh(*parts, notes), seams)


def _numbered(border: np.ndarray, lines: list[np.ndarray]) -> tuple[list[np.ndarray], np.ndarray, np.ndarray]:
    """Points of lines (k, 2) in a panel, those in one place merged.

    Returns:
        (numbers (k,) of each line's points, counted along the border and then inside; the points inside (j, 2); pairs (p, 2)
        of numbers of points that follow each other).
    """
    number = {key: k for k, key in enumerate(map(tuple, border.round(SAME).tolist()))}
    inside: list[np.ndarray] = []
    rows = []
    for line in lines:
        row = []
        for point, key in zip(line, map(tuple, line.round(SAME).tolist())):
            if key not in number:
                number[key] = len(border) + len(inside)
                inside.append(point)
            row.append(number[key])
        rows.append(np.array(row))
    pairs = np.concatenate([np.zeros((0, 2), dtype=np.int64), *(np.column_stack([row[:-1], row[1:]]) for row in rows)])
    return rows, np.array(inside).reshape(-1, 2), pairs


def axis_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(lower end (3,), upper end (3,), largest distance from it) of the axis along which points (n, 3) [m] lie.

    Raises:
        SceneError: no points, or all in one place.
    """
    if not len(points):
        raise SceneError("wrap: the part of the body has no points")
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    v = np.linalg.svd(points - points.mean(axis=0))[2][0]
    v = v if v[1] >= 0 else -v
    along = (points - middle) @ v
    if not np.ptp(along) > 0:
        raise SceneError("wrap: the part of the body is a single point")
    away = points - middle - along[:, None] * v
    return middle + along.min() * v, middle + along.max() * v, float(np.linalg.norm(away, axis=1).max())
