"""Numbers that a picture's kernels read: rows of three, an array, because a number on an object is frozen into a kernel."""

import numpy as np

from .camera import Frame
from .rig import Rig

AXES = 0  # three rows: the camera's right, up, backward
EYE = 3  # [m]
SIDE = 4  # two rows across the light, and then
LIGHT = 6  # the direction towards it
PLACE = 7  # focal length [picture heights], height of the ground [m], side of a tile [m]
SHADOW = 8  # two rows: where the shadow map begins, its scale
CLOTH = 10  # side of a check [m], number of cloth's faces, whether edges are drawn
SCENE = 11  # whether vertices have colours of their own, size of the scene [m], size of the light
BACKGROUND = 12  # linear RGB
FLOOR = 13  # linear RGB
POWER = 14  # linear RGB of the key light
FILL, RIM = 15, 16  # directions of lights without shadows, as long as they are strong
UP, DOWN = 17, 18  # linear RGB of the light from above and from below
ZENITH, HORIZON = 19, 20  # linear RGB of the sky
LENS = 21  # by how much the picture is moved, right and up [picture heights]; number of the exposure


def uniforms(camera: Frame, light: np.ndarray, ground: float, tile: float, shadow: np.ndarray, checks: float, cloth_faces: int,
             wire: bool, painted: bool, size: float, background: np.ndarray, floor: np.ndarray, rig: Rig,
             exposure: int = 0) -> np.ndarray:
    """(22, 3) f32 rows, as named above; light: (3, 3) two rows across it, and towards it."""
    rows = [*camera.axes, camera.eye, *light, [camera.focal, ground, tile], *shadow, [checks, cloth_faces, wire],
            [painted, size, rig.size], background, floor, rig.power, rig.fill, rig.rim, rig.up, rig.down, rig.zenith,
            rig.horizon, [*camera.shift, exposure]]
    return np.array(rows, dtype=np.float32)
