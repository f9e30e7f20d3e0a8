"""Rows of numbers that tell kernels of an object's finish: squares, an image, threads, a hem. numpy only."""

import numpy as np

from ..colornames import from_srgb, to_srgb
from ..scene.appearance import WEAVES, Appearance

# columns of an object's row
CHECK = 0  # how much darker every other square of the pattern is
TEXTURE = 1  # 0 none, 1 an image that repeats, 2 one that does not; then:
ORIGIN, SIZE, FIRST, LEVELS, BOTH = 2, 4, 6, 7, 8  # two [m], two [m], first level, number of levels, whether on both sides
WEAVE = 9  # 0 none, else 1 + its place in WEAVES; then:
SPACING, RELIEF = 10, 11  # [m], factor
SHEEN, SPECULAR, SHARPNESS = 12, 13, 14  # along the rim, of light that falls straight on it, of its highlight
HEM = 15  # width [m], 0 for none
COLUMNS = 16
DARKER = 0.16  # the squares
SHINE = 0.1, 0.015, 0.6  # sheen, specular and roughness where an appearance says none


class Textures:
    """Images at full size and at halves of it, one after the other.

    Attributes:
        texels: (n,) int32: four bytes of sRGB already multiplied by alpha; levels: (k, 3) int32: first texel, width, height.
        decode: (256,) f32 linear light of a byte.
    """

    def __init__(self) -> None:
        self.parts: list[np.ndarray] = []
        self.shapes: list[tuple[int, int]] = []
        self.decode = from_srgb(np.arange(256) / 255).astype(np.float32)

    def add(self, image: np.ndarray) -> tuple[int, int]:
        """Adds an image (h, w, 4) uint8; its first level and how many it has."""
        first = len(self.parts)
        alpha = image[..., 3:] / np.float32(255)
        light = np.concatenate([self.decode[image[..., :3]] * alpha, alpha], axis=2)
        while True:
            coded = np.concatenate([to_srgb(light[..., :3]), light[..., 3:]], axis=2)
            bytes_ = np.ascontiguousarray((coded * 255 + 0.5).astype(np.uint8))
            self.parts.append(bytes_.view("<i4").ravel())
            self.shapes.append((light.shape[1], light.shape[0]))
            if max(light.shape[:2]) == 1:
                return first, len(self.parts) - first
            light = _halved(_halved(light).transpose(1, 0, 2)).transpose(1, 0, 2)

    @property
    def texels(self) -> np.ndarray:
        """(texels,) int32, the RGBA bytes of all levels of all images."""
        return np.concatenate(self.parts) if self.parts else np.zeros(1, dtype=np.int32)

    @property
    def levels(self) -> np.ndarray:
        """(k, 3) first texel, width and height of each level."""
        starts = np.cumsum([0] + [len(p) for p in self.parts])[:-1]
        rows = [(start, w, h) for start, (w, h) in zip(starts, self.shapes)]
        return np.array(rows or [(0, 1, 1)], dtype=np.int32)


def _halved(light: np.ndarray) -> np.ndarray:
    """Means of pairs of rows; the last row alone where it has no other."""
    if len(light) == 1:
        return light
    if len(light) % 2:
        light = np.concatenate([light, light[-1:]])
    return (light[::2] + light[1::2]) / 2


def object_row(look: Appearance, uv: np.ndarray, textures: Textures, unit: float = np.nan) -> np.ndarray:
    """(COLUMNS,) f32 of a cloth whose faces have the corners uv (m, 3, 2) [m]; unit: as in `Texture.place`."""
    row = np.zeros(COLUMNS, dtype=np.float32)
    row[CHECK] = DARKER if look.has_squares else 0.0
    sheen, specular, roughness = (usual if said is None else said for said, usual in zip(look.surface[:3], SHINE))
    row[SHEEN], row[SPECULAR], row[SHARPNESS] = sheen, specular, 2 / roughness**4 - 2  # as wide as a lobe of that roughness
    row[HEM] = look.hem or 0.0
    if look.texture is not None:
        t = look.texture
        row[TEXTURE] = 1 if t.repeat else 2
        row[ORIGIN: ORIGIN + 2], row[SIZE: SIZE + 2] = t.place(uv, unit)
        row[FIRST], row[LEVELS] = textures.add(t.image)
        row[BOTH] = look.back is None
    if look.weave is not None:
        row[WEAVE] = 1 + WEAVES.index(look.weave.kind)
        row[SPACING], row[RELIEF] = look.weave.spacing, look.weave.relief
    return row
