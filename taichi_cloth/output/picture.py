"""Pictures of a recorded run: geometry once, then frame after frame, with camera, heat map and caption."""

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from ..errors import OutputError
from ..scene.appearance import Appearance
from ..scene.view import Camera, CameraKeys, View, camera_at
from .camera import ground_height
from .colors import PALETTE, STONE, draw_bar, heat_colors
from .described import appearances_of, image_uv, view_of
from .finish import COLUMNS, Textures, object_row
from .framing import fit_all, fit_round
from .look import Look
from .passes import PassRaster
from .renderer import Renderer, developed
from .smooth import Smooth
from .surfaces import Surfaces, back_of
from .text import draw_text

Frame = dict[str, np.ndarray]


class Artist:
    """Draws frames of one geometry, both as `record` makes them.

    Args:
        size: (width, height) [pixels].
        frames: gives the frames, or what is known of them, that a fitted camera has to have in its picture.

    Raises:
        SceneError: the look names a cloth that is not there.
    """

    def __init__(self, geometry: Frame, size: tuple[int, int], look: Look,
                 frames: Callable[[], Iterable[Frame]] | None = None) -> None:
        self.look, self.geometry, self.size = look, geometry, size
        self._first = {name: geometry[name] for name in ("faces", "sewn") if name in geometry}
        look.check_names([str(name) for name in geometry["cloth_names"]])
        self.smooth = (Smooth(geometry["faces"], len(geometry["x"]), look.smooth, geometry.get("sewn")) if look.smooth
                       else None)
        first = np.concatenate([geometry["x"], geometry["solid_x"]])
        self.centre = (geometry["x"] if len(geometry["x"]) else first).mean(axis=0)
        view = look.view(view_of(geometry))
        self.fitted = view.camera is None
        view = self._placed(view, first, frames)
        self.camera = view.camera
        view = replace(view, camera=camera_at(view.camera, 0.0))
        self.renderer = Renderer(*size, surfaces(geometry, look, self.smooth), first, view, look.quality)
        self._passes: PassRaster | None = None

    def draw(self, frame: Frame, number: int = 0, colors: np.ndarray | None = None) -> np.ndarray:
        """(height, width, 3) picture of a frame, uint8 or uint16; (height, width, 4) where the background is transparent.

        Args:
            colors: (n, 3) linear RGB of vertices, instead of the look's; there is no caption then.
        """
        image = developed(self.light(frame, colors), self.look.bits, self.renderer.transparent)
        return self.captioned(image, frame, number) if colors is None else image

    def light(self, frame: Frame, colors: np.ndarray | None = None) -> np.ndarray:
        """(height, width, 4) f32 linear RGB of a frame, multiplied by its alpha; no caption."""
        look = self.look
        self._follow(frame)
        self._aim(frame)
        if look.heat is not None and colors is None:
            colors = heat_colors(look.heat.values(frame), *look.heat.range, look.heat.diverging)
        if colors is not None and self.smooth is not None:
            colors = self.smooth.linear(colors)
        return self.renderer.light_of(self.points(frame), colors, look.wire)

    def captioned(self, image: np.ndarray, frame: Frame, number: int = 0) -> np.ndarray:
        """The same picture with what is written into it."""
        look = self.look
        if look.heat is not None:
            label = f"{look.heat.name} [{look.heat.unit}]" if look.heat.unit else look.heat.name
            draw_bar(image, *look.heat.range, look.heat.diverging, label)
        if look.caption:
            scale = max(1, image.shape[0] // 360)
            draw_text(image, look.caption_at(float(frame["t"]), number), 10 * scale, 10 * scale, scale)
        return image

    def passes(self, frame: Frame) -> Frame:
        """depth, normal and id of each pixel; see `passes.PassRaster`."""
        self._follow(frame)
        self._aim(frame)
        if self._passes is None:
            self._passes = PassRaster(*self.size)
        return self._passes.draw(self.renderer, self.points(frame))

    def sees(self, frame: Frame) -> bool:
        """Whether all of the cloth is in the picture."""
        self._aim(frame)
        at = self.renderer.camera.project(frame["x"].astype(np.float64), *self.size)
        return bool((at[:, 2] > 0).all() and (at[:, :2] >= 0).all() and (at[:, :2] <= self.size).all())

    def points(self, frame: Frame) -> np.ndarray:
        """(k, 3) what the renderer draws: cloth's vertices, finer ones where drawn smooth, then those of solids [m]."""
        x = frame["x"].astype(np.float64)
        return np.concatenate([x if self.smooth is None else self.smooth.points(x),
                               frame.get("solid_x", self.geometry["solid_x"]).astype(np.float64)])

    def _follow(self, frame: Frame) -> None:
        """Takes over the faces that a frame has of its own, where cloth tears, and what is sewn in it."""
        g, drawn = self.geometry, self.renderer.surfaces
        own = {name: frame.get(name, first) for name, first in self._first.items()}
        if all(np.array_equal(array, g[name]) for name, array in own.items()):
            return
        self.geometry = g = g | own
        faces = g["faces"]
        if self.smooth is not None:
            before = self.smooth.count
            self.smooth = Smooth(faces, len(g["x"]), self.look.smooth, g.get("sewn"))
            faces = self.smooth.faces
            drawn.faces[drawn.cloth_faces:] += self.smooth.count - before
        drawn.faces[: drawn.cloth_faces] = faces

    def _aim(self, frame: Frame) -> None:
        if self.look.orbit or self.look.follow or isinstance(self.camera, CameraKeys):
            self.renderer.look(self._camera(frame))

    def _camera(self, frame: Frame) -> Camera:
        t = float(frame["t"])
        camera = camera_at(self.camera, t)
        eye, target = np.array(camera.eye), np.array(camera.target)
        angle = np.radians(self.look.orbit * t)
        c, s = np.cos(angle), np.sin(angle)
        arm = (eye - target) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        if self.look.follow and len(frame["x"]):
            target = target + frame["x"].mean(axis=0) - self.centre
        return replace(camera, eye=tuple((target + arm).tolist()), target=tuple(target.tolist()))

    def _placed(self, view: View, first: np.ndarray, frames: Callable[[], Iterable[Frame]] | None) -> View:
        """The view with a ground, and with a camera that has all frames in its picture where it has none.

        The ground touches solids where they are the lowest of all that there is in any frame; else it is below.
        """
        n = len(self.geometry["x"])
        cloth, solid = (float(x[:, 1].min(initial=np.inf)) for x in (first[:n], first[n:]))
        cloth, ground, sets = cloth - view.reach, ground_height(first, view), [first]
        stands = view.ground is None and view.drawn_floor != "none" and solid <= cloth
        with contextlib.nullcontext() if self.fitted else contextlib.suppress(OutputError):  # said where it is drawn
            for frame in frames() if frames and (self.fitted or stands) else ():
                x = np.concatenate([frame["x"], frame.get("solid_x", first[:0])]).astype(np.float64)
                low = (float(part[:, 1].min(initial=np.inf)) for part in np.split(x, [len(frame["x"])]))
                cloth, solid = map(min, (cloth, solid), low)
                if len(x):  # of solids alone, what stands still is in the first set
                    sets.append(x - (frame["x"].mean(axis=0) - self.centre) if self.look.follow and n else x)
        if view.ground is None:
            view = replace(view, ground=solid if solid <= cloth else min(ground, cloth, solid) if self.fitted else ground)
        fit = fit_round if self.look.orbit else fit_all
        return replace(view, camera=fit(sets, view.reach, self.size[0] / self.size[1])) if self.fitted else view


def surfaces(geometry: Frame, look: Look, smooth: Smooth | None) -> Surfaces:
    """What is drawn of a geometry: cloths one after the other, then solids."""
    faces, (corner_uv, units), solid_faces = geometry["faces"], image_uv(geometry), geometry["solid_faces"]
    starts, names = geometry["cloth_faces"], [str(name) for name in geometry["cloth_names"]]
    corner_uv = corner_uv * np.repeat(np.where(np.isnan(units), 1.0, units), np.diff(starts))[:, None, None].astype(np.float32)
    textures = Textures()
    colors, backs, rows = [], [], []
    for k, (name, own) in enumerate(zip(names, appearances_of(geometry))):
        one = look.appearance(name, own)
        color = np.array(PALETTE[k % len(PALETTE)] if one.color is None else one.color)
        mine = np.tile(color, (int(starts[k + 1] - starts[k]), 1))
        if "face_colors" in geometry and look.appearance(name, Appearance()).color is None:
            panels = geometry["face_colors"][starts[k]: starts[k + 1]]
            mine = np.where(np.isnan(panels), mine, panels)
        colors.append(mine)
        backs.append(back_of(mine) if one.back is None else np.tile(one.back, (len(mine), 1)))
        rows.append(object_row(one, corner_uv[starts[k]: starts[k + 1]], textures, units[k]))
    owner = np.repeat(np.arange(len(names)), np.diff(starts))
    n = len(geometry["x"])
    if smooth is not None:
        faces, corner_uv, n = smooth.faces, smooth.corners(corner_uv), smooth.count
        owner = np.repeat(owner, smooth.each)
        colors, backs = ([np.repeat(c, smooth.each, axis=0) for c in part] for part in (colors, backs))
    solid = np.searchsorted(geometry["solid_start"], solid_faces[:, 0], side="right") - 1
    stone = np.array([STONE if np.isnan(c).any() else c for c in geometry["solid_colors"]]).reshape(-1, 3)
    rows += [object_row(Appearance(squares=False), np.zeros((0, 3, 2)), textures)] * len(stone)
    objects = np.array(rows).reshape(-1, COLUMNS)
    uv = np.concatenate([corner_uv, np.zeros((len(solid_faces), 3, 2), dtype=np.float32)])
    return Surfaces(np.concatenate([faces, solid_faces + n]), uv, np.concatenate([*colors, stone[solid]]),
                    np.concatenate([*backs, stone[solid]]), np.concatenate([owner, solid + len(names)]), objects, len(faces),
                    textures)


def contact_sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Pictures of one size and type in one, row by row; white, or transparent, where there is none."""
    height, width, channels = images[0].shape
    rows = -(-len(images) // columns)
    empty = np.iinfo(images[0].dtype).max if channels == 3 else 0
    out = np.full((rows * height, columns * width, channels), empty, dtype=images[0].dtype)
    for k, image in enumerate(images):
        row, column = divmod(k, columns)
        out[row * height: (row + 1) * height, column * width: (column + 1) * width] = image
    return out
