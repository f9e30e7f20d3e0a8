"""A sequence of binary PLY files."""

import pathlib
from collections.abc import Callable

import numpy as np

from ..folder import write_whole
from .pieces import Cut, Frame, first_color, first_uv

Fields = dict[str, Callable[[Frame], np.ndarray]]


def write(pieces: Cut, folder: pathlib.Path, fields: Fields) -> list[pathlib.Path]:
    """`00000.ply ...` with positions, one uv a vertex (the first corner's), scalar fields, and colours of panels."""
    files = []
    for k in pieces.frames():
        frame = pieces.frame(k)
        faces, uv = frame.geometry["faces"].astype("<i4"), first_uv(frame)
        rows = np.zeros(len(faces), dtype=[("count", "u1"), ("index", "<i4", 3)])
        rows["count"], rows["index"] = 3, faces
        values = {name: v for name, f in fields.items() if (v := f(frame)).ndim == 1}
        table = np.ascontiguousarray(np.column_stack([frame["x"], uv, *values.values()]), dtype="<f4")
        color = first_color(frame)
        body = table.view(np.uint8) if color is None else np.hstack([table.view(np.uint8), color])
        header = "\n".join(["ply", "format binary_little_endian 1.0",
                            f"comment t {float(frame['t']):.9g} s", f"element vertex {len(table)}",
                            *(f"property float {name}" for name in ["x", "y", "z", "s", "t", *values]),
                            *(f"property uchar {name}" for name in ([] if color is None else ["red", "green", "blue"])),
                            f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]) + "\n"
        files.append(folder / f"{k:05d}.ply")
        write_whole(files[-1], header.encode() + body.tobytes() + rows.tobytes())
    return files
