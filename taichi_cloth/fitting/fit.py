"""Fits fabric parameters to measurements of one of four experiments."""

import functools
import json
import pathlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import checks
from ..errors import BackendError, OutputError, SceneError
from ..output.folder import write_whole
from ..output.plot import as_file, line_plot
from ..sweeps.store import as_csv
from . import closed_forms, simulated
from .data import SIGMA, read, within
from .least_squares import Estimate, Model, estimate

KINDS = ("cantilever", "strip", "drape", "swing")
UNITS = {"D": "N m", "k": "N/m", "k_d": "N s/m", "limit": "", "air": "N s/m^3"}
FILES = ("fit.json", "fit.csv", "fit.svg")
SAMPLES = 60  # of the curve
SIMULATED = {"drape": (1e-5, 1e-3), "swing": (1e-3, 1.0)}  # values that are tried where no range is given
POINTS, CLOSER, EACH = 7, 5, 1.5  # values simulated over the range; then about the optimum, up to a factor of it both ways


@dataclass
class Fit:
    """Result of a fit.

    Attributes:
        parameters: values by name, in SI units; intervals: (low, high) by name, None if there are no more measurements than
            parameters.
        confidence: of the intervals and of the curve's band.
        covariance: (n, n) of the parameters in their order.
        scatter: standard deviation of the residuals, in the unit of the measurement (in sigmas where these were given).
        curve: columns by name: the varied quantity, the model, low and high end of its band.
        data: the measurements; across, up: the columns of both that make the plot.
    """

    kind: str
    parameters: dict[str, float]
    intervals: dict[str, tuple[float, float] | None]
    confidence: float
    covariance: np.ndarray
    scatter: float
    curve: dict[str, np.ndarray]
    data: dict[str, np.ndarray]
    across: str
    up: str
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        lines = []
        for name, value in self.parameters.items():
            unit, ends = UNITS[name] if self.kind != "swing" or name != "k_d" else "N m s", self.intervals[name]
            sure = "no interval: too few measurements"
            if ends:
                sure = f"{self.confidence:.0%} between {ends[0]:.4g} and {ends[1]:.4g}"
            lines.append(f"{name} = {value:.4g} {unit} ({sure})".replace("  ", " "))
        lines.append(f"residuals scatter by {self.scatter:.3g} in {self.up}, {len(self.data[self.up])} measurements")
        return "\n".join([*lines, *self.notes])

    def plot(self) -> str:
        """An SVG: the measurements, the curve and its band."""
        c = self.curve
        series = {"fit": (c[self.across], c[self.up]), "low": (c[self.across], c["low"]), "high": (c[self.across], c["high"])}
        points = (self.data[self.across], self.data[self.up])
        return line_plot({**series, "measured": (np.zeros(0), np.zeros(0))}, f"{self.across}; up: {self.up}",
                         dots={"fit": points})

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(str(self))}</pre>{self.plot()}"

    def save(self, folder: str | pathlib.Path) -> None:
        """Writes fit.json, fit.csv (the curve) and fit.svg into a folder.

        Raises:
            OutputError: it cannot be written.
        """
        path = checks.path("fit: folder", folder, OutputError)
        try:
            path.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise OutputError(f"cannot write to {path}: {getattr(error, 'strerror', None) or error}") from None
        found = {"kind": self.kind, "parameters": self.parameters, "intervals": self.intervals, "confidence": self.confidence,
                 "covariance": [[None if np.isnan(v) else float(v) for v in row] for row in self.covariance],
                 "scatter": self.scatter, "notes": self.notes}
        rows = [dict(zip(self.curve, map(float, values))) for values in zip(*self.curve.values())]
        for name, text in zip(FILES, (json.dumps(found, indent=1) + "\n", as_csv(rows), as_file(self.plot()))):
            write_whole(path / name, text.encode())


