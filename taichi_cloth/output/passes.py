"""The surface in the middle of each pixel: how far, which way it faces, of which object. For compositing and as ground
truth."""

from typing import Any

import numpy as np

from ..backend import runtime
from ..backend.fields import Fields
from ..backend.language import ti
from ..system.quantities import vertex_normals
from .coverage import corner, edge, weights
from .ground import FADE, ground_at
from .raster import Raster
from .uniforms import AXES, EYE, PLACE, uniforms

PASSES = ("depth", "normal", "id")
SOLID_FLOORS = ("checker", "plain")  # other floors have no surface


@ti.data_oriented
class PassRaster:
    """Draws passes at a sample a pixel: their values mean nothing where they are averaged."""

    def __init__(self, width: int, height: int) -> None:
        self.fields = Fields(np.float32, pooled=runtime.on_cpu())
        self.raster = Raster(self.fields, width, height)
        self.fields.allocate()
        self.width, self.height = width, height
        self.turns = self.raster.turns(height)

    def draw(self, renderer: Any, x: np.ndarray) -> dict[str, np.ndarray]:
        """Passes of a renderer's surfaces at positions x (n, 3) [m], through its camera.

        Returns:
            depth (h, w) f32: distance along the direction of view [m]; normal (h, w, 3) f32: in the world, of length 1,
            towards the eye; id (h, w) int32: cloths, solids and the ground from 1 on. In empty pixels depth is infinite,
            normal and id are 0.
        """
        s, c = renderer.surfaces, renderer.camera
        screen = c.project(x, self.width, self.height).astype(np.float32)
        self.raster.see(screen, s.faces, c.near)
        rows = uniforms(c, renderer.light, renderer.ground, renderer.tile, np.zeros((2, 3)), 1.0, s.cloth_faces, False, False,
                        renderer.size, np.zeros(3), np.zeros(3), renderer.rig)
        shape = self.height, self.width
        depth, number = np.full(shape, np.inf, np.float32), np.zeros(shape, np.int32)
        normal = np.zeros((*shape, 3), np.float32)
        floor = len(s.objects) + 1 if renderer.shader.around.floor in SOLID_FLOORS else 0
        normals = vertex_normals(x, s.faces).astype(np.float32)
        self._fill(screen, x.astype(np.float32), normals, s.faces, s.owner, rows, floor, depth, normal, number)
        return {"depth": depth, "normal": normal, "id": number}

    @ti.kernel
    def _fill(self, p: ti.types.ndarray(), x: ti.types.ndarray(), normals: ti.types.ndarray(), faces: ti.types.ndarray(),
              owner: ti.types.ndarray(), rows: ti.types.ndarray(), floor: int, depth: ti.types.ndarray(),
              normal: ti.types.ndarray(), number: ti.types.ndarray()):
        for t in range(self.turns):
            row = self.raster.row(t, self.turns, self.height)
            for column in range(ti.select(row < self.height, self.width, 0)):
                f = self.raster.face[row * self.width + column]
                n = ti.Vector([0.0, 0.0, 0.0])
                if f >= 0:
                    a, b, c = corner(p, faces[f, 0]), corner(p, faces[f, 1]), corner(p, faces[f, 2])
                    k = weights(a, b, c, edge(a, b, c[0], c[1]), column + 0.5, row + 0.5) * ti.Vector([a[2], b[2], c[2]])
                    depth[row, column] = ti.cast(1 / k.sum(), ti.f32)
                    k /= k.sum()
                    q, r, s = corner(x, faces[f, 0]), corner(x, faces[f, 1]), corner(x, faces[f, 2])
                    n = (k[0] * corner(normals, faces[f, 0]) + k[1] * corner(normals, faces[f, 1])
                         + k[2] * corner(normals, faces[f, 2])).normalized(1e-12)
                    if (r - q).cross(s - q).dot(corner(rows, EYE) - q) < 0:
                        n = -n
                    number[row, column] = owner[f] + 1
                elif floor > 0:
                    away, ray = ground_at(ti.Vector([column + 0.5, row + 0.5]), self.width, self.height, rows)
                    if away > 0 and away < FADE * rows[PLACE, 2]:
                        depth[row, column] = ti.cast(-away * ray.dot(corner(rows, AXES + 2)), ti.f32)
                        n = ti.Vector([0.0, 1.0, 0.0])
                        number[row, column] = floor
                for d in ti.static(range(3)):
                    normal[row, column, d] = ti.cast(n[d], ti.f32)


def named(passes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Passes as channels of an EXR image."""
    out = {}
    for name, array in passes.items():
        if name == "depth":
            out["depth.Z"] = array
        elif name == "normal":
            out |= {f"normal.{axis}": array[..., d] for d, axis in enumerate("XYZ")}
        else:
            out["id.I"] = array
    return out
