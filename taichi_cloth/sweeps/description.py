"""The description by which a run is known again: all that its scene describes, and the code that measures it.

Functions of time (motions, wind, loads, gas) count by their code and by their values at times of the run, so that data which
they read from elsewhere count too. The functions of events count by their code.
"""

from collections.abc import Callable, Iterator

import numpy as np

from ..scene.scene import Scene
from .digest import Digest, Unknown, combined

A_FRAME = 3  # times a frame at which functions of time are looked at
PLACES = 64  # of vertices, at which wind that varies in space is


def described(scene: Scene, metrics: object, duration: float, fps: float) -> tuple[str, str]:
    """(16 hexadecimal digits, "") that tell runs apart; ("", the culprit) where something cannot be read.

    Args:
        metrics: a function, functions by name, or None.
        duration: of the run [s]; fps: frames a second.
    """
    digest = Digest()
    times = np.arange(int(np.ceil(A_FRAME * duration * fps)) + 1) / (A_FRAME * fps)
    try:
        parts = [digest.of(scene, "the scene"), digest.of(metrics, "the metrics")]
        for name, function in functions_of_time(scene):
            if callable(function):
                parts += [name.encode(), *(Digest().of(_value(function, float(t)), name) for t in times)]
    except Unknown as unknown:
        return "", str(unknown)
    except RecursionError:
        return "", "something in it that is nested too deeply"
    return told(combined("run", parts)), ""


def of_failure(reason: str, message: str) -> tuple[str, str]:
    """The description of a scene that could not be built, like that of `described`."""
    return told(combined("failure", [reason.encode(), message.encode()])), ""


def told(digest: bytes) -> str:
    """A digest as a file's name has it."""
    return digest[1:9].hex()


def functions_of_time(scene: Scene) -> Iterator[tuple[str, object]]:
    """Values of a scene that may be functions of time [s], by name."""
    script, air = scene.script, scene.air
    for placed in (*scene.solids, *scene.props):
        for name in ("position", "rotation"):
            yield f"{name} of {placed.name!r}", getattr(placed, name)
    for attachment in script.attachments:
        yield f"path of {attachment.cloth.name!r}", attachment.path
    for load in script.loads:
        yield f"load on {load.cloth.name!r}", load.force
    for gas in script.inflations:
        yield f"pressure of {gas.name!r}", gas.pressure
        yield f"volume of {gas.name!r}", gas.volume
    if air is not None and air.varies_in_space:
        x = np.concatenate([cloth.positions for cloth in scene.cloths] or [np.zeros((1, 3))])
        x = x[:: max(1, len(x) // PLACES)]
        yield "wind", lambda t: air.wind_at(t, x)
    elif air is not None:
        yield "wind", air.wind


def _value(function: Callable[[float], object], t: float) -> object:
    """Its value, or the name of the exception that it ends with."""
    try:
        return np.asarray(function(t))
    except Exception as error:  # the run will say so, if it comes that far
        return type(error).__name__
