"""Recorded runs as files that other tools read: one format a module.

All but Blender's own are in metres with y up; positions are the recorded float32. Data that a format cannot hold, a frame that
is damaged and a package that is not there are said before a file is written; each file is written aside and renamed.
"""

import importlib
import os
import pathlib
from collections.abc import Callable

import numpy as np

from ... import checks
from ...errors import OutputError
from ...system.quantities import evaluate, in_one
from ..recording import Recording
from .pieces import PARTS, Cut, at
from .shot import shot

SCENES = {"usda": "usd", "usdc": "usd", "glb": "gltf", "gltf": "gltf", "abc": "blend", "blend": "blend"}  # one file each
MESHES = {"obj": "obj", "pc2": "pc2"}  # several files, also of scenes
FIELDS = {"vtu": "vtu", "ply": "ply"}  # a file a frame, cloth alone, with values on vertices
FORMATS = {**SCENES, **MESHES, **FIELDS}
CHANGING = ("usda", "usdc", "obj")  # formats whose meshes may be others at every frame
Fields = dict[str, Callable[[dict[str, np.ndarray]], np.ndarray]]


def export(recording: Recording, format: str, path: str | os.PathLike | None = None, parts: str = "cloths",
           fields: Fields | None = None) -> list[pathlib.Path]:
    """Writes a run in a format.

    Args:
        format: one of `FORMATS`.
        path: a folder; for a format of one file also that file's name; `FORMAT` in the run's folder if None.
        parts: one mesh for each of the "cloths", of the "panels" of garments, or garments "welded" over their seams.
            Welding turns triangles to one side if panels face both ways; `Recording.notes` say how many.
        fields: by name, functions of a frame that give (n,) or (n, 3) values on vertices, for vtu and ply; stretch and
            forces of contact if None.

    Returns:
        The files that it wrote.

    Raises:
        SceneError: an unknown format, or other parts.
        OutputError: no frames, a damaged one, a package that is not there, data that a format cannot hold, files that cannot
            be written.
    """
    checks.choice("format", format, FORMATS)
    pieces = Cut(recording, checks.choice("parts", parts, PARTS), format in CHANGING)
    if pieces.turned.any():
        recording.notes.append(f"{int(pieces.turned.sum()):,} of {len(pieces.turned):,} triangles go round the other way in "
                               f"{format}: welded, panels that face both ways are turned to one side")
    folder = recording.path / format if path is None else checks.path("export: path", path, OutputError)
    module = importlib.import_module(f"{__name__}.{FORMATS[format]}")
    getattr(module, "needed", lambda format: None)(format)
    named = format in SCENES and folder.suffix == f".{format}" and not folder.is_dir()
    file = folder if named else folder / f"cloth.{format}"
    folder = file.parent if named else folder
    if format in FIELDS:
        pieces.check()
        chosen = usual_fields(recording) if fields is None else fields
        of_pieces = {name: pieces.of(field) for name, field in chosen.items()}
        return _in(folder, lambda: module.write(pieces, folder, of_pieces))
    whole = shot(pieces, floor=format == "blend")
    if format not in CHANGING:
        whole.one_topology(format)
    return _in(folder, lambda: module.write(whole, folder) if format in MESHES else module.write(whole, file, format))


def usual_fields(recording: Recording) -> Fields:
    """Stretch, and where there are solids the forces of contact [N]."""
    fields: Fields = {"stretch": lambda frame: evaluate("stretch", at(recording.geometry, frame), frame)}
    if "contact" in recording.frame(recording.frames()[0]):
        fields["contact_force"] = lambda frame: in_one(recording.geometry, frame, frame["contact"])
    return fields


def _in(folder: pathlib.Path, write: Callable[[], list[pathlib.Path]]) -> list[pathlib.Path]:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return write()
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None
