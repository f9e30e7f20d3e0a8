"""A sequence of binary PLY files."""

import pathlib

import numpy as np

from ..folder import write_whole
from ..recording import Recording
from . import Fields


def write(recording: Recording, folder: pathlib.Path, fields: Fields, format: str) -> list[pathlib.Path]:
    """`00000.ply ...` with positions, one uv a vertex (the first corner's), and scalar fields."""
    g, files = recording.geometry, []
    faces = g["faces"].astype("<i4")
    n, m = len(g["x"]), len(faces)
    uv = np.zeros((n, 2), dtype="<f4")
    uv[faces[::-1].ravel()] = g["uv"][::-1].reshape(-1, 2)
    rows = np.zeros(m, dtype=[("count", "u1"), ("index", "<i4", 3)])
    rows["count"], rows["index"] = 3, faces
    for k in recording.frames():
        frame = recording.frame(k)
        values = {name: f(frame) for name, f in fields.items()}
        names = ["x", "y", "z", "s", "t", *(name for name, v in values.items() if v.ndim == 1)]
        table = np.column_stack([frame["x"], uv, *(v for v in values.values() if v.ndim == 1)]).astype("<f4")
        header = "\n".join(["ply", "format binary_little_endian 1.0",
                            f"comment t {float(frame['t']):.9g} s", f"element vertex {n}",
                            *(f"property float {name}" for name in names), f"element face {m}",
                            "property list uchar int vertex_indices", "end_header"]) + "\n"
        files.append(folder / f"{k:05d}.ply")
        write_whole(files[-1], header.encode() + table.tobytes() + rows.tobytes())
    return files
