"""Panels hung clear of a body: those that start within it go further out, along lines that leave it. numpy only.

From each vertex goes a line the way its panel is brought out. If it leaves a closed piece of the body once more than it
enters, the vertex is within that piece. A panel goes out to the first place where no vertex is within and no edge through.
"""

from __future__ import annotations

import numpy as np

from ..contact.layer_order import surface_of_solids
from ..scene.boxes import near
from ..scene.connected import components
from ..scene.garment import Garment
from ..scene.intersections import count_crossings
from ..scene.mesh import face_edges
from ..scene.scene import Scene
from .outside import Bent, Flat, hung_by

PLACES = 9  # decimals [m] by which vertices are in one place
ASKEW = np.array([3.1e-6, 1.7e-6, 2.3e-6])  # by which lines are off, so that none goes through an edge or a corner


def hung_clear(garment: Garment, body: Scene, thickness: float) -> tuple[Garment, tuple[str, ...]]:
    """The garment with its panels clear of the solids of a scene, and a note on each that had to go further out.

    Args:
        thickness: of the garment [m]; panels that go out keep that and the solids'.

    Raises:
        SceneError: a panel that is within a solid, or passes through one, however far out it is hung.
    """
    pieces = [piece for s in body.solids for piece in pieces_of(s.surface_at(0.0), s.shape.surface()[1])]
    widest = float(np.ptp(np.concatenate([x for x, *_ in pieces]), axis=0).max())
    keeps = thickness + max(s.thickness for s in body.solids)

    def way_out(panel: Flat | Bent, triangles: np.ndarray) -> float:
        far = 0.0
        while far <= widest:
            x, ways = panel.moved(far)
            lack = max(exit_from(x, ways, widest, at, faces) if closed else 0.0 for at, faces, closed in pieces)
            if not lack and any(count_crossings(x, triangles, at, faces) for at, faces, _ in pieces):
                lack = panel.sheet.longest / 2
            if not lack:
                return far + keeps if far else 0.0
            far += max(lack, keeps)
        return float("inf")

    return hung_by(garment, surface_of_solids(body), way_out, "clear of", "the body")


def exit_from(x: np.ndarray, ways: np.ndarray, widest: float, at: np.ndarray, faces: np.ndarray) -> float:
    """Distance [m] by which all points leave a closed surface; 0 if none is within.

    Args:
        x: (n, 3) points [m]; ways: (n, 3) along which they go; widest: the largest distance that is tried [m].
        at: (m, 3) vertices of the surface [m]; faces: (k, 3) its triangles.
    """
    ways = ways + ASKEW
    ray, far = np.zeros(0, dtype=np.int64), np.zeros(0)
    for i, j in near(np.stack([x, x + widest * ways], axis=1), at[faces]):
        a, b, c = (at[faces[j, k]] - x[i] for k in range(3))
        n = np.cross(b - a, c - a)
        with np.errstate(all="ignore"):
            t = np.einsum("ki,ki->k", a, n) / np.einsum("ki,ki->k", ways[i], n)
        turns = np.stack([np.einsum("ki,ki->k", ways[i], np.cross(p, q)) for p, q in ((a, b), (b, c), (c, a))])
        hits = ((turns > 0).all(axis=0) | (turns < 0).all(axis=0)) & (t > 0)
        ray, far = np.append(ray, i[hits]), np.append(far, t[hits])
    within = np.bincount(ray, minlength=len(x)) % 2 == 1
    first = np.full(len(x), np.inf)
    np.minimum.at(first, ray, far)
    return float(first[within].max(initial=0.0))


def pieces_of(x: np.ndarray, faces: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, bool]]:
    """(vertices (n, 3), triangles (k, 3), whether it is closed) of each piece of a surface that is connected."""
    x, one = np.unique(x.round(PLACES), axis=0, return_inverse=True)  # poles and rims of shapes are double
    faces = one.reshape(-1)[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    edges = np.sort(face_edges(faces), axis=1)
    label = components(len(x), edges[:, 0], edges[:, 1])[faces[:, 0]]
    out = []
    for k in np.unique(label):
        used, mine = np.unique(faces[label == k], return_inverse=True)
        mine = mine.reshape(-1, 3)
        count = np.unique(np.sort(face_edges(mine), axis=1), axis=0, return_counts=True)[1]
        out.append((x[used], mine, bool((count == 2).all())))
    return out
