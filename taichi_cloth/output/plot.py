"""Line plots as SVG text."""

import html
from dataclasses import dataclass

import numpy as np

WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 480, 240, 58, 30, 12, 10
COLORS = ("#b3252b", "#1f5fa8", "#2c8a4b", "#c27a12", "#6a3d9a", "#444", "#999", "#0aa", "#d45ca0", "#7a5230")
BESIDE = 155  # width of names beside the lines, where they do not fit into a row above them
ABOVE, LETTER = 16, 6.2  # height of that row, width of a letter


@dataclass(frozen=True)
class Mean:
    """Points x, y (k,), several of them over the same x: each is a dot, and a line goes through their means."""

    x: np.ndarray
    y: np.ndarray

    def line(self) -> tuple[np.ndarray, np.ndarray]:
        """(x, mean of y there), x growing."""
        x = np.unique(self.x)
        return x, np.array([self.y[self.x == a].mean() for a in x])


def scatter_plot(series: dict[str, Mean], x_label: str, log: bool = False, log_x: bool = False) -> str:
    """The plot of `line_plot` for points that repeat: a line through their means, and dots."""
    return line_plot({name: s.line() for name, s in series.items()}, x_label, log, log_x,
                     dots={name: (s.x, s.y) for name, s in series.items()})


def line_plot(series: dict[str, tuple[np.ndarray, np.ndarray]], x_label: str, log: bool = False, log_x: bool = False,
              marks: bool = False, dots: dict[str, tuple[np.ndarray, np.ndarray]] | None = None) -> str:
    """An SVG of lines (x, y) by name over a common axis; steps if there is one point, nothing if there is none.

    Args:
        log, log_x: logarithmic y and x axis; values that are not positive are left out.
        marks: a dot at every point.
        dots: points by name instead, in the colours of the lines.
    """
    if dots is None:
        dots = series if marks else {}
    if log_x:
        series, dots = ({name: (np.log10(x[x > 0]), y[x > 0]) for name, (x, y) in some.items()} for some in (series, dots))
    series = {name: (x, y) for name, (x, y) in series.items() if len(x)}
    if not series:
        return "<p>nothing to plot</p>"
    xs, ys = (np.concatenate([pair[k] for some in (series, dots) for pair in some.values()]) for k in (0, 1))
    if log:
        ys = ys[ys > 0] if (ys > 0).any() else np.ones(1)
    x_0, x_1, y_0, y_1 = float(xs.min()), float(xs.max()), float(ys.min()), float(ys.max())
    if log:
        y_0, y_1 = np.log10(y_0), np.log10(y_1)
    x_1 = x_1 if x_1 > x_0 else x_0 + 1
    if y_1 - y_0 < 1e-12 * max(1.0, abs(y_1)):
        y_0, y_1 = y_0 - 0.5 * max(abs(y_0), 1.0), y_1 + 0.5 * max(abs(y_1), 1.0)

    def across(x):
        return LEFT + (WIDTH - LEFT - RIGHT) * (x - x_0) / (x_1 - x_0)

    def up(y):
        return HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * (y - y_0) / (y_1 - y_0)

    starts = np.cumsum([0.0] + [LETTER * (len(name) + 2) for name in series])
    row = LEFT + starts[-1] < WIDTH
    wide, high = (WIDTH, ABOVE if len(series) > 1 else 0) if row else (WIDTH + BESIDE, 0)
    out = [f'<svg viewBox="0 {-high} {wide} {HEIGHT + high}" font-size="11" font-family="sans-serif">']
    for tick in _ticks(y_0, y_1):
        label = f"{10**tick:.3g}" if log else f"{tick:.4g}"
        out.append(f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{up(tick):.1f}" y2="{up(tick):.1f}" stroke="#e3e6e9"/>'
                   f'<text x="{LEFT - 5}" y="{up(tick) + 4:.1f}" text-anchor="end">{label}</text>')
    for tick in _ticks(x_0, x_1):
        label = f"{10**tick:.3g}" if log_x else f"{tick:.4g}"
        out.append(f'<text x="{across(tick):.1f}" y="{HEIGHT - 14}" text-anchor="middle">{label}</text>')
    out.append(f'<text x="{(WIDTH + LEFT) / 2}" y="{HEIGHT - 2}" text-anchor="middle" fill="#666">'
               f'{html.escape(x_label)}</text>')
    for k, (name, (x, y)) in enumerate(series.items()):
        color = COLORS[k % len(COLORS)]
        if log:
            x, y = x[y > 0], np.log10(y[y > 0])
        pick = np.unique(np.linspace(0, max(len(x) - 1, 0), min(len(x), 800)).astype(np.int64))
        points = " ".join(f"{across(x[i]):.1f},{up(y[i]):.1f}" for i in pick)
        out.append(f'<polyline points="{points}" fill="none" stroke="{color}" stroke-width="1.4"/>')
        for a, b in zip(*dots.get(name, ((), ()))):
            if not log or b > 0:
                height = up(np.log10(b) if log else b)
                out.append(f'<circle cx="{across(a):.1f}" cy="{height:.1f}" r="2.5" fill="{color}"/>')
        if len(series) > 1:
            x_name, y_name = (LEFT + starts[k], 2) if row else (WIDTH, TOP + 12 + 13 * k)
            out.append(f'<text x="{x_name:.0f}" y="{y_name}" fill="{color}">{html.escape(name)}</text>')
    return "\n".join([*out, "</svg>"])


def as_file(svg: str) -> str:
    """A plot as a file of its own; in a page it needs no address."""
    return svg.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1) + "\n"


def _ticks(low: float, high: float) -> np.ndarray:
    """Four or five round numbers between two."""
    step = 10 ** np.floor(np.log10((high - low) / 4))
    step *= next(m for m in (1, 2, 5, 10) if (high - low) / (step * m) <= 5)
    return np.arange(np.ceil(low / step), np.floor(high / step + 1e-9) + 1) * step
