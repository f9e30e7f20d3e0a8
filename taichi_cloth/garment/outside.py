"""Panels hung outside worn garments: the distance that each has to go out is found from positions. numpy only.

A panel goes out until each of its vertices is outside the nearest vertex of a worn garment. It goes along the way it faces,
away from the figure; a panel that is bent round a limb is bent wider. Panels that lie over it go out with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..contact.layer_order import facing, nearest, surface_of_solids
from ..errors import SceneError
from ..scene.connected import components
from ..scene.garment import FLAT, Garment
from ..scene.intersections import count_crossings, count_self_crossings
from ..scene.mesh import face_edges
from ..scene.scene import Scene
from ..system.quantities import vertex_normals
from .worn import Worn

NEAR = 1e-2  # part of the distance of layers by which panels may be nearer
ONE_WAY = 0.5  # length of the mean of a panel's normals, below which it faces all ways: one of half a circle has .64


@dataclass(frozen=True)
class Sheet:
    """Vertices x (n, 3) [m] with normals (n, 3) away from the figure, and edges of at most a length [m]."""

    x: np.ndarray
    normal: np.ndarray
    longest: float

    @staticmethod
    def of(garment: Garment, figure: tuple[np.ndarray, np.ndarray] | None) -> Sheet:
        """A garment as it hangs or is worn."""
        x, faces = garment.positions, garment.mesh.faces
        away = facing(faces, x, figure)[:, None] * vertex_normals(x, faces)
        return Sheet(x, away, _longest(x, faces))

    def worn(self) -> Sheet:
        """The vertices that have triangles."""
        return self.part(np.flatnonzero(self.normal.any(axis=1)))

    def part(self, rows: np.ndarray) -> Sheet:
        """Some of it."""
        return Sheet(self.x[rows], self.normal[rows], self.longest)


class Flat:
    """A panel that goes out along the way it faces."""

    def __init__(self, sheet: Sheet) -> None:
        self.sheet = sheet
        mean = sheet.normal.mean(axis=0)
        long = float(np.linalg.norm(mean))
        self.out = mean / long if long > ONE_WAY else np.zeros(3)

    def lies_over(self, under: Flat) -> bool:
        """Whether some of it is over another panel that faces the same way, or beside it in its plane."""
        across = np.linalg.svd(under.out[None])[2][1:]
        x, own = self.sheet.x @ across.T, under.sheet.x @ across.T
        near = nearest(x, own)
        there = np.linalg.norm(x - own[near], axis=1) < self.sheet.longest + under.sheet.longest
        height = (self.sheet.x - under.sheet.x[near]) @ under.out
        return bool(self.out @ under.out > 0 and (height[there] >= -FLAT * self.sheet.longest).any())

    def moved(self, by: float) -> tuple[np.ndarray, np.ndarray]:
        """Its vertices (n, 3), that far out, and the ways out there (n, 3)."""
        return self.sheet.x + by * self.out, np.broadcast_to(self.out, self.sheet.x.shape)


class Bent:
    """A panel that is bent round an axis through `middle`, at a radius [m]; axes (3, 3): across, across, along."""

    def __init__(self, sheet: Sheet, middle: np.ndarray, axes: np.ndarray, radius: float) -> None:
        self.sheet, self.middle, self.radius = sheet, middle, radius
        along = axes[2]
        off = (sheet.x - middle) @ axes[:2].T
        angle = np.sort(np.arctan2(off[:, 1], off[:, 0]))
        gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
        k = int(gaps.argmax())
        front = angle[k] + gaps[k] / 2 + np.pi  # opposite the middle of the opening
        first = np.cos(front) * axes[0] + np.sin(front) * axes[1]
        self.axes = np.stack([first, np.cross(along, first), along])

    @staticmethod
    def found(sheet: Sheet, uv: np.ndarray) -> Bent | None:
        """The panel, where it is bent so; uv: (n, 2) the pattern's coordinates."""
        tube = tube_of(sheet.x, uv)
        if tube is None:
            return None
        middle, axes, radius = tube
        if np.einsum("ki,ki->", (sheet.x - middle) @ axes[:2].T @ axes[:2], sheet.normal) <= 0:
            return None  # the limb would be outside
        return Bent(sheet, middle, axes, radius)

    def moved(self, by: float) -> tuple[np.ndarray, np.ndarray]:
        """Vertices and ways out as `Flat.moved` gives them, bent wider by that much; no length changes."""
        a, b, s = self.axes @ (self.sheet.x - self.middle).T
        angle, r = np.arctan2(b, a) * self.radius / (self.radius + by), np.hypot(a, b) + by
        ways = np.cos(angle)[:, None] * self.axes[0] + np.sin(angle)[:, None] * self.axes[1]
        return self.middle + r[:, None] * ways + s[:, None] * self.axes[2], ways


