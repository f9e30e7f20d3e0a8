"""A pattern in words and as a drawing: panels beside each other, the numbers of their edges, and the warp. numpy only."""

import html
import math

import numpy as np

from .pattern import Panel, Pattern

GAP, LETTER = 40.0, 14.0  # mm between panels, and height of letters
ROW = 1600.0  # mm after which a row of panels ends
WARP = 0.25  # of a panel's smaller side that the line along the warp takes to each side


def described(pattern: Pattern) -> list[str]:
    """A line on each panel: its size and the lengths of its edges, from edge 0 on."""
    out = []
    for panel in pattern.panels:
        wide, high = np.ptp(panel.outline()[0], axis=0)
        lengths = ", ".join(f"{e.length(panel.corners):.3f}{f' ({e.label})' if e.label else ''}" for e in panel.edges)
        out.append(f"panel   {panel.name!r}, {wide:.4g} x {high:.4g} m, warp at {math.degrees(panel.grain):.4g} degrees, "
                   f"{len(panel.edges)} edges [m]: {lengths}")
    return out


def drawing(pattern: Pattern) -> str:
    """An SVG in millimetres, in which each panel has its name, its edges their numbers, and an open line the warp.

    `load_pattern` reads it again: only the borders are closed.
    """
    parts, x, y, high, wide = [], GAP, GAP, 0.0, 0.0
    for panel in pattern.panels:
        border = panel.outline()[0] * 1000
        size = np.ptp(border, axis=0)
        if x > GAP and x + size[0] > ROW:
            x, y, high = GAP, y + high + GAP + 2 * LETTER, 0.0
        parts.append(_drawn(panel, border, np.array([x - border[:, 0].min(), y + border[:, 1].max()])))
        x, high = x + size[0] + GAP, max(high, size[1])
        wide = max(wide, x)
    tall = y + high + GAP
    return (f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.1f}mm" height="{tall:.1f}mm" '
            f'viewBox="0 0 {wide:.1f} {tall:.1f}" font-size="{LETTER:g}" font-family="sans-serif" text-anchor="middle">\n'
            + "\n".join(parts) + "\n</svg>\n")


def _drawn(panel: Panel, border: np.ndarray, origin: np.ndarray) -> str:
    """A panel, its border (n, 2) [mm], whose origin is at (2,) on the sheet."""
    def at(points: np.ndarray) -> np.ndarray:
        return origin + np.asarray(points) * [1.0, -1.0]

    line = " ".join(f"{u:.3f},{v:.3f}" for u, v in at(border))
    middle = (border.min(axis=0) + border.max(axis=0)) / 2
    name = html.escape(panel.name)
    out = [f'<polygon id="{name}" points="{line}" fill="#f3f1ea" stroke="#333" stroke-width="1"/>']
    way = np.array([math.cos(panel.grain), math.sin(panel.grain)])
    (a, b), (u, v) = at(middle + np.outer([-1.0, 1.0], way) * WARP * np.ptp(border, axis=0).min()), at(middle)
    out.append(f'<line x1="{a[0]:.2f}" y1="{a[1]:.2f}" x2="{b[0]:.2f}" y2="{b[1]:.2f}" stroke="#a33" stroke-width="1"/>'
               f'<text x="{u:.2f}" y="{v:.2f}">{name}</text>')
    for k, edge in enumerate(panel.edges):
        corner, (u, v) = at(panel.corners[edge.start] * 1000), at(edge.points(panel.corners, np.array([0.5]))[0] * 1000)
        label = f"{k} {html.escape(edge.label)}".strip()
        out.append(f'<path d="M{corner[0]:.2f} {corner[1]:.2f} h.01" stroke="#333" stroke-width="5" stroke-linecap="round"/>'
                   f'<text x="{u:.2f}" y="{v:.2f}" fill="#06c">{label}</text>')
    return "".join(out)
