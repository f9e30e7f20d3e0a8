"""Trials of panels drawn in SVG files: random ones, whole or damaged.

Of a whole drawing every corner must come back where it was drawn, and the middle of every curve; a damaged one must load, or
be refused by one of the project's own errors that names the file, within seconds and a bounded amount of memory.
"""

import gzip
import pathlib
import tempfile
import warnings

import numpy as np
from fuzz import FAILED, OK, Outcome

import taichi_cloth as tc
from fuzzing.files import Limits, damage
from taichi_cloth.errors import ClothError

WORDS = ("M", "z", "S", "T", "A 0 0 0 1 1", "h", ",", "#p0", "use", "rotate(", "50mm", "100%", "1e400", "-", "&amp;", "&x;",
         "<g>", "</g>", "<!--", "]]>", "display:none", 'id="p1"', 'viewBox="0 0 0 0"', "skewX(90)", "scale(0)", "\x00",
         "1" * 400)
EXACT = 1e-6  # of a panel's size, in decimals of nine digits


def panel(rng: np.random.Generator) -> tuple[str, np.ndarray]:
    """(path data, (n, 2) its corners with the middles of its curves between them) of a star-shaped outline about 100 wide."""
    n = int(rng.integers(3, 12))
    angle = np.sort(rng.uniform(0, 2 * np.pi / n * 0.6, n) + np.arange(n) * 2 * np.pi / n)
    corners = rng.uniform(60, 100, n) * np.exp(1j * angle) + rng.uniform(-50, 50) * (1 + 1j)
    corners = np.array([complex(round(c.real, 3), round(c.imag, 3)) for c in corners])
    text, points = [f"M{corners[0].real:g},{corners[0].imag:g}"], []
    for a, b in zip(corners, np.roll(corners, -1)):
        count = {"L": 0, "Q": 1, "C": 2}[kind := str(rng.choice(["L", "Q", "C"]))]
        control = [complex(*np.round([(p := a + (k + 1) / (count + 1) * (b - a) + 0.05 * abs(b - a)).real, p.imag], 3))
                   for k in range(count)]
        relative = rng.random() < 0.5
        numbers = [p - a * relative for p in (*control, b)]
        text.append((kind.lower() if relative else kind) + " ".join(f"{p.real:.9g} {p.imag:.9g}" for p in numbers))
        points += [a, *([bezier([a, *control, b])] if control else [])]
    return " ".join([*text, "z" if rng.random() < 0.5 else ""]), np.array([[p.real, p.imag] for p in points])


def bezier(points: list[complex]) -> complex:
    """Its middle."""
    while len(points) > 1:
        points = [(p + q) / 2 for p, q in zip(points, points[1:])]
    return points[0]


def drawing(rng: np.random.Generator) -> tuple[str, dict[str, np.ndarray]]:
    """(text, points of each panel in metres, y up, round any origin)."""
    body, expected = "<defs><path id='mark' d='M0 0 h10'/></defs><circle display='none' r='30' id='hole'/>", {}
    unit, metres = [("mm", 1e-3), ("cm", 1e-2), ("in", 0.0254), ("pt", 0.0254 / 72)][int(rng.integers(4))]
    for k in range(int(rng.integers(1, 4))):
        d, points = panel(rng)
        a = rng.uniform(-1, 1, (2, 2)) + 2 * np.eye(2)
        matrix = ",".join(f"{v:.9g}" for v in (*a.T.ravel(), *rng.uniform(-99, 99, 2)))
        turn = rng.uniform(0, 360)
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        body += f'<g transform="rotate({turn:.9g} 7 9)"><path id="p{k}" transform="matrix({matrix})" d="{d}"/></g>'
        expected[f"p{k}"] = points @ a.T @ np.array([[c, -s], [s, c]]).T
        if rng.random() < 0.3:
            body += f'<use id="u{k}" x="3" href="#p{k}" transform="scale(-2 1)"/>'
            expected[f"u{k}"] = points @ a.T * [-2, 1]
    body += '<use href="#mark"/><path d="M0,0 L5,5" style="visibility:hidden"/>'
    scale = 0.5 / max(np.ptp(p) for p in expected.values())  # the largest is half a metre wide
    size = 1000 * scale / metres
    text = f'<svg xmlns="http://www.w3.org/2000/svg" width="{size:.12g}{unit}" viewBox="0 0 1000 1000">{body}</svg>'
    return text, {name: p * [scale, -scale] for name, p in expected.items()}


def spoilt(text: str, rng: np.random.Generator) -> tuple[bytes, str]:
    """The bytes of a drawing that is damaged, and how."""
    if rng.random() < 0.5:
        return damage(text.encode(), rng)
    at, word = int(rng.integers(len(text))), str(rng.choice(WORDS))
    gone = int(rng.integers(4))
    return (text[:at] + word + text[at + gone:]).encode(), f"{gone} characters at {at} are now {word[:20]!r}"


def trial(seed: int, precision: str) -> Outcome:
    """One drawing, read as a pattern; `precision` makes no difference."""
    rng = np.random.default_rng([seed, 78])
    text, expected = drawing(rng)
    whole, packed = rng.random() < 0.3, rng.random() < 0.1
    data, way = (text.encode(), "whole") if whole else spoilt(text, rng)
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        path = pathlib.Path(folder) / ("panels.svgz" if packed else "panels.svg")
        path.write_bytes(gzip.compress(data) if packed else data)
        case = f"seed {seed}: {way}"
        try:
            with Limits():
                pattern = tc.load_pattern(path)
        except ClothError as error:
            if whole or str(path) not in str(error) or len(str(error)) > 600:
                return Outcome(FAILED, f"{case}: refused: {str(error)[:600]}")
            return Outcome(OK)
        except Exception as error:
            return Outcome(FAILED, f"{case}: {type(error).__name__}: {error}")
    if not all(np.isfinite(p.outline()[0]).all() for p in pattern.panels):
        return Outcome(FAILED, f"{case}: corners that are not finite")
    if whole and not same(pattern, expected):
        return Outcome(FAILED, f"{case}: other panels came back")
    return Outcome(OK)


def same(pattern: tc.Pattern, expected: dict[str, np.ndarray]) -> bool:
    """Whether panels are those, with their corners and the middles of their curves."""
    if sorted(p.name for p in pattern.panels) != sorted(expected):
        return False
    for p in pattern.panels:
        got = [edge.points(p.corners, np.array([0.0] if edge.kind == "line" else [0.0, 0.5])) for edge in p.edges]
        got, want = np.concatenate(got), expected[p.name]
        if got.shape != want.shape or np.abs((got - got[0]) - (want - want[0])).max() > EXACT * np.ptp(want):
            return False
    return True
