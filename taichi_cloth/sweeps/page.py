"""A sweep as one HTML page: a small plot for each figure, by the varied settings, and the table."""

import html
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..output.plot import Mean, scatter_plot
from .plan import SEED

WIDE = 20.0  # ratio of the largest and the smallest value from which on an axis is logarithmic
SKIPPED = ("run", "status", "reason", "message", "digest", "key", "time_s")
STYLE = """body { font: 15px/1.5 system-ui, sans-serif; color: #1c2126; background: #f6f7f8; margin: 2em; }
.multiples { display: grid; gap: 12px; align-items: start; }
figure { margin: 0; background: #fff; border: 1px solid #dde1e5; padding: 8px; }
figcaption { font-size: .85em; color: #555; } svg { width: 100%; height: auto; display: block; }
table { border-collapse: collapse; background: #fff; font-size: .85em; }
td, th { padding: .2em .6em; border: 1px solid #dde1e5; text-align: right; } .bad { background: #fbe3e1; }"""

Row = dict[str, Any]


def page(varied: Sequence[str], rows: Sequence[Row], summary: str, notes: Sequence[str] = ()) -> str:
    """A page of its own."""
    return (f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Sweep</title><style>{STYLE}</style></head>'
            f"<body><h1>Sweep over {html.escape(', '.join(varied)) or 'nothing'}</h1>{body(varied, rows, summary, notes)}"
            "</body></html>\n")


def body(varied: Sequence[str], rows: Sequence[Row], summary: str, notes: Sequence[str] = ()) -> str:
    """Plots and table, for a page or a notebook."""
    axis, series, facets = axes(varied, rows)
    figures = numbers(varied, rows)
    parts = [f"<p>{html.escape(text)}</p>" for text in (summary, *notes)]
    if axis:
        columns = [dict(zip(facets, values)) for values in dict.fromkeys(tuple(r[f] for f in facets) for r in rows)]
        parts.append(f'<div class="multiples" style="display:grid;grid-template-columns:repeat({max(len(columns), 2)},'
                     'minmax(260px,1fr))">')
        parts += [_multiple(figure, axis, series, column, rows) for figure in figures for column in columns]
        parts.append("</div>")
    return "\n".join([*parts, table(rows)])


def axes(varied: Sequence[str], rows: Sequence[Row]) -> tuple[str, str, list[str]]:
    """(setting along the axis, setting of lines, setting of columns) of the settings with more than one value."""
    several = [name for name in varied if name != SEED and len({repr(r[name]) for r in rows}) > 1]
    numeric = [name for name in several if all(_is_number(r[name]) for r in rows)]
    axis = max(numeric, key=lambda name: len({r[name] for r in rows}), default="")
    others = [name for name in several if name != axis]
    return axis, others[0] if others else "", others[1:]


def numbers(varied: Sequence[str], rows: Sequence[Row]) -> list[str]:
    """Names of the figures that are numbers and differ from row to row, the scene's own first."""
    names = [n for n in dict.fromkeys(name for row in rows for name in row) if n not in varied and n not in SKIPPED]
    kept = []
    for name in names:
        values = [row[name] for row in rows if row.get(name) is not None]
        if values and all(_is_number(v) for v in values) and len(set(values)) > 1:
            kept.append(name)
    standard = kept.index("lowest_m") + 1 if "lowest_m" in kept else 0
    return [*[n for n in kept[standard:] if n != "wall_s"], *kept[:standard], *[n for n in kept[standard:] if n == "wall_s"]]


def table(rows: Sequence[Row]) -> str:
    """Every row; those that are not ok are marked."""
    names = list(dict.fromkeys(name for row in rows for name in row))
    out = ["<table><tr>", *(f"<th>{html.escape(n)}</th>" for n in names), "</tr>"]
    for row in rows:
        mark = "" if row["status"] == "ok" else ' class="bad"'
        out.append(f"<tr{mark}>" + "".join(f"<td>{html.escape(_cell(row.get(n)))}</td>" for n in names) + "</tr>")
    return "".join([*out, "</table>"])


def _multiple(figure: str, axis: str, series: str, column: Row, rows: Sequence[Row]) -> str:
    """One small plot: dots of single runs, lines through their means."""
    mine = [r for r in rows if all(r[n] == v for n, v in column.items()) and r.get(figure) is not None]
    lines: dict[str, Mean] = {}
    for value in dict.fromkeys(r[series] for r in mine) if series else [None]:
        chosen = [r for r in mine if not series or r[series] == value]
        x, y = (np.array([float(r[n]) for r in chosen]) for n in (axis, figure))
        lines[f"{series} = {_cell(value)}" if series else figure] = Mean(x, y)
    every = [np.array([float(r[n]) for r in rows if r.get(n) is not None]) for n in (axis, figure)]
    log_x, log = (bool((v > 0).all() and v.max() > WIDE * v.min()) for v in every)
    title = ", ".join([figure, *(f"{n} = {_cell(v)}" for n, v in column.items())])
    return f"<figure>{scatter_plot(lines, axis, log, log_x)}<figcaption>{html.escape(title)}</figcaption></figure>"


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _cell(value: object) -> str:
    return "" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value)
