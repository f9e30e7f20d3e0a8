"""Pictures from Python: of scenes, simulations and recorded runs, and the surfaces behind their pixels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .. import checks
from ..backend import runtime
from ..errors import OutputError, SceneError, shown
from ..output.folder import write_whole
from ..output.look import Look
from ..output.passes import PASSES
from ..output.picture import Artist
from ..output.png import Picture, encode_png
from ..output.recording import Recording
from ..scene.appearance import Appearance
from ..scene.scene import Scene
from ..scene.view import AnyCamera, Camera, Color
from ..simulation import Simulation
from ..system.quantities import QUANTITIES
from . import record
from .drawing import Extras, frames_of, next_of, numbers_in
from .playback import Films, heat_of
from .playback import render as render_files

SMALLEST, LARGEST = 16, 16384  # pixels
Cameras = AnyCamera | Mapping[float, Camera] | str | None
Looks = Appearance | Mapping[str, Appearance] | None
Drawable = Scene | Simulation | Recording


def render(what: Drawable, path: str | Path | None = None, frame: int | None = None,
           size: tuple[int, int] = (1280, 720), quality: str = "standard", heat: str | None = None,
           limits: tuple[float, float] | None = None, camera: Cameras = None, wire: bool = False, caption: str = "", *,
           orbit: float = 0.0, follow: bool = False, background: str | Color | None = None, floor: str | Color | None = None,
           light: str | tuple[float, float, float] | None = None, appearance: Looks = None, smooth: int = 0, bits: int = 8,
           aperture: float = 0.0, focus: float | None = None, shutter: float = 0.0) -> np.ndarray:
    """Draws a picture.

    Args:
        what: a simulation, drawn as it now is; a recorded run; or a scene, drawn as it was built.
        path: of a PNG to be written, or None.
        frame: of a recorded run; its last one if None.
        size: (width, height) [pixels].
        quality: "fast" (shadow map), "standard" or "high" (traced shadows and ambient occlusion).
        heat: quantity that colours the cloth: stretch, shear, bend, speed, contact, crease, limit or seam; not of a scene.
        limits: (low, high) of its scale.
        camera: one, or cameras by time [s]; None takes the scene's, or fits one to all recorded frames. "front", "back",
            "left" and "right" fit one from there, which are +z, -z, -x and +x.
        wire: whether the triangles' edges are drawn.
        caption: text, in which {t} and {frame} stand for the time and the frame.
        orbit: degrees that the camera goes round its target in a second; follow: whether it moves with the cloth.
        background, floor, light: as in `View`; None takes the scene's.
        appearance: of all cloths, or appearances by the cloths' names; their open values are the scene's.
        smooth: how often triangles' edges are halved, 0 to 3: round outlines, for the picture only.
        bits: of a number, 8 or 16.
        aperture: diameter of the lens [m]: blurs surfaces that are not as far away as `focus` [m], None for the cloth's
            middle.
        shutter: of a recorded run: part of the time until the next frame that the picture takes, 0 to 1; blurs motion.

    Returns:
        (height, width, 3), uint8 or uint16; (height, width, 4) where the background is transparent. A notebook shows it as a
        picture.

    Raises:
        SceneError: an impossible value or an unknown name.
        OutputError: no such frame, or a file that cannot be written.
    """
    path = None if path is None else checks.png("render: path", path, OutputError)
    artist, arrays, number = _artist("render", what, frame, size, heat, limits, quality=quality, camera=camera, wire=wire,
                                     caption=caption, orbit=orbit, follow=follow, background=background, floor=floor,
                                     light=light, appearance=appearance, smooth=smooth, bits=bits, aperture=aperture,
                                     focus=focus, shutter=shutter)
    image = artist.draw(arrays, number, next_=next_of(what, number, artist.look) if isinstance(what, Recording) else None)
    if path is not None:
        write_whole(path, encode_png(image))
    return image.view(Picture)


def passes(what: Drawable, frame: int | None = None, size: tuple[int, int] = (1280, 720),
           names: Iterable[str] = PASSES, **look: Any) -> dict[str, np.ndarray]:
    """Depth, normal and object in the middle of each pixel of the picture that `render` draws.

    Args:
        what, frame, size: as in `render`; names: of "depth", "normal", "id".
        look: other arguments of `render` that move the camera or the surfaces: camera, orbit, follow, floor, smooth.

    Returns:
        By name: depth (h, w) f32, distance along the direction of view [m]; normal (h, w, 3) f32, towards the eye; id (h, w)
        int32, cloths, solids and the ground from 1. In empty pixels depth is infinite, normal and id are 0.

    Raises:
        SceneError: an impossible value or an unknown name.
        OutputError: no such frame.
    """
    wanted = Extras(_names(names)).passes
    artist, arrays, _ = _artist("passes", what, frame, size, None, None, **look)
    drawn = artist.passes(arrays)
    return {name: drawn[name] for name in wanted}


def render_frames(recording: Recording, folder: str | Path, frames: str | Iterable[int] = "",
                  size: tuple[int, int] = (1280, 720), heat: str | None = None,
                  limits: tuple[float, float] | None = None, passes: Iterable[str] = (), pass_format: str = "npy",
                  sheet: int = 0, apng: bool = False, mp4: bool = False, **look: Any) -> list[Path]:
    """Draws frames of a recorded run into a folder, as `taichi-cloth render` does.

    Args:
        frames: their numbers, or a text such as "10:60:5"; all where "".
        size, heat, limits: as in `render`; look: other arguments of `render`.
        passes: of "depth", "normal", "id", beside each picture, as `pass_format`: "npy", or "exr" with the linear light.
        sheet: how many of them also in one picture; apng, mp4: whether also as a film.

    Returns:
        The files that were written.

    Raises:
        SceneError: an impossible value or an unknown name.
        OutputError: no such frame, or a file that cannot be written.
    """
    checks.instance("render_frames: recording", recording, Recording)
    path = checks.path("render_frames: folder", folder, OutputError)
    there = recording.frames()
    if isinstance(frames, str):
        numbers = numbers_in(frames, there) if frames else there
    else:
        numbers = sorted({_frame("render_frames", recording, k) for k in frames})
        if not numbers:
            raise SceneError("render_frames: frames: names none")
    films = Films(checks.integer("render_frames: sheet", sheet, least=0), checks.flag("render_frames: apng", apng),
                  checks.flag("render_frames: mp4", mp4))
    extras = Extras(_names(passes), pass_format)
    width, height, limits = _size_and_limits("render_frames", size, limits)
    made = _look(heat, limits, recording.geometry, recording, look)
    runtime.go_on()
    return render_files(recording, path, (width, height), made, numbers, films, extras)


def _artist(name: str, what: object, frame: int | None, size: object, heat: str | None, limits: object,
            **look: Any) -> tuple[Artist, dict[str, np.ndarray], int]:
    """The renderer, the arrays of the frame, and its number."""
    if not isinstance(what, Drawable):
        raise SceneError(f"{name}: what = {shown(what)}: must be a Simulation, a Recording or a Scene")
    width, height, limits = _size_and_limits(name, size, limits)
    _look(None, None, {}, None, look)
    if heat is not None:
        checks.choice(f"{name}: heat", heat, QUANTITIES)
    if isinstance(what, Recording):
        number = what.frames()[-1] if frame is None else _frame(name, what, frame)
        geometry, arrays, recorded = what.geometry, what.frame(number), what
        runtime.go_on()
        return Artist(geometry, (width, height), _look(heat, limits, geometry, recorded, look),
                      lambda: frames_of(recorded), lambda: [arrays]), arrays, number
    if look.get("shutter"):
        raise SceneError(f"{name}: shutter: only a recorded run knows how cloth and solids move on: tc.record keeps one")
    if frame is not None:
        raise SceneError(f"{name}: frame: a simulation is drawn as it now is; frames are those of a recorded run")
    if isinstance(what, Scene):
        if heat is not None:
            raise SceneError(f"{name}: heat: a scene has no state that could colour it: make a Simulation of it, or run it")
        if not (what.cloths or record.drawn_solids(what)):
            raise SceneError(f"{name}: the scene has no cloth and no solid: there is nothing to draw")
        geometry = record.as_built(what)
        arrays = {"t": np.array(0.0), "x": geometry["x"]}
        runtime.go_on()
    else:
        geometry, arrays = record.geometry(what), record.frame(what)
    return Artist(geometry, (width, height), _look(heat, limits, geometry, None, look), lambda: [arrays]), arrays, 0


def _look(heat: str | None, limits: tuple[float, float] | None, geometry: dict[str, np.ndarray], recording: Recording | None,
          said: dict[str, Any]) -> Look:
    """The look of the arguments of `render`."""
    said = dict(said)
    appearance = said.pop("appearance", None)
    if isinstance(appearance, Appearance):
        said["cloths"] = {"": appearance}
    elif appearance is not None:
        said["cloths"] = appearance
    for name in said:
        checks.choice("argument", name, [n for n in Look.__dataclass_fields__ if n != "heat"])
    return Look(heat=None if heat is None else heat_of(heat, geometry, limits, recording), **{"quality": "standard", **said})


def _frame(name: str, recording: Recording, number: object) -> int:
    """A frame that the recording has."""
    out, there = checks.integer(f"{name}: frame", number, least=0), recording.frames()
    if out not in there:
        raise OutputError(f"{name}: {recording.path} has no frame {out}; it has {there[0]} to {there[-1]}")
    return out


def _size_and_limits(name: str, size: object, limits: object) -> tuple[int, int, tuple[float, float] | None]:
    width, height = (checks.integer(f"{name}: size", n, least=SMALLEST, most=LARGEST) for n in _two(f"{name}: size", size))
    if limits is None:
        return width, height, None
    low, high = (checks.number(f"{name}: limits", n) for n in _two(f"{name}: limits", limits))
    if not low < high:
        raise SceneError(f"{name}: limits = ({low:g}, {high:g}): the first must be less")
    return width, height, (low, high)


def _names(names: object) -> tuple[str, ...]:
    """Names of passes, from one or several."""
    return (names,) if isinstance(names, str) else tuple(names)  # type: ignore[arg-type]


def _two(what: str, pair: object) -> tuple:
    """The two elements of a pair."""
    if not checks.is_sequence(pair) or len(pair) != 2:  # type: ignore[arg-type]
        raise SceneError(f"{what} = {shown(pair)}: must be a pair of numbers")
    return tuple(pair)  # type: ignore[arg-type]
