"""Surroundings of cloth in a picture: ground, sky, the light from them."""

from ..backend.language import ti
from .coverage import corner
from .uniforms import DOWN, HORIZON, UP, ZENITH


@ti.func
def soft_checker(q, width):
    """1 and 0 in turn, the mean of it over a square of this width: its edges are as soft as a sample is wide."""
    side = 1.0
    for d in ti.static(range(2)):
        low, high = (q[d] - 0.5 * width) / 2, (q[d] + 0.5 * width) / 2
        side *= 2 * (ti.abs(low - ti.floor(low) - 0.5) - ti.abs(high - ti.floor(high) - 0.5)) / width
    return 0.5 - 0.5 * side


@ti.func
def sky(ray, rows: ti.template()):
    """Colour of the sky in a direction."""
    t = ti.sqrt(ti.max(ray[1], 0.0))  # paler only near the horizon
    return corner(rows, HORIZON) * (1 - t) + corner(rows, ZENITH) * t


@ti.func
def ambient(n, rows: ti.template()):
    """Light from everywhere: of the sky from above, of the ground from below."""
    t = 0.5 + 0.5 * n[1]
    return corner(rows, UP) * t + corner(rows, DOWN) * (1 - t)
