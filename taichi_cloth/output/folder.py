"""The folder of a run: manifest, telemetry, images. Files are written aside and renamed, so that each is whole."""

import json
import os
import pathlib
import re
from typing import TextIO

from ..errors import OutputError

MANIFEST, TELEMETRY, IMAGES = "manifest.json", "telemetry.jsonl", "images"
IMAGE = re.compile(r"\d{5,}\.png$")


class RunFolder:
    """Where a run writes.

    Args:
        path: made where it does not exist.
        overwrite: whether another run's files there may be removed; nothing else ever is.

    Raises:
        OutputError: another run's files are there, or the folder cannot be written.
    """

    def __init__(self, path: str | os.PathLike, overwrite: bool = False) -> None:
        self.path = pathlib.Path(path)
        try:
            self._prepare(overwrite)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"cannot write to {self.path}: {error.strerror or error}") from None
        self._telemetry: TextIO | None = None

    def _prepare(self, overwrite: bool) -> None:
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, not a folder")
        old = self.run_files()
        if old and not overwrite:
            raise OutputError(f"{self.path} holds another run's files ({len(old)}, such as {old[0].name}): choose another "
                              "folder, or --overwrite removes them")
        for file in old:
            file.unlink()
        (self.path / IMAGES).mkdir(parents=True, exist_ok=True)
        if not os.access(self.path, os.W_OK):
            raise OutputError(f"cannot write to {self.path}")

    def run_files(self) -> list[pathlib.Path]:
        """The files there that a run wrote."""
        names = [self.path / MANIFEST, self.path / TELEMETRY]
        images = sorted((self.path / IMAGES).glob("*.png")) if (self.path / IMAGES).is_dir() else []
        aside = sorted(self.path.glob("**/*.partial"))
        return [f for f in names if f.is_file()] + [f for f in images if IMAGE.match(f.name)] + aside

    def write_manifest(self, content: dict) -> None:
        """Writes manifest.json."""
        self._write(self.path / MANIFEST, (json.dumps(content, indent=2, default=str) + "\n").encode())

    def write_image(self, frame: int, data: bytes) -> None:
        """Writes images/NNNNN.png."""
        self._write(self.path / IMAGES / f"{frame:05d}.png", data)

    def append_telemetry(self, records: list[dict]) -> None:
        """Appends a JSON line a record; lines are whole after every call."""
        if self._telemetry is None:
            self._telemetry = open(self.path / TELEMETRY, "a", encoding="utf-8")
        self._telemetry.write("".join(json.dumps(r) + "\n" for r in records))
        self._telemetry.flush()

    def close(self) -> None:
        """Closes what is open."""
        if self._telemetry is not None:
            self._telemetry.close()
            self._telemetry = None

    def _write(self, path: pathlib.Path, data: bytes) -> None:
        aside = path.with_suffix(path.suffix + ".partial")
        try:
            aside.write_bytes(data)
            os.replace(aside, path)
        except OSError as error:
            aside.unlink(missing_ok=True)
            raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