def fit(kind: str, data: object, *, density: float | None = None, width: float | None = None, length: float | None = None,
        D: float = 1e-5, k: float = 1000.0, find: str | None = None, range_: tuple[float, float] | None = None,
        confidence: float = 0.95, rings: int = 15, cells: int = 12, h: float = 1 / 240, workers: int | None = None,
        out: str | pathlib.Path | None = None, say: Callable[[str], None] = lambda text: None) -> Fit:
    """Finds parameters of a fabric from measurements, with their uncertainty.

    | kind | columns of the data | needs | finds |
    |---|---|---|---|
    | cantilever | length [m]; drop of the free end [m], or angle of its chord [degrees] | density | D |
    | strip | strain; tension [N/m], or force [N] with `width`; rate [1/s] | | k; with a rate k_d; find="k,limit" both |
    | drape | coefficient (Cusick's, a part of 1) | density | D |
    | swing | time [s], x [m] of the lower end of a strip let go at time 0 | density, length, width | air, or k_d of bending |

    A column `sigma` gives the standard deviation of each measurement. drape and swing are simulated over `range_`, as a
    sweep, then again about the optimum.

    Args:
        kind: cantilever, strip, drape or swing.
        data: a CSV file, or arrays by column.
        density: [kg/m^2]; width, length: of the strip [m].
        D, k: bending rigidity [N m] and stretch stiffness [N/m] that the simulated experiments take as known.
        find: of a strip "k" or "k,limit"; of a swing "air" or "k_d".
        range_: (low, high) values that are tried in simulated experiments.
        confidence: of the intervals.
        rings: of the disk's mesh; cells: along the swinging strip; h: of its steps [s].
        workers: as in `sweep`.
        out: folder for fit.json, fit.csv, fit.svg and, of simulated experiments, sweep/.
        say: is told of each run.

    Raises:
        SceneError: data or options that are wrong, or that do not determine the parameters.
    """
    checks.choice("kind of experiment", kind, KINDS)
    try:
        import scipy  # noqa: F401
    except ImportError:
        raise BackendError('SciPy is not installed: pip install "taichi-cloth[fit]"') from None
    confidence = checks.number("fit: confidence", confidence, least=0.5, most=0.9999)
    density = checks.maybe(density, checks.number, "fit: density", "kg/m^2", positive=True)
    width, length = (checks.maybe(v, checks.number, f"fit: {n}", "m", positive=True) for n, v in (("width", width),
                                                                                               ("length", length)))
    folder = None if out is None else checks.path("fit: out", out, OutputError)
    if kind == "cantilever":
        made = _cantilever(data, _needed(kind, "density", density), confidence)
    elif kind == "strip":
        made = _strip(data, width, checks.choice("fit: find", "k" if find is None else find, ("k", "k,limit")), confidence)
    else:
        low, high = _range(SIMULATED[kind] if range_ is None else range_)
        simulate = {"workers": workers, "out": None if folder is None else folder / "sweep", "say": say}
        material = {"density": _needed(kind, "density", density), "k": checks.number("fit: k", k, "N/m", positive=True)}
        if kind == "drape":
            made = _drape(data, {**material, "rings": checks.integer("fit: rings", rings, least=4, most=200)}, (low, high),
                          simulate, confidence)
        else:
            setting = {**material, "D": checks.number("fit: D", D, "N m", positive=True),
                       "find": checks.choice("fit: find", "air" if find is None else find, ("air", "k_d")),
                       "cells": checks.integer("fit: cells", cells, least=2, most=1000),
                       "length": _needed(kind, "length", length), "width": _needed(kind, "width", width)}
            made = _swing(data, setting, checks.number("fit: h", h, "s", positive=True), (low, high), simulate, confidence)
    if folder is not None:
        made.save(folder)
    return made


