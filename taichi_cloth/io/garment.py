"""Garments from files that `Garment.save` wrote. numpy only."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .. import checks
from ..errors import SceneError, near
from ..scene.garment import Garment, SewnRows
from ..scene.mesh import TriMesh
from . import npz


def load_garment(path: str | Path) -> Garment:
    """A garment that `Garment.save` wrote: the same mesh, groups, notes, seams and positions.

    Raises:
        SceneError: a file that is missing, damaged or no garment.
    """
    path = checks.path("path", path, SceneError)
    try:
        data = npz.read(path, _fits)
        return Garment(_mesh(data), _seams(data), data["positions"])
    except FileNotFoundError as error:
        raise SceneError(f"{path}: cannot be read: {error.strerror or error}{near(path)}") from None
    except (KeyError, ValueError, TypeError) as error:
        what = f"{type(error).__name__}: " if isinstance(error, KeyError) else ""
        raise SceneError(f"{path}: is not a garment: {what}{error}") from None


def _fits(shapes: npz.Shapes) -> None:
    """Refuses arrays that do not go together, before they are read."""
    n = shapes.get("x", (0,))[:1]
    wanted = {"x": (*n, 3), "positions": (*n, 3), "faces": (*shapes.get("faces", (0,))[:1], 3)}
    for name, shape in wanted.items():
        if name in shapes and shapes[name] != shape:
            raise npz.DamagedError(f"{name} needs shape {shape}, not {shapes[name]}")


def _mesh(data: dict[str, np.ndarray]) -> TriMesh:
    groups = {name[6:]: index for name, index in data.items() if name.startswith("group_")}
    flattened = bool(data.get("flattened", False))
    uv = None if flattened else data["uv" if "uv" in data else "corner_uv"]  # older files have these alone
    weights = {name[7:]: values for name, values in data.items() if name.startswith("weight_")}
    mesh = TriMesh(data["x"], data["faces"], uv, groups, (), data.get("texture"), data.get("polygon"), weights)
    if "notes" in data:
        object.__setattr__(mesh, "notes", tuple(data["notes"].tolist()))
    return mesh


def _seams(data: dict[str, np.ndarray]) -> tuple[SewnRows, ...]:
    rests = [rest if rest == "given" else float(rest) for rest in data["rest"].tolist()]
    stiffness, strength = (np.broadcast_to(data.get(name, usual), len(rests)).tolist()  # older files have none
                           for name, usual in (("stiffness", 1.0), ("strength", np.inf)))
    rows = [data[f"seam_{k}"] for k in range(len(rests))]
    return tuple(SewnRows(a, b, rest, k, bears if np.isfinite(bears) else None)
                 for (a, b), rest, k, bears in zip(rows, rests, stiffness, strength))
