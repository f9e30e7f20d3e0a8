"""An offscreen renderer in Taichi kernels: z-buffer, smooth two-sided shading, shadows, ambient occlusion, checker ground.

What is seen is rasterised; what shades it is a shadow map (`fast`) or traced rays: to a round light for soft shadows, and
over the hemisphere for ambient occlusion (`standard`, `high`). Everything is f32 whatever the simulation's precision.
"""

from typing import Any

import numpy as np
import taichi as ti

from .. import checks
from ..backend import runtime
from ..errors import BackendError
from ..scene.view import Camera, View
from .camera import fit, frame, ground_height
from .colors import to_srgb
from .coverage import PIECE, corner, edge, pieces, weights, wire
from .rays import RayTree
from .surroundings import ambient, checker, sky, soft_checker

QUALITY = {"fast": (2, 0, 0), "standard": (2, 2, 4), "high": (3, 6, 12)}  # samples an axis, shadow and ambient rays each
LIGHT_SIZE = 0.06  # tangent of half the angle under which the light is seen
REACH = 2  # pixels around that share what rays found
OCCLUDE = 0.35  # part of the scene's size beyond which nothing takes ambient light away
SHADOW = 1536  # shadow map, pixels a side
SAME = 8  # roundings by which depths of one sample may differ between the two passes: not all backends round alike
LIGHT = (0.45, 0.8, 0.5)  # towards the key light


