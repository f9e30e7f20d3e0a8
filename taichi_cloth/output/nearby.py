"""Vertices of cloth that are near a solid, or near another layer of cloth: rounding for pictures spares them. numpy only."""

from dataclasses import dataclass

import numpy as np

from ..scene.boxes import near
from ..scene.closest import closest
from ..scene.mesh import face_edges
from .drawn import Frame

NEAR = 1.5  # thicknesses: surfaces that touch are about one apart


@dataclass(frozen=True)
class Nearby:
    """push (n, 3): where a solid is near or pushes, a direction away from it, else 0; layered (n,): another layer is near."""

    push: np.ndarray
    layered: np.ndarray


def nearby(geometry: Frame, frame: Frame, push: np.ndarray | None) -> Nearby:
    """Where solids and layers are near in a recorded frame.

    Args:
        push: (n, 3) forces of solids [N], or None.
    """
    x, n = frame["x"].astype(np.float64), len(geometry["x"])
    out = np.zeros((n, 3)) if push is None else push
    if "ground_solid" in geometry:
        height, thick = geometry["ground_solid"]
        low = (x[:, 1] - height < NEAR * thick) & ~out.any(axis=1)
        out = np.where(low[:, None], [0.0, 1.0, 0.0], out)
    thickness = geometry.get("solid_thickness", np.zeros(0))
    if len(thickness):
        at, faces = frame.get("solid_x", geometry["solid_x"]).astype(np.float64), geometry["solid_faces"]
        owner = np.searchsorted(geometry["solid_start"], faces[:, 0], "right") - 1
        out = np.where(out.any(axis=1, keepdims=True), out, away_from(x, at, faces, NEAR * thickness[owner]))
    return Nearby(out, _layered(geometry, x))


def away_from(x: np.ndarray, at: np.ndarray, faces: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(n, 3) unit vectors from the nearest place of a surface to points x (n, 3) within its reach, else 0.

    Args:
        at: (m, 3) vertices of the surface [m]; faces: (k, 3); reach: (k,) of each face [m], 0 for those that do not count.
    """
    out, best = np.zeros_like(x), np.full(len(x), np.inf)
    faces, reach = faces[reach > 0], reach[reach > 0]
    for i, _, off in _pairs(x, at[faces], reach):
        order = np.argsort(-np.linalg.norm(off, axis=1), kind="stable")  # the nearest of each is written last
        i, off = i[order], off[order]
        length = np.linalg.norm(off, axis=1)
        closer = (length < best[i]) & (length > 0)
        out[i[closer]], best[i[closer]] = off[closer] / length[closer, None], length[closer]
    return out


def _layered(geometry: Frame, x: np.ndarray) -> np.ndarray:
    """(n,) whether a vertex belongs to a triangle with a corner near another cloth, or near a part of its own that is no
    neighbour of it."""
    out = np.zeros(len(x), dtype=bool)
    thickness = geometry.get("cloth_thickness", np.zeros(0))
    if not np.isfinite(thickness).any():
        return out
    of = np.repeat(np.arange(len(thickness)), np.diff(geometry["cloth_start"]))
    thick = np.nan_to_num(thickness)[of]
    faces = geometry["faces"]
    faces = faces[thick[faces[:, 0]] > 0]
    sewn = geometry.get("sewn", np.arange(len(x)))
    ends = np.sort(sewn[face_edges(faces)], axis=1).astype(np.int64)
    known = np.unique(ends[:, 0] * len(x) + ends[:, 1])
    edge = float(np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1).mean())
    used = np.unique(faces)
    for i, j, off in _pairs(x[used], x[faces], np.full(len(faces), NEAR * thick.max())):
        i, face = used[i], faces[j]
        a, b = sewn[i][:, None].astype(np.int64), sewn[face].astype(np.int64)
        beside = (a == b) | np.isin(np.minimum(a, b) * len(x) + np.maximum(a, b), known)
        reach = NEAR * (thick[i] + thick[face[:, 0]]) / 2
        reach = np.where(of[i] == of[face[:, 0]], np.minimum(reach, edge / 2), reach)  # fine cloth is near itself
        met = (np.linalg.norm(off, axis=1) < reach) & ~beside.any(axis=1)
        out[i[met]] = True
        out[face[met]] = True
    out[faces[out[faces].any(axis=1)]] = True
    shared = np.zeros(len(x), dtype=bool)
    shared[sewn[out]] = True  # sewn vertices stay together
    return shared[sewn]


def _pairs(x: np.ndarray, corner: np.ndarray, reach: np.ndarray):
    """(rows of points x (n, 3), rows of triangles (k, 3, 3), offsets (p, 3) from the nearest places), within reach (k,)."""
    if not len(corner):
        return
    grown = np.concatenate([corner - reach[:, None, None], corner + reach[:, None, None]], axis=1)
    for i, j in near(x[:, None], grown):
        off = x[i] - np.einsum("pa,pai->pi", closest(x[i], corner[j]), corner[j])
        within = np.linalg.norm(off, axis=1) < reach[j]
        yield i[within], j[within], off[within]
