"""Colours of a picture: cloth and solids in the light that reaches them, ground and sky around."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..backend.language import ti
from . import finish
from .coverage import corner, edge, spot, weights, wire
from .ground import FADE, ground_at
from .lit import lit
from .objects import BOTH, HEM, TEXTURE, WEAVE
from .raster import Raster
from .surroundings import sky, soft_checker
from .uniforms import BACKGROUND, CLOTH, EYE, FLOOR, LIGHT, PLACE, POWER, SCENE, UP


@dataclass(frozen=True)
class Around:
    """Surroundings of the cloth.

    Attributes:
        background: "sky", "transparent" or "color"; floor: "checker", "plain", "shadow" or "none".
        key, accents: whether there is a light that throws shadows, and others that throw none.
    """

    background: str
    floor: str
    key: bool
    accents: bool


@ti.data_oriented
class Shader:
    """Shades the samples of a raster.

    Args:
        light: `ShadowMap` or `TracedLight`.
        around: background and floor; textured, woven, hemmed: whether any cloth is. Code for
            other kinds is not compiled.
    """

    def __init__(self, raster: Raster, light: Any, around: "Around", textured: bool, woven: bool, hemmed: bool) -> None:
        self.raster, self.light = raster, light
        self.around, self.textured, self.woven, self.hemmed = around, textured, woven, hemmed
        self.width, self.height = raster.w // raster.samples, raster.h // raster.samples
        self.turns = raster.turns(self.height)

    def shade(self, *arrays: np.ndarray) -> np.ndarray:
        """(height, width, 4) f32 linear RGB, already multiplied by the alpha behind it."""
        image = np.empty((self.height, self.width, 4), dtype=np.float32)
        self._shade(*arrays, image)
        return image

    @ti.kernel
    def _shade(self, p: ti.types.ndarray(), x: ti.types.ndarray(), normals: ti.types.ndarray(),
               faces: ti.types.ndarray(), corner_uv: ti.types.ndarray(), colors: ti.types.ndarray(), backs: ti.types.ndarray(),
               owner: ti.types.ndarray(), objects: ti.types.ndarray(), texels: ti.types.ndarray(),
               levels: ti.types.ndarray(), decode: ti.types.ndarray(), borders: ti.types.ndarray(), rows: ti.types.ndarray(),
               paint: ti.types.ndarray(), image: ti.types.ndarray()):
        """Each face that is seen in a pixel is shaded once there, in the middle of the samples that see it."""
        n = self.raster.samples
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            for column in range(ti.select(row < self.height, self.width, 0)):
                total, done = ti.Vector([0.0, 0.0, 0.0, 0.0]), 0
                for s in range(n * n):
                    if (done >> s) & 1 == 0:
                        f = self.raster.face[(row * n + s // n) * self.raster.w + column * n + s % n]
                        at, count = ti.Vector([0.0, 0.0]), 0
                        for r in range(s, n * n):
                            px, py = column * n + r % n, row * n + r // n
                            if self.raster.face[py * self.raster.w + px] == f:
                                at, count, done = at + spot(px, py, n), count + 1, done | (1 << r)
                        at /= count
                        if f >= 0:
                            color = self.surface(f, at, ti.sqrt(count), row, column, p, x, normals, faces, corner_uv, colors,
                                                 backs, owner, objects, texels, levels, decode, borders, rows, paint)
                            total += count * ti.Vector([color[0], color[1], color[2], 1.0])
                        else:
                            total += count * self.background(at, row, column, rows)
                for c in ti.static(range(4)):
                    image[row, column, c] = ti.cast(total[c] / (n * n), ti.f32)

    @ti.func
    def surface(self, f, at, wide, row, column, p: ti.template(), x: ti.template(), normals: ti.template(),
                faces: ti.template(), corner_uv: ti.template(), colors: ti.template(), backs: ti.template(),
                owner: ti.template(), objects: ti.template(), texels: ti.template(), levels: ti.template(),
                decode: ti.template(), borders: ti.template(), rows: ti.template(), paint: ti.template()):
        """Colour of a face at a place of the picture; wide: of a square of so many samples."""
        i, j, l = faces[f, 0], faces[f, 1], faces[f, 2]
        a, b, c = corner(p, i), corner(p, j), corner(p, l)
        area = edge(a, b, c[0], c[1])
        flat_k = weights(a, b, c, area, at[0], at[1])
        k = flat_k * ti.Vector([a[2], b[2], c[2]])
        k /= k.sum()
        position = k[0] * corner(x, i) + k[1] * corner(x, j) + k[2] * corner(x, l)
        n = (k[0] * corner(normals, i) + k[1] * corner(normals, j) + k[2] * corner(normals, l)).normalized(1e-12)
        view = (corner(rows, EYE) - position).normalized(1e-12)
        base = corner(colors, f)
        flat = (corner(x, j) - corner(x, i)).cross(corner(x, l) - corner(x, i)).normalized(1e-12)
        front = 1
        side = ti.select(flat.dot(view) < 0, -1.0, 1.0)
        # faces of a round surface do not shade each other [J. Hanika: Hacking the Shadow Terminator, 2021]
        bulge = (k[0] * out_of(position, corner(x, i), side * corner(normals, i))
                 + k[1] * out_of(position, corner(x, j), side * corner(normals, j))
                 + k[2] * out_of(position, corner(x, l), side * corner(normals, l)))
        if flat.dot(view) < 0:
            n = -n
            flat = -flat
            base, front = corner(backs, f), 0
        uv, tilt = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
        for d in ti.static(range(2)):
            uv[d] = k[0] * corner_uv[f, 0, d] + k[1] * corner_uv[f, 1, d] + k[2] * corner_uv[f, 2, d]
        if f < rows[CLOTH, 1] and rows[SCENE, 0] > 0:
            base = k[0] * corner(paint, i) + k[1] * corner(paint, j) + k[2] * corner(paint, l)
        else:
            of_sample, o = footprint(f, corner_uv, area), owner[f]
            base = finish.squared(base, uv, of_sample * wide, rows[CLOTH, 0], objects, o)
            if ti.static(self.textured):
                if objects[o, TEXTURE] > 0 and (front == 1 or objects[o, BOTH] > 0):
                    base = finish.printed(base, uv, of_sample * wide, objects, o, texels, levels, decode)
            if ti.static(self.woven):
                if objects[o, WEAVE] > 0:
                    u, v, shade = finish.threads(uv, of_sample * self.raster.samples, objects, o)
                    base *= shade
                    tilt += ti.Vector([u, v])
            if ti.static(self.hemmed):
                if objects[o, HEM] > 0:
                    u, v, shade = finish.hemmed(uv, of_sample * self.raster.samples, borders, f, objects, o)
                    base *= shade
                    tilt += ti.Vector([u, v])
            if ti.static(self.woven or self.hemmed):
                n = tilted(n, tilt[0], tilt[1], f, faces, x, corner_uv)
        if rows[CLOTH, 2] > 0:
            base *= wire(a, b, c, area, flat_k, self.raster.samples)
        reached, open_sky = self.light.at(position, bulge, flat, row, column, rows)
        return lit(base, n, view, reached, open_sky, objects, owner[f], rows, self.around.key, self.around.accents)

    @ti.func
    def background(self, at, row, column, rows: ti.template()):
        """The colour where no surface is: ground that fades into the sky; alpha last."""
        t, ray = ground_at(at, self.raster.w, self.raster.h, rows)
        color, alpha = ti.Vector([0.0, 0.0, 0.0]), 1.0
        if ti.static(self.around.background == "sky"):
            color = sky(ray, rows)
        elif ti.static(self.around.background == "color"):
            color = corner(rows, BACKGROUND)
        else:
            alpha = 0.0
        if ti.static(self.around.floor != "none"):
            if t > 0:
                hit = corner(rows, EYE) + t * ray
                up_n = ti.Vector([0.0, 1.0, 0.0])
                reached, open_sky = 1.0, 1.0
                if t < FADE * rows[PLACE, 2]:
                    reached, open_sky = self.light.at(hit, 0 * up_n, up_n, row, column, rows)
                sun, above = corner(rows, POWER) * ti.max(corner(rows, LIGHT)[1], 0.0), corner(rows, UP)
                fade = ti.exp(-((t / (FADE * rows[PLACE, 2])) ** 4)) * ti.min(1.0, -ray[1] * 12)
                if ti.static(self.around.floor == "shadow"):
                    left = (sun[1] * reached + open_sky * above[1]) / (sun[1] + above[1])
                    color *= 1 - fade * (1 - left)
                    alpha += (1 - alpha) * fade * (1 - left)
                else:
                    ground = self.ground(hit, t, ray, rows) * (sun * reached + open_sky * above)
                    color = fade * ground + (1 - fade) * color
                    alpha = fade + (1 - fade) * alpha
        return ti.Vector([color[0], color[1], color[2], alpha])

    @ti.func
    def ground(self, hit, t, ray, rows: ti.template()):
        """Colour of the ground."""
        out = corner(rows, FLOOR)
        if ti.static(self.around.floor == "checker"):
            width = t / (rows[PLACE, 0] * self.height * ti.max(-ray[1], 0.02))  # of a pixel, along the view
            base = 0.455 + 0.05 * soft_checker(ti.Vector([hit[0], hit[2]]) / rows[PLACE, 2], width / rows[PLACE, 2])
            out = base * ti.Vector([1.0, 0.98, 0.95])
        return out


@ti.func
def out_of(position, place, normal):
    """(3,) from a position inside the plane through a corner's place, with its normal, out to it [m]."""
    return ti.max((place - position).dot(normal), 0.0) * normal


