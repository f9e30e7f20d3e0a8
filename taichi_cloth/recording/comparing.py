"""Two recorded runs beside each other, through one camera: pictures, a film, and how far they are apart frame by frame."""

import pathlib
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import OutputError
from ..output.colors import draw_bar, heat_colors
from ..output.folder import write_whole
from ..output.look import Look
from ..output.movie import encoder, write_mp4
from ..output.picture import Artist, contact_sheet
from ..output.png import encode_apng, encode_png
from ..output.recording import Recording
from ..output.text import draw_text, text_width
from .drawing import frames_of
from .playback import apart_in_all, distances, rms_of, same_times, spread, weights

FILMS = (".mp4", ".apng")
STRIP = 20  # pixels under a picture, for its time in letters of scale 1
TIMES = ("t = {:.3f} s", "{:.3f} s", "{:.3f}")  # under a column, the longest for which it is wide enough
ROWS = 12  # of the table that is printed; the file has all


class Pair:
    """Two runs with the frames at which both are compared.

    Args:
        common: whether only times that both have are, where their frames do not match.

    Raises:
        OutputError: their frames do not match.

    Attributes:
        frames: of the second by those of the first.
        apart: by frame of the first, distances as `playback.distances` gives them; None where `why` says why not.
    """

    def __init__(self, a: Recording, b: Recording, common: bool = False) -> None:
        self.a, self.b = a, b
        if not common and (a.fps != b.fps or a.frames() != b.frames()):
            first, second = (f"{run.path} has frames {run.frames()[0]} to {run.frames()[-1]}, {run.fps:g} a second"
                             for run in (a, b))
            raise OutputError(f"{first}, and {second}: {_way(a, b)}")
        self.frames = dict(same_times(a, b))
        self.apart: dict[int, np.ndarray] | None = None
        self.why = ""
        try:
            self.apart, self.of = distances(a, b), weights(a, b)
        except OutputError as error:
            self.why = f"{error}: no distances"
        folders = [run.path.absolute() for run in (a, b)]
        self.names = [f.name for f in folders] if folders[0].name != folders[1].name else [f"{f.parent.name}/{f.name}"
                                                                                           for f in folders]

    def table(self) -> list[tuple[int, float, float, float]]:
        """(frame, t [s], largest, RMS distance [m]) of every frame; none where there are no distances."""
        return [(k, self.a.time(k), float(d.max()), rms_of([d], self.of)) for k, d in (self.apart or {}).items()]

    def said(self) -> list[str]:
        """Lines for a reader: some rows of the table, and how far they are apart in all."""
        if self.apart is None:
            return [f"note: {self.why}"]
        rows = self.table()
        picked = spread(list(range(len(rows))), ROWS)
        return [f"{'frame':>6}{'t [s]':>9}{'largest [m]':>13}{'RMS [m]':>11}",
                *("{:6d}{:9.3f}{:13.4g}{:11.4g}".format(*rows[i]) for i in picked), apart_in_all(self.apart, self.of)]

    def written(self, file: pathlib.Path) -> None:
        """The table as CSV, all of it."""
        lines = ["frame,t_s,largest_m,rms_m", *(f"{k},{t:.9g},{most:.6g},{mean:.6g}" for k, t, most, mean in self.table())]
        write_whole(file, ("\n".join(lines) + "\n").encode())


def _way(a: Recording, b: Recording) -> str:
    """How runs are compared whose frames do not match."""
    try:
        weights(a, b)
    except OutputError as error:
        return f"{error}: `taichi-cloth render` draws each by itself"
    return "--common compares the times that both have"


