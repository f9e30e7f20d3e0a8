"""Files of a frame's picture: PNG, and passes beside it as NPY, or with the light in one EXR."""

import io
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import SceneError, shown
from ..output.exr import encode_exr
from ..output.look import Look
from ..output.passes import PASSES, named
from ..output.picture import Artist, Next
from ..output.png import encode_png
from ..output.recording import Recording
from ..output.renderer import developed

FORMATS = ("npy", "exr")


@dataclass(frozen=True)
class Extras:
    """Files of a frame besides its picture.

    Attributes:
        passes: of `passes.PASSES`; format: "npy", a file each, or "exr", all in one with the picture's linear light.
    """

    passes: tuple[str, ...] = ()
    format: str = "npy"

    def __post_init__(self) -> None:
        for name in self.passes:
            checks.choice("pass", name, PASSES)
        checks.choice("format of passes", self.format, FORMATS)


class Framing:
    """Counts the pictures that have not all of the cloth in them.

    Attributes:
        drawn: frames so far; cut: those of them; sunk: those with cloth below the ground.
    """

    def __init__(self, artist: Artist) -> None:
        self.artist, self.drawn, self.cut, self.sunk = artist, 0, 0, 0
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def see(self, frame: dict[str, np.ndarray]) -> None:
        """A frame that is drawn."""
        self.drawn += 1
        self.cut += not self.artist.sees(frame)
        self.sunk += bool((frame["x"][:, 1] < self.artist.renderer.ground).any())
        self._low = frame["x"].min(axis=0, initial=np.inf).clip(max=self._low)
        self._high = frame["x"].max(axis=0, initial=-np.inf).clip(min=self._high)

    def note(self, path: object) -> str | None:
        """A note on cloth that the camera cuts off in a run's folder, or that comes below a ground that was placed before the
        run, and the way out; None if the scene's own camera or ground does that."""
        if not self.cut or not (self.artist.fitted or self.artist.look.camera):
            return (f"cloth came below the ground of the picture in {self.sunk} of {self.drawn} frames: `taichi-cloth render "
                    f"{path}` draws them with a ground below all of them") if self.sunk and self.artist.sought else None
        if self.artist.fitted:
            return (f"cloth left the picture in {self.cut} of {self.drawn} frames: `taichi-cloth render {path}` draws them "
                    "through a camera that fits all of them")
        ends = " to ".join("(" + ", ".join(f"{value:.3g}" for value in end) + ")" for end in (self._low, self._high))
        return (f"cloth is outside the picture in {self.cut} of {self.drawn} frames, through the camera that was given: it is "
                f"from {ends} m")


def files_of(artist: Artist, frame: dict[str, np.ndarray], number: int, extras: Extras,
             next_: Next = None) -> tuple[np.ndarray, dict[str, bytes]]:
    """A frame's picture, and the files of it by their ending, such as ".png" and ".depth.npy"; next_: as in `Artist.light`."""
    light = artist.light(frame, next_=next_)
    image = artist.captioned(developed(light, artist.look.bits, artist.renderer.transparent), frame, number)
    out = {".png": encode_png(image)}
    if not extras.passes:
        return image, out
    passes = {name: array for name, array in artist.passes(frame).items() if name in extras.passes}
    if extras.format == "exr":
        colors = dict(zip("RGBA" if artist.renderer.transparent else "RGB", np.moveaxis(light, 2, 0)))
        return image, out | {".exr": encode_exr(colors | named(passes))}
    for name, array in passes.items():
        buffer = io.BytesIO()
        np.save(buffer, array)
        out[f".{name}.npy"] = buffer.getvalue()
    return image, out


def frames_of(recording: Recording) -> Iterator[dict[str, np.ndarray]]:
    """All recorded frames, which a fitted camera has to have in its picture."""
    return (recording.frame(k) for k in recording.frames())


def next_of(recording: Recording, number: int, look: Look) -> Next:
    """The frame after one, and the time between, for a shutter."""
    if not look.shutter:
        return None
    return recording.frame(number + 1) if number + 1 in recording.frames() else None, 1 / recording.fps


def numbers_in(text: str, there: Iterable[int]) -> list[int]:
    """Frames that a text names: "10", "10:60", "10:60:5" (first, last, step; ends may be left out), several by commas.

    Raises:
        SceneError: it is no such text, or names none that is there.
    """
    numbers = list(there)
    named: set[int] = set()
    for part in text.split(","):
        pieces = part.strip().split(":")
        if len(pieces) > 3 or not all(checks.is_whole(p.strip()) or (p.strip() == "" and len(pieces) > 1)
                                       for p in pieces):
            raise SceneError(f"frames = {shown(text)}: needs FIRST:LAST:STEP, such as 10:60:5, or numbers with commas between")
        first, last, step = (*(int(p) if p.strip() else None for p in pieces), None, None)[:3]
        if step == 0:
            raise SceneError(f"frames = {shown(text)}: the step must be at least 1")
        low = numbers[0] if first is None else first
        high = low if len(pieces) == 1 else numbers[-1] if last is None else last
        if len(pieces) == 1 and low not in numbers:
            raise SceneError(f"frames = {shown(text)}: {low} is not there; there are {numbers[0]} to {numbers[-1]}")
        named |= {k for k in numbers if low <= k <= high and (k - low) % (step or 1) == 0}
    found = sorted(named)
    if not found:
        raise SceneError(f"frames = {shown(text)}: none of them is there; there are {numbers[0]} to {numbers[-1]}")
    return found
