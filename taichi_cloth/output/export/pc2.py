"""Point cache 2: for each mesh an OBJ with its faces and uv, and for each that moves a .pc2 with its positions at every frame.

Blender (modifier Mesh Cache), Houdini, Maya.
"""

import pathlib
import struct

import numpy as np

from ..folder import write_whole
from .obj import colors, object_lines, word
from .shot import Shot, unique


def write(shot: Shot, folder: pathlib.Path) -> list[pathlib.Path]:
    """`NAME.obj` and `NAME.pc2` by the meshes' names, `cloth.mtl` and the images of prints; cloths first."""
    words = unique(word(mesh.name) for mesh in shot.meshes)
    files = []
    for name, mesh in zip(words, shot.meshes):
        lines, _ = object_lines(name, mesh, 0, (1, 1, 1), normals=False)
        files.append(folder / f"{name}.obj")
        write_whole(files[-1], "\n".join(["mtllib cloth.mtl", *lines, ""]).encode())
        if mesh.moves:
            files.append(folder / f"{name}.pc2")
            write_whole(files[-1], pc2(mesh.x, shot.numbers[0]))
    return files + colors(words, shot.meshes, folder)


def pc2(x: list[np.ndarray], start: int) -> bytes:
    """A cache of positions (n, 3) by frame, the first of which has the number `start`."""
    header = b"POINTCACHE2\0" + struct.pack("<iiffi", 1, len(x[0]), float(start), 1.0, len(x))
    return header + np.stack(x).astype("<f4").tobytes()


def read_pc2(path: pathlib.Path) -> np.ndarray:
    """(frames, n, 3) positions of a .pc2 file."""
    data = path.read_bytes()
    _, n, _, _, count = struct.unpack("<iiffi", data[12:32])
    return np.frombuffer(data, "<f4", offset=32).reshape(count, n, 3)
