"""View of a scene: camera, ground, background and light. Description only: the renderer is in output/."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown

Color = tuple[float, float, float]
FLOORS = ("checker", "plain", "shadow", "none")
LIGHT = (0.45, 0.8, 0.5)  # towards the key light
LIGHTS = ("day", "studio", "sun", "soft")


@dataclass(frozen=True)
class Camera:
    """A pinhole camera.

    Args:
        eye, target: positions [m].
        fov: vertical opening angle [degrees].
        up: the direction that is up in the picture.
    """

    eye: tuple[float, float, float]
    target: tuple[float, float, float]
    fov: float = 35.0
    up: tuple[float, float, float] = (0.0, 1.0, 0.0)

    def __post_init__(self) -> None:
        for name in ("eye", "target", "up"):
            object.__setattr__(self, name, tuple(checks.vector(f"camera {name}", getattr(self, name)).tolist()))
        object.__setattr__(self, "fov", checks.number("camera fov", self.fov, "degrees", least=1.0, most=150.0))
        if self.eye == self.target:
            raise SceneError(f"camera eye and target are the same point {self.eye!r}")
        if not any(self.up):
            raise SceneError(f"camera up = {self.up!r}: needs a direction")

    @property
    def numbers(self) -> np.ndarray:
        """(10,) eye, target, fov, up."""
        return np.array([*self.eye, *self.target, self.fov, *self.up])


def camera_of(numbers: np.ndarray) -> Camera:
    """The camera that has these `numbers`."""
    c = numbers.tolist()
    return Camera(tuple(c[:3]), tuple(c[3:6]), c[6], tuple(c[7:]))


class CameraKeys:
    """A camera that moves: through each key at its time, by cubics in between [Catmull and Rom], still before and after.

    Args:
        keys: cameras by time [s].

    Attributes:
        times: (k,) rising [s]; rows: (k, 10) `Camera.numbers`.
    """

    def __init__(self, keys: Mapping[float, Camera]) -> None:
        if not keys:
            raise SceneError("camera: keys are empty: needs cameras by time, such as {0: Camera(...), 2: Camera(...)}")
        pairs = sorted((checks.number("camera: time of a key", t, "s"), checks.instance(f"camera at {shown(t)}", c, Camera))
                       for t, c in keys.items())
        self.times = np.array([t for t, _ in pairs])
        self.rows = np.stack([c.numbers for _, c in pairs])

    def at(self, t: float) -> Camera:
        """The camera at time t [s]."""
        times, rows = self.times, self.rows
        if len(times) == 1:
            return camera_of(rows[0])
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
        h = times[k + 1] - times[k]
        s = float(np.clip((t - times[k]) / h, 0, 1))
        slope = np.gradient(rows, times, axis=0) if len(times) > 2 else np.repeat(np.diff(rows, axis=0) / h, 2, axis=0)
        a, b = h * slope[k], h * slope[k + 1]
        return camera_of(rows[k] * (2 * s**3 - 3 * s**2 + 1) + a * (s**3 - 2 * s**2 + s)
                         + rows[k + 1] * (3 * s**2 - 2 * s**3) + b * (s**3 - s**2))


AnyCamera = Camera | CameraKeys


def camera_at(camera: object, t: float) -> Camera:
    """A camera, or cameras by time, at time t [s]."""
    return camera.at(t) if isinstance(camera, CameraKeys) else checks.instance("camera", camera, Camera)


def any_camera(what: str, value: object) -> AnyCamera | None:
    """A camera, cameras by time, or None."""
    if isinstance(value, Mapping):
        return CameraKeys(value)
    return value if value is None or isinstance(value, CameraKeys) else checks.instance(what, value, Camera)


@dataclass(frozen=True)
class View:
    """Surroundings of the cloth in a picture.

    Args:
        camera: one, or cameras by time [s], such as {0: Camera(...), 2: Camera(...)}; None fits one.
        ground: height [m] of the ground; None takes that of a level plane that stays. Else it touches the lowest solid, if
            nothing comes lower in all frames; else it is below all of them, by a twentieth of the size at the start.
        reach: room [m] that the cloth will need round its first shape, for the fitted camera.
        floor: the ground: "checker", "plain", "shadow" (nothing but the shadows on it), "none", or a colour. None is
            "none" where the background is transparent, "shadow" where it is a colour, "plain" in the lights "studio" and
            "soft", "checker" elsewhere.
        background: "sky", "transparent" or a colour. Colours are names of CSS, "#rrggbb" in sRGB, or linear RGB.
        light: direction towards the key light of the day, or lights by name. "day"; "studio": a large light, one that fills
            shadows and one from behind, round the camera; "sun": low, warm, hard shadows; "soft": an overcast sky alone.
    """

    camera: AnyCamera | Mapping[float, Camera] | None = None
    ground: float | None = None
    reach: float = 0.0
    floor: str | Color | None = None
    background: str | Color = "sky"
    light: str | tuple[float, float, float] = LIGHT

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera", any_camera("view camera", self.camera))
        object.__setattr__(self, "ground", checks.maybe(self.ground, checks.number, "view ground", "m"))
        object.__setattr__(self, "reach", checks.number("view reach", self.reach, "m", least=0.0))
        object.__setattr__(self, "floor", checks.maybe(self.floor, color_or, "floor", FLOORS))
        object.__setattr__(self, "background", color_or("background", self.background, ("sky", "transparent")))
        object.__setattr__(self, "light", light_or("light", self.light))

    @property
    def drawn_floor(self) -> str | Color:
        """The floor, decided."""
        if self.floor is not None:
            return self.floor
        if self.background != "sky":
            return "none" if self.background == "transparent" else "shadow"
        return "plain" if self.light in ("studio", "soft") else "checker"


def direction(what: str, value: object) -> tuple[float, float, float]:
    """Three numbers, not all 0."""
    x, y, z = checks.vector(what, value).tolist()
    if not (x or y or z):
        raise SceneError(f"{what} = (0, 0, 0): needs a direction, such as (0.45, 0.8, 0.5) towards the light")
    return x, y, z


def light_or(what: str, value: object) -> str | tuple[float, float, float]:
    """Lights by name, or a direction."""
    return checks.choice(what, value, LIGHTS) if isinstance(value, str) else direction(what, value)


def color_or(what: str, value: object, words: tuple[str, ...]) -> str | Color:
    """One of some words, or a colour in linear RGB."""
    if isinstance(value, str) and value in words:
        return value
    try:
        return checks.color(what, value)
    except SceneError as error:
        raise SceneError(f"{error}, or one of {', '.join(words)}") from None
