"""The ground of a picture: where a ray meets it."""

from ..backend.language import ti
from .coverage import corner
from .uniforms import AXES, EYE, LENS, PLACE

FADE = 60  # tiles beyond which the ground has faded away


@ti.func
def ground_at(at, w: ti.template(), h: ti.template(), rows: ti.template()):
    """(distance along a ray to the ground or -1, the ray); at: where it goes through a picture of w x h."""
    right = ((at[0] - w / 2) / h - rows[LENS, 0]) / rows[PLACE, 0]
    up = ((h / 2 - at[1]) / h - rows[LENS, 1]) / rows[PLACE, 0]
    ray = (right * corner(rows, AXES) + up * corner(rows, AXES + 1) - corner(rows, AXES + 2)).normalized()
    t = -1.0
    if ray[1] < -1e-4 and rows[EYE, 1] > rows[PLACE, 1]:
        t = (rows[PLACE, 1] - rows[EYE, 1]) / ray[1]
    return t, ray
