"""A solid in one picture: a few moments of its motion, side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..backend import runtime
from ..output.folder import write_whole
from ..output.look import Look
from ..output.picture import Artist, contact_sheet
from ..output.png import encode_png
from ..scene.scene import Scene
from ..scene.solids import SolidMesh
from . import record

MOMENTS = 4  # of a motion


def draw(shape: SolidMesh, path: Path, size: tuple[int, int]) -> None:
    """Writes a PNG.

    Args:
        size: (width, height) of each moment's picture [pixels].
    """
    scene = Scene()
    scene.add_prop(shape, name="solid")
    last = shape.start + (len(shape.x) - 1) / (shape.fps or 1.0)
    times = np.linspace(shape.start, last, MOMENTS if len(shape.x) > 1 else 1)
    frames = [{"t": np.array(t), "x": np.zeros((0, 3)), "solid_x": shape.shape_at(t)} for t in times.tolist()]
    runtime.go_on()
    artist = Artist(record.as_built(scene), size, Look(quality="standard", caption="{t} s" if len(frames) > 1 else ""),
                    lambda: frames)
    write_whole(path, encode_png(contact_sheet([artist.draw(frame, k) for k, frame in enumerate(frames)], len(frames))))
