"""Panels that are bent round a limb, as sleeves are, are brought to where a body has that limb. numpy only.

The body is cut across a panel's tube, as it is cut for its trunk. Of the parts that reach into the tube, one that the tube
goes round is the limb. A line through the middles of the cuts becomes the tube's axis: the panel is turned and moved whole.
Where an arm is level and the sleeve was drawn for one that hangs, the first cuts show its upper end alone, and the next turn
the rest. A panel that is shorter than wide, such as a collar, is moved and not turned: its cuts are too near to each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..scene.connected import components
from ..scene.garment import Garment
from ..scene.mesh import face_edges
from .figure import centre, girth, hull, overlap, parts_at
from .outside import tube_of

CUTS = 8  # along a panel
TURNS = 4  # times that a panel is turned: cuts across another axis have other middles
FEWEST, ENOUGH = 2, CUTS // 2  # cuts with a limb by which a panel is turned, and with which it is round that in the end
ROUND = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)  # corners of a tube's outline


def round_limbs(garment: Garment, x: np.ndarray, faces: np.ndarray) -> Garment:
    """The garment with each bent panel round the limb that is in it, if one is; x, faces: the body's surface [m]."""
    mesh, out = garment.mesh, garment.positions.copy()
    if mesh.vertex_uv is None:
        return garment
    edges = face_edges(mesh.faces)
    label = components(mesh.vertex_count, edges[:, 0], edges[:, 1])
    for k in np.unique(label[mesh.faces]):
        rows = np.flatnonzero(label == k)
        panel, found = out[rows], 0
        for _ in range(TURNS):
            panel, found = _round_limb(panel, mesh.vertex_uv[rows], x, faces)
        if found >= ENOUGH:
            out[rows] = panel
    return replace(garment, positions=out)


def _round_limb(panel: np.ndarray, uv: np.ndarray, x: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int]:
    """(a panel's vertices (n, 3) [m], turned and moved to the limb that is in it; how many cuts show one)."""
    tube = tube_of(panel, uv)
    if tube is None:
        return panel, 0
    middle, axes, radius = tube
    along = (panel - middle) @ axes[2]
    cut = ((x - middle) @ axes.T)[:, [0, 2, 1]]  # `parts_at` cuts across the second
    outline = hull(radius * np.column_stack([np.cos(ROUND), np.sin(ROUND)]))
    found = []
    for s in along.min() + np.ptp(along) * (np.arange(CUTS) + 0.5) / CUTS:
        inside = [part for part in parts_at(cut, faces, s) if overlap(part, outline) and girth(part) < girth(outline)]
        if inside:
            found.append([s, *min(map(centre, inside), key=np.linalg.norm)])
    if len(found) < FEWEST:
        return panel, len(found)
    s, a, b = np.array(found).T
    at, short = s.mean(), np.ptp(along) < 2 * radius
    (tilt_a, tilt_b), (off_a, off_b) = (np.zeros(2), np.array([a.mean(), b.mean()])) if short else np.polyfit(
        s, np.column_stack([a, b]), 1)
    way = np.array([tilt_a, tilt_b, 1.0]) @ axes
    place = middle + np.array([off_a + at * tilt_a, off_b + at * tilt_b, at]) @ axes
    return place + (panel - middle - at * axes[2]) @ _turning(axes[2], way / np.linalg.norm(way)).T, len(found)


def _turning(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) by the least angle of one direction (3,) into another that is not opposite to it."""
    v = np.cross(a, b)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    return np.eye(3) + cross + cross @ cross / (1.0 + a @ b)
