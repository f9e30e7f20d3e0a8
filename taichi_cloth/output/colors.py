"""Colour scales for heat maps, their bar, and sRGB."""

import numpy as np

from .. import colornames
from .text import HEIGHT, draw_text, ink, text_width

# linear RGB of solids, and of cloths in turn, where a scene names no colour
STONE = (0.52, 0.50, 0.47)
PALETTE = ((0.62, 0.07, 0.08), (0.06, 0.19, 0.46), (0.08, 0.36, 0.20), (0.62, 0.36, 0.05), (0.32, 0.10, 0.42))

# linear light at even steps: dark blue to yellow for quantities from 0, blue over yellow to red for those with a middle, which
# is not grey in any light, as floors and solids are
_RISING = np.array([(0.02, 0.01, 0.10), (0.16, 0.03, 0.36), (0.45, 0.06, 0.30),
                    (0.80, 0.20, 0.10), (0.95, 0.55, 0.06), (0.98, 0.94, 0.45)])
_DIVERGING = np.array([(0.01, 0.03, 0.35), (0.05, 0.25, 0.70), (0.12, 0.60, 0.35), (0.98, 0.90, 0.24),
                       (0.95, 0.42, 0.07), (0.75, 0.10, 0.04), (0.35, 0.00, 0.03)])


def heat_colors(values: np.ndarray, low: float, high: float, diverging: bool) -> np.ndarray:
    """(n, 3) linear RGB of values (n,) on a scale from low to high."""
    table = _DIVERGING if diverging else _RISING
    at = np.clip((values - low) / max(high - low, 1e-300), 0, 1) * (len(table) - 1)
    k = np.minimum(at.astype(np.int64), len(table) - 2)
    part = (at - k)[:, None]
    return (1 - part) * table[k] + part * table[k + 1]


def draw_bar(image: np.ndarray, low: float, high: float, diverging: bool, label: str) -> None:
    """A colour bar with its ends and a label in the lower left corner of an image (h, w, c). What is beyond an end has its
    colour, which the bar says of all ends but 0."""
    scale = max(1, image.shape[0] // 360)
    width, height, edge = min(220 * scale // 2 * 2, image.shape[1] - 20), 8 * scale, 10 * scale
    row = image.shape[0] - edge - height - (HEIGHT + 3) * scale
    ramp = to_srgb(heat_colors(np.linspace(low, high, width), low, high, diverging))
    image[row: row + height, edge: edge + width] = ink(ramp, image)[None]
    draw_text(image, label, edge, row - (HEIGHT + 3) * scale, scale)
    draw_text(image, "0" if low == 0 else f"{low:.3g} or less", edge, row + height + 3 * scale, scale)
    right = "0" if high == 0 else f"{high:.3g} or more"
    draw_text(image, right, edge + width - text_width(right, scale), row + height + 3 * scale, scale)


def to_srgb(linear: np.ndarray, bits: int = 8) -> np.ndarray:
    """uint8 or uint16 sRGB of linear light in 0..1, in an array of any shape."""
    return (colornames.to_srgb(linear) * (2**bits - 1) + 0.5).astype(np.uint8 if bits == 8 else np.uint16)
