"""MP4 by the optional package imageio-ffmpeg."""

import pathlib
from collections.abc import Iterable

import numpy as np

from ..errors import OutputError
from .folder import written_aside


def encoder():
    """The package that writes films.

    Raises:
        OutputError: it is not installed, or has no program of ffmpeg.
    """
    try:
        import imageio_ffmpeg  # type: ignore[import-not-found]

        imageio_ffmpeg.get_ffmpeg_exe()
    except ImportError:
        raise OutputError("mp4 needs the package imageio-ffmpeg: pip install 'taichi-cloth[film]'; an animated PNG (apng) "
                          "needs nothing") from None
    except RuntimeError as error:
        raise OutputError(f"mp4 needs ffmpeg: {error}") from None
    return imageio_ffmpeg


def write_mp4(path: pathlib.Path, images: Iterable[np.ndarray], size: tuple[int, int], fps: float) -> None:
    """Writes a film of images (height, width, 3) of one size (width, height), aside and renamed.

    Raises:
        OutputError: as `encoder`, or it cannot write there.
    """
    ffmpeg = encoder()
    with written_aside(path, ".partial.mp4") as aside:  # its kind goes by its name
        film = ffmpeg.write_frames(str(aside), size, fps=fps, quality=8, macro_block_size=2)
        film.send(None)
        try:
            for image in images:
                film.send(np.ascontiguousarray(image))
        finally:
            film.close()
