"""Point cache 2: an OBJ with the topology and uv, and a .pc2 with every frame's positions. Blender, Houdini, Maya."""

import pathlib
import re
import struct

import numpy as np

from ..folder import write_whole
from ..recording import Recording
from . import Fields, uv_vertices


def write(recording: Recording, folder: pathlib.Path, fields: Fields, format: str) -> list[pathlib.Path]:
    """`cloth.obj` (groups are the pieces) and `cloth.pc2`."""
    numbers, g = recording.frames(), recording.geometry
    n = len(g["x"])
    header = b"POINTCACHE2\0" + struct.pack("<iiffi", 1, n, float(numbers[0]), 1.0, len(numbers))
    frames = [recording.frame(k)["x"].astype("<f4") for k in numbers]
    files = [folder / "cloth.obj", folder / "cloth.pc2"]
    write_whole(files[0], obj(frames[0], g).encode())
    write_whole(files[1], header + np.stack(frames).tobytes())
    return files


def obj(x: np.ndarray, geometry: dict[str, np.ndarray]) -> str:
    """An OBJ of positions (n, 3) [m] with uv that keep their seams."""
    faces, pieces = geometry["faces"] + 1, geometry["cloth_faces"]
    table, index = uv_vertices(faces, geometry["uv"])
    lines = [f"v {a:.9g} {b:.9g} {c:.9g}" for a, b, c in x.tolist()] + [f"vt {u:.9g} {v:.9g}" for u, v in table.tolist()]
    for name, first, last in zip(geometry["cloth_names"], pieces[:-1], pieces[1:]):
        lines.append("g " + (re.sub(r"[^\w.+-]", "_", str(name)) or "piece"))  # one word: what follows is another group
        for corners, uvs in zip(faces[first:last].tolist(), (index[first:last] + 1).tolist()):
            lines.append("f " + " ".join(f"{i}/{j}" for i, j in zip(corners, uvs)))
    return "\n".join(lines) + "\n"


def read_pc2(path: pathlib.Path) -> np.ndarray:
    """(frames, n, 3) positions of a .pc2 file."""
    data = path.read_bytes()
    _, n, _, _, count = struct.unpack("<iiffi", data[12:32])
    return np.frombuffer(data, "<f4", offset=32).reshape(count, n, 3)
