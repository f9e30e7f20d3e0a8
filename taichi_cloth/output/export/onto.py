"""A run put onto objects of somebody's own .blend: caches of positions, and a modifier each; all else of the file stays.

The order of vertices is the objects' own, so a run's triangles have to be pieces of their polygons. Positions of a run are in
the world; a cache has them in its object's axes, as these are at each frame.
"""

import json
import os
import pathlib
from collections.abc import Mapping, Sequence

import numpy as np

from ...errors import MeshError, OutputError, did_you_mean, shown
from ...io import blender, blendfile
from ...io.blendfile import Blend, Item
from ..folder import write_whole, written_aside
from ..recording import Recording
from .blend import up
from .obj import word
from .pc2 import pc2
from .shot import unique

LIST = "caches.json"  # of the caches: object, file, the modifier before, and the modifier's frame_start and frame_scale
SCRIPT = pathlib.Path(__file__).with_name("onto_script.py")


def onto(recording: Recording, blend: str | os.PathLike, path: str | os.PathLike | None = None,
         objects: Mapping[str, str] | None = None) -> list[pathlib.Path]:
    """Writes a copy of a .blend whose objects move as a run's cloths.

    Args:
        blend: the file, which stays as it is.
        path: the new one, beside which a folder of caches is made; `blend/NAME` in the run's folder if None.
        objects: an object's name for each cloth; if None objects have the names of the cloths.

    Returns:
        The files that it wrote, the .blend first; `Recording.notes` say where modifiers may be in the way.

    Raises:
        OutputError: a file that is not there or would be overwritten, names or vertices that are not the run's, frames that
            are missing, Blender that is not here.
    """
    source = pathlib.Path(blend)
    target = recording.path / "blend" / source.name if path is None else pathlib.Path(path)
    _refuse_target(source, target)
    cloths = recording.geometry["cloth_names"].tolist()
    chosen = _chosen(cloths, objects)
    numbers = recording.frames()
    try:
        found = blendfile.read(source, list(chosen.values()), [recording.time(k) for k in numbers])
    except MeshError as error:
        raise OutputError(f"{error}{'' if objects else ' (objects: --object CLOTH=OBJECT)'}") from None
    for cloth, name in chosen.items():
        _refuse_other(recording, cloths.index(cloth), found.items[name], f"{source}: {name!r}")
        recording.notes += _doubts(name, found.items[name])
    last = found.frames[0] + recording.time(numbers[-1]) * found.fps
    if last > found.frames[1]:
        recording.notes.append(f"the run ends at frame {last:g}, and the scene at {found.frames[1]}")
    return _write(recording, source, target, found, chosen)


def _refuse_target(source: pathlib.Path, target: pathlib.Path) -> None:
    if target.suffix.lower() != ".blend":
        raise OutputError(f"{target}: the new file must be a .blend")
    if target.exists() and source.exists() and target.samefile(source):
        raise OutputError(f"{target} is the file that it is read from, and stays as it is: name another (--to)")


def _chosen(cloths: Sequence[str], objects: Mapping[str, str] | None) -> dict[str, str]:
    """The object of each cloth that is wanted."""
    chosen = {name: name for name in cloths} if objects is None else dict(objects)
    for cloth in chosen:
        if cloth not in cloths:
            raise OutputError(f"the run has no cloth {shown(cloth)}; {did_you_mean(cloth, cloths)}")
    names = list(chosen.values())
    for name in names:
        if names.count(name) > 1:
            raise OutputError(f"object {name!r} is named for {names.count(name)} cloths")
    if not chosen:
        raise OutputError("the run has no cloth")
    return chosen