class Sides:
    """Draws both runs of a pair through the camera of the first, each with its name."""

    def __init__(self, pair: Pair, size: tuple[int, int], look: Look) -> None:
        self.pair = pair

        def frames() -> Iterator[dict[str, np.ndarray]]:
            for run in (pair.a, pair.b):
                yield from frames_of(run)

        self.first = Artist(pair.a.geometry, size, look, frames)
        self.second = Artist(pair.b.geometry, size, replace(look, camera=self.first.camera), frames)

    def both(self, k: int) -> list[np.ndarray]:
        """Pictures (h, w, c) of frame k of the first run and of the second run's frame at the same time."""
        pair = self.pair
        images = [self.first.draw(pair.a.frame(k), k), self.second.draw(pair.b.frame(pair.frames[k]), pair.frames[k])]
        for image, name in zip(images, pair.names):
            scale = max(1, image.shape[0] // 180)
            draw_text(image, name, 10 * scale, image.shape[0] - 20 * scale, scale)
        return images

    def difference(self, k: int, high: float) -> np.ndarray:
        """Picture (h, w, c) of the first run's cloth at frame k, coloured by its distance from the second's,
        up to `high` [m]."""
        assert self.pair.apart is not None
        return self.first.draw(self.pair.a.frame(k), k, heat_colors(self.pair.apart[k], 0.0, high, False))


def draw(pair: Pair, sides: Sides, file: pathlib.Path, count: int) -> None:
    """One picture: a column a frame, with both runs and, where they have distances, the difference below."""
    numbers = spread(list(pair.frames), count)
    rows = [list(row) for row in zip(*map(sides.both, numbers))]
    if pair.apart is not None:
        high = max(max(float(d.max()) for d in pair.apart.values()), 1e-12)
        rows.append([sides.difference(k, high) for k in numbers])
        draw_bar(rows[2][0], 0.0, high, False, "distance [m]")
    sheet = contact_sheet([image for row in rows for image in row], len(numbers))
    write_whole(file, encode_png(_above(sheet, [pair.a.time(k) for k in numbers])))


def _scale(width: int) -> int:
    """Scale of the letters under a column of this width [pixels]."""
    return max(1, width // 240)


def _above(image: np.ndarray, times: list[float]) -> np.ndarray:
    """A picture (h, w, c) above a strip with a time [s] under each of its columns, or every few where they are narrow."""
    width = image.shape[1] // len(times)
    scale = _scale(width)
    strip = np.full((STRIP * scale, *image.shape[1:]), np.iinfo(image.dtype).max, dtype=image.dtype)
    said, each = _fitting(times, width, scale)
    for column in range(0, len(times) - each + 1, each):
        room = each * width - text_width(said[column], scale)
        draw_text(strip, said[column], column * width + max(0, min(10 * scale, room // 2)), 5 * scale, scale)
    return np.concatenate([image, strip])


def _fitting(times: list[float], width: int, scale: int) -> tuple[list[str], int]:
    """(times in words, columns to a time): as long as columns so wide [pixels] let them be."""
    for form in TIMES:
        said = [form.format(t) for t in times]
        longest = max(text_width(text, scale) for text in said)
        if longest <= width:
            return said, 1
    return said, min(-(-longest // width), len(times))


def files_at(to: pathlib.Path | None, run: pathlib.Path, movie: bool) -> tuple[pathlib.Path, pathlib.Path | None]:
    """The files of the picture and of the film, which is None where none is asked for.

    Args:
        to: a folder, the picture's file, or the film's; None is the first run's folder, `run`.
        movie: whether a film is asked for; one that is named is, too.

    Raises:
        OutputError: a file of another kind, or a film that cannot be written.
    """
    to = to or run
    ending = "" if to.is_dir() else to.suffix.lower()
    if ending not in ("", ".png", *FILMS):
        raise OutputError(f"--to {str(to)!r}: takes a folder, the picture's file (.png), or the film's ({', '.join(FILMS)}), "
                          "which has the picture beside it")
    picture = to / "compare.png" if ending == "" else to.with_suffix(".png") if ending in FILMS else to
    if ending == ".mp4":
        encoder()
    if ending in FILMS:
        return picture, to
    return picture, picture.with_suffix(_kind()) if movie else None


def _kind() -> str:
    """The format of films that installed packages can write."""
    try:
        encoder()
    except OutputError:
        return ".apng"
    return ".mp4"


def film(pair: Pair, sides: Sides, file: pathlib.Path, size: tuple[int, int]) -> None:
    """Both runs side by side as a film; its kind goes by the file's name."""
    images = (_above(np.concatenate(sides.both(k), axis=1), [pair.a.time(k), pair.b.time(j)]) for k, j in pair.frames.items())
    numbers = list(pair.frames)
    fps = pair.a.fps * (len(numbers) - 1) / max(numbers[-1] - numbers[0], 1) or pair.a.fps
    if file.suffix.lower() == ".apng":
        write_whole(file, encode_apng(list(images), fps))
    else:
        write_mp4(file, images, (2 * size[0], size[1] + STRIP * _scale(size[0])), fps)
