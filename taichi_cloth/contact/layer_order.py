"""Which cloth lies outside which: before the first step, vertices on the wrong side are moved out. numpy only.

A scan, or clothes put on one over the other, start with layers through each other, and contact cannot know which belongs
outside. `ClothContact.layer` says it. A cloth is moved out of those with lower layers that it crosses, by as little as brings
it to the distance that both keep: its vertices over their surface, and their vertices under its own. Cloths that do not cross
stay as they are drawn. Outside is where a surface faces away from the nearest solid; without solids it is where its triangles
are counterclockwise.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..backend.ordering import components
from ..scene.cloth import Cloth
from ..scene.intersections import count_crossings
from ..scene.mesh import face_edges
from ..scene.scene import Scene
from ..system.quantities import vertex_normals
from ..system.state import ParticleState
from .settle import as_one
from .solid.query import SolidCollisionDetector

DEEPEST = 0.03  # m: vertices further inside belong elsewhere, on the other side of a limb for example
SWEEPS = 12
SAMPLE = 400  # triangles of a panel that say which way it faces
ROWS = 512  # points at a time whose nearest others are looked for


@dataclass(frozen=True)
class MovedOut:
    """Vertices of a cloth that were moved out of others.

    Attributes:
        cloth: which; out_of: the names of the others.
        inside: how many lay inside them, or had one of their vertices outside.
        vertex: that was moved furthest; by: how far [m].
    """

    cloth: Cloth
    out_of: str
    inside: int
    vertex: int
    by: float

    def __str__(self) -> str:
        c = self.cloth
        assert c.contact is not None
        return (f"{c.name}, layer {c.contact.layer}: {self.inside} vertices lay inside {self.out_of}, and were moved out, "
                f"furthest vertex {self.vertex} by {self.by:.2g} m")


@dataclass(frozen=True)
class _Surface:
    """Vertices x (n, 3), where they start [m], normals (n, 3) out of it, edges: length [m], keeps: (n,) half of the distance
    [m] from its like."""

    x: np.ndarray
    normal: np.ndarray
    edge: float
    keeps: np.ndarray

    @staticmethod
    def join(parts: list[_Surface]) -> _Surface:
        """All of them as one."""
        x, normal, keeps = (np.concatenate([getattr(p, name) for p in parts]) for name in ("x", "normal", "keeps"))
        return _Surface(x, normal, max(p.edge for p in parts), keeps)


def put_in_order(detector: SolidCollisionDetector, model: ParticleState, scene: Scene, fixed: np.ndarray) -> list[MovedOut]:
    """Moves cloths out of those that belong inside them; the model is at rest where it starts.

    Args:
        fixed: (k,) particles that stay.
    """
    order = sorted((c.contact.layer, k, c) for k, c in enumerate(scene.cloths) if c.contact is not None)
    (x, v), solid = model.read(), surface_of_solids(scene)
    still = np.zeros(model.n, dtype=bool)
    still[fixed] = True
    cluster_ids = np.arange(model.n) if model.sewn is None else model.sewn.representative
    moved: list[MovedOut] = []
    detector.set_time(detector.time, 0.0)
    model.save()
    crossed = len(detector.find_crossings())
    for layer, _, outer in order:
        inside = [c for k, _, c in order if k < layer and not scene.passes(c, outer) and _cross(c, outer, x)]
        if not inside:
            continue
        rows = _rows(outer)
        lower = _Surface.join([_surface(c, x[_rows(c)], facing(c.mesh.faces, x[_rows(c)], solid)) for c in inside])
        there, count = _out_of(outer, x[rows], facing(outer.mesh.faces, x[rows], solid), lower)
        if not count:
            continue
        by = np.zeros_like(x)
        by[rows] = there - x[rows]
        before, held = x.copy(), still.copy()
        for _ in range(2):
            x[model.user] = before[model.user] + as_one(by[model.user], cluster_ids, held)
            model.write(x, v)
            through = detector.find_crossings()
            if len(through) <= crossed:
                break
            held[through] = True  # a solid is there: contact parts layers as it can
        far = np.linalg.norm(x[rows] - before[rows], axis=1)
        names = " and ".join(f"{c.name!r}" for c in inside)
        moved.append(MovedOut(outer, names, count, int(far.argmax()), float(far.max())))
    model.save()
    return moved


def _rows(cloth: Cloth) -> slice:
    """A cloth's vertices among those of its scene."""
    return slice(cloth.start, cloth.start + cloth.mesh.vertex_count)


def _cross(a: Cloth, b: Cloth, x: np.ndarray) -> bool:
    """Whether two cloths go through each other, with the scene's vertices at x (n, 3) [m]."""
    return count_crossings(x[_rows(a)], a.mesh.faces, x[_rows(b)], b.mesh.faces) > 0


