"""An offscreen renderer in Taichi kernels: z-buffer, smooth two-sided shading, shadows, ambient occlusion, ground and sky.

Visibility is rasterised. Shade comes from a shadow map (`fast`) or traced rays: to a round light for soft shadows, and
over the hemisphere for ambient occlusion (`standard`, `high`). Everything is f32 whatever the simulation's precision.
"""

from typing import Any

import numpy as np

from .. import checks
from ..backend import placement, runtime
from ..backend.fields import Fields
from ..errors import BackendError
from ..scene.view import Camera, Color, View
from ..system.quantities import vertex_normals
from .camera import frame, ground_height
from .colors import to_srgb
from .quality import EXPOSED, QUALITY
from .raster import Raster
from .rig import Rig, rig_of
from .shade import Around, Shader
from .shadow_map import MAP, ShadowMap
from .surfaces import Surfaces
from .traced_light import TracedLight
from .uniforms import uniforms

LARGE = 0.1  # size of a light whose wide shadows take twice the rays


class Renderer:
    """Draws cloth and solids.

    Args:
        width, height: of the picture [pixels].
        x: (n, 3) first positions [m], by which ground and shadows take their size.
        view: with one camera, and the surroundings.
        quality: one of QUALITY; exposed: whether a picture is the mean of many exposures.
    """

    def __init__(self, width: int, height: int, surfaces: Surfaces, x: np.ndarray, view: View, quality: str = "fast",
                 exposed: bool = False) -> None:
        samples, *rays = (EXPOSED if exposed else QUALITY)[checks.choice("quality", quality, QUALITY)]
        self.surfaces = surfaces
        self.camera = frame(checks.instance("renderer: view camera", view.camera, Camera))
        self.ground = ground_height(x, view)
        size = float(np.linalg.norm(x.max(axis=0) - x.min(axis=0))) + 2 * view.reach
        self.tile = 10.0 ** np.floor(np.log10(max(size, 1e-6))) / (5 if size < 3 * 10 ** np.floor(np.log10(size)) else 2)
        self.size = max(size, 1e-9)
        extent = np.ptp(surfaces.corner_uv.reshape(-1, 2), axis=0).max()
        self.checks = float(extent) / 20 if extent > 0 else 1.0
        self.rig = rig_of(view.light, self.camera)
        self.light = light_frame(self.rig.key)
        self.view = view
        around = around_of(view, self.rig)
        fields = Fields(np.float32, pooled=runtime.on_cpu())
        self.raster = Raster(fields, width * samples, height * samples, samples, 0 if rays[0] else MAP * MAP)
        self.lighting: Any = ShadowMap(self.raster)
        if rays[0]:
            shadow, ambient = rays if around.key else (0, 2 * rays[1])
            shadow *= 2 if self.rig.size > LARGE else 1
            self.lighting = TracedLight(fields, self.raster, samples, around.floor != "none", len(surfaces.faces),
                                        (shadow, ambient))
        fields.allocate()
        self.fields = fields  # given back when nobody has the renderer any more
        self.shader = Shader(self.raster, self.lighting, around, surfaces.textured, surfaces.woven, surfaces.hemmed)
        images = surfaces.textures
        self.images = images.texels, images.levels, images.decode
        runtime.hold(self)
        self.generation = runtime.generation

    @property
    def transparent(self) -> bool:
        """Whether pictures have alpha."""
        return self.view.background == "transparent"

    def look(self, camera: Camera) -> None:
        """Looks through another camera from now on."""
        self.camera = frame(camera)

    def render(self, x: np.ndarray, colors: np.ndarray | None = None, wire: bool = False, bits: int = 8) -> np.ndarray:
        """(height, width, 3) uint8 picture at positions (n, 3) [m]; with alpha, (height, width, 4), where that is transparent.

        Args:
            colors: (k, 3) linear RGB of the first k vertices, cloth's, instead of the fabric's.
            wire: draws the triangles' edges.
            bits: of a number: 8, or 16 for uint16.

        Raises:
            BackendError: Taichi was started anew since.
        """
        return developed(self.light_of(x, colors, wire), bits, self.transparent)

    def light_of(self, x: np.ndarray, colors: np.ndarray | None = None, wire: bool = False, exposure: int = 0) -> np.ndarray:
        """(height, width, 4) f32 linear RGB, already multiplied by the alpha behind it; see `render`.

        Args:
            exposure: its number, where a picture is the mean of many: rays of each go other ways.
        """
        if self.generation != runtime.generation:
            raise BackendError("this renderer ended when a simulation was started with a different arch, precision or number "
                               "of threads: make another")
        placement.mind()
        s, c = self.surfaces, self.camera
        screen = c.project(x, self.raster.w, self.raster.h).astype(np.float32)
        self.raster.see(screen, s.faces, c.near)
        shadow = self.lighting.prepare(x, s.faces, self.light)
        behind, floor = (rgb(color, self.rig) for color in (self.view.background, self.view.drawn_floor))
        rows = uniforms(c, self.light, self.ground, self.tile, shadow, self.checks, s.cloth_faces, wire, colors is not None,
                        self.size, behind, floor, self.rig, exposure)
        paint = np.zeros((1, 3), dtype=np.float32) if colors is None else np.ascontiguousarray(colors, dtype=np.float32)
        points, normals = x.astype(np.float32), vertex_normals(x, s.faces).astype(np.float32)
        self.lighting.trace(screen, points, s.faces, rows)
        return self.shader.shade(screen, points, normals, s.faces, s.corner_uv, s.colors, s.backs, s.owner, s.objects,
                                 *self.images, s.borders, rows, paint)


def light_frame(direction: Color) -> np.ndarray:
    """(3, 3) two rows across a direction, and itself, of length 1."""
    light = np.array(direction) / np.linalg.norm(direction)
    side = np.cross([0.0, 0.0, 1.0], light)
    side = side / np.linalg.norm(side) if np.linalg.norm(side) > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.stack([side, np.cross(light, side), light])


def around_of(view: View, rig: Rig) -> Around:
    """The kinds of background, floor and lights."""
    background, floor = view.background, view.drawn_floor
    return Around(background if isinstance(background, str) else "color", floor if isinstance(floor, str) else "plain",
                  any(rig.power), any(rig.fill + rig.rim))


def rgb(color: str | Color, rig: Rig) -> np.ndarray:
    """(3,) linear RGB; that of the plain floor for a value that is no colour."""
    return np.array(rig.floor if isinstance(color, str) else color)


def developed(light: np.ndarray, bits: int, alpha: bool) -> np.ndarray:
    """sRGB of linear RGB (h, w, 4) that is multiplied by its alpha: (h, w, 3) or, with alpha, (h, w, 4), uint8 or uint16.

    With alpha, colours are those where nothing shines through, as PNG wants it.
    """
    if not alpha:
        return to_srgb(light[..., :3], bits)
    part = light[..., 3:]
    color = light[..., :3] / np.maximum(part, 1e-6)
    most = 2**bits - 1
    return np.concatenate([to_srgb(color, bits), (part * most + 0.5).astype(np.uint8 if bits == 8 else np.uint16)], axis=2)