def _cantilever(data: object, density: float, confidence: float) -> Fit:
    columns = read(data, ["length"], ["drop", "angle"])
    within(columns, "length", "cantilever", 0.0, 10.0, ": it is in metres")
    up = "drop" if "drop" in columns else "angle"
    if up == "drop":
        bad = np.flatnonzero(~((columns["drop"] > 0) & (columns["drop"] < columns["length"])))
        if len(bad):
            raise SceneError(f"cantilever: drop of row {bad[0]} is {columns['drop'][bad[0]]:g} m of a strip of "
                             f"{columns['length'][bad[0]]:g} m: must be more than 0 and less than its length")
    else:
        within(columns, "angle", "cantilever", 0.0, 90.0, ": it is in degrees below the horizontal")

    def model(lengths: np.ndarray, p: np.ndarray) -> np.ndarray:
        drop, reach = closed_forms.cantilever(density * closed_forms.G * lengths**3 / p[0])
        return lengths * drop if up == "drop" else np.degrees(np.arctan2(drop, reach))

    low, high = closed_forms.rigidity_range(density * closed_forms.G * columns["length"] ** 3)
    start = np.median(density * closed_forms.G * columns["length"] ** 3 / 10)
    return _fitted("cantilever", columns, "length", up, model, ("D",), np.array([start]), (np.array([low]), np.array([high])),
                   confidence)


def _strip(data: object, width: float | None, find: str, confidence: float) -> Fit:
    columns = read(data, ["strain"], ["tension", "force"], ["rate"])
    if "tension" not in columns:
        columns["tension"] = columns.pop("force") / _needed("strip of forces", "width", width)
        if SIGMA in columns:
            columns[SIGMA] = columns[SIGMA] / width
    strain, T = columns["strain"], columns["tension"]
    if not (strain > 0).any() or not (T > 0).any():
        raise SceneError("strip: needs measurements under tension, with strain and tension more than 0")
    within(columns, "strain", "strip", -0.5, 10.0, ": a part of 1, not percent")
    rate, limited = columns.get("rate"), find == "k,limit"
    names = ("k", *(("limit",) if limited else ()), *(("k_d",) if rate is not None else ()))
    first = max(float(np.sum(strain * T) / np.sum(strain**2)), 1e-9)
    start, low, high = [first], [first * 1e-6], [first * 1e6]
    if limited:
        top = float(strain.max())
        start, low, high = [first / 3, 1 + 0.5 * top], [first * 1e-6, 1 + 1e-3 * top], [first * 1e6, 1 + top]
    if rate is not None:
        start, low, high = [*start, 1e-3 * first], [*low, 1e-12 * first], [*high, 1e6 * first]

    def model(at: np.ndarray, p: np.ndarray) -> np.ndarray:
        own = closed_forms.tension(at, p[0], p[1] if limited else None)
        return own + p[-1] * rate if rate is not None and len(at) == len(strain) else own

    made = _fitted("strip", columns, "strain", "tension", model, names, np.array(start), (np.array(low), np.array(high)),
                   confidence)
    if rate is not None:
        made.notes.append("the curve is that of a slow pull, without damping")
    return made


def _drape(data: object, setting: dict[str, Any], span: tuple[float, float], simulate: dict[str, Any],
           confidence: float) -> Fit:
    columns = read(data, ["coefficient"])
    within(columns, "coefficient", "drape", 0.0, 1.0, ": a part of 1, not percent")
    build = functools.partial(simulated.drape_scene, **setting)
    surrogate = simulated.Surrogate(build, "D", simulated.drape_coefficient, {
        **simulate, "duration": 2.0, "fps": 0.5, "h": 1 / 60, "integrator": "backward_euler"})
    measured = columns["coefficient"]

    def model(at: np.ndarray, p: np.ndarray) -> np.ndarray:
        return np.full(len(at), float(surrogate(p[0])[0]))

    columns["number"] = np.arange(len(measured), dtype=float)
    made = _closer(surrogate, span, lambda bounds, start: _fitted(
        "drape", columns, "number", "coefficient", model, ("D",), start, bounds, confidence))
    D = np.geomspace(min(surrogate.values), max(surrogate.values), SAMPLES)
    values = np.array([float(surrogate(v)[0]) for v in D])
    half = (made.curve["high"] - made.curve["low"])[0] / 2  # of the mean coefficient
    made.curve = {"D": D, "coefficient": values, "low": values - half, "high": values + half}
    made.data, made.across = {**columns, "D": np.full(len(measured), made.parameters["D"])}, "D"
    return made


