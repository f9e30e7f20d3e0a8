"""Blender's own files: objects with their polygons, groups and weights, as the file has them. Blender reads it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import MeshError, did_you_mean, near, shown
from . import blender
from .polygon import cut

SCRIPT = Path(__file__).with_name("blendfile_script.py")


class Item(NamedTuple):
    """A mesh object.

    Attributes:
        x: (n, 3) its own positions at the scene's first frame, by its shape keys and the modifiers up to `before`.
        corners: vertices of all polygons, one after the other; counts: corners of each.
        uv: (k, 2) texture coordinates of the corners, or None.
        material: (f,) number among `materials` of each polygon's.
        groups: (vertices, weights above 0) by the names of vertex groups.
        world: (t, 4, 4) transforms to the world, at the times asked for.
        before: the modifier after which its cloth comes, "" if that comes first.
        late: modifiers that lead vertices and come later.
        linked: whether it is another file's.
    """

    x: np.ndarray
    corners: np.ndarray
    counts: np.ndarray
    uv: np.ndarray | None
    material: np.ndarray
    materials: list[str]
    groups: dict[str, tuple[np.ndarray, np.ndarray]]
    world: np.ndarray
    before: str
    late: list[str]
    linked: bool


class Blend(NamedTuple):
    """The content of a .blend.

    Attributes:
        names: of all its mesh objects.
        fps: frames a second; frames: the scene's first and last.
        unit: metres of its unit.
        items: those that were asked for, by name.
    """

    names: list[str]
    fps: float
    frames: tuple[int, int]
    unit: float
    items: dict[str, Item]


def read(path: Path, only: Sequence[str] | None, times: Sequence[float] = (0.0,)) -> Blend:
    """Objects of a .blend by name, all if None.

    Args:
        times: [s] after the scene's first frame, for `Item.world`.

    Raises:
        MeshError: no such file or object, Blender is not here, or it cannot read the file.
    """
    if not path.is_file():
        raise MeshError(f"no such file: {path}{near(path)}")
    got = _arrays(path, json.dumps({"only": only, "times": list(times)}))
    names = got["names"].tolist()
    if not names:
        raise MeshError(f"{path}: has no mesh")
    for name in only or ():
        if name not in names:
            raise MeshError(f"{path}: has no mesh object {shown(name)}; {did_you_mean(name, names)}")
    first, last = got["frames"].tolist()
    return Blend(names, float(got["fps"]), (first, last), float(got["unit"]),
                 {name: _item(name, got) for name in only or names})


def whole(path: Path, only: Sequence[str] | None) -> tuple[Item, float]:
    """The object that cloth is made of, and metres of the file's unit.

    Raises:
        MeshError: as `read`; several objects, or none that is named of several.
    """
    found = read(path, only)
    if len(found.items) > 1:
        raise MeshError(f"{path}: cloth is one object of a .blend: name one of them (only=): {', '.join(sorted(found.items))}")
    return next(iter(found.items.values())), found.unit


def triangles(item: Item) -> tuple[np.ndarray, np.ndarray]:
    """(m, 3) places in `corners` of triangles that an object's polygons are cut into, and (m,) the polygon of each.

    Raises:
        MeshError: no polygon.
    """
    if not len(item.counts):
        raise MeshError("has no faces")
    places, polygon = cut(item.x, item.corners, item.counts)
    return (places[:, [0, 2, 1]] if np.linalg.det(item.world[0, :3, :3]) < 0 else places), polygon


def placed(item: Item, k: int = 0) -> np.ndarray:
    """(n, 3) positions in the world, in the file's unit, z up, by the k-th transform."""
    return item.x @ item.world[k, :3, :3].T + item.world[k, :3, 3]


def _arrays(path: Path, choices: str) -> dict[str, np.ndarray]:
    try:
        got = blender.arrays(SCRIPT, path, choices, "a .blend")
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    if "refused" in got:
        raise MeshError(f"{path}: {got['refused']}")
    return got


def _item(name: str, got: dict[str, np.ndarray]) -> Item:
    groups = {said: (got[f"group {k} {name}"].astype(np.int64), got[f"weight {k} {name}"])
              for k, said in enumerate(got[f"groups {name}"].tolist())}
    return Item(got[f"x {name}"].astype(np.float64), got[f"corners {name}"].astype(np.int64),
                got[f"counts {name}"].astype(np.int64), got.get(f"uv {name}"), got[f"material {name}"],
                got[f"materials {name}"].tolist(), groups, got[f"world {name}"], str(got[f"before {name}"]),
                got[f"leads after {name}"].tolist(), bool(got[f"linked {name}"]))
