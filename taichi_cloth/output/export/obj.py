"""A sequence of OBJ files, an object a mesh, with its groups of faces, and the colours in an MTL beside them."""

import pathlib
import re

import numpy as np

from ..folder import write_whole
from ..png import encode_png
from .shot import Mesh, Shot, unique

Bases = tuple[int, ...]  # of vertices, uv and normals


def write(shot: Shot, folder: pathlib.Path) -> list[pathlib.Path]:
    """`00000.obj ...`, `cloth.mtl` and the images of prints."""
    words = unique(word(mesh.name) for mesh in shot.meshes)
    files = colors(words, shot.meshes, folder)
    grouped = any(mesh.groups is not None for mesh in shot.meshes)
    for k, number in enumerate(shot.numbers):
        lines = ["mtllib cloth.mtl"]
        bases: Bases = (1, 1, 1)
        for name, mesh in zip(words, shot.meshes):
            more, bases = object_lines(name, mesh, k, bases, True, grouped)
            lines += more
        files.append(folder / f"{number:05d}.obj")
        write_whole(files[-1], ("\n".join(lines) + "\n").encode())
    return files


def object_lines(name: str, mesh: Mesh, k: int, bases: Bases, normals: bool, grouped: bool = False) -> tuple[list[str], Bases]:
    """The lines of an object at the k-th frame, and the numbers that the next vertex, uv and normal will have.

    Args:
        bases: the numbers that its own first ones have.
        grouped: whether other objects have groups, which would hold for this one too.
    """
    x, surface = mesh.position(k), mesh.surface(k)
    lines = [f"o {name}", *(f"v {a:.9g} {b:.9g} {c:.9g}" for a, b, c in x.tolist())]
    index, counts = [surface.faces + bases[0]], [len(x), 0, 0]
    if surface.uv is not None:
        table, of_corner = uv_vertices(surface.uv)
        lines += [f"vt {u:.9g} {v:.9g}" for u, v in table.tolist()]
        index.append(of_corner + bases[1])
        counts[1] = len(table)
    if normals:
        table = mesh.normals(k)
        lines += [f"vn {a:.6g} {b:.6g} {c:.6g}" for a, b, c in table.tolist()]
        index.append(surface.normal_of + bases[2])
        counts[2] = len(table)
    lines.append(f"usemtl {name}")
    corner = {(True, True): "{}/{}/{}", (True, False): "{}/{}", (False, True): "{}//{}", (False, False): "{}"}[
        surface.uv is not None, normals]
    row = "f " + " ".join([corner] * 3)
    faces = [row.format(*numbers) for numbers in np.stack(index, axis=2).reshape(len(surface.faces), -1).tolist()]
    return lines + _grouped(name, faces, mesh.groups, grouped), tuple(b + c for b, c in zip(bases, counts))


def _grouped(name: str, faces: list[str], groups: np.ndarray | None, own: bool) -> list[str]:
    """Lines of faces, with one of their groups wherever that changes; faces of no group are in the object's own."""
    if groups is None or not groups.any():
        return [f"g {name}", *faces] if own else faces
    out: list[str] = []
    last = None
    for line, group in zip(faces, groups.tolist()):
        if group != last:
            out.append(f"g {' '.join(map(word, group.split())) or name}")
        out.append(line)
        last = group
    return out


def colors(words: list[str], meshes: list[Mesh], folder: pathlib.Path) -> list[pathlib.Path]:
    """An MTL of the meshes' colours, and a PNG for each that something is printed on."""
    files, lines = [folder / "cloth.mtl"], []
    for name, mesh in zip(words, meshes):
        on = mesh.printed
        lines += [f"newmtl {name}", "Kd {:.6g} {:.6g} {:.6g}".format(*(mesh.color if on is None else (1, 1, 1))), "Ks 0 0 0",
                  "illum 1"]
        if on is not None:
            files.append(folder / f"{name}.png")
            write_whole(files[-1], encode_png(on.image))
            lines.append(f"map_Kd {'' if on.repeats else '-clamp on '}{name}.png")
        lines.append("")
    write_whole(files[0], "\n".join(lines).encode())
    return files


def uv_vertices(uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(different uv (k, 2), index of each corner (m, 3)) of corner coordinates (m, 3, 2): seams keep their two sides."""
    table, index = np.unique(uv.reshape(-1, 2), axis=0, return_inverse=True)
    return table, index.reshape(-1, 3)


def word(name: str) -> str:
    """A name without blanks or signs that mean something, for OBJ and for files."""
    return re.sub(r"[^\w.+-]", "_", name)[:100].lstrip(".") or "piece"