def _swing(data: object, setting: dict[str, Any], h: float, span: tuple[float, float], simulate: dict[str, Any],
           confidence: float) -> Fit:
    columns = read(data, ["time", "x"])
    t, x = columns["time"], columns["x"]
    if len(t) < 3 or t[0] != 0 or (np.diff(t) <= 0).any():
        raise SceneError("swing: times must begin with 0, where the strip is let go, and rise from row to row, three or more")
    if not 0 < abs(x[0]) < 0.9 * setting["length"]:
        raise SceneError(f"swing: x at time 0 is {x[0]:g} m: the end must be aside, by less than .9 of the length "
                         f"{setting['length']:g} m")
    if t[-1] / h > 100_000:
        raise SceneError(f"swing: {t[-1]:g} s is {t[-1] / h:.3g} steps of h = {h:g} s: too many")
    side, later = float(np.sign(x[0])), {n: v[1:] for n, v in columns.items()}  # the first says how it began
    later["x"] = side * later["x"]
    build = functools.partial(simulated.swing_scene, start=float(abs(x[0])), **setting)
    surrogate = simulated.Surrogate(build, "value", functools.partial(simulated.follow, times=tuple(map(float, t[1:]))), {
        **simulate, "duration": h, "fps": 1 / h, "h": h, "integrator": "tr_bdf2"})

    def model(at: np.ndarray, p: np.ndarray) -> np.ndarray:
        found = surrogate(p[0])
        return found if len(at) == len(found) else np.interp(at, t[1:], found)

    return _closer(surrogate, span, lambda bounds, start: _fitted(
        "swing", later, "time", "x", model, (setting["find"],), start, bounds, confidence))


def _closer(surrogate: simulated.Surrogate, span: tuple[float, float],
            fitted: Callable[[tuple[np.ndarray, np.ndarray], np.ndarray], Fit]) -> Fit:
    """Fits to runs over the range, then with more of them about the optimum."""
    surrogate.add(np.geomspace(*span, POINTS))
    bounds = (np.array([span[0]]), np.array([span[1]]))
    value = next(iter(fitted(bounds, np.array([np.sqrt(span[0] * span[1])])).parameters.values()))
    surrogate.add(np.clip(value * EACH ** np.linspace(-1, 1, CLOSER), *span))
    made = fitted(bounds, np.array([value]))
    made.notes.append(f"{len(surrogate.values)} runs, the last of them within a factor of {EACH:g}")
    return made


def _fitted(kind: str, columns: Mapping[str, np.ndarray], across: str, up: str,
            model: Callable[[np.ndarray, np.ndarray], np.ndarray], names: tuple[str, ...], start: np.ndarray,
            bounds: tuple[np.ndarray, np.ndarray], confidence: float) -> Fit:
    at, measured = columns[across], columns[up]
    there: Model = functools.partial(model, at)
    found: Estimate = estimate(there, measured, start, bounds, columns.get(SIGMA), confidence, names)
    fine = np.linspace(at.min(), at.max(), SAMPLES)
    middle, half = found.band(functools.partial(model, fine))
    intervals = {n: None if np.isnan(a) else (float(a), float(b)) for n, a, b in zip(names, found.low, found.high)}
    return Fit(kind, dict(zip(names, map(float, found.values))), intervals, confidence, found.covariance, found.scatter,
               {across: fine, up: middle, "low": middle - half, "high": middle + half}, dict(columns), across, up)


def _needed(kind: str, name: str, value: float | None) -> float:
    if value is None:
        raise SceneError(f"fit: {kind} needs {name}")
    return value


def _range(pair: object) -> tuple[float, float]:
    if not checks.is_sequence(pair) or len(pair) != 2:  # type: ignore[arg-type]
        raise SceneError(f"fit: range = {checks.shown(pair)}: needs a pair of numbers")
    low, high = (checks.number("fit: range", v, positive=True) for v in pair)  # type: ignore[attr-defined]
    if not low < high:
        raise SceneError(f"fit: range = ({low:g}, {high:g}): the first must be less")
    return low, high
