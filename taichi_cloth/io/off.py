"""OFF, the Geomview object file format, text: positions and faces; colours are passed over."""

from pathlib import Path

import numpy as np

from .polygon import triangles_of
from .text import text_of


def read_off(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and triangles (m, 3).

    Raises:
        ValueError: names the fault of the file.
    """
    text = text_of(path.read_bytes())
    rows = [words for words in (line.split("#", 1)[0].split() for line in text.splitlines()) if words]
    if not rows or rows[0][0] != "OFF":
        raise ValueError("is not an OFF file: its first word is not OFF")
    rows[0] = rows[0][1:]  # the sizes may follow in the same line
    rows = rows if rows[0] else rows[1:]
    if not rows or len(rows[0]) < 2:
        raise ValueError("its header has no numbers of vertices and faces")
    n, m, rows = int(rows[0][0]), int(rows[0][1]), rows[1:]
    if n < 0 or m < 0 or n + m > len(rows):
        raise ValueError(f"its header says {n} vertices and {m} faces, and {len(rows)} lines follow it")
    if any(len(row) < 3 for row in rows[:n]):
        raise ValueError(f"vertex {next(k for k, row in enumerate(rows) if len(row) < 3)} has fewer than 3 coordinates")
    x = np.array([row[:3] for row in rows[:n]], dtype=np.float64).reshape(n, 3)
    polygons = []
    for number, row in enumerate(rows[n: n + m]):
        count = int(row[0])
        if not 0 <= count < len(row):
            raise ValueError(f"face {number} says {count} corners and has {len(row) - 1} numbers")
        polygons.append([int(word) for word in row[1: count + 1]])
    if not polygons:
        raise ValueError("the mesh has no faces")
    return x, triangles_of(x, polygons)
