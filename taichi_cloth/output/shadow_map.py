"""Shadows by a map: depths as the light sees them. Quick, with edges as soft as a few of its samples."""

import numpy as np

from ..backend.language import ti
from .coverage import corner
from .raster import Raster
from .uniforms import LIGHT, SHADOW, SIDE

MAP = 1536  # samples a side
REACH = 3  # samples to either side over which shade changes
OUT = 5.0  # samples by which cloth has to be further out to shade a face: it bends, and its neighbours do not
GRAZING = 0.1  # cosine of the light's angle to a face, below which it is treated as if it were that


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
    def at(self, position, bulge, flat, row, column, rows: ti.template()):
        """(share of the light, share of the sky) at a sample of a face of the normal `flat`, which is round by `bulge` [m]."""
        return self._reaches(position + bulge, flat, rows), 1.0

    @ti.func
    def _reaches(self, position, flat, rows: ti.template()):
        """Share of the light that reaches a point: 0 in full shadow.

        Samples of the map count by a tent over REACH of them to either side, so that shade changes without steps from place to
        place. Each is compared with the height of the face's plane there, so that no face shades itself.
        """
        scale = corner(rows, SHADOW + 1)
        seen = (seen_by_light(position, rows) - corner(rows, SHADOW)) * scale
        normal = seen_by_light(flat, rows)
        facing = ti.max(normal[2], GRAZING)
        steep = -ti.Vector([normal[0], normal[1]]) / facing * scale[2] / scale[0]  # height a sample aside
        height = seen[2] + 1.0 + OUT / facing * scale[2] / scale[0]  # nearer to the light: the edge of a shadow stays in place
        x, y = ti.cast(ti.floor(seen[0] - 0.5), int), ti.cast(ti.floor(seen[1] - 0.5), int)
        reached, whole = 0.0, 0.0
        for dy in range(1 - REACH, REACH + 1):
            for dx in range(1 - REACH, REACH + 1):
                aside = ti.Vector([x + dx + 0.5 - seen[0], y + dy + 0.5 - seen[1]])
                part = (REACH - ti.abs(aside[0])) * (REACH - ti.abs(aside[1]))
                above = 0.0
                if 0 <= x + dx and x + dx < MAP and 0 <= y + dy and y + dy < MAP:
                    above = ti.bit_cast(self.raster.depth[self.offset + (y + dy) * MAP + x + dx], ti.f32)
                whole += part
                if above <= 0 or above <= height + steep.dot(aside):
                    reached += part
        return reached / whole


@ti.func
def seen_by_light(v, rows: ti.template()):
    """A vector in the light's axes: two across, and towards it."""
    return ti.Vector([corner(rows, SIDE).dot(v), corner(rows, SIDE + 1).dot(v), corner(rows, LIGHT).dot(v)])
