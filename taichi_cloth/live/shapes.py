"""The pieces of a scene that a page draws, of one colour each."""

from __future__ import annotations

import numpy as np

from ..output.colors import heat_colors, to_srgb
from ..output.drawn import surfaces
from ..output.look import Heat, Look
from .seen import Piece

BANDS = 16  # colours of a heat map: a piece has one
Arrays = dict[str, np.ndarray]


class Shapes:
    """The pieces of a geometry, which stay while its faces do."""

    def __init__(self, geometry: Arrays) -> None:
        flat = {name: array for name, array in geometry.items() if name != "cloth_surface"}  # a page draws no hems, no sheen
        drawn = surfaces(flat, Look(), None)
        self.faces, self.owner, self.count = drawn.faces, drawn.owner, drawn.cloth_faces
        colors = drawn.colors
        if drawn.textured:
            colors = np.array([drawn.mean_color(k, True) for k in range(len(self.faces))])
        self.colors = to_srgb(colors).astype(np.int64)
        self._known: dict[str, Piece] = {}

    def pieces(self, geometry: Arrays, arrays: Arrays, heat: Heat | None) -> dict[str, Piece]:
        """All of them, by name.

        Args:
            heat: the heat map that colours the cloth; None for its look.
        """
        faces = arrays.get("faces", geometry["faces"])
        moved = not np.array_equal(faces, self.faces[: self.count])
        if moved:
            self.faces[: self.count] = faces
        if heat is None and self._known and not moved:
            return self._known
        kind, colors = np.zeros(len(self.faces), dtype=np.int64), self.colors.copy()
        if heat is not None:
            kind[: self.count], colors[: self.count] = _bands(heat, faces, arrays)
        key = np.column_stack([self.owner, kind, colors])
        kinds, which = np.unique(key, axis=0, return_inverse=True)
        out: dict[str, Piece] = {}
        for k, one in enumerate(kinds):
            rows = np.flatnonzero(which.ravel() == k)
            index, local = np.unique(self.faces[rows], return_inverse=True)
            cloth = bool(rows[0] < self.count)
            name = f"{'cloth' if cloth else 'solid'}/{one[0]}/" + "-".join(map(str, one[1:]))
            out[name] = Piece(cloth, index, local.reshape(-1, 3), tuple(int(c) for c in one[2:]))  # type: ignore[arg-type]
        self._known = out if heat is None else {}
        return out


def points(geometry: Arrays, arrays: Arrays) -> np.ndarray:
    """(k, 3) f32 vertices of cloth, then of solids [m], as `Piece.index` counts them."""
    return np.concatenate([arrays["x"], arrays.get("solid_x", geometry["solid_x"])]).astype(np.float32)


def bar(heat: Heat) -> np.ndarray:
    """(h, w, 3) uint8 the colours of a heat map from its lowest to its highest value."""
    row = to_srgb(heat_colors(np.linspace(*heat.range, 256), *heat.range, heat.diverging))
    return np.repeat(row[None], 12, axis=0)


def _bands(heat: Heat, faces: np.ndarray, arrays: Arrays) -> tuple[np.ndarray, np.ndarray]:
    """(m,) the band of each face's mean value, from 1, and (m, 3) its sRGB."""
    low, high = heat.range
    value = heat.values(arrays)[faces].mean(axis=1)
    band = np.clip(np.floor((value - low) / (high - low) * BANDS), 0, BANDS - 1)
    colors = to_srgb(heat_colors(low + (band + 0.5) / BANDS * (high - low), low, high, heat.diverging))
    return band.astype(np.int64) + 1, colors.astype(np.int64)