@ti.data_oriented
class Renderer:
    """Draws cloth and solids.

    Args:
        width, height: of the picture [pixels].
        faces: (m, 3); corner_uv: (m, 3, 2) [m]; colors: (m, 3) linear RGB.
        x: (n, 3) first positions [m], which a fitted camera fits.
        view: camera and ground.
        cloth_faces: how many of the faces, the first ones, are cloth; the others are solids: plain, one colour. None
            is all.
        quality: one of QUALITY.
    """

    def __init__(self, width: int, height: int, faces: np.ndarray, corner_uv: np.ndarray, colors: np.ndarray,
                 x: np.ndarray, view: View, cloth_faces: int | None = None, quality: str = "fast") -> None:
        self.samples, self.shadow_rays, self.ambient_rays = QUALITY[checks.choice("quality", quality, QUALITY)]
        self.traces = self.shadow_rays > 0
        self.cloth_faces = len(faces) if cloth_faces is None else cloth_faces
        self.width, self.height = width, height
        self.w, self.h = width * self.samples, height * self.samples
        self.faces = np.ascontiguousarray(faces, dtype=np.int32)
        self.corner_uv = np.ascontiguousarray(corner_uv, dtype=np.float32)
        self.colors = np.ascontiguousarray(colors, dtype=np.float32)
        self.view, self.first = view, x
        self.camera = frame(view.camera or fit(x, view, width / height))
        self.ground = ground_height(x, view)
        size = float(np.linalg.norm(x.max(axis=0) - x.min(axis=0))) + 2 * view.reach
        self.tile = 10.0 ** np.floor(np.log10(max(size, 1e-6))) / (5 if size < 3 * 10 ** np.floor(np.log10(size)) else 2)
        extent = np.ptp(self.corner_uv.reshape(-1, 2), axis=0).max()
        self.weave = float(extent) / 20 if extent > 0 else 1.0
        light = np.array(LIGHT) / np.linalg.norm(LIGHT)
        side = np.cross([0.0, 0.0, 1.0], light)
        side /= np.linalg.norm(side)
        self.light = np.stack([side, np.cross(light, side), light])
        self.size = max(size, 1e-9)
        self.tree: Any = RayTree(len(faces)) if self.traces else None
        self.wide = ti.cfg.arch not in (ti.x64, ti.arm64)
        self._no_values: np.ndarray = np.zeros((1, 3), dtype=np.float32)
        runtime.hold(self)
        self.generation = runtime.generation()
        # nearest 1/depth and the face that has it: picture first, shadow map behind it
        pixels = self.w * self.h + (0 if self.traces else SHADOW * SHADOW)
        self.depth, self.face = ti.field(ti.i32, pixels), ti.field(ti.i32, pixels)  # depth: bits of an f32 from 0 up
        if self.traces:  # by pixel: what light reaches it, where it is, which way it faces
            self.lit = ti.Vector.field(2, ti.f32, width * height)
            self.spot, self.facing = (ti.Vector.field(3, ti.f32, width * height) for _ in range(2))

    def look(self, camera: Camera) -> None:
        """Looks through another camera from now on."""
        self.camera = frame(camera)

    def render(self, x: np.ndarray, colors: np.ndarray | None = None, wire: bool = False) -> np.ndarray:
        """(height, width, 3) uint8 picture at positions (n, 3) [m].

        Args:
            colors: (k, 3) linear RGB of the first k vertices, cloth's, instead of the fabric's.
            wire: draws the triangles' edges.

        Raises:
            BackendError: Taichi was started anew since.
        """
        if self.generation != runtime.generation():
            raise BackendError("this renderer ended when a simulation was started with a different arch, precision or number "
                               "of threads: make another")
        screen = self.camera.project(x, self.w, self.h).astype(np.float32)
        self._clear()
        seen = pieces(screen, self.faces, self.w, self.h, 1 / self.camera.near)
        for identify in range(2):
            self._raster(screen, self.faces, seen, self.w, 0, identify)
        shadow_frame = np.zeros((2, 3))
        if self.tree is not None:
            self.tree.build(x, self.faces)
        else:
            shadow, shadow_frame = self._light_view(x)
            self._raster(shadow, self.faces, pieces(shadow, self.faces, SHADOW, SHADOW, np.inf), SHADOW,
                         self.w * self.h, 0)
        image = np.empty((self.height, self.width, 3), dtype=np.float32)
        c = self.camera
        rows = np.concatenate([c.axes, [c.eye], self.light, [[c.focal, self.ground, self.tile]], shadow_frame,
                               [[self.weave, self.cloth_faces, wire]], [[colors is not None, self.size, 0]]])
        paint = self._no_values if colors is None else np.ascontiguousarray(colors, dtype=np.float32)
        rows = rows.astype(np.float32)
        if self.traces:
            self._light(screen, x.astype(np.float32), self.faces, rows)
        self._shade(screen, x.astype(np.float32), vertex_normals(x, self.faces), self.faces, self.corner_uv, self.colors,
                    rows, paint, image)
        return to_srgb(image)

    def _light_view(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points as the light sees them, all of them in its map; and how to get there: rows low, scale."""
        local = x @ self.light.T
        low, high = local.min(axis=0), local.max(axis=0)
        size = max(float((high - low)[:2].max()), 1e-9) * 1.05
        scale = np.array([SHADOW / size, SHADOW / size, 1 / max(float(high[2] - low[2]), 1e-9)])
        centre = np.array([*(low + high)[:2] / 2 - size / 2, low[2]])
        # heights above the lowest, from 1 up, because 0 means nothing
        seen = (local - centre) * scale + [0, 0, 1]
        return seen.astype(np.float32), np.stack([centre, scale])

    @ti.kernel
    def _clear(self):
        for i in self.depth:
            self.depth[i] = 0
            self.face[i] = -1

    @ti.kernel
    def _raster(self, p: ti.types.ndarray(), faces: ti.types.ndarray(), pieces: ti.types.ndarray(), w: int, offset: int,
                identify: int):
        """Nearest depth in each pixel; then, with `identify`, which face it was that has it."""
        if ti.static(self.wide):
            for i in range(pieces.shape[0] * PIECE):
                self._touch(p, faces, pieces, i // PIECE, i % PIECE, w, offset, identify)
        else:
            for piece in range(pieces.shape[0]):
                for i in range(PIECE):
                    self._touch(p, faces, pieces, piece, i, w, offset, identify)

    @ti.func
    def _touch(self, p: ti.template(), faces: ti.template(), pieces: ti.template(), piece, i, w, offset, identify):
        """One pixel of a piece of a triangle's box."""
        f, i_box, across = pieces[piece, 0], pieces[piece, 1] + i, pieces[piece, 4]
        if i_box < pieces[piece, 5]:
            a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
            x, y = pieces[piece, 2] + i_box % across, pieces[piece, 3] + i_box // across
            k = weights(a, b, c, edge(a, b, c[0], c[1]), x + 0.5, y + 0.5)
            if k.min() >= 0:
                pixel = offset + y * w + x
                here = ti.bit_cast(ti.cast(k.dot(ti.Vector([a[2], b[2], c[2]])), ti.f32), ti.i32)
                if identify == 0:
                    ti.atomic_max(self.depth[pixel], here)
                elif here >= self.depth[pixel] - SAME:
                    ti.atomic_max(self.face[pixel], f)

    @ti.kernel
    def _shade(self, p: ti.types.ndarray(), x: ti.types.ndarray(), normals: ti.types.ndarray(),
               faces: ti.types.ndarray(), corner_uv: ti.types.ndarray(), colors: ti.types.ndarray(),
               rows: ti.types.ndarray(), paint: ti.types.ndarray(), image: ti.types.ndarray()):
        for row in range(self.height):
            for column in range(self.width):
                total = ti.Vector([0.0, 0.0, 0.0])
                for s in range(self.samples * self.samples):
                    px, py = column * self.samples + s % self.samples, row * self.samples + s // self.samples
                    f = self.face[py * self.w + px]
                    if f >= 0:
                        total += self.cloth(f, px, py, p, x, normals, faces, corner_uv, colors, rows, paint)
                    else:
                        total += self.background(px, py, rows)
                for c in ti.static(range(3)):
                    image[row, column, c] = ti.cast(total[c] / (self.samples * self.samples), ti.f32)

    @ti.func
    def cloth(self, f, px, py, p: ti.template(), x: ti.template(), normals: ti.template(), faces: ti.template(),
              corner_uv: ti.template(), colors: ti.template(), rows: ti.template(), paint: ti.template()):
        """Colour of a face at a sample."""
        i, j, l = faces[f, 0], faces[f, 1], faces[f, 2]
        a, b, c = corner(p, i), corner(p, j), corner(p, l)
        area = edge(a, b, c[0], c[1])
        flat_k = weights(a, b, c, area, px + 0.5, py + 0.5)
        k = flat_k * ti.Vector([a[2], b[2], c[2]])
        k /= k.sum()
        position = k[0] * corner(x, i) + k[1] * corner(x, j) + k[2] * corner(x, l)
        n = (k[0] * corner(normals, i) + k[1] * corner(normals, j) + k[2] * corner(normals, l)).normalized(1e-12)
        view = (corner(rows, 3) - position).normalized(1e-12)
        base = corner(colors, f)
        flat = (corner(x, j) - corner(x, i)).cross(corner(x, l) - corner(x, i)).normalized(1e-12)
        if flat.dot(view) < 0:  # the back is a paler cloth
            n = -n
            flat = -flat
            if f < rows[10, 1] and rows[11, 0] == 0:
                base = 0.55 * base + 0.3
        uv = ti.Vector([0.0, 0.0])
        for d in ti.static(range(2)):
            uv[d] = k[0] * corner_uv[f, 0, d] + k[1] * corner_uv[f, 1, d] + k[2] * corner_uv[f, 2, d]
        if f < rows[10, 1]:
            if rows[11, 0] > 0:
                base = k[0] * corner(paint, i) + k[1] * corner(paint, j) + k[2] * corner(paint, l)
            else:
                base *= 1.0 - 0.16 * checker(uv / rows[10, 0])
        if rows[10, 2] > 0:
            base *= wire(a, b, c, area, flat_k, self.samples)
        light = corner(rows, 6)
        reached, open_sky = self.light_at(position, flat, px, py, rows)
        lit = ti.max(n.dot(light), 0.0) * reached
        half = (light + view).normalized(1e-12)
        gloss = 0.06 * ti.max(n.dot(half), 0.0) ** 24 * lit
        rim = 0.08 * (1 - ti.max(n.dot(view), 0.0)) ** 3
        return base * (0.98 * lit + open_sky * ambient(n)) + gloss + rim * open_sky * ambient(n)

    @ti.func
    def background(self, px, py, rows: ti.template()):
        """Checker ground that fades into the sky."""
        t, ray = self.ground_at(px, py, rows)
        color = sky(ray)
        if t > 0:
            hit = corner(rows, 3) + t * ray
            width = t / (rows[7, 0] * self.h * ti.max(-ray[1], 0.02))  # of a sample on the ground, along the view
            base = 0.34 + 0.10 * soft_checker(ti.Vector([hit[0], hit[2]]) / rows[7, 2], width / rows[7, 2])
            up_n = ti.Vector([0.0, 1.0, 0.0])
            reached, open_sky = 1.0, 1.0
            if t < 60 * rows[7, 2]:
                reached, open_sky = self.light_at(hit, up_n, px, py, rows)
            ground = base * ti.Vector([1.0, 0.98, 0.95]) * (0.98 * corner(rows, 6)[1] * reached + open_sky * ambient(up_n))
            fade = ti.exp(-t / (60 * rows[7, 2])) * ti.min(1.0, -ray[1] * 12)
            color = fade * ground + (1 - fade) * color
        return color

    @ti.kernel
    def _light(self, p: ti.types.ndarray(), x: ti.types.ndarray(), faces: ti.types.ndarray(), rows: ti.types.ndarray()):
        """Traces what light reaches the middle of every pixel: share of the light, share of the sky."""
        for row in range(self.height):
            for column in range(self.width):
                px, py = column * self.samples + self.samples // 2, row * self.samples + self.samples // 2
                f = self.face[py * self.w + px]
                there, spot, flat = 0, ti.Vector([0.0, 0.0, 0.0]), ti.Vector([0.0, 1.0, 0.0])
                if f >= 0:
                    a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
                    k = weights(a, b, c, edge(a, b, c[0], c[1]), px + 0.5, py + 0.5) * ti.Vector([a[2], b[2], c[2]])
                    k /= k.sum()
                    q, r, s = corner(x, faces[f, 0]), corner(x, faces[f, 1]), corner(x, faces[f, 2])
                    spot, there = k[0] * q + k[1] * r + k[2] * s, 1
                    flat = (r - q).cross(s - q).normalized(1e-12)
                    if flat.dot(corner(rows, 3) - spot) < 0:
                        flat = -flat
                else:
                    t, ray = self.ground_at(px, py, rows)
                    if t > 0 and t < 60 * rows[7, 2]:
                        spot, there = corner(rows, 3) + t * ray, 1
                reached, open_sky = 1.0, 1.0
                if there == 1:
                    reached, open_sky = self.trace(spot, flat, px * 73 + py * 9781, rows)
                pixel = row * self.width + column
                self.lit[pixel] = ti.Vector([reached, open_sky])
                self.spot[pixel], self.facing[pixel] = spot, flat * there

    @ti.func
    def trace(self, spot, flat, seed, rows: ti.template()):
        """Rays to the light, which is round, and over the hemisphere."""
        size, light = rows[11, 1], corner(rows, 6)
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
                way, reach = (light + r * (ti.cos(w) * corner(rows, 4) + ti.sin(w) * corner(rows, 5))).normalized(), 1e9
            blocked = self.tree.blocked(origin, way, reach)
            if s < self.shadow_rays:
                dark += blocked
            else:
                closed += blocked
        return 1 - dark / self.shadow_rays, 1 - 0.85 * closed / self.ambient_rays

    @ti.func
    def light_at(self, position, flat, px, py, rows: ti.template()):
        """(share of the light, share of the sky) at a sample: of pixels around that see the same surface, or by the map."""
        reached, open_sky = 1.0, 1.0
        if ti.static(self.traces):
            row, column = py // self.samples, px // self.samples
            eye = corner(rows, 3)
            width = (position - eye).norm() / (rows[7, 0] * self.height)  # of a pixel there
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
            reached, open_sky = total[0] / weight, total[1] / weight
        else:
            reached = self.light_reaches(position + flat * 0.004 / rows[9, 2], rows)
        return reached, open_sky

    @ti.func
    def ground_at(self, px, py, rows: ti.template()):
        """(distance along the ray of a sample to the ground or -1, the ray)."""
        right = (px + 0.5 - self.w / 2) / (rows[7, 0] * self.h)
        up = (self.h / 2 - py - 0.5) / (rows[7, 0] * self.h)
        ray = (right * corner(rows, 0) + up * corner(rows, 1) - corner(rows, 2)).normalized()
        t = -1.0
        if ray[1] < -1e-4 and rows[3, 1] > rows[7, 1]:
            t = (rows[7, 1] - rows[3, 1]) / ray[1]
        return t, ray

    @ti.func
    def light_reaches(self, position, rows: ti.template()):
        """Share of the light that reaches a point: 0 in full shadow."""
        local = ti.Vector([corner(rows, 4).dot(position), corner(rows, 5).dot(position),
                           corner(rows, 6).dot(position)])
        seen = (local - corner(rows, 8)) * corner(rows, 9)
        reached, taps = 0.0, 0.0
        for dy in range(-2, 3):
            for dx in range(-2, 3):
                sx, sy = ti.cast(ti.floor(seen[0]), int) + 2 * dx, ti.cast(ti.floor(seen[1]), int) + 2 * dy
                taps += 1.0
                above = 0.0
                if 0 <= sx and sx < SHADOW and 0 <= sy and sy < SHADOW:
                    above = ti.bit_cast(self.depth[self.w * self.h + sy * SHADOW + sx], ti.f32)
                if above <= 0 or above <= seen[2] + 1.0 + 0.006:
                    reached += 1.0
        return reached / taps


@ti.func
def spread(seed, s):
    """A point of [0, 1) x [0, 2 pi): rays of a sample in a low-discrepancy sequence, turned from sample to sample."""
    h = ti.cast(seed, ti.u32) * ti.u32(2654435761)
    h = (h ^ (h >> 15)) * ti.u32(2246822519)
    h = h ^ (h >> 13)
    a = ti.cast(h & ti.u32(65535), ti.f32) / 65536.0 + 0.7548777 * s
    b = ti.cast(h >> 16, ti.f32) / 65536.0 + 0.5698403 * s
    return a - ti.floor(a), 6.2831853 * (b - ti.floor(b))


def vertex_normals(x: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(n, 3) f32 normals, the mean of a vertex's triangles weighted by area."""
    a, b, c = (x[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    out = np.zeros_like(x)
    for d in range(3):
        out[:, d] = sum(np.bincount(faces[:, k], normal[:, d], minlength=len(x)) for k in range(3))
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return (out / np.maximum(length, 1e-30)).astype(np.float32)
