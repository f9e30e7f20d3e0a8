"""Meshes made from numbers: grid, strip, equilateral strip, disk, cylinder. All lengths in metres.

Flat shapes lie with u along x; `plane="xz"` (horizontal, normal up) maps v to -z, `plane="xy"` maps v to y.
"""

import math

import numpy as np

from .. import checks
from ..errors import MeshError, shown
from .mesh import TriMesh

MOST_TRIANGLES = 20_000_000  # of a shape: more would not fit a simulation into memory


def grid(size, cells, diagonals: str = "alternating", plane: str = "xz", centred: bool = False) -> TriMesh:
    """A rectangle of cells, each cut into triangles.

    Args:
        size: (width, height) or one number for a square [m].
        cells: (along u, along v) or one number.
        diagonals: "alternating" (union jack), "uniform" (one direction) or "cross" (four triangles a cell).
        plane: "xz" or "xy".
        centred: whether its middle is at the origin, where else its lower left corner is; the pattern stays as it is.

    Vertex i + j (cells_u + 1) lies at column i, row j. Groups: `left`, `right` (u), `bottom`, `top` (v),
    `border`, and the corners `bottom_left`, `bottom_right`, `top_left`, `top_right`, `corners`.
    """
    width, height = _lengths("size", size)
    checks.choice("diagonals", diagonals, ("alternating", "uniform", "cross"))
    nu, nv = _counts("cells", cells, 4 if diagonals == "cross" else 2)
    i, j = np.meshgrid(np.arange(nu + 1), np.arange(nv + 1))
    uv = np.stack([i.ravel() * width / nu, j.ravel() * height / nv], axis=1)
    ci, cj = (a.ravel() for a in np.meshgrid(np.arange(nu), np.arange(nv)))
    a = ci + cj * (nu + 1)
    b, c, d = a + 1, a + nu + 2, a + nu + 1
    if diagonals == "cross":
        e = len(uv) + np.arange(nu * nv)
        uv = np.concatenate([uv, np.stack([(ci + 0.5) * width / nu, (cj + 0.5) * height / nv], axis=1)])
        faces = np.stack([a, b, e, b, c, e, c, d, e, d, a, e], axis=1).reshape(-1, 3)
    else:
        rising = np.stack([a, b, c, a, c, d], axis=1)
        falling = np.stack([a, b, d, b, c, d], axis=1)
        turn = (ci + cj) % 2 == 1 if diagonals == "alternating" else np.zeros(len(a), dtype=bool)
        faces = np.where(turn[:, None], falling, rising).reshape(-1, 3)
    middle = np.array([width, height]) / 2 if checks.flag("centred", centred, MeshError) else np.zeros(2)
    return TriMesh(_place(uv - middle, plane), faces, uv, _grid_groups(nu, nv))


def strip(length: float, width: float, cells, diagonals: str = "alternating", plane: str = "xz",
          centred: bool = False) -> TriMesh:
    """A strip along u: `grid` by another name; `cells` = (along, across) or the number along, cells kept square."""
    length, width = _length("length", length), _length("width", width)
    if checks.is_sequence(cells):
        return grid((length, width), cells, diagonals, plane, centred)
    along = _count("cells", cells)
    return grid((length, width), (along, max(1, round(along * width / length))), diagonals, plane, centred)


def equilateral_strip(length: float, rows_across: int, cells_along: int, plane: str = "xz") -> TriMesh:
    """A strip along u of equilateral triangles with half triangles at its two ends.

    Its width follows: rows_across sqrt(3)/2 length/cells_along. Groups: `left`, `right`, `border`.
    """
    n, rows = _count("cells_along", cells_along), _count("rows_across", rows_across)
    _check_size("cells_along", n, (2 * n + 1) * rows)
    length = _length("length", length)
    a = length / n
    uv, row_start, rows_u = [], [0], []
    for r in range(rows + 1):
        u = np.arange(n + 1) * a if r % 2 == 0 else np.concatenate([[0], (np.arange(n) + 0.5) * a, [length]])
        rows_u.append(u)
        uv.append(np.stack([u, np.full(len(u), r * a * math.sqrt(3) / 2)], axis=1))
        row_start.append(row_start[-1] + len(u))
    faces: list[tuple[int, int, int]] = []
    for r in range(rows):
        faces += _zip_rows(rows_u[r], rows_u[r + 1], row_start[r], row_start[r + 1])
    points = np.concatenate(uv)
    groups = {"left": np.flatnonzero(points[:, 0] < 1e-9 * length),
              "right": np.flatnonzero(points[:, 0] > length * (1 - 1e-9))}
    groups["border"] = np.unique(np.concatenate([*groups.values(), np.arange(row_start[1]),
                                                 np.arange(row_start[-2], row_start[-1])]))
    return TriMesh(_place(points, plane), faces, points, groups)


