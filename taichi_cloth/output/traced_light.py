"""Light by rays: to a round light for soft shadows, over the hemisphere for ambient occlusion. Traced once a pixel.

Pixels share the findings of those around that see the same surface. Each of them then has all rays of the sequence, but every
edge of a shadow has steps of `ACROSS` pixels, since each ray goes from one pixel of so many. Samples therefore take the mean
over pixels around.
"""

import numpy as np

from ..backend.fields import Fields
from ..backend.language import ti
from .coverage import corner, edge, spot, weights
from .ground import FADE, ground_at
from .raster import Raster
from .rays import RayTree
from .uniforms import EYE, LENS, LIGHT, PLACE, SCENE, SIDE

REACH = 2  # pixels around that share their rays' findings
ACROSS = 2 * REACH + 1
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
        # by pixel: the light that reaches it, where it is, which way it faces
        self.lit, self.shared, self.place, self.facing = (fields.real(self.width * self.height, k, dtype=ti.f32)
                                                          for k in (2, 2, 3, 3))

    def prepare(self, x: np.ndarray, faces: np.ndarray, light: np.ndarray) -> np.ndarray:
        """Takes points (n, 3)."""
        self.tree.build(x, faces)
        return np.zeros((2, 3))

    def trace(self, screen: np.ndarray, x: np.ndarray, faces: np.ndarray, rows: np.ndarray) -> None:
        """Traces the pixels of a picture that the raster has seen."""
        self._trace(screen, x, faces, rows)
        self._share(self.lit, self.shared, 0, rows)
        self._share(self.shared, self.lit, 1, rows)

    @ti.kernel
    def _trace(self, p: ti.types.ndarray(), x: ti.types.ndarray(), faces: ti.types.ndarray(), rows: ti.types.ndarray()):
        """Light that reaches the middle of every pixel: share of the light, share of the sky."""
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            for column in range(ti.select(row < self.height, self.width, 0)):
                px, py = column * self.samples + self.samples // 2, row * self.samples + self.samples // 2
                f, at = self.raster.face[py * self.raster.w + px], spot(px, py, self.samples)
                there, place, flat = 0, ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 1.0, 0.0])
                if f >= 0:
                    a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
                    k = weights(a, b, c, edge(a, b, c[0], c[1]), at[0], at[1]) * ti.Vector([a[2], b[2], c[2]])
                    k /= k.sum()
                    q, r, s = corner(x, faces[f, 0]), corner(x, faces[f, 1]), corner(x, faces[f, 2])
                    place, there = k[0] * q + k[1] * r + k[2] * s, 1
                    flat = (r - q).cross(s - q).normalized(1e-12)
                    if flat.dot(corner(rows, EYE) - place) < 0:
                        flat = -flat
                elif ti.static(self.floor):
                    away, ray = ground_at(at, self.raster.w, self.raster.h, rows)
                    if away > 0 and away < FADE * rows[PLACE, 2]:
                        place, there = corner(rows, EYE) + away * ray, 1
                reached, open_sky = 1.0, 1.0
                if there == 1:
                    reached, open_sky = self._from(place, flat, row, column, rows)
                pixel = row * self.width + column
                self.lit[pixel] = ti.Vector([reached, open_sky])
                self.place[pixel], self.facing[pixel] = place, flat * there

    @ti.func
    def _from(self, place, flat, row, column, rows: ti.template()):
        """Rays to the light, which is round, and over the hemisphere."""
        size, light = rows[SCENE, 1], corner(rows, LIGHT)
        origin = place + flat * (3e-4 * size)
        side = flat.cross(ti.Vector([0.31, 0.2, 0.93]))
        if side.norm() < 0.1:
            side = flat.cross(ti.Vector([0.9, 0.1, 0.2]))
        side = side.normalized()
        other = flat.cross(side)
        dark, closed = 0.0, 0.0
        first, last = self._worth(place, OCCLUDE * size, light, rows[SCENE, 2])
        for s in range(first, last):
            u, w = spread(row, column, s, rows[LENS, 2])
            r = ti.sqrt(u)
            way, reach = ti.sqrt(1 - u) * flat + r * (ti.cos(w) * side + ti.sin(w) * other), OCCLUDE * size
            if s < self.shadow_rays:
                r *= rows[SCENE, 2]
                way = (light + r * (ti.cos(w) * corner(rows, SIDE) + ti.sin(w) * corner(rows, SIDE + 1))).normalized()
                reach = 1e9
            blocked = self.tree.blocked(origin, way, reach)
            if s < self.shadow_rays:
                dark += blocked
            else:
                closed += blocked
        return 1 - dark / ti.max(self.shadow_rays, 1), 1 - 0.85 * closed / self.ambient_rays

    @ti.func
    def _worth(self, place, reach, light, wide):
        """First and last of the rays from a place that may meet anything: rays that stay away from the bounds of all do
        not."""
        low, high = self.tree.boxes.low[1], self.tree.boxes.high[1]
        first, last = self.shadow_rays, self.shadow_rays
        if ti.max(low - place, place - high, 0.0).norm() < reach:
            last += self.ambient_rays
        to = (low + high) / 2 - place
        along = to.dot(light)
        radius = (high - low).norm() / 2
        if (to - along * light).norm() < radius + wide * ti.max(along + radius, 0.0) and along > -radius:
            first = 0
        return first, last

    @ti.kernel
    def _share(self, light: ti.template(), out: ti.template(), down: ti.template(), rows: ti.types.ndarray()):
        """The findings of each pixel and those beside it, or above and below it."""
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            for column in range(ti.select(row < self.height, self.width, 0)):
                pixel = row * self.width + column
                out[pixel] = self._around(light, REACH * down, REACH * (1 - down), 1, self.place[pixel], self.facing[pixel],
                                          row, column, rows)

    @ti.func
    def at(self, position, bulge, flat, row, column, rows: ti.template()):
        """(share of the light, share of the sky) in a pixel: of pixels around that see the same surface."""
        light = self._around(self.lit, 1, 1, REACH, position, flat, row, column, rows)
        return light[0], light[1]

    @ti.func
    def _around(self, light: ti.template(), down: ti.template(), beside: ti.template(), stride: ti.template(), position, flat,
                row, column, rows: ti.template()):
        """(2,) the mean of pixels around that see the same surface: so many to each side, so far apart."""
        eye = corner(rows, EYE)
        width = (position - eye).norm() / (rows[PLACE, 0] * self.height)  # of a pixel there
        total, weight = ti.Vector([0.0, 0.0]), 1e-12
        for dy in range(-down, down + 1):
            for dx in range(-beside, beside + 1):
                y, z = row + stride * dy, column + stride * dx
                if 0 <= y and y < self.height and 0 <= z and z < self.width:
                    pixel = y * self.width + z
                    away = ti.abs((self.place[pixel] - position).dot(flat)) / (2 * width)
                    alike = ti.max(self.facing[pixel].dot(flat), 0.0)
                    w = ti.exp(-away * away) * alike * alike + 1e-9
                    total += w * light[pixel]
                    weight += w
        return total / weight


@ti.func
def spread(row, column, s, exposure):
    """A point of [0, 1) x [0, 2 pi) for ray s of a pixel.

    Pixels that share their findings have different parts of one low-discrepancy sequence, all of it together: where they see
    one surface there is no noise. [A. Keller, W. Heidrich: Interleaved Sampling, 2001]
    """
    k = row % ACROSS * ACROSS + column % ACROSS + ACROSS * ACROSS * (s + 16 * exposure) + 0.5
    a, b = 0.7548777 * k, 0.5698403 * k
    return a - ti.floor(a), 6.2831853 * (b - ti.floor(b))
