"""STL, text or binary: triangles with three vertices of their own, of which equal ones become one."""

import struct
from pathlib import Path

import numpy as np

from .text import unmarked

HEADER, TRIANGLE = 84, 50  # bytes


def read_stl(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and triangles (m, 3).

    Raises:
        ValueError: names the fault of the file.
    """
    data = unmarked(path)
    count = struct.unpack("<I", data[80:84])[0] if len(data) >= HEADER else 0
    if data.lstrip()[:5] == b"solid" and len(data) != HEADER + TRIANGLE * count:
        corners = _text(data)
    elif len(data) < HEADER:
        raise ValueError(f"is {len(data)} bytes long: too short for an STL file")
    elif len(data) != HEADER + TRIANGLE * count:
        raise ValueError(f"is {len(data)} bytes long, its header of {count} triangles says {HEADER + TRIANGLE * count}")
    else:
        row = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("color", "<u2")])
        rows = np.frombuffer(data, row, count, HEADER)
        corners = rows["corners"].astype(np.float64)
    if not len(corners):
        raise ValueError("the mesh has no faces")
    unique, inverse = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return unique, inverse.reshape(-1, 3)


def _text(data: bytes) -> np.ndarray:
    """(m, 3, 3) corners of a text file."""
    if b"endsolid" not in data[-200:]:
        raise ValueError("is cut off: it does not end with endsolid")
    words = data.split()
    places = [k for k, word in enumerate(words) if word == b"vertex"]
    if len(places) % 3 or len(places) != 3 * words.count(b"facet"):
        raise ValueError(f"has {len(places)} vertices for {words.count(b'facet')} triangles")
    return np.array([words[k + 1: k + 4] for k in places], dtype=np.float64).reshape(-1, 3, 3)
