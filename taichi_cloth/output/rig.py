"""Lights and sky round a picture's cloth, by name."""

from dataclasses import dataclass, replace

import numpy as np

from ..scene.view import Color
from .camera import Frame

DARK = (0.0, 0.0, 0.0)
PLAIN = (0.48, 0.4704, 0.456)  # the mean of the floor's squares


@dataclass(frozen=True)
class Rig:
    """Lights. Linear RGB; 1 makes white cloth that faces it just white.

    Attributes:
        key: direction towards the light that throws shadows; power: its colour; size: tangent of half the angle under which it
            is seen.
        fill, rim: directions, as long as they are strong, of lights that throw no shadow: into the shadows, and along edges.
        up, down: light from the sky above and from the ground below; zenith, horizon: colours of the sky that is seen.
        floor: colour of a plain floor.
        turned: whether directions are in the camera's axes (right, up, back), as if lights were set up round it.
    """

    key: Color
    power: Color
    size: float
    up: Color
    down: Color
    zenith: Color
    horizon: Color
    fill: Color = DARK
    rim: Color = DARK
    floor: Color = PLAIN
    turned: bool = False


DAY = Rig((0.45, 0.8, 0.5), (0.76, 0.76, 0.76), 0.06, (0.315, 0.344, 0.389), (0.155, 0.141, 0.126),
          (0.42, 0.60, 0.86), (0.80, 0.86, 0.93))
RIGS = {
    "day": DAY,
    "studio": Rig((-0.90, 1.0, 0.50), (0.82, 0.80, 0.77), 0.2, (0.20, 0.205, 0.215), (0.34, 0.335, 0.33),
                  (0.26, 0.265, 0.28), (0.47, 0.47, 0.48), (0.16, 0.04, 0.11), (0.45, 0.35, -0.45), (0.80, 0.79, 0.78), True),
    "sun": Rig((0.75, 0.62, 0.45), (1.02, 0.90, 0.72), 0.0047, (0.17, 0.23, 0.34), (0.26, 0.24, 0.215),
               (0.16, 0.36, 0.74), (0.66, 0.78, 0.92)),
    "soft": Rig((0.0, 1.0, 0.0), DARK, 0.0, (0.98, 0.99, 1.0), (0.42, 0.41, 0.40), (0.70, 0.74, 0.80), (0.72, 0.72, 0.73),
                floor=(0.72, 0.715, 0.71)),
}


def rig_of(light: str | Color, camera: Frame) -> Rig:
    """The lights of a name, or those of the day with the key light in a direction."""
    if not isinstance(light, str):
        return replace(DAY, key=light)
    rig = RIGS[light]
    if not rig.turned:
        return rig
    back = camera.axes[2]
    angle = np.arctan2(back[0], back[2])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    key, fill, rim = (tuple((turn @ way).tolist()) for way in (rig.key, rig.fill, rig.rim))
    return replace(rig, key=key, fill=fill, rim=rim)