@ti.func
def footprint(f, corner_uv: ti.template(), area):
    """The part of a face's pattern that a sample covers [m]; area: twice the face's, in samples."""
    a, b = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
    for d in ti.static(range(2)):
        a[d], b[d] = corner_uv[f, 1, d] - corner_uv[f, 0, d], corner_uv[f, 2, d] - corner_uv[f, 0, d]
    return ti.sqrt(ti.abs(a[0] * b[1] - a[1] * b[0]) / ti.max(ti.abs(area), 1e-6)) + 1e-9


@ti.func
def tilted(n, u, v, f, faces: ti.template(), x: ti.template(), corner_uv: ti.template()):
    """A normal tilted along a face's material directions."""
    e, g = corner(x, faces[f, 1]) - corner(x, faces[f, 0]), corner(x, faces[f, 2]) - corner(x, faces[f, 0])
    a, b = ti.Vector([0.0, 0.0]), ti.Vector([0.0, 0.0])
    for d in ti.static(range(2)):
        a[d], b[d] = corner_uv[f, 1, d] - corner_uv[f, 0, d], corner_uv[f, 2, d] - corner_uv[f, 0, d]
    turn = 1.0
    if a[0] * b[1] - a[1] * b[0] < 0:
        turn = -1.0
    along_u = (turn * (b[1] * e - a[1] * g)).normalized(1e-12)  # dx/du, dx/dv but for their length
    along_v = (turn * (a[0] * g - b[0] * e)).normalized(1e-12)
    return (n + u * along_u + v * along_v).normalized(1e-12)
