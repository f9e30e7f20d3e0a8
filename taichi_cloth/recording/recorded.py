"""A run's folder with methods to draw, export and report it, as `tc.Recording`."""

import html
import os
import pathlib
from typing import Any

import numpy as np

from .. import checks
from ..errors import OutputError
from ..output import recording
from ..output.export import export
from ..output.retimed import Retimed
from .play import Playback


class Recording(recording.Recording):
    """A recorded run in its folder, to be read, exported and reported.

    Args:
        path: of the folder.

    Attributes:
        manifest: as it was written.
        notes: damage that was found, and repairs.

    Raises:
        OutputError: the folder is no run's, or its manifest is damaged.
    """

    def __repr__(self) -> str:
        kept = self.kept
        frames = f"frames {kept[0]} to {kept[1]}" if kept else "no frames"
        return f"Recording({str(self.path)!r}): {self.manifest.get('scene', 'a scene')}, {frames}"

    def export(self, format: str, path: str | os.PathLike | None = None, parts: str = "cloths") -> list[pathlib.Path]:
        """Writes the run in another tool's format, as `taichi-cloth export` does.

        Args:
            format: blend, abc, usda, usdc, glb, gltf, obj, pc2, vtu or ply.
            path: a folder; for a format of one file also that file's name; FORMAT in the run's folder if None.
            parts: one mesh for each of the "cloths", of the "panels" of garments, or garments "welded" over their seams.
                Welding turns triangles to one side if panels face both ways; `notes` say how many.

        Returns:
            The files that it wrote.

        Raises:
            SceneError: an unknown format, or other parts.
            OutputError: no frames, a damaged one, a package that is not there, data that a format cannot hold, files that
                cannot be written.
        """
        return export(self, format, path, parts)

    def render(self, path: str | os.PathLike | None = None, **options: Any) -> np.ndarray:
        """Draws a frame: `tc.render` with its other arguments."""
        from .still import render

        return render(self, path, **options)  # type: ignore[arg-type]

    def retimed(self, speed: float = 1.0, fps: float | None = None) -> "Recording":
        """The run as if it had been recorded at other times, to be drawn, exported and played like any other.

        Args:
            speed: seconds of the run in a second of the film; .5 is half as fast.
            fps: frames a second of the film; the run's if None.

        Returns:
            Frames numbered from 0; between recorded ones points go along curves, as `output/retimed.py` says.

        Raises:
            SceneError: a speed or a number of frames that is not positive.
            OutputError: the run has no frames.
        """
        return _Retimed(self, speed, fps)

    def play(self) -> Playback:
        """The run's motion, to be played and turned in a notebook, or in a browser: `recording.play().show()`.

        Raises:
            OutputError: the run has no frames, or a damaged one.
        """
        return Playback(self)

    def _repr_html_(self) -> str:
        """The view in a notebook."""
        try:
            return self.play()._repr_html_()
        except OutputError as error:
            return f"<p>{html.escape(f'{self!r}: {error}')}</p>"

    def report(self, path: str | os.PathLike | None = None) -> pathlib.Path:
        """Writes one HTML page about the run, as `taichi-cloth report` does.

        Args:
            path: of the page; report.html in the run's folder if None.

        Returns:
            Its path.

        Raises:
            OutputError: the run has no steps or no frames, or the page cannot be written.
        """
        from .report import write_report

        file = self.path / "report.html" if path is None else checks.path("report: path", path, OutputError)
        write_report(self, file)
        return file


class _Retimed(Retimed, Recording):
    """A run at other times, with the methods of a recording."""
