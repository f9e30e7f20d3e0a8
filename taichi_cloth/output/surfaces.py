"""Surfaces of a picture: triangles with their colours, and the objects that they belong to."""

from dataclasses import dataclass, field

import numpy as np

from ..scene.appearance import Appearance
from .objects import BOTH, FIRST, HEM, LEVELS, TEXTURE, WEAVE, Textures, object_row


@dataclass(frozen=True)
class Surfaces:
    """Triangles to be drawn, cloth's first.

    Attributes:
        faces: (m, 3) vertices; corner_uv: (m, 3, 2) [m].
        colors, backs: (m, 3) linear RGB of the two sides.
        owner: (m,) the object that a face belongs to; objects: (k, COLUMNS) `objects.object_row` of each.
        cloth_faces: how many of the faces, the first ones, are cloth.
        textures: images that the objects name.
        borders: (m, 8) as `hems.borders` gives them; (1, 8) where nothing has a hem.
    """

    faces: np.ndarray
    corner_uv: np.ndarray
    colors: np.ndarray
    backs: np.ndarray
    owner: np.ndarray
    objects: np.ndarray
    cloth_faces: int
    textures: Textures = field(default_factory=Textures)
    borders: np.ndarray = field(default_factory=lambda: np.zeros((1, 8)))

    def __post_init__(self) -> None:
        for name, dtype in (("faces", np.int32), ("corner_uv", np.float32), ("colors", np.float32), ("backs", np.float32),
                            ("owner", np.int32), ("objects", np.float32), ("borders", np.float32)):
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name), dtype=dtype))

    @property
    def textured(self) -> bool:
        """Whether an image is on anything."""
        return bool((self.objects[:, TEXTURE] > 0).any())

    @property
    def woven(self) -> bool:
        """Whether threads show on anything."""
        return bool((self.objects[:, WEAVE] > 0).any())

    @property
    def hemmed(self) -> bool:
        """Whether anything has a hem."""
        return bool((self.objects[:, HEM] > 0).any())

    def mean_color(self, face: int, front: bool) -> np.ndarray:
        """(3,) linear RGB of a side of a face; where an image is on it, with the mean of that."""
        row, color = self.objects[self.owner[face]], (self.colors if front else self.backs)[face]
        if row[TEXTURE] == 0 or not (front or row[BOTH]):
            return color
        last = int(row[FIRST] + row[LEVELS]) - 1  # one texel, the mean of all
        code = self.textures.texels[self.textures.levels[last, 0]: ][:1].view(np.uint8)
        return color * (1 - code[3] / 255) + self.textures.decode[code[:3]]


def plain(faces: np.ndarray, corner_uv: np.ndarray, colors: np.ndarray) -> Surfaces:
    """One cloth in these colours (m, 3)."""
    row = object_row(Appearance(), corner_uv, Textures())
    return Surfaces(faces, corner_uv, colors, back_of(colors), np.zeros(len(faces)), row[None], len(faces))


def back_of(colors: np.ndarray) -> np.ndarray:
    """Colours (..., 3) of the other side if none is given: a little darker and greyer, as the back of dyed cloth is."""
    grey = colors.mean(axis=-1, keepdims=True)
    return 0.72 * (0.85 * colors + 0.15 * grey)