def tube_of(x: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray, float] | None:
    """(a place (3,) on the axis, axes (3, 3): across, across, along, radius [m]) of the tube that a panel with vertices x
    (n, 3) is part of; None where it is bent another way. Along the axis places are linear in the pattern's uv (n, 2)."""
    linear = np.column_stack([uv, np.ones(len(uv))])
    bulge = x - linear @ np.linalg.lstsq(linear, x, rcond=None)[0]
    if np.abs(bulge).max() <= FLAT * np.ptp(uv, axis=0).min():
        return None
    axes = np.linalg.svd(bulge, full_matrices=False)[2]
    flat = x @ axes[:2].T
    a, b, c = np.linalg.lstsq(np.column_stack([flat, np.ones(len(x))]), (flat**2).sum(axis=1), rcond=None)[0]
    centre, radius = np.array([a, b]) / 2, float(np.sqrt(max(c + (a * a + b * b) / 4, 0.0)))
    if np.abs(np.linalg.norm(flat - centre, axis=1) - radius).max() > FLAT * radius:
        return None
    return centre @ axes[:2], axes, radius


def hung_outside(garment: Garment, worn: Sequence[Worn], thickness: float, body: Scene) -> tuple[Garment, tuple[str, ...]]:
    """The garment with its panels outside the worn garments, and a note on each that had to go further out.

    Args:
        thickness: of the garment [m]; it keeps the mean of its own and another's.

    Raises:
        SceneError: a panel that passes through a worn garment, or through another panel, however it is hung.
    """
    figure = surface_of_solids(body)
    inner = [Sheet.of(w.garment, figure).worn() for w in worn]
    keeps = [(thickness + w.contact.thickness) / 2 for w in worn if w.contact is not None]
    hung, notes = hung_by(garment, figure, lambda panel, _: _way_out(panel, inner, keeps), "over", "worn garments")
    _refuse_crossings(hung, count_self_crossings(garment.positions, garment.mesh.faces), worn)
    return hung, notes


def hung_by(garment: Garment, figure: tuple[np.ndarray, np.ndarray] | None,
            way_out: Callable[[Flat | Bent, np.ndarray], float], over: str, what: str) -> tuple[Garment, tuple[str, ...]]:
    """The garment with each panel hung out by its own distance, away from a figure.

    Args:
        way_out: the distance [m] of a panel, from it and its triangles (m, 3); infinite is refused.
        over, what: why a panel went out, for the notes: "over", "worn garments".

    Returns:
        (the garment, a note on each panel that went out).
    """
    whole, edges, faces = Sheet.of(garment, figure), face_edges(garment.mesh.faces), garment.mesh.faces
    label = components(garment.mesh.vertex_count, edges[:, 0], edges[:, 1])
    rows = [np.flatnonzero(label == k) for k in np.unique(label[faces])]
    panels = [_panel(whole.part(r), garment.mesh.vertex_uv, r) for r in rows]
    by = [way_out(panel, np.searchsorted(r, faces[label[faces[:, 0]] == r[0]])) for panel, r in zip(panels, rows)]
    stuck = next((garment.panel_of(int(r[0])) for r, far in zip(rows, by) if np.isinf(far)), None)
    if stuck is not None:
        raise SceneError(f"dress: panel {stuck!r} does not come outside {what} along the way it faces: place it "
                         "outside, by its translation or Garment.moved")
    flat = [k for k, panel in enumerate(panels) if isinstance(panel, Flat)]
    for _ in flat:  # panels that lie over a panel go out with it
        for k in flat:
            by[k] = max([by[k]] + [by[j] for j in flat if by[j] > by[k] and panels[k].lies_over(panels[j])])  # type: ignore
    x, notes = garment.positions.copy(), []
    for panel, r, far in zip(panels, rows, by):
        if far > 0:
            x[r] = panel.moved(far)[0]
            notes.append(f"panel {garment.panel_of(int(r[0]))!r} was hung {100 * far:.2g} cm further out, {over} {what}")
    return replace(garment, positions=x), tuple(notes)


