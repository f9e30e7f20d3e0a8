"""Shadows by a map: depths as the light sees them. Quick, with edges as soft as a few of its samples."""

import numpy as np
import taichi as ti

from .coverage import corner
from .raster import Raster
from .uniforms import LIGHT, SHADOW, SIDE

MAP = 1536  # pixels a side


@ti.data_oriented
class ShadowMap:
    """Light that a map of depths lets through.

    Args:
        raster: has the map behind its picture, of MAP x MAP samples.
    """

    def __init__(self, raster: Raster) -> None:
        self.raster = raster
        self.offset = raster.w * raster.h

    def prepare(self, x: np.ndarray, faces: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Draws the map of points (n, 3); how to get there: rows low, scale."""
        local = x @ light.T
        low, high = local.min(axis=0), local.max(axis=0)
        size = max(float((high - low)[:2].max()), 1e-9) * 1.05
        scale = np.array([MAP / size, MAP / size, 1 / max(float(high[2] - low[2]), 1e-9)])
        centre = np.array([*(low + high)[:2] / 2 - size / 2, low[2]])
        # heights above the lowest, from 1 up, because 0 means nothing
        seen = (local - centre) * scale + [0, 0, 1]
        self.raster.see_behind(seen.astype(np.float32), faces, MAP)
        return np.stack([centre, scale])

    def trace(self, screen: np.ndarray, x: np.ndarray, faces: np.ndarray, rows: np.ndarray) -> None:
        """Nothing: the map is all there is."""

    @ti.func
    def at(self, position, flat, row, column, rows: ti.template()):
        """(share of the light, share of the sky) at a sample."""
        return self._reaches(position + flat * 0.004 / rows[SHADOW + 1, 2], rows), 1.0

    @ti.func
    def _reaches(self, position, rows: ti.template()):
        """Share of the light that reaches a point: 0 in full shadow."""
        local = ti.Vector([corner(rows, SIDE).dot(position), corner(rows, SIDE + 1).dot(position),
                           corner(rows, LIGHT).dot(position)])
        seen = (local - corner(rows, SHADOW)) * corner(rows, SHADOW + 1)
        reached, taps = 0.0, 0.0
        for dy in range(-2, 3):
            for dx in range(-2, 3):
                sx, sy = ti.cast(ti.floor(seen[0]), int) + 2 * dx, ti.cast(ti.floor(seen[1]), int) + 2 * dy
                taps += 1.0
                above = 0.0
                if 0 <= sx and sx < MAP and 0 <= sy and sy < MAP:
                    above = ti.bit_cast(self.raster.depth[self.offset + sy * MAP + sx], ti.f32)
                if above <= 0 or above <= seen[2] + 1.0 + 0.006:
                    reached += 1.0
        return reached / taps
