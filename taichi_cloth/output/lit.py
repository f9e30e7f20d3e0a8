"""Light reflected by a surface: spread evenly, in a highlight, and along its rim."""

from ..backend.language import ti
from .coverage import corner
from .objects import SHARPNESS, SHEEN, SPECULAR
from .surroundings import ambient
from .uniforms import FILL, LIGHT, POWER, RIM

BOUNCE = 0.6  # part of the light that near surfaces throw back


@ti.func
def lit(base, n, view, reached, open_sky, objects: ti.template(), o, rows: ti.template(), key: ti.template(),
        accents: ti.template()):
    """Colour of a surface of colour `base`, normal n, seen from the direction `view`; reached, open_sky: shares of the light.

    Args:
        key, accents: whether there is a light that throws shadows, and others that throw none.
    """
    light = corner(rows, LIGHT)
    around = (open_sky + (1 - open_sky) * BOUNCE * base) * ambient(n, rows)  # folds are lit by the cloth around them
    shine = ti.Vector([0.0, 0.0, 0.0])
    if ti.static(key):
        direct = corner(rows, POWER) * ti.max(n.dot(light), 0.0) * reached
        around += direct
        shine += direct * gloss(n, view, light, objects, o)
    if ti.static(accents):
        for k in ti.static((FILL, RIM)):
            direct = ti.max(n.dot(corner(rows, k)), 0.0) * open_sky
            around += direct
            shine += direct * gloss(n, view, corner(rows, k).normalized(1e-12), objects, o)
    rim = objects[o, SHEEN] * (1 - ti.max(n.dot(view), 0.0)) ** 3
    return (base + rim) * around + shine


@ti.func
def gloss(n, view, way, objects: ti.template(), o):
    """Part of the light from a direction that a surface throws back, relative to white cloth.

    [J. Blinn: Models of Light Reflection, 1977, normalised; C. Schlick: An Inexpensive BRDF Model, 1994]
    """
    half = (way + view).normalized(1e-12)
    least, sharp = objects[o, SPECULAR], objects[o, SHARPNESS]
    part = least + (ti.min(50 * least, 1.0) - least) * (1 - ti.max(half.dot(view), 0.0)) ** 5
    return part * (sharp + 8) / 8 * ti.max(n.dot(half), 0.0) ** sharp
