"""Prints on cloth, as other tools take them: an opaque image, and texture coordinates that are 0 to 1 across it."""

from typing import NamedTuple

import numpy as np

from ...colornames import from_srgb, to_srgb
from ...scene.appearance import Texture

BLOCK = 8  # pixels a side of a colour in a palette, so that its middle is free of its neighbours


class Print(NamedTuple):
    """An image on a cloth's pattern.

    Attributes:
        image: (h, w, 3) uint8 sRGB, first row on top: over the cloth's own colour where it lets that through.
        repeats: whether it goes on beyond its edges; else these have the cloth's colour, and go on for ever.
        origin, size: (2,) where its lower left corner is on the pattern, and how large it is [m].
        unit: length of 1 in the cloth's texture coordinates [m].
    """

    image: np.ndarray
    repeats: bool
    origin: np.ndarray
    size: np.ndarray
    unit: float = 1.0

    def coordinates(self, uv: np.ndarray) -> np.ndarray:
        """(m, 3, 2) float32, (0, 0) in the image's lower left corner and (1, 1) in the other, of the cloth's own."""
        return ((uv.astype(np.float64) * self.unit - self.origin) / self.size).astype(np.float32)


def printed(texture: Texture, color: np.ndarray, uv: np.ndarray, unit: float) -> Print:
    """A texture on cloth of a linear colour (3,) whose faces have the corners uv (m, 3, 2) [m]; unit: of `Texture.place`."""
    origin, size = texture.place(uv, unit)
    rgba = texture.image / 255
    part = rgba[..., 3:]
    image = (255 * to_srgb(from_srgb(rgba[..., :3]) * part + color * (1 - part)) + 0.5).astype(np.uint8)
    if not texture.repeat:  # a rim of the cloth's own colour
        pixel = size / [image.shape[1], image.shape[0]]
        rim = (255 * to_srgb(color) + 0.5).astype(np.uint8)
        whole = np.tile(rim, (image.shape[0] + 2, image.shape[1] + 2, 1))
        whole[1:-1, 1:-1] = image
        image, origin, size = whole, origin - pixel, size + 2 * pixel
    return Print(image, texture.repeat, origin, size, 1.0 if np.isnan(unit) else unit)


def palette(colors: np.ndarray) -> Print:
    """An image of linear colours (k, 3) beside each other; faces are in it by `in_palette`."""
    row = np.repeat((255 * to_srgb(colors) + 0.5).astype(np.uint8), BLOCK, axis=0)
    return Print(np.tile(row, (BLOCK, 1, 1)), False, np.zeros(2), np.ones(2))


def in_palette(faces: np.ndarray, colors: np.ndarray) -> np.ndarray:
    """(m, 3, 2) float32 coordinates in the palette of colours (k, 3), of the corners of faces of some of them (m, 3)."""
    which = np.linalg.norm(faces[:, None] - colors, axis=2).argmin(axis=1)
    middle = np.column_stack([(which + 0.5) / len(colors), np.full(len(which), 0.5)])
    return np.repeat(middle[:, None], 3, axis=1).astype(np.float32)
