"""Recorded runs without simulating again: drawn, compared, told apart."""

import json
import pathlib
import sys
from dataclasses import dataclass

import numpy as np

from .. import checks
from ..errors import OutputError
from ..output.folder import write_whole
from ..output.look import Heat, Look
from ..output.movie import encoder, write_mp4
from ..output.picture import Artist, contact_sheet
from ..output.png import encode_apng, encode_png
from ..output.recording import Recording
from ..scene.view import camera_at
from ..system.quantities import QUANTITIES, evaluate, require
from .drawing import Extras, Framing, files_of, frames_of, next_of
from .material import SameMaterial

NOTHING = Extras()


def heat_of(name: str, geometry: dict[str, np.ndarray], limits: tuple[float, float] | None = None,
            recording: Recording | None = None) -> Heat:
    """The heat map of one of `quantities.QUANTITIES`.

    Args:
        limits: (low, high) of its scale; else those that fit the recording, or the usual ones if there is none.
    """
    quantity = QUANTITIES[checks.choice("quantity", name, QUANTITIES)]
    require(name, geometry)
    if limits is None:
        seen = None
        if recording is not None:
            picked = spread(recording.frames(), 12)
            seen = np.concatenate([evaluate(name, geometry, recording.frame(k)) for k in picked])
        limits = quantity.scale(seen)
    return Heat(name, quantity.unit, lambda frame: evaluate(name, geometry, frame), limits, quantity.middle is not None)


@dataclass(frozen=True)
class Films:
    """Products of a run's pictures besides single files.

    Attributes:
        sheet: pictures in one contact sheet, 0 for none; apng, mp4: whether to write these.
    """

    sheet: int = 0
    apng: bool = False
    mp4: bool = False


