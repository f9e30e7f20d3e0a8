"""A recorded run that plays in a notebook or in a browser: the playback of the report's page."""

import atexit
import functools
import html
import os
import pathlib
import tempfile
import time
import webbrowser

from .. import checks
from ..errors import OutputError
from ..output.folder import write_whole
from ..output.recording import Recording

INLINE = 4e6  # bytes of positions that go into a notebook
HEIGHT = 700  # pixels
READ = 5.0  # s that a browser gets to read a page before the process may end, and the page with it


class Pages:
    """The pages that this process shows, in one folder for temporary files.

    Attributes:
        opened: when the last of them was [s].
    """

    def __init__(self) -> None:
        self.folder = tempfile.TemporaryDirectory(prefix="taichi-cloth-", ignore_cleanup_errors=True)
        self.opened = time.monotonic()
        atexit.register(self.close)

    def close(self) -> None:
        """They go, but not before a browser has read them."""
        time.sleep(max(0.0, self.opened + READ - time.monotonic()))
        self.folder.cleanup()


_pages = functools.cache(Pages)


class Playback:
    """A run's motion; a notebook shows it, `show` opens it in a browser, `save` writes its page.

    Raises:
        OutputError: the run has no frames, or a damaged one.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording, self.count = recording, len(recording.frames())

    def __repr__(self) -> str:
        return f"Playback of {self.count} frames of {self.recording.path}: a notebook plays it, .show() a browser"

    def _repr_html_(self) -> str:
        """A frame of its own in the notebook's page, which neither can disturb."""
        text = html.escape(self._page(INLINE), quote=True)
        return f'<iframe srcdoc="{text}" width="100%" height="{HEIGHT}" style="border: 0"></iframe>'

    def save(self, path: str | os.PathLike) -> pathlib.Path:
        """Writes the page, which needs nothing else; its path.

        Raises:
            OutputError: it cannot be written.
        """
        file = checks.path("save: path", path, OutputError)
        write_whole(file, self._page().encode())
        return file

    def show(self) -> pathlib.Path:
        """Opens the page in a browser; its path, in a folder that goes when the process ends. `save` keeps it."""
        pages = _pages()
        file = self.save(pathlib.Path(pages.folder.name) / f"{self.recording.path.absolute().name}.html")
        pages.opened = time.monotonic()
        webbrowser.open(file.as_uri())
        return file

    def _page(self, budget: float | None = None) -> str:
        from .report import BUDGET, page

        m = self.recording.manifest
        rate = f"{self.count} frames, {m.get('fps', 24):g} a second"
        return page(self.recording, str(m.get("scene", self.recording.path.name)), rate, "", budget or BUDGET)
