"""VTK unstructured grids with a PVD that lists them by time: ParaView. Written by meshio."""

import pathlib
from collections.abc import Callable

import numpy as np

from ..folder import write_whole, written_aside
from .pieces import Cut, Frame, first_color, first_uv

Fields = dict[str, Callable[[Frame], np.ndarray]]


def write(pieces: Cut, folder: pathlib.Path, fields: Fields) -> list[pathlib.Path]:
    """`cloth.pvd` and `00000.vtu ...` with uv, velocity and the fields on vertices, and colours where panels have their own.

    Vertices on seams have the uv and the colour of their first corner.
    """
    import meshio

    files, entries = [], []
    for k in pieces.frames():
        frame = pieces.frame(k)
        faces = frame.geometry["faces"].astype(np.int64)
        data = {"uv": first_uv(frame), "velocity": frame["v"]}
        data |= {name: f(frame).astype(np.float32) for name, f in fields.items()}
        data |= {} if (color := first_color(frame)) is None else {"color": color}
        mesh = meshio.Mesh(frame["x"], [("triangle", faces)], point_data=data)
        files.append(folder / f"{k:05d}.vtu")
        with written_aside(files[-1]) as aside:
            meshio.write(aside, mesh, file_format="vtu")
        entries.append(f'    <DataSet timestep="{float(frame["t"]):.9g}" part="0" file="{files[-1].name}"/>')
    text = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>", *entries,
            "  </Collection>", "</VTKFile>", ""]
    files.append(folder / "cloth.pvd")
    write_whole(files[-1], "\n".join(text).encode())
    return files