def _refuse_other(recording: Recording, k: int, item: Item, what: str) -> None:
    """Refuses an object whose vertices are not those of the k-th cloth, in their order."""
    g = recording.geometry
    name, first, n = str(g["cloth_names"][k]), int(g["cloth_start"][k]), int(np.diff(g["cloth_start"])[k])
    if item.linked:
        raise OutputError(f"{what} is linked from another file: make it local first")
    if len(item.x) != n:
        raise OutputError(f"{what} has {len(item.x):,} vertices, and cloth {name!r} of the run {n:,}: it was made of another "
                          "mesh")
    faces = g["faces"][g["cloth_faces"][k]:g["cloth_faces"][k + 1]] - first
    if not _are_pieces(faces, item, n):
        raise OutputError(f"{what} has other faces than cloth {name!r} of the run, or its vertices in another order: load the "
                          "cloth from the .blend itself, or from an OBJ")
    flat = np.abs(np.linalg.det(item.world[:, :3, :3])) < 1e-30
    if flat.any():
        raise OutputError(f"{what} is scaled to nothing at frame {recording.frames()[int(np.argmax(flat))]} of the run")


def _are_pieces(faces: np.ndarray, item: Item, n: int) -> bool:
    """Whether triangles (m, 3) are those that an object's polygons are cut into, along any diagonals."""
    following = np.arange(1, len(item.corners) + 1)
    ends = np.cumsum(item.counts)
    following[ends - 1] = ends - item.counts
    sides = _codes(item.corners, item.corners[following], n)
    made = _codes(faces.ravel(), np.roll(faces, -1, axis=1).ravel(), n)
    return len(faces) == int((item.counts - 2).sum()) and bool(np.isin(sides, made).all())


def _codes(a: np.ndarray, b: np.ndarray, n: int) -> np.ndarray:
    return np.minimum(a, b).astype(np.int64) * n + np.maximum(a, b)


def _doubts(name: str, item: Item) -> list[str]:
    return [f"{name!r}: modifier {late!r} comes after its cache and moves it once more, as the modifiers before that change "
            "its vertices" for late in item.late]


def _write(recording: Recording, source: pathlib.Path, target: pathlib.Path, found: Blend,
           chosen: dict[str, str]) -> list[pathlib.Path]:
    """Caches first, then the .blend that names them."""
    folder = target.with_name(f"{target.stem}_cache")
    files = [folder / f"{name}.pc2" for name in unique(word(name) for name in chosen.values())]
    data = [pc2(x, recording.frames()[0]) for x in _local(recording, found, chosen)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None
    for file, cache in zip(files, data):
        write_whole(file, cache)
    scale = recording.fps / found.fps
    start = scale * (found.frames[0] + recording.time(recording.frames()[0]) * found.fps)
    caches = [{"object": name, "file": file.name, "before": found.items[name].before, "start": start, "scale": scale}
              for file, name in zip(files, chosen.values())]
    write_whole(folder / LIST, json.dumps(caches, indent=1).encode())
    _run(source, target, {"folder": folder.name, "caches": caches})
    return [target, *files, folder / LIST]


def _run(source: pathlib.Path, target: pathlib.Path, choices: dict) -> None:
    words = blender.command(SCRIPT)
    assert words is not None  # it has read the file
    with written_aside(target, ".partial.blend") as aside:
        done = blender.run([*words, str(source.absolute()), str(aside.absolute()), json.dumps(choices)])
        if done.returncode or not aside.is_file():
            raise OutputError(f"cannot write {target}: {blender.reason(done)}")


def _local(recording: Recording, found: Blend, chosen: dict[str, str]) -> list[list[np.ndarray]]:
    """For each object its positions (n, 3) at every frame, in its own axes and unit."""
    g = recording.geometry
    rows = [slice(*g["cloth_start"][g["cloth_names"].tolist().index(cloth):][:2].tolist()) for cloth in chosen]
    back = [np.linalg.inv(found.items[name].world) for name in chosen.values()]
    out: list[list[np.ndarray]] = [[] for _ in chosen]
    for t, number in enumerate(recording.frames()):
        x = up(recording.frame(number)["x"].astype(np.float64)) / found.unit
        for frames, mine, inverse in zip(out, rows, back):
            frames.append(x[mine] @ inverse[t, :3, :3].T + inverse[t, :3, 3])
    return out
