"""Light by rays: to a round light for soft shadows, over the hemisphere for ambient occlusion. Traced once a pixel; samples
take what pixels around found that see the same surface."""

import numpy as np
import taichi as ti

from ..backend.fields import Fields
from .colors import LIGHT_SIZE
from .coverage import corner, edge, weights
from .ground import FADE, ground_at
from .raster import Raster
from .rays import RayTree
from .uniforms import EYE, LIGHT, PLACE, SCENE, SIDE

REACH = 2  # pixels around that share what rays found
OCCLUDE = 0.35  # part of the scene's size beyond which nothing takes ambient light away


@ti.data_oriented
class TracedLight:
    """Light that rays found.

    Args:
        fields: where its own are declared.
        raster: the picture's; samples: of a pixel, across; floor: whether there is ground; triangles: how many there are.
        rays: (to the light, over the hemisphere) from each pixel.
    """

    def __init__(self, fields: Fields, raster: Raster, samples: int, floor: bool, triangles: int,
                 rays: tuple[int, int]) -> None:
        self.raster, self.samples, self.floor = raster, samples, floor
        self.width, self.height = raster.w // samples, raster.h // samples
        self.turns = raster.turns(self.height)
        self.shadow_rays, self.ambient_rays = rays
        self.tree = RayTree(fields, triangles)
        # by pixel: what light reaches it, where it is, which way it faces
        self.lit, self.spot, self.facing = (fields.real(self.width * self.height, k, dtype=ti.f32) for k in (2, 3, 3))

    def prepare(self, x: np.ndarray, faces: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Takes points (n, 3)."""
        self.tree.build(x, faces)
        return np.zeros((2, 3))

    def trace(self, screen: np.ndarray, x: np.ndarray, faces: np.ndarray, rows: np.ndarray) -> None:
        """Traces the pixels of a picture that the raster has seen."""
        self._trace(screen, x, faces, rows)

    @ti.kernel
    def _trace(self, p: ti.types.ndarray(), x: ti.types.ndarray(), faces: ti.types.ndarray(), rows: ti.types.ndarray()):
        """What light reaches the middle of every pixel: share of the light, share of the sky."""
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            for column in range(ti.select(row < self.height, self.width, 0)):
                px, py = column * self.samples + self.samples // 2, row * self.samples + self.samples // 2
                f = self.raster.face[py * self.raster.w + px]
                there, spot, flat = 0, ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 1.0, 0.0])
                if f >= 0:
                    a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
                    k = weights(a, b, c, edge(a, b, c[0], c[1]), px + 0.5, py + 0.5) * ti.Vector([a[2], b[2], c[2]])
                    k /= k.sum()
                    q, r, s = corner(x, faces[f, 0]), corner(x, faces[f, 1]), corner(x, faces[f, 2])
                    spot, there = k[0] * q + k[1] * r + k[2] * s, 1
                    flat = (r - q).cross(s - q).normalized(1e-12)
                    if flat.dot(corner(rows, EYE) - spot) < 0:
                        flat = -flat
                elif ti.static(self.floor):
                    away, ray = ground_at(px, py, self.raster.w, self.raster.h, rows)
                    if away > 0 and away < FADE * rows[PLACE, 2]:
                        spot, there = corner(rows, EYE) + away * ray, 1
                reached, open_sky = 1.0, 1.0
                if there == 1:
                    reached, open_sky = self._from(spot, flat, px * 73 + py * 9781, rows)
                pixel = row * self.width + column
                self.lit[pixel] = ti.Vector([reached, open_sky])
                self.spot[pixel], self.facing[pixel] = spot, flat * there

    @ti.func
    def _from(self, spot, flat, seed, rows: ti.template()):
        """Rays to the light, which is round, and over the hemisphere."""
        size, light = rows[SCENE, 1], corner(rows, LIGHT)
        origin = spot + flat * (3e-4 * size)
        side = flat.cross(ti.Vector([0.31, 0.2, 0.93]))
        if side.norm() < 0.1:
            side = flat.cross(ti.Vector([0.9, 0.1, 0.2]))
        side = side.normalized()
        other = flat.cross(side)
        dark, closed = 0.0, 0.0
        for s in range(self.shadow_rays + self.ambient_rays):
            u, w = spread(seed, s)
            r = ti.sqrt(u)
            way, reach = ti.sqrt(1 - u) * flat + r * (ti.cos(w) * side + ti.sin(w) * other), OCCLUDE * size
            if s < self.shadow_rays:
                r *= LIGHT_SIZE
                way = (light + r * (ti.cos(w) * corner(rows, SIDE) + ti.sin(w) * corner(rows, SIDE + 1))).normalized()
                reach = 1e9
            blocked = self.tree.blocked(origin, way, reach)
            if s < self.shadow_rays:
                dark += blocked
            else:
                closed += blocked
        return 1 - dark / self.shadow_rays, 1 - 0.85 * closed / self.ambient_rays

    @ti.func
    def at(self, position, flat, px, py, rows: ti.template()):
        """(share of the light, share of the sky) at a sample: of pixels around that see the same surface."""
        row, column = py // self.samples, px // self.samples
        eye = corner(rows, EYE)
        width = (position - eye).norm() / (rows[PLACE, 0] * self.height)  # of a pixel there
        total, weight = ti.Vector([0.0, 0.0]), 1e-12
        for dy in range(-REACH, REACH + 1):
            for dx in range(-REACH, REACH + 1):
                y, z = row + dy, column + dx
                if 0 <= y and y < self.height and 0 <= z and z < self.width:
                    pixel = y * self.width + z
                    away = ti.abs((self.spot[pixel] - position).dot(flat)) / (2 * width)
                    alike = ti.max(self.facing[pixel].dot(flat), 0.0)
                    w = ti.exp(-away * away) * alike * alike + 1e-9
                    total += w * self.lit[pixel]
                    weight += w
        return total[0] / weight, total[1] / weight


@ti.func
def spread(seed, s):
    """A point of [0, 1) x [0, 2 pi): rays of a sample in a low-discrepancy sequence, turned from sample to sample."""
    h = ti.cast(seed, ti.u32) * ti.u32(2654435761)
    h = (h ^ (h >> 15)) * ti.u32(2246822519)
    h = h ^ (h >> 13)
    a = ti.cast(h & ti.u32(65535), ti.f32) / 65536.0 + 0.7548777 * s
    b = ti.cast(h >> 16, ti.f32) / 65536.0 + 0.5698403 * s
    return a - ti.floor(a), 6.2831853 * (b - ti.floor(b))
