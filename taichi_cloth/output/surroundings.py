"""What surrounds cloth in a picture: ground, sky, the light from them."""

import taichi as ti

from .colors import ABOVE, BELOW, HORIZON, SKYLIGHT, ZENITH


@ti.func
def checker(q):
    """1 and 0 in turn."""
    cell = ti.cast(ti.floor(q[0]), int) + ti.cast(ti.floor(q[1]), int)
    return ti.cast(cell & 1, float)


@ti.func
def soft_checker(q, width):
    """The mean of `checker` over a square of this width: its edges are as soft as a sample is wide."""
    side = 1.0
    for d in ti.static(range(2)):
        low, high = (q[d] - 0.5 * width) / 2, (q[d] + 0.5 * width) / 2
        side *= 2 * (ti.abs(low - ti.floor(low) - 0.5) - ti.abs(high - ti.floor(high) - 0.5)) / width
    return 0.5 - 0.5 * side


@ti.func
def sky(ray):
    """Colour of the sky in a direction."""
    t = ti.max(ray[1], 0.0)
    return ti.Vector(HORIZON) * (1 - t) + ti.Vector(ZENITH) * t


@ti.func
def ambient(n):
    """Light from everywhere: blueish from above, warm from the ground."""
    t = 0.5 + 0.5 * n[1]
    return SKYLIGHT * (ti.Vector(ABOVE) * t + ti.Vector(BELOW) * (1 - t))
