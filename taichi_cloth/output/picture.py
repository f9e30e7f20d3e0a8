"""Pictures of a recorded run: geometry once, then frame after frame, with camera, heat map and caption."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from ..scene.view import Camera, View
from .camera import fit
from .colors import PALETTE, STONE, draw_bar, heat_colors
from .raster import QUALITY, Renderer
from .text import draw_text


@dataclass(frozen=True)
class Heat:
    """A quantity to colour the cloth by.

    Attributes:
        name: and unit, for the bar.
        values: function of a frame's arrays that gives (n,) values.
        range: (low, high) of the scale.
        diverging: whether its middle is special.
    """

    name: str
    unit: str
    values: Callable[[dict[str, np.ndarray]], np.ndarray]
    range: tuple[float, float]
    diverging: bool


@dataclass(frozen=True)
class Look:
    """How to draw.

    Attributes:
        quality: one of `raster.QUALITY`.
        camera: None takes the scene's, or fits one.
        orbit: degrees that the camera goes round its target in a second.
        follow: whether the camera moves with the cloth's centre.
        wire: whether edges are drawn; heat: what colours the cloth, or None.
        caption: text, in which {t} and {frame} stand for the time and the frame; "" draws none.

    Raises:
        SceneError: an impossible value or an unknown name.
    """

    quality: str = "fast"
    camera: Camera | None = None
    orbit: float = 0.0
    follow: bool = False
    wire: bool = False
    heat: Heat | None = None
    caption: str = ""

    def __post_init__(self) -> None:
        checks.choice("quality", self.quality, QUALITY)
        checks.maybe(self.camera, checks.instance, "camera", Camera)
        object.__setattr__(self, "orbit", checks.number("orbit", self.orbit, "degrees a second"))
        for name in ("follow", "wire"):
            object.__setattr__(self, name, checks.flag(name, getattr(self, name)))
        checks.maybe(self.heat, checks.instance, "heat", Heat)
        try:
            self.caption_at(0.0, 0)
        except (AttributeError, IndexError, KeyError, ValueError, TypeError):
            raise SceneError(f"caption = {shown(self.caption)}: must be a text with nothing but {{t}} and {{frame}} in "
                             "braces; {{ and }} stand for braces themselves") from None

    def caption_at(self, t: float, number: int) -> str:
        """The caption of a frame at time t [s]."""
        return checks.instance("caption", self.caption, str).format(t=f"{t:.3f}", frame=number)


class Artist:
    """Draws frames of one geometry, both as `record` makes them.

    Args:
        size: (width, height) [pixels].
    """

    def __init__(self, geometry: dict[str, np.ndarray], size: tuple[int, int], look: Look) -> None:
        self.look, self.geometry = look, geometry
        ground, c = float(geometry["ground"]), geometry["camera"].tolist()
        camera = look.camera or (None if np.isnan(c[0]) else Camera(tuple(c[:3]), tuple(c[3:6]), c[6], tuple(c[7:])))
        view = View(camera, None if np.isnan(ground) else ground, float(geometry["reach"]))
        faces, n = geometry["faces"], len(geometry["x"])
        first = np.concatenate([geometry["x"], geometry["solid_x"]])
        solid_faces = geometry["solid_faces"]
        m = len(solid_faces)
        cloth = [np.tile(_color(c, PALETTE[k % len(PALETTE)]), (int(count), 1))
                 for k, (c, count) in enumerate(zip(geometry["cloth_colors"], np.diff(geometry["cloth_faces"])))]
        owner = np.searchsorted(geometry["solid_start"], solid_faces[:, 0], side="right") - 1
        stone = np.array([_color(c, STONE) for c in geometry["solid_colors"]]).reshape(-1, 3)
        colors = np.concatenate([*cloth, stone[owner]])
        uv = np.concatenate([geometry["uv"], np.zeros((m, 3, 2), dtype=np.float32)])
        self.camera = view.camera or fit(first, view, size[0] / size[1])
        self.renderer = Renderer(*size, np.concatenate([faces, solid_faces + n]), uv, colors, first, view, len(faces),
                                 look.quality)
        self.centre = geometry["x"].mean(axis=0)

    def draw(self, frame: dict[str, np.ndarray], number: int = 0) -> np.ndarray:
        """(height, width, 3) uint8 picture of a frame."""
        x = np.concatenate([frame["x"], frame.get("solid_x", self.geometry["solid_x"])]).astype(np.float64)
        look, colors = self.look, None
        if look.orbit or look.follow:
            self.renderer.look(self._camera(frame))
        if look.heat is not None:
            colors = heat_colors(look.heat.values(frame), *look.heat.range, look.heat.diverging)
        image = self.renderer.render(x, colors, look.wire)
        if look.heat is not None:
            label = f"{look.heat.name} [{look.heat.unit}]" if look.heat.unit else look.heat.name
            draw_bar(image, *look.heat.range, look.heat.diverging, label)
        if look.caption:
            scale = max(1, image.shape[0] // 360)
            draw_text(image, look.caption_at(float(frame["t"]), number), 10 * scale, 10 * scale, scale)
        return image

    def _camera(self, frame: dict[str, np.ndarray]) -> Camera:
        eye, target = np.array(self.camera.eye), np.array(self.camera.target)
        angle = np.radians(self.look.orbit * float(frame["t"]))
        c, s = np.cos(angle), np.sin(angle)
        arm = (eye - target) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        if self.look.follow:
            target = target + frame["x"].mean(axis=0) - self.centre
        return replace(self.camera, eye=tuple((target + arm).tolist()), target=tuple(target.tolist()))


def contact_sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Pictures of one size in one, row by row."""
    height, width = images[0].shape[:2]
    rows = -(-len(images) // columns)
    out = np.full((rows * height, columns * width, 3), 255, dtype=np.uint8)
    for k, image in enumerate(images):
        row, column = divmod(k, columns)
        out[row * height: (row + 1) * height, column * width: (column + 1) * width] = image
    return out


def _color(own: np.ndarray, other: tuple[float, float, float]) -> np.ndarray:
    return np.array(other) if np.isnan(own).any() else np.asarray(own)
