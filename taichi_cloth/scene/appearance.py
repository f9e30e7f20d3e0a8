"""Appearance of a cloth: the colours of its two sides, an image printed on the pattern, the weave. For pictures only."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from .. import checks
from ..errors import SceneError, near, shown
from .view import Color

LARGEST = 8192  # pixels a side of an image
WEAVES = ("plain", "twill")


@dataclass(frozen=True, eq=False)
class Texture:
    """An image on the pattern: its lower left corner at `origin`, its width along u, its height along v.

    On a mesh with texture coordinates of its own (`TriMesh.texture`) the image goes by these: one
    image from 0 to 1, or a metre as long as it is in the mean over the mesh, with its origin at 0.

    Args:
        image: a file (PNG, JPEG ...; needs the extra `texture`), or (h, w, 3 or 4) uint8, first row on top, sRGB.
        size: (width, height) [m] of one image on the pattern, or its width; None spreads it over the whole pattern.
        origin: (2,) material coordinates [m] of its lower left corner; None is that of the pattern's bounds.
        repeat: whether it goes on beyond its edges; else cloth has its own colour there.
    """

    image: np.ndarray
    size: tuple[float, float] | float | None = None
    origin: tuple[float, float] | None = None
    repeat: bool = True

    def __post_init__(self) -> None:
        image = _read(self.image) if not isinstance(self.image, np.ndarray) else self.image
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] not in (3, 4) or 0 in image.shape:
            raise SceneError("texture image: needs shape (height, width, 3 or 4) and type uint8, not "
                             f"{image.shape} {image.dtype}")
        if max(image.shape) > LARGEST:
            raise SceneError(f"texture image: {image.shape[1]} x {image.shape[0]} pixels: at most {LARGEST} a side")
        if image.shape[2] == 3:
            image = np.concatenate([image, np.full_like(image[..., :1], 255)], axis=2)
        object.__setattr__(self, "image", np.ascontiguousarray(image))
        size = checks.maybe(self.size, checks.number_or_pair, "texture size", "m", positive=True)
        if isinstance(size, float):
            size = size, size * image.shape[0] / image.shape[1]
        object.__setattr__(self, "size", size)
        origin = self.origin
        if origin is not None:
            origin = tuple(checks.array("texture origin", origin, (2,)).tolist())
        object.__setattr__(self, "origin", origin)
        object.__setattr__(self, "repeat", checks.flag("texture repeat", self.repeat))

    def place(self, uv: np.ndarray, unit: float = np.nan) -> tuple[np.ndarray, np.ndarray]:
        """(2,) lower left corner and (2,) size [m] of one image.

        Args:
            uv: (m, 3, 2) corners of the pattern's faces [m].
            unit: length of 1 in texture coordinates that are not the pattern's [m]; NaN if they are.
        """
        if not np.isnan(unit):
            return np.array(self.origin or (0.0, 0.0)), np.array(self.size or (unit, unit))
        low, high = (f(uv.reshape(-1, 2), axis=0) if len(uv) else np.zeros(2) for f in (np.min, np.max))
        origin = low if self.origin is None else np.array(self.origin)
        return origin, np.maximum(high - origin, 1e-9) if self.size is None else np.array(self.size)

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        return f"<Texture of {width} x {height} pixels>"


@dataclass(frozen=True)
class Weave:
    """Threads that show in the light: crosswise over and under each other.

    Args:
        spacing: from thread to thread [m].
        relief: how strongly they show, 0 to 2.
        kind: "plain" (over one, under one) or "twill" (over two, under two, shifted by one a row).
    """

    spacing: float = 0.002
    relief: float = 1.0
    kind: str = "plain"

    def __post_init__(self) -> None:
        object.__setattr__(self, "spacing", checks.number("weave spacing", self.spacing, "m", positive=True))
        object.__setattr__(self, "relief", checks.number("weave relief", self.relief, least=0.0, most=2.0))
        checks.choice("weave kind", self.kind, WEAVES)


@dataclass(frozen=True, eq=False)
class Appearance:
    """How a cloth looks. Values of None are left to the renderer.

    Args:
        color: of the front, to which the faces' normals point (corners run counterclockwise there): the upper side of
            `grid` in the plane "xz", that towards +z in "xy". Names of CSS ("crimson"), "#rrggbb" in sRGB, or linear RGB in
            0..1.
        back: color of the other side, on which no texture shows then.
        squares: whether squares on the pattern show how it is strained; None draws them where there is neither texture
            nor weave.
        texture: an image on the pattern.
        weave: threads that show.
        panels: colours of faces all of whose corners are in a group of the cloth's mesh, by the groups' names; later ones go
            over earlier ones, and all over `color`. A scene's to say, in `add_cloth` and `add_garment`.
        sheen: light that fibres throw along outlines, as velvet does, 0 to 1 (0.1).
        specular: part of the light that is reflected in a highlight at normal incidence, 0 to 1 (0.015).
        roughness: width of the highlight, from 0.1, silk, to 1 (0.6).
        hem: width [m] of a hem along borders that are not sewn; None for none.
        thickness: [m] with which the cloth is drawn, half of it to each side, and walls along borders; None draws a sheet.
    """

    color: str | Color | None = None
    back: str | Color | None = None
    squares: bool | None = None
    texture: Texture | None = None
    weave: Weave | None = None
    panels: Mapping[str, str | Color] | None = None
    sheen: float | None = None
    specular: float | None = None
    roughness: float | None = None
    hem: float | None = None
    thickness: float | None = None

    def __post_init__(self) -> None:
        for name in ("color", "back"):
            object.__setattr__(self, name, checks.maybe(getattr(self, name), checks.color, f"appearance {name}"))
        object.__setattr__(self, "squares", checks.maybe(self.squares, checks.flag, "appearance squares"))
        checks.maybe(self.texture, checks.instance, "appearance texture", Texture)
        checks.maybe(self.weave, checks.instance, "appearance weave", Weave)
        for name, least in (("sheen", 0.0), ("specular", 0.0), ("roughness", 0.1)):
            object.__setattr__(self, name, checks.maybe(
                getattr(self, name), lambda what, v, least=least: checks.number(what, v, least=least, most=1.0),
                f"appearance {name}"))
        for name in ("hem", "thickness"):
            object.__setattr__(self, name, checks.maybe(
                getattr(self, name), lambda what, v: checks.number(what, v, "m", positive=True), f"appearance {name}"))
        if self.panels is not None:
            if not isinstance(self.panels, Mapping):
                raise SceneError(f"appearance panels = {shown(self.panels)}: must be colours by the names of a mesh's groups")
            object.__setattr__(self, "panels", {checks.name("appearance panels: name", name): checks.color(
                f"colour of panel {shown(name)}", color) for name, color in self.panels.items()})

    def over(self, other: "Appearance") -> "Appearance":
        """This one, with its open values from another."""
        return Appearance(**{f.name: getattr(other, f.name) if getattr(self, f.name) is None else getattr(self, f.name)
                             for f in fields(self)})

    @property
    def surface(self) -> tuple[float | None, ...]:
        """Sheen, specular, roughness, hem, thickness."""
        return self.sheen, self.specular, self.roughness, self.hem, self.thickness

    @property
    def has_squares(self) -> bool:
        """Whether squares are drawn."""
        return self.squares if self.squares is not None else self.texture is None and self.weave is None


def appearance(what: str, value: object) -> Appearance:
    """An appearance, or that of a colour, or one that leaves everything open."""
    if isinstance(value, Appearance):
        return value
    return Appearance(color=checks.maybe(value, checks.color, what))


def _read(source: object) -> np.ndarray:
    """(h, w, 4) uint8 of an image file."""
    path = checks.path("texture image", source)
    try:
        from PIL import Image, UnidentifiedImageError
    except ImportError:
        raise SceneError(f"texture image {shown(str(path))}: needs the package Pillow: pip install 'taichi-cloth[texture]'"
                         "; an array needs nothing") from None
    try:
        with Image.open(path) as image:
            if max(image.size) > LARGEST:
                raise SceneError(f"texture image {shown(str(path))}: {image.size[0]} x {image.size[1]} pixels: at most "
                                 f"{LARGEST} a side")
            return np.array(image.convert("RGBA"))
    except FileNotFoundError:
        raise SceneError(f"texture image {shown(str(path))}: there is no such file{near(path)}") from None
    except (OSError, UnidentifiedImageError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise SceneError(f"texture image {shown(str(path))}: cannot be read: {error}") from None
