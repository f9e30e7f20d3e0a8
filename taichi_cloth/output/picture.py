"""Pictures of a recorded run: geometry once, then frame after frame, with camera, heat map and caption."""

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from ..errors import OutputError
from ..scene.view import Camera, CameraKeys, View, camera_at
from ..system.quantities import in_one
from .camera import SIDES, ground_height
from .colors import draw_bar, heat_colors
from .described import view_of
from .drawn import Frame, shell_of, surfaces
from .exposure import between, focused, spots, through
from .facing import facing
from .framing import fit_all, fit_round
from .look import Look
from .nearby import Nearby, nearby
from .passes import PassRaster
from .renderer import Renderer, developed
from .smooth import Smooth
from .text import draw_text

EXPOSURES = {"fast": 16, "standard": 32, "high": 96}  # where a picture is the mean of many
Next = tuple[Frame | None, float] | None


class Artist:
    """Draws frames of one geometry, both as `record` makes them.

    Args:
        size: (width, height) [pixels].
        frames: gives the frames of the whole motion, or expected ones: the ground is below all of them.
        fits: gives those that a fitted camera has to have in its picture; the first shape and all of `frames` if None.

    Attributes:
        fitted: whether the camera is fitted; sought: whether the ground is placed below all of `frames`.

    Raises:
        SceneError: the look names a cloth that is not there.
    """

    def __init__(self, geometry: Frame, size: tuple[int, int], look: Look,
                 frames: Callable[[], Iterable[Frame]] | None = None, fits: Callable[[], Iterable[Frame]] | None = None
                 ) -> None:
        self.look, self.geometry, self.size = look, geometry, size
        self._first = {name: geometry[name] for name in ("faces", "sewn") if name in geometry}
        look.check_names([str(name) for name in geometry["cloth_names"]])
        self.smooth = (Smooth(geometry["faces"], len(geometry["x"]), look.smooth, geometry.get("sewn")) if look.smooth
                       else None)
        first = np.concatenate([geometry["x"], geometry["solid_x"]])
        self.shell = shell_of(geometry, look, self.smooth)
        self.centre = (geometry["x"] if len(geometry["x"]) else first).mean(axis=0)
        view = look.view(view_of(geometry))
        self.fitted = view.camera is None
        view = self._placed(view, first, frames, fits)
        self.camera = view.camera
        view = replace(view, camera=camera_at(view.camera, 0.0))
        drawn = surfaces(geometry, look, self.smooth, self.shell)
        self.renderer = Renderer(*size, drawn, first, view, look.quality, look.exposed)
        self._passes: PassRaster | None = None

    def draw(self, frame: Frame, number: int = 0, colors: np.ndarray | None = None, next_: Next = None) -> np.ndarray:
        """(height, width, 3) picture of a frame, uint8 or uint16; (height, width, 4) where the background is transparent.

        Args:
            colors: (n, 3) linear RGB of vertices, instead of the look's; there is no caption then.
            next_: as in `light`.
        """
        image = developed(self.light(frame, colors, next_), self.look.bits, self.renderer.transparent)
        return self.captioned(image, frame, number) if colors is None else image

    def light(self, frame: Frame, colors: np.ndarray | None = None, next_: Next = None) -> np.ndarray:
        """(height, width, 4) f32 linear RGB of a frame, multiplied by its alpha; no caption.

        Args:
            next_: the frame after it, None at the end, and the time between frames [s]; for a shutter.
        """
        look = self.look
        self._follow(frame)
        if look.heat is not None and colors is None:
            colors = heat_colors(look.heat.values(frame), *look.heat.range, look.heat.diverging)
        if colors is not None and self.smooth is not None:
            colors = self.smooth.linear(colors)
        if colors is not None and self.shell is not None:
            colors = self.shell.linear(colors)
        if look.exposed:
            return self._exposed(frame, colors, next_ or (None, 0.0))
        self._aim(frame)
        return self.renderer.light_of(self.points(frame), colors, look.wire)

    def _exposed(self, frame: Frame, colors: np.ndarray | None, next_: tuple[Frame | None, float]) -> np.ndarray:
        """The mean of many exposures."""
        look, r = self.look, self.renderer
        kept = None if self.smooth is None else self._kept(frame)
        count, total = EXPOSURES[look.quality], np.zeros((self.size[1], self.size[0], 4), np.float32)
        pinhole = r.camera
        for k, (time, lens, pixel) in enumerate(spots(count)):
            moment = between(frame, next_[0], time * look.shutter, next_[1]) if look.shutter else frame
            r.camera = pinhole
            self._aim(moment)
            pinhole = r.camera
            focus = focused(pinhole, look.focus, moment["x"] if len(moment["x"]) else self.geometry["solid_x"])
            r.camera = through(pinhole, lens * look.aperture / 2, focus, pixel / self.size[1])
            total += r.light_of(self.points(moment, kept), colors, look.wire, k)
        r.camera = pinhole
        return total / count

    def captioned(self, image: np.ndarray, frame: Frame, number: int = 0) -> np.ndarray:
        """The picture (h, w, c) with its caption and colour bar drawn in."""
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

    def points(self, frame: Frame, kept: Nearby | None = None) -> np.ndarray:
        """(k, 3) points that the renderer draws: cloth's vertices, finer ones where drawn smooth, then those of solids [m].

        Args:
            kept: vertices that rounding spares, if known: they are sought once for all moments of a frame.
        """
        x = frame["x"].astype(np.float64)
        if self.smooth is not None:
            kept = kept or self._kept(frame)
            x = self.smooth.points(x, kept.push, kept.layered)
        x = x if self.shell is None else self.shell.points(x)
        return np.concatenate([x, frame.get("solid_x", self.geometry["solid_x"]).astype(np.float64)])

    def _kept(self, frame: Frame) -> Nearby:
        """Vertices that rounding spares."""
        push = in_one(self.geometry, frame, frame["contact"]) if "contact" in frame else None
        return nearby(self.geometry, frame, push)

    def _follow(self, frame: Frame) -> None:
        """Takes over the faces that a frame has of its own, where cloth tears, and its seams."""
        g, drawn = self.geometry, self.renderer.surfaces
        own = {name: frame.get(name, first) for name, first in self._first.items()}
        if all(np.array_equal(array, g[name]) for name, array in own.items()):
            return
        self.geometry = g = g | own
        faces = g["faces"]
        if self.shell is not None:
            self._anew()
            return
        if self.smooth is not None:
            before = self.smooth.count
            self.smooth = Smooth(faces, len(g["x"]), self.look.smooth, g.get("sewn"))
            faces = self.smooth.faces
            drawn.faces[drawn.cloth_faces:] += self.smooth.count - before
        drawn.faces[: drawn.cloth_faces] = faces

    def _anew(self) -> None:
        """Another renderer, where the borders of thick cloth are others than before."""
        g, look, old = self.geometry, self.look, self.renderer
        if self.smooth is not None:
            self.smooth = Smooth(g["faces"], len(g["x"]), look.smooth, g.get("sewn"))
        self.shell = shell_of(g, look, self.smooth)
        x = np.concatenate([g["x"], g["solid_x"]])
        drawn = surfaces(g, look, self.smooth, self.shell, g | self._first)
        self.renderer = Renderer(*self.size, drawn, x, old.view, look.quality, look.exposed)
        self.renderer.camera = old.camera

    def _aim(self, frame: Frame) -> None:
        if self.look.orbit or self.look.follow or isinstance(self.camera, CameraKeys):
            self.renderer.look(self._camera(frame))

    def _camera(self, frame: Frame) -> Camera:
        t = float(frame["t"])
        camera = camera_at(self.camera, t)
        eye, target = np.array(camera.eye), np.array(camera.target)
        angle = np.radians(self.look.orbit * float(frame.get("clock", t)))  # a film of its own has its own time
        c, s = np.cos(angle), np.sin(angle)
        arm = (eye - target) @ np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
        if self.look.follow and len(frame["x"]):
            target = target + frame["x"].mean(axis=0) - self.centre
        return replace(camera, eye=tuple((target + arm).tolist()), target=tuple(target.tolist()))

    def _placed(self, view: View, first: np.ndarray, frames: Callable[[], Iterable[Frame]] | None,
                fits: Callable[[], Iterable[Frame]] | None) -> View:
        """The view with a ground, and with a camera that has all frames that it fits in its picture where it has none.

        The ground touches solids where they are the lowest of all that there is in any frame; else it is below all frames.
        """
        n = len(self.geometry["x"])
        cloth, solid = (float(x[:, 1].min(initial=np.inf)) for x in (first[:n], first[n:]))
        cloth, sets, shapes = cloth - view.reach, [first], [{"x": first[:n]}]
        self.sought = floor = view.ground is None and view.drawn_floor != "none"
        with contextlib.nullcontext() if self.fitted else contextlib.suppress(OutputError):  # said where it is drawn
            for frame in frames() if frames and (self.fitted or floor) else ():
                x = self._all_of(frame, first[:0])
                low = (float(part[:, 1].min(initial=np.inf)) for part in np.split(x, [len(frame["x"])]))
                cloth, solid = map(min, (cloth, solid), low)
                if fits is None and len(x):  # solids that stand still are in the first set already
                    sets.append(x - self._followed(frame))
                    shapes.append(frame)
            if fits is not None and self.fitted:
                shapes = list(fits())
                sets = [self._all_of(frame, first[n:]) - self._followed(frame) for frame in shapes]
        view = replace(view, ground=ground_height(first, view, cloth, solid))
        fit = fit_round if self.look.orbit else fit_all
        if not self.fitted:
            return view
        way = SIDES[self.look.camera] if isinstance(self.look.camera, str) else facing(shapes, self.geometry["faces"])
        return replace(view, camera=fit(sets, view.reach, self.size[0] / self.size[1], way))

    def _all_of(self, frame: Frame, still: np.ndarray) -> np.ndarray:
        """(k, 3) vertices of the cloth and of solids in a frame [m], with those of solids that stand still (m, 3)."""
        return np.concatenate([frame["x"], frame.get("solid_x", still)]).astype(np.float64)

    def _followed(self, frame: Frame) -> np.ndarray:
        """(3,) by which a camera that follows the cloth goes with it [m]."""
        follows = self.look.follow and len(frame["x"])
        return frame["x"].mean(axis=0) - self.centre if follows else np.zeros(3)


def contact_sheet(images: list[np.ndarray], columns: int) -> np.ndarray:
    """Pictures (h, w, c) of one size and type in one, row by row; empty places are white, or transparent."""
    height, width, channels = images[0].shape
    rows = -(-len(images) // columns)
    empty = np.iinfo(images[0].dtype).max if channels == 3 else 0
    out = np.full((rows * height, columns * width, channels), empty, dtype=images[0].dtype)
    for k, image in enumerate(images):
        row, column = divmod(k, columns)
        out[row * height: (row + 1) * height, column * width: (column + 1) * width] = image
    return out