def disk(radius: float, rings: int, plane: str = "xz") -> TriMesh:
    """A disk of concentric rings with 6 k vertices on ring k. Groups: `centre`, `rim`."""
    rings, radius = _count("rings", rings), _length("radius", radius)
    _check_size("rings", rings, 6 * rings**2)
    uv = [np.zeros((1, 2))]
    faces: list[tuple[int, int, int]] = []
    start = [0, 1]
    for k in range(1, rings + 1):
        angle = 2 * math.pi * np.arange(6 * k) / (6 * k)
        uv.append(radius * k / rings * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        start.append(start[-1] + 6 * k)
        inner, outer = max(1, 6 * (k - 1)), 6 * k
        i = o = 0
        while i < inner * (k > 1) or o < outer:  # zip the two rings by angle
            here_o, here_i = start[k] + o % outer, start[k - 1] + i % inner
            if k > 1 and i < inner and (i + 1) / inner <= (o + 1) / outer - 1e-12:
                faces.append((here_i, here_o, start[k - 1] + (i + 1) % inner))
                i += 1
            else:
                faces.append((here_i, here_o, start[k] + (o + 1) % outer))
                o += 1
    points = np.concatenate(uv)
    groups = {"centre": np.array([0]), "rim": np.arange(start[-2], start[-1])}
    return TriMesh(_place(points, plane), faces, points, groups)


def cylinder(radius: float, height: float, cells) -> TriMesh:
    """An open tube about the y axis, sewn from a flat panel: uv per corner, the seam at angle 0.

    Args:
        cells: (around, along). Groups: `bottom`, `top`, `border`.
    """
    around, along = _counts("cells", cells, 2)
    radius, height = _length("radius", radius), _length("height", height)
    if around < 3:
        raise MeshError(f"a cylinder needs at least 3 cells around, not {around}")
    flat = grid((2 * math.pi * radius, height), (around, along))
    column, row = np.arange(flat.vertex_count) % (around + 1), np.arange(flat.vertex_count) // (around + 1)
    welded = column % around + row * around
    angle = 2 * math.pi * np.arange(around) / around
    x = np.stack([np.tile(radius * np.cos(angle), along + 1), np.repeat(np.arange(along + 1) * height / along, around),
                  np.tile(-radius * np.sin(angle), along + 1)], axis=1)
    bottom, top = np.arange(around), np.arange(around) + along * around
    groups = {"bottom": bottom, "top": top, "border": np.concatenate([bottom, top])}
    return TriMesh(x, welded[flat.faces], flat.corner_uv, groups)


def _zip_rows(lower: np.ndarray, upper: np.ndarray, lower_start: int, upper_start: int) -> list[tuple[int, int, int]]:
    """Triangles between two rows of points with rising u: each advance takes the edge whose middle is nearer."""
    faces, i, j = [], 0, 0
    while i < len(lower) - 1 or j < len(upper) - 1:
        step_lower = j == len(upper) - 1 or (i < len(lower) - 1 and lower[i] + lower[i + 1] <= upper[j] + upper[j + 1])
        if step_lower:
            faces.append((lower_start + i, lower_start + i + 1, upper_start + j))
            i += 1
        else:
            faces.append((lower_start + i, upper_start + j + 1, upper_start + j))
            j += 1
    return faces


def _grid_groups(nu: int, nv: int) -> dict[str, np.ndarray]:
    bottom, left = np.arange(nu + 1), np.arange(nv + 1) * (nu + 1)
    top, right = bottom + nv * (nu + 1), left + nu
    corners = {"bottom_left": bottom[:1], "bottom_right": bottom[-1:], "top_left": top[:1], "top_right": top[-1:]}
    return {"bottom": bottom, "top": top, "left": left, "right": right, **corners,
            "corners": np.concatenate(list(corners.values())),
            "border": np.unique(np.concatenate([bottom, top, left, right]))}


def _place(uv: np.ndarray, plane: str) -> np.ndarray:
    checks.choice("plane", plane, ("xz", "xy"))
    zero = np.zeros(len(uv))
    return np.stack([uv[:, 0], zero, -uv[:, 1]] if plane == "xz" else [uv[:, 0], uv[:, 1], zero], axis=1)


def _lengths(what: str, value: object) -> tuple[float, float]:
    """Two positive numbers [m] from a number or a pair."""
    pair = checks.number_or_pair(what, value, "m", positive=True, error=MeshError)
    return pair if isinstance(pair, tuple) else (pair, pair)


def _length(what: str, value: object) -> float:
    return checks.number(what, value, "m", positive=True, error=MeshError)


def _counts(what: str, value: object, each: int) -> tuple[int, int]:
    """Two numbers of cells from a number or a pair, of `each` triangles."""
    pair = checks.number_or_pair(what, value, error=MeshError)
    a, b = (_count(what, v) for v in (pair if isinstance(pair, tuple) else (pair, pair)))
    _check_size(what, value, each * a * b)
    return a, b


def _count(what: str, value: object) -> int:
    return checks.integer(what, value, error=MeshError)


def _check_size(what: str, value: object, triangles: int) -> None:
    if triangles > MOST_TRIANGLES:
        raise MeshError(f"{what} = {shown(value)} makes {triangles:,} triangles: at most {MOST_TRIANGLES:,}")
