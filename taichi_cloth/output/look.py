"""Settings of a picture, which come before those of the scene's view."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from .. import checks
from ..errors import SceneError, did_you_mean, shown
from ..scene.appearance import Appearance
from ..scene.view import FLOORS, AnyCamera, Camera, Color, View, any_camera, color_or, light_or
from .camera import SIDES
from .quality import QUALITY
from .smooth import MOST

BITS = (8, 16)


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
    """How to draw. Values of None are the scene's.

    Attributes:
        quality: one of `quality.QUALITY`.
        camera: one, cameras by time [s], or the side from which one is fitted, as in `camera.SIDES`; None takes the scene's,
            or fits one.
        orbit: degrees that the camera goes round its target in a second.
        follow: whether the camera moves with the cloth's centre.
        wire: whether edges are drawn; heat: the quantity that colours the cloth, or None.
        caption: text, in which {t} and {frame} stand for the time and the frame; "" draws none.
        floor, background, light: as those of `View`.
        aperture: diameter of the lens [m], 0 if all is sharp.
        focus: distance along the view that is sharp [m], None for that of the cloth's middle.
        shutter: part of the time between two frames that a picture takes, 0 to 1: motion is blurred.
        smooth: how often triangles' edges are halved, for round outlines.
        bits: of a number in the picture, 8 or 16.
        cloths: appearances by the cloths' names, "" for all; their open values are the scene's.

    Raises:
        SceneError: an impossible value or an unknown name.
    """

    quality: str = "fast"
    camera: AnyCamera | Mapping[float, Camera] | str | None = None
    orbit: float = 0.0
    follow: bool = False
    wire: bool = False
    heat: Heat | None = None
    caption: str = ""
    floor: str | Color | None = None
    background: str | Color | None = None
    light: str | tuple[float, float, float] | None = None
    aperture: float = 0.0
    focus: float | None = None
    shutter: float = 0.0
    smooth: int = 0
    bits: int = 8
    cloths: Mapping[str, Appearance] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks.choice("quality", self.quality, QUALITY)
        object.__setattr__(self, "camera", checks.choice("camera", self.camera, SIDES) if isinstance(self.camera, str)
                           else any_camera("camera", self.camera))
        object.__setattr__(self, "orbit", checks.number("orbit", self.orbit, "degrees a second"))
        for name in ("follow", "wire"):
            object.__setattr__(self, name, checks.flag(name, getattr(self, name)))
        checks.maybe(self.heat, checks.instance, "heat", Heat)
        try:
            self.caption_at(0.0, 0)
        except (AttributeError, IndexError, KeyError, ValueError, TypeError):
            raise SceneError(f"caption = {shown(self.caption)}: must be a text with nothing but {{t}} and {{frame}} in "
                             "braces; {{ and }} stand for braces themselves") from None
        object.__setattr__(self, "floor", checks.maybe(self.floor, color_or, "floor", FLOORS))
        object.__setattr__(self, "background",
                           checks.maybe(self.background, color_or, "background", ("sky", "transparent")))
        object.__setattr__(self, "light", checks.maybe(self.light, lambda what, v: light_or(what, v), "light"))
        object.__setattr__(self, "aperture", checks.number("aperture", self.aperture, "m", least=0.0))
        object.__setattr__(self, "focus", checks.maybe(self.focus, lambda what, v: checks.number(what, v, "m", positive=True),
                                                       "focus"))
        object.__setattr__(self, "shutter", checks.number("shutter", self.shutter, least=0.0, most=1.0))
        object.__setattr__(self, "smooth", checks.integer("smooth", self.smooth, least=0, most=MOST))
        object.__setattr__(self, "bits", checks.integer("bits", self.bits, least=8, most=16))
        if self.bits not in BITS:
            raise SceneError(f"bits = {shown(self.bits)}: must be 8 or 16")
        if not isinstance(self.cloths, Mapping):
            raise SceneError(f"cloths = {shown(self.cloths)}: must be appearances by the cloths' names")
        for name, one in self.cloths.items():
            if checks.instance(f"appearance of {name!r}", one, Appearance).panels:
                raise SceneError(f"appearance of {name!r}: panels have colours from the scene (add_cloth), as their groups")

    @property
    def exposed(self) -> bool:
        """Whether a picture is the mean of many exposures."""
        return self.aperture > 0 or self.shutter > 0

    def caption_at(self, t: float, number: int) -> str:
        """The caption of a frame at time t [s]."""
        return checks.instance("caption", self.caption, str).format(t=f"{t:.3f}", frame=number)

    def view(self, scene: View) -> View:
        """The scene's view with these settings."""
        said = {name: getattr(self, name) for name in ("camera", "floor", "background", "light")}
        view = {name: value for name, value in said.items() if value is not None}
        return replace(scene, **view | ({"camera": None} if isinstance(self.camera, str) else {}))

    def appearance(self, name: str, own: Appearance) -> Appearance:
        """Appearance of a cloth: the one asked for it, else for all cloths, else the scene's."""
        for key in ("", name):
            own = self.cloths[key].over(own) if key in self.cloths else own
        return own

    def check_names(self, names: list[str]) -> None:
        """The cloths that are named are there.

        Raises:
            SceneError: one is not.
        """
        for name in self.cloths:
            if name and name not in names:
                raise SceneError(f"there is no cloth {shown(name)}; {did_you_mean(name, names)}")
