"""VTK unstructured grids with a PVD that lists them by time: ParaView. Written by meshio."""

import pathlib

import numpy as np

from ..folder import write_whole, written_aside
from ..recording import Recording
from . import Fields


def write(recording: Recording, folder: pathlib.Path, fields: Fields, format: str) -> list[pathlib.Path]:
    """`cloth.pvd` and `00000.vtu ...` with uv, velocity and the fields on vertices.

    Vertices on seams have the uv of their first corner.
    """
    import meshio

    g, files, entries = recording.geometry, [], []
    faces = g["faces"].astype(np.int64)
    uv = np.zeros((len(g["x"]), 2), dtype=np.float32)
    uv[faces[::-1].ravel()] = g["uv"][::-1].reshape(-1, 2)
    for k in recording.frames():
        frame = recording.frame(k)
        data = {"uv": uv, "velocity": frame["v"], **{name: f(frame).astype(np.float32) for name, f in fields.items()}}
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
