"""Rasterizer: the triangle seen in each sample, by a z-buffer in two passes, the first for depths and the second for faces."""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from ..backend.runtime import TASK
from .coverage import PIECE, corner, edge, pieces, spot, weights

BANDS = 16  # of a picture, of which rows are taken in turn: those with cloth cost most, and each thread has a run of turns
SAME = 8  # roundings by which depths of one sample may differ between the two passes: not all backends round alike


@ti.data_oriented
class Raster:
    """Nearest 1/depth of each sample and the face that has it; room for another map behind the picture.

    Args:
        fields: where its own are declared; who has them allocates.
        w, h: samples of the picture, across and down; samples: of a pixel, across.
        behind: samples of the other map.

    Attributes:
        depth: bits of an f32 from 0 up, 0 where nothing is; face: -1 where nothing is.
    """

    def __init__(self, fields: Fields, w: int, h: int, samples: int = 1, behind: int = 0) -> None:
        self.w, self.h, self.samples = w, h, samples
        self.wide = ti.cfg.arch not in (ti.x64, ti.arm64)
        self.grain = 1 if self.wide else TASK
        self.depth, self.face = (fields.integer(w * h + behind) for _ in range(2))

    def turns(self, height: int) -> int:
        """Iterations of a loop over a picture's rows that all threads share: `row` says which rows these are."""
        return BANDS * -(-height // BANDS) * self.grain

    @ti.func
    def row(self, t, turns, height):
        """Row of the picture for iteration t; `height` or more if there is none."""
        turn, out = t // self.grain, height
        if t % self.grain == 0:
            out = turn % BANDS * (turns // (self.grain * BANDS)) + turn // BANDS
        return out

    def see(self, screen: np.ndarray, faces: np.ndarray, near: float) -> None:
        """Rasterises the picture; points (n, 3) as `Frame.project` gives them, nothing nearer than `near` [m]."""
        self._clear()
        seen = pieces(screen, faces, self.w, self.h, 1 / near)
        for identify in range(2):
            self._raster(screen, faces, seen, self.w, 0, identify, self.samples)

    def see_behind(self, points: np.ndarray, faces: np.ndarray, side: int) -> None:
        """Rasterises depths of points (n, 3) and faces (m, 3) into the other map, `side` samples square."""
        self._raster(points, faces, pieces(points, faces, side, side, np.inf), side, self.w * self.h, 0, 1)

    @ti.kernel
    def _clear(self):
        for i in self.depth:
            self.depth[i] = 0
            self.face[i] = -1

    @ti.kernel
    def _raster(self, p: ti.types.ndarray(), faces: ti.types.ndarray(), pieces: ti.types.ndarray(), w: int, offset: int,
                identify: int, n: int):
        """Nearest depth in each pixel; then, with `identify`, the face that has it."""
        if ti.static(self.wide):
            for i in range(pieces.shape[0] * PIECE):
                self._touch(p, faces, pieces, i // PIECE, i % PIECE, w, offset, identify, n)
        else:
            for piece in range(pieces.shape[0]):
                for i in range(PIECE):
                    self._touch(p, faces, pieces, piece, i, w, offset, identify, n)

    @ti.func
    def _touch(self, p: ti.template(), faces: ti.template(), pieces: ti.template(), piece, i, w, offset, identify, n):
        """One pixel of a piece of a triangle's box."""
        f, i_box, across = pieces[piece, 0], pieces[piece, 1] + i, pieces[piece, 4]
        if i_box < pieces[piece, 5]:
            a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
            x, y = pieces[piece, 2] + i_box % across, pieces[piece, 3] + i_box // across
            at = spot(x, y, n)
            k = weights(a, b, c, edge(a, b, c[0], c[1]), at[0], at[1])
            if k.min() >= 0:
                pixel = offset + y * w + x
                here = ti.bit_cast(ti.cast(k.dot(ti.Vector([a[2], b[2], c[2]])), ti.f32), ti.i32)
                if identify == 0:
                    ti.atomic_max(self.depth[pixel], here)
                elif here >= self.depth[pixel] - SAME:
                    ti.atomic_max(self.face[pixel], f)
