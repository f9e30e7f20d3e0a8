"""Place of the nearest contact, for messages on rejected or slow steps. numpy only."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Particles, solid and gap of the nearest contact.

    Attributes:
        particles: of the cloth there, up to 4, the one that is told of first.
        solid: index of the solid that it is against, or -1: cloth.
        gap: distance over the one to keep; below 0 cloth has passed the surface.
    """

    particles: tuple[int, ...]
    solid: int
    gap: float
