"""One picture, of a simulation as it now is or of a frame of a recorded run."""

from pathlib import Path

import numpy as np

from .. import checks
from ..backend import runtime
from ..errors import OutputError, SceneError, shown
from ..output.folder import write_whole
from ..output.picture import Artist, Look
from ..output.png import encode_png
from ..output.recording import Recording
from ..scene.view import Camera
from ..simulation import Simulation
from ..system.quantities import QUANTITIES
from . import record
from .playback import heat_of

SMALLEST, LARGEST = 16, 16384  # pixels


def render(what: Simulation | Recording, path: str | Path | None = None, frame: int | None = None,
           size: tuple[int, int] = (1280, 720), quality: str = "standard", heat: str | None = None,
           limits: tuple[float, float] | None = None, camera: Camera | None = None, wire: bool = False,
           caption: str = "") -> np.ndarray:
    """Draws a picture.

    Args:
        what: a simulation, drawn as it now is, or a recorded run.
        path: of a PNG to be written, or None.
        frame: of a recorded run; its last one where None.
        size: (width, height) [pixels].
        quality: "fast", "standard" (shadow map) or "high" (traced shadows and ambient occlusion).
        heat: quantity that colours the cloth: stretch, shear, bend, speed or contact.
        limits: (low, high) of its scale.
        camera: None takes the scene's, or fits one.
        wire: whether the triangles' edges are drawn.
        caption: text, in which {t} and {frame} stand for the time and the frame.

    Returns:
        (height, width, 3) uint8.

    Raises:
        SceneError: an impossible value or an unknown name.
        OutputError: no such frame, or a file that cannot be written.
    """
    if not isinstance(what, (Simulation, Recording)):
        raise SceneError(f"render: what = {shown(what)}: must be a Simulation or a Recording")
    width, height = (checks.integer("render: size", n, least=SMALLEST, most=LARGEST) for n in _two("render: size", size))
    path = None if path is None else checks.path("render: path", path, OutputError)
    if limits is not None:
        low, high = (checks.number("render: limits", n) for n in _two("render: limits", limits))
        if not low < high:
            raise SceneError(f"render: limits = ({low:g}, {high:g}): the first must be less")
        limits = low, high
    look = Look(quality, camera, wire=wire, caption=caption)
    if heat is not None:
        checks.choice("render: heat", heat, QUANTITIES)
    if isinstance(what, Recording):
        number = what.frames()[-1] if frame is None else checks.integer("render: frame", frame, least=0)
        if number not in what.frames():
            raise OutputError(f"render: {what.path} has no frame {number}; it has {what.frames()[0]} to {what.frames()[-1]}")
        geometry, arrays, recorded = what.geometry, what.frame(number), what
        if not runtime.running():
            runtime.start("cpu", "f32")
    elif frame is not None:
        raise SceneError("render: frame: a simulation is drawn as it now is; frames are those of a recorded run")
    else:
        number, geometry, arrays, recorded = 0, record.geometry(what), record.frame(what), None
    if heat is not None:
        look = Look(quality, camera, wire=wire, caption=caption, heat=heat_of(heat, geometry, limits, recorded))
    image = Artist(geometry, (width, height), look).draw(arrays, number)
    if path is not None:
        write_whole(path, encode_png(image))
    return image


def _two(what: str, pair: object) -> tuple:
    """The two elements of a pair."""
    if not checks.is_sequence(pair) or len(pair) != 2:  # type: ignore[arg-type]
        raise SceneError(f"{what} = {shown(pair)}: must be a pair of numbers")
    return tuple(pair)  # type: ignore[arg-type]