def render(recording: Recording, folder: pathlib.Path, size: tuple[int, int], look: Look, numbers: list[int],
           films: Films, extras: Extras = NOTHING) -> list[pathlib.Path]:
    """Draws frames of a recorded run into `folder`; the files that were written. `recording.notes` tell of cloth cut off.

    Raises:
        OutputError: a film that cannot be written, or cannot be transparent, or no folder; nothing is drawn then.
    """
    if films.mp4:
        encoder()
    artist = Artist(recording.geometry, size, look, lambda: frames_of(recording), lambda: map(recording.frame, numbers))
    if films.mp4 and artist.renderer.transparent:
        raise OutputError("a film (mp4) cannot be transparent: choose another background, or an animated PNG (apng)")
    files, images, framing = [], [], Framing(artist)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"cannot write to {folder}: {error.strerror or error}") from None
    picked = set(spread(numbers, films.sheet)) if films.sheet else set()
    for k in numbers:
        frame = recording.frame(k)
        framing.see(frame)
        image, parts = files_of(artist, frame, k, extras, next_of(recording, k, look))
        for ending, data in parts.items():
            files.append(folder / f"{k:05d}{ending}")
            write_whole(files[-1], data)
        if k in picked or films.apng or films.mp4:
            images.append((k, image))
    note = None if artist.fitted else framing.note(folder)
    recording.notes += [note] if note else []
    every = (numbers[-1] - numbers[0]) / max(len(numbers) - 1, 1) or 1.0
    fps = recording.fps / every
    if films.sheet:
        chosen = [image for k, image in images if k in picked]
        files.append(folder / "sheet.png")
        write_whole(files[-1], encode_png(contact_sheet(chosen, _columns(len(chosen)))))
    if films.apng:
        files.append(folder / "animation.png")
        write_whole(files[-1], encode_apng([image for _, image in images], fps))
    if films.mp4:
        files.append(folder / "film.mp4")
        write_mp4(files[-1], (image if image.dtype == np.uint8 else (image // 257).astype(np.uint8) for _, image in images),
                  size, fps)
    if "id" in extras.passes:
        files.append(folder / "id_names.json")
        write_whole(files[-1], (json.dumps(id_names(recording.geometry), indent=1) + "\n").encode())
    return files


def id_names(geometry: dict[str, np.ndarray]) -> dict[int, str]:
    """Meaning of the numbers of the pass "id"."""
    names = [*map(str, geometry["cloth_names"]), *map(str, geometry["solid_names"]), "ground"]
    return {0: "nothing", **dict(enumerate(names, 1))}


def distances(a: Recording, b: Recording) -> dict[int, np.ndarray]:
    """By frame of a at whose time b has one too, (n,) distance [m] of each of its vertices from the other run.

    If meshes differ, it is the distance from the place of the other cloth with the same material coordinates.

    Raises:
        OutputError: the runs are of other cloths, or have no time in common.
    """
    common = same_times(a, b)
    other = None if _same_mesh(a, b) else SameMaterial(a.geometry, b.geometry)
    out = {}
    for k, j in common:
        x, y = a.frame(k)["x"].astype(np.float64), b.frame(j)["x"].astype(np.float64)
        out[k] = np.linalg.norm(x - y, axis=1) if other is None else np.linalg.norm(x - other.at(y), axis=1) * other.used
    return out


def weights(a: Recording, b: Recording) -> np.ndarray | None:
    """(n,) of a's vertices in a mean: their areas of material where meshes differ; None, all alike, where they do not."""
    return None if _same_mesh(a, b) else SameMaterial(a.geometry, b.geometry).area


def apart_in_all(apart: dict[int, np.ndarray], of: np.ndarray | None) -> str:
    """How far two runs are apart in all frames, in a sentence; `apart` as `distances`, `of` as `weights` gives it."""
    rms = rms_of([rms_of([d], of) for d in apart.values()])
    return f"in all {len(apart)} frames: RMS {rms:.3g} m, largest {max(float(d.max()) for d in apart.values()):.3g} m"


def parting(a: Recording, b: Recording, tolerance: float) -> list[str]:
    """Sentences on where the motion of two runs parts, and on how far they are apart at the end."""
    apart, of = distances(a, b), weights(a, b)
    last, size = max(apart), float(np.linalg.norm(np.ptp(a.frame(max(apart))["x"], axis=0))) or 1.0
    off = rms_of([apart[last]], of)
    counts = len(apart[last]), len(b.geometry["x"])
    where = "" if of is None else f" of {counts[0]:,} vertices against {counts[1]:,}, by material coordinates"
    end = f"at the end, t = {a.time(last):.4g} s{where}: RMS {off:.3g} m, {off / size:.2%} of the size {size:.3g} m"
    for k, d in apart.items():
        rms = rms_of([d], of)
        if rms > tolerance:
            worst = int(np.argmax(d))
            return [f"the motion parts at frame {k} (t = {a.time(k):.4g} s): RMS {rms:.3g} m, "
                    f"vertex {worst} by {d[worst]:.3g} m", end, apart_in_all(apart, of)]
    largest = max(float(d.max()) for d in apart.values())
    return [f"the motion agrees in all {len(apart)} frames: no vertex is further apart than {largest:.3g} m"]


def _same_mesh(a: Recording, b: Recording) -> bool:
    return np.array_equal(a.geometry["faces"], b.geometry["faces"]) and len(a.geometry["x"]) == len(b.geometry["x"])


def same_times(a: Recording, b: Recording) -> list[tuple[int, int]]:
    """Frames of both, at the same times.

    Raises:
        OutputError: there are none.
    """
    frames = set(b.frames())
    pairs = [(k, round((a.time(k) - b.time(0)) * b.fps)) for k in a.frames()]
    common = [(k, j) for k, j in pairs if j in frames and abs(a.time(k) - b.time(j)) < 1e-9]
    if not common:
        raise OutputError(f"{a.path} and {b.path} have no time in common at which both have a frame")
    return common


def rms_of(parts: list, of: np.ndarray | None = None) -> float:
    """Root of the mean square of all numbers, weighted by `of` (n,) if given."""
    values = np.concatenate([np.atleast_1d(p) for p in parts])
    return float(np.sqrt(np.average(values**2, weights=of)))


def warn_inside(recording: Recording, look: Look) -> None:
    """Says so where the camera is within the cloth's bounds: it may see the inside of a fold."""
    if look.camera is None or isinstance(look.camera, str):
        return
    x = recording.frame(recording.frames()[0])["x"]
    eye = np.array(camera_at(look.camera, 0.0).eye)
    if (eye > x.min(axis=0)).all() and (eye < x.max(axis=0)).all():
        print(f"note: the camera at {tuple(eye.tolist())} is inside the cloth's bounds", file=sys.stderr)


def spread(numbers: list[int], count: int) -> list[int]:
    """`count` of the numbers, evenly, first and last among them."""
    if count >= len(numbers):
        return numbers
    return [numbers[round(i)] for i in np.linspace(0, len(numbers) - 1, max(count, 1))]


def _columns(count: int) -> int:
    return max(1, int(np.ceil(np.sqrt(count))))