def _out_of(outer: Cloth, x: np.ndarray, facing: np.ndarray, lower: _Surface) -> tuple[np.ndarray, int]:
    """(positions (n, 3) of a cloth's vertices outside the cloth that belongs inside it, how many were not)."""
    wrong, there = np.zeros(len(x), dtype=bool), x.copy()
    for sweep in range(SWEEPS):
        upper = _surface(outer, there, facing)
        by, way = np.zeros(len(x)), np.zeros_like(x)
        over = _above(upper.x, lower)  # its vertices over the others' surface
        keeps = upper.keeps[over.rows] + lower.keeps[over.near]
        if sweep == 0:
            wrong[over.rows[over.height < 0]] = True
        lack = keeps - over.height
        by[over.rows], way[over.rows] = lack, lower.normal[over.near]
        under = _above(lower.x, upper)  # their vertices under its own
        keeps = lower.keeps[under.rows] + upper.keeps[under.near]
        if sweep == 0:
            wrong[under.near[under.height > 0]] = True
            if not wrong.any():
                return x, 0
        lack = under.height + keeps
        order = np.argsort(lack)
        more = np.zeros(len(x))
        more[under.near[order]] = lack[order]  # the most of each
        way = np.where((more > by)[:, None], upper.normal, way)
        by = np.maximum(np.maximum(by, more), 0.0)
        if by.max() < 1e-3 * upper.keeps.min():
            break
        there = there + by[:, None] * way
    return there, int(wrong.sum())


@dataclass(frozen=True)
class _Above:
    """Points rows (k,) of some, over vertices near (k,) of a surface, height (k,) [m]."""

    rows: np.ndarray
    near: np.ndarray
    height: np.ndarray


def _above(x: np.ndarray, surface: _Surface) -> _Above:
    """Those of points (n, 3) that are within DEEPEST of a surface, and not beside it."""
    low, high = surface.x.min(axis=0) - DEEPEST, surface.x.max(axis=0) + DEEPEST
    rows = np.flatnonzero(((x > low) & (x < high)).all(axis=1))
    on = np.flatnonzero(surface.normal.any(axis=1))  # vertices of no face lie on nothing
    near = on[nearest(x[rows], surface.x[on])]
    off = x[rows] - surface.x[near]
    height = np.einsum("ki,ki->k", off, surface.normal[near])
    beside = np.linalg.norm(off - height[:, None] * surface.normal[near], axis=1)
    there = (np.abs(height) < DEEPEST) & (beside < surface.edge)  # further beside its nearest vertex it is beyond the border
    return _Above(rows[there], near[there], height[there])


def nearest(x: np.ndarray, among: np.ndarray) -> np.ndarray:
    """(n,) the nearest of points among (m, 3) to each of x (n, 3)."""
    out, size = np.zeros(len(x), dtype=np.int64), np.einsum("ki,ki->k", among, among)
    for k in range(0, len(x), ROWS):
        out[k: k + ROWS] = np.argmin(size - 2 * x[k: k + ROWS] @ among.T, axis=1)
    return out


def surface_of_solids(scene: Scene) -> tuple[np.ndarray, np.ndarray] | None:
    """((k, 3) vertices of all solids as they are at the start [m], (k, 3) normals out of them); None without solids."""
    parts = [(s.surface_at(0.0), s.shape.surface()[1]) for s in scene.solids]
    if not parts:
        return None
    return np.concatenate([x for x, _ in parts]), np.concatenate([vertex_normals(x, faces) for x, faces in parts])


def facing(faces: np.ndarray, x: np.ndarray, solid: tuple[np.ndarray, np.ndarray] | None) -> np.ndarray:
    """(n,) 1, or -1 for vertices of a cloth at x (n, 3) [m] whose panel's triangles (m, 3) face the solids."""
    out = np.ones(len(x))
    if solid is None:
        return out
    edges = face_edges(faces)
    panel = components(len(x), edges[:, 0], edges[:, 1])
    a, b, c = (x[faces[:, k]] for k in range(3))
    centre, area = (a + b + c) / 3, np.cross(b - a, c - a)
    for first in np.unique(panel[faces[:, 0]]):
        some = np.flatnonzero(panel[faces[:, 0]] == first)
        some = some[:: max(1, len(some) // SAMPLE)]
        away = solid[1][nearest(centre[some], solid[0])]
        if np.einsum("ki,ki->", area[some], away) < 0:
            out[panel == first] = -1
    return out


def _surface(cloth: Cloth, x: np.ndarray, facing: np.ndarray) -> _Surface:
    """A cloth's, with its vertices at x (n, 3) [m]."""
    assert cloth.contact is not None
    edges = face_edges(cloth.mesh.faces)
    length = float(np.mean(np.linalg.norm(x[edges[:, 0]] - x[edges[:, 1]], axis=1)))
    return _Surface(x, facing[:, None] * vertex_normals(x, cloth.mesh.faces), length,
                    np.full(len(x), cloth.contact.thickness / 2))
