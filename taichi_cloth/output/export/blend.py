"""Blender's own files, and Alembic by way of Blender, which runs `blender_script.py` as a process of its own."""

import pathlib
import tempfile

import numpy as np

from ...errors import OutputError
from ...io import blender
from ...scene.view import View
from ..camera import Frame
from ..camera import frame as axes_of
from ..folder import written_aside
from ..rig import rig_of
from .polygons import loops
from .shot import Mesh, Shot

SCRIPT = pathlib.Path(__file__).with_name("blender_script.py")
WORDS = {"blend": "a .blend", "abc": "Alembic"}


def needed(format: str) -> None:
    """Looks for Blender.

    Raises:
        OutputError: neither the module bpy nor the program is here.
    """
    command(format)


def command(format: str) -> list[str]:
    """How Blender is told to run the script.

    Raises:
        OutputError: it is not here.
    """
    words = blender.command(SCRIPT)
    if words is None:
        raise OutputError(f"{WORDS[format]} is written by Blender, and {blender.ABSENT}. usda, glb and obj need neither, and "
                          "Blender opens them")
    return words


def write(shot: Shot, path: pathlib.Path, format: str) -> list[pathlib.Path]:
    """One .blend or one .abc.

    Raises:
        OutputError: Blender is not here, or could not write it.
    """
    run = command(format)
    with tempfile.TemporaryDirectory() as folder, written_aside(path, f".partial.{format}") as aside:
        data = pathlib.Path(folder) / "shot.npz"
        np.savez(data, allow_pickle=False, **arrays(shot))
        done = blender.run([*run, str(data), str(aside.absolute())])
        if done.returncode or not aside.is_file():
            raise OutputError(f"cannot write {path}: {blender.reason(done)}")
    return [path]


def arrays(shot: Shot) -> dict[str, np.ndarray]:
    """Input of the script, by name: plain arrays, z up as in Blender."""
    near, far = shot.clipping
    out = {"numbers": np.array(shot.numbers), "fps": np.array(shot.fps), "names": np.array([m.name for m in shot.meshes]),
           "kinds": np.array([m.kind for m in shot.meshes]), "colors": np.array([m.color for m in shot.meshes]),
           "fov": np.radians([c.fov for c in shot.cameras]), "clip": np.array([near, far]),
           "eye": up(np.array([c.eye for c in shot.cameras])), "axes": up(np.array([axes_of(c).axes for c in shot.cameras])),
           "thickness": np.array([m.thickness or 0.0 for m in shot.meshes])}
    out |= surroundings(shot.view, axes_of(shot.cameras[0]))
    for k, mesh in enumerate(shot.meshes):
        surface = mesh.surface(0)
        places, counts = loops(surface.faces, surface.polygon)
        out |= {f"corners_{k}": surface.faces.ravel()[places], f"counts_{k}": counts, f"x_{k}": up(np.stack(mesh.x)),
                f"sharp_{k}": sharp_edges(mesh)}
        if surface.uv is not None:
            out[f"uv_{k}"] = surface.uv.reshape(-1, 2)[places]
        if mesh.printed is not None:
            out |= {f"image_{k}": mesh.printed.image, f"repeats_{k}": np.array(mesh.printed.repeats)}
    return out


def surroundings(view: View, camera: Frame) -> dict[str, np.ndarray]:
    """Lights and background as pictures here have them, by name.

    `lights` are the directions towards the key light and those that throw no shadow, (k, 3), with linear RGB `powers` (k, 3);
    the first is seen under the angle `sun`. `everywhere` is the radiance from all sides; its second row is times the height
    of a direction. `sky` has the colours at the horizon and above, none for a transparent background.
    """
    rig = rig_of(view.light, camera)
    others = [way for way in (rig.fill, rig.rim) if any(way)]
    powers = [rig.power] + [(float(np.linalg.norm(way)),) * 3 for way in others]
    above, below, background = np.array(rig.up), np.array(rig.down), view.background
    sky = np.array([rig.horizon, rig.zenith] if background == "sky" else
                   [] if background == "transparent" else [background] * 2, dtype=np.float64)
    # a matt surface gathers 2/3 of light that grows with height
    return {"lights": up(np.array([rig.key, *others])), "powers": np.array(powers), "sun": np.array(2 * np.arctan(rig.size)),
            "sky": sky, "everywhere": np.stack([(above + below) / 2, 3 / 2 * (above - below) / 2])}


def up(x: np.ndarray) -> np.ndarray:
    """Points (..., 3) with z up of those with y up: a turn about x, which rounds nothing."""
    return np.stack([x[..., 0], -x[..., 2], x[..., 1]], axis=-1)


def sharp_edges(mesh: Mesh) -> np.ndarray:
    """(k, 2) edges of a solid whose two faces have different normals there."""
    surface = mesh.surface(0)
    if mesh.kind == "cloth":
        return np.zeros((0, 2), dtype=np.int32)
    ends = np.stack([surface.faces, np.roll(surface.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    normals = np.stack([surface.normal_of, np.roll(surface.normal_of, -1, axis=1)], axis=2).reshape(-1, 2)
    turned = ends[:, 0] > ends[:, 1]
    ends[turned], normals[turned] = ends[turned][:, ::-1], normals[turned][:, ::-1]
    rows = np.unique(np.concatenate([ends, normals], axis=1), axis=0)  # an edge comes once where its faces agree
    edges, count = np.unique(rows[:, :2], axis=0, return_counts=True)
    return edges[count > 1].astype(np.int32)
