"""Wavefront OBJ: positions, texture corners, groups. A vertex may carry several texture coordinates (a seam)."""

from pathlib import Path

import numpy as np

from ..errors import MeshError
from .polygon import cut

Corner = tuple[int, int | None]


def read_obj(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, dict[str, np.ndarray]]:
    """Reads v, vt, f, g and o; everything else is passed over.

    Returns:
        positions (n, 3), triangles (m, 3), texture coordinates per corner (m, 3, 2) or None where the file has
        none for some face, and vertex groups by the names of `g` and `o`.

    Raises:
        MeshError: a line that does not parse or an index out of range, with the line's number.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    v: list[tuple[float, float, float]] = []
    vt: list[tuple[float, float]] = []
    triangles: list[tuple[Corner, Corner, Corner]] = []
    members: dict[str, set[int]] = {}
    current: dict[str, list[str]] = {"g": [], "o": []}
    for number, line in _lines(text):
        key, *words = line.split()
        try:
            if key == "v":
                v.append((float(words[0]), float(words[1]), float(words[2])))
            elif key == "vt":
                vt.append((float(words[0]), float(words[1]) if len(words) > 1 else 0.0))
            elif key in current:
                current[key] = words
            elif key == "f":
                corners = [_corner(w, len(v), len(vt)) for w in words]
                places = cut(np.array([v[c[0]] for c in corners]))
                triangles += [(corners[i], corners[j], corners[k]) for i, j, k in places]
                for name in current["g"] + current["o"]:
                    members.setdefault(name, set()).update(c[0] for c in corners)
        except (ValueError, IndexError) as error:
            raise MeshError(f"{path}: line {number}: {line[:60]!r}: {error}") from None
    if not triangles:
        raise MeshError(f"{path}: the mesh has no faces")
    faces = np.array([[c[0] for c in t] for t in triangles])
    groups = {name: np.array(sorted(index)) for name, index in members.items()}
    return np.array(v), faces, _texture(triangles, vt), groups


def _lines(text: str):
    """(number, content) of the lines that say something: comments cut, continued lines joined."""
    start, held = 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        line = held + line.split("#", 1)[0].strip()
        start = start or number
        if line.endswith("\\"):
            held = line[:-1] + " "
            continue
        if line:
            yield start, line
        start, held = 0, ""


def _corner(word: str, n: int, n_texture: int) -> Corner:
    parts = word.split("/")
    texture = parts[1] if len(parts) > 1 else ""
    return _index(parts[0], n, "vertex"), _index(texture, n_texture, "texture coordinate") if texture else None


def _index(word: str, n: int, what: str) -> int:
    i = int(word)
    if i == 0 or i > n or i < -n:
        raise ValueError(f"{what} {i} is out of range: there are {n} before this line")
    return i - 1 if i > 0 else n + i


def _texture(triangles: list, vt: list) -> np.ndarray | None:
    index = np.array([[-1 if c[1] is None else c[1] for c in t] for t in triangles])
    if not vt or (index < 0).any():
        return None
    return np.array(vt)[index]
