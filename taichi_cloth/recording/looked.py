"""A solid in one picture: a few moments of its motion, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..backend import runtime
from ..output.colors import PALETTE
from ..output.folder import write_whole
from ..output.look import Look
from ..output.picture import Artist, contact_sheet
from ..output.png import encode_png
from ..scene.scene import Scene
from ..scene.solids import SolidMesh
from ..scene.view import View
from . import record

MOMENTS = 4  # of a motion


def draw(shape: SolidMesh, path: Path, size: tuple[int, int], parts: Sequence[str] = (), ground: float | None = None) -> None:
    """Writes a PNG.

    Args:
        size: (width, height) of each moment's picture [pixels].
        parts: names of the shape's groups that are drawn in colours of their own, where there are several.
        ground: its height [m]; below all if None.
    """
    scene = Scene(view=View(ground=ground))
    pieces = [shape] if len(parts) < 2 else _apart(shape, parts)
    for k, piece in enumerate(pieces):
        scene.add_prop(piece, name=f"part {k}", color=PALETTE[k % len(PALETTE)] if len(pieces) > 1 else None)
    last = shape.start + (len(shape.x) - 1) / (shape.fps or 1.0)
    times = np.linspace(shape.start, last, MOMENTS if len(shape.x) > 1 else 1)
    frames = [{"t": np.array(t), "x": np.zeros((0, 3)), "solid_x": np.concatenate([p.shape_at(t) for p in pieces])}
              for t in times.tolist()]
    runtime.go_on()
    artist = Artist(record.as_built(scene), size, Look(quality="standard", caption="{t} s" if len(frames) > 1 else ""),
                    lambda: frames)
    write_whole(path, encode_png(contact_sheet([artist.draw(frame, k) for k, frame in enumerate(frames)], len(frames))))


def _apart(shape: SolidMesh, parts: Sequence[str]) -> list[SolidMesh]:
    """A mesh for each part that has a face, and one for the faces of no part."""
    inside = [np.isin(shape.faces, shape.groups[name]).all(axis=1) for name in parts if name in shape.groups]
    first = np.argmax([*inside, np.ones(len(shape.faces), dtype=bool)], axis=0)  # a face of two parts is the first one's
    out = []
    for k in np.unique(first):
        used, faces = np.unique(shape.faces[first == k], return_inverse=True)
        out.append(SolidMesh(shape.x[:, used], faces.reshape(-1, 3), shape.fps, start=shape.start))
    return out
