"""Where contact goes worst, for messages on rejected or slow steps. numpy only."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Of the nearest contact.

    Attributes:
        particles: of the cloth there, up to 4, the one that is told of first.
        solid: index of the solid that it is against, or -1: cloth.
        gap: distance that is left over the one to keep; below 0 it has passed the surface.
    """

    particles: tuple[int, ...]
    solid: int
    gap: float