def _longest(x: np.ndarray, faces: np.ndarray) -> float:
    """[m] of the edges of triangles (m, 3)."""
    edges = face_edges(faces)
    return float(np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1).max())


def _panel(sheet: Sheet, uv: np.ndarray | None, rows: np.ndarray) -> Flat | Bent:
    return (None if uv is None else Bent.found(sheet, uv[rows])) or Flat(sheet)


def _way_out(panel: Flat | Bent, inner: Sequence[Sheet], keeps: Sequence[float]) -> float:
    """[m] by which a panel has to go out to keep a distance [m] of each sheet; infinite if it comes to no end."""
    far, widest = 0.0, max(float(np.ptp(sheet.x, axis=0).max()) for sheet in inner)
    while far <= widest:
        lack = max(_lack(*panel.moved(far), panel.sheet.longest, sheet, keep) for sheet, keep in zip(inner, keeps))
        if lack <= NEAR * min(keeps):
            return far
        far += lack
    return float("inf")


def _lack(x: np.ndarray, ways: np.ndarray, longest: float, sheet: Sheet, keeps: float) -> float:
    """Distance [m] by which a panel is too near to a sheet, its vertices above the sheet and the sheet's below the panel.

    Args:
        x: (n, 3) vertices of the panel [m]; ways: (n, 3) its ways out; longest: of its edges [m].
        keeps: distance [m] that they should keep.
    """
    near = nearest(x, sheet.x)
    height, beside = _over(x - sheet.x[near], sheet.normal[near])
    lack = float((keeps - height)[beside < sheet.longest].max(initial=0.0))
    near = nearest(sheet.x, x)
    height, beside = _over(sheet.x - x[near], ways[near])
    pokes = (beside < longest) & (height < longest) & (np.einsum("ki,ki->k", sheet.normal, ways[near]) > 0)
    return max(lack, float((height + keeps)[pokes].max(initial=0.0)))


def _over(off: np.ndarray, normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(heights (k,), distances beside the normals (k,)) of offsets (k, 3) from places with normals (k, 3) [m]."""
    height = np.einsum("ki,ki->k", off, normal)
    return height, np.linalg.norm(off - height[:, None] * normal, axis=1)


def _refuse_crossings(hung: Garment, before: int, worn: Sequence[Worn]) -> None:
    x, faces = hung.positions, hung.mesh.faces
    for w in worn:
        count = count_crossings(x, faces, w.garment.positions, w.garment.mesh.faces)
        if count:
            raise SceneError(f"dress: panels start through {w.name!r}, in {count} pairs of an edge and a triangle, however "
                             "far out they hang: place them round it, by their translation or Garment.moved")
    count = count_self_crossings(x, faces)
    if count > before:
        raise SceneError(f"dress: hung outside worn garments, panels pass through each other in {count} pairs of an edge and "
                         "a triangle: place them further apart, by their translation or Garment.moved")
