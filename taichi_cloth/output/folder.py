"""The folder of a run: manifest, telemetry, geometry, frames, checkpoints, images.

Files are written aside and renamed, so that each is whole, whenever the process ends. Arrays are in .npz files of numpy.

    manifest.json         what ran, how it ended
    telemetry.jsonl       a line a step
    geometry.npz          what does not change: faces, uv, colours, solids, camera
    frames/00000.npz      what does: positions, velocities, contact forces
    checkpoints/00010.npz all that a run needs to go on from there
    images/00000.png
"""

import contextlib
import io
import json
import os
import pathlib
import re
import zipfile
from typing import TextIO

import numpy as np

from ..errors import OutputError

MANIFEST, TELEMETRY, GEOMETRY = "manifest.json", "telemetry.jsonl", "geometry.npz"
IMAGES, FRAMES, CHECKPOINTS = "images", "frames", "checkpoints"
NUMBERED = re.compile(r"\d{5,}\.(png|npz)$")


class RunFolder:
    """Where a run writes.

    Args:
        path: made where it does not exist.
        overwrite: whether another run's files there may be removed; nothing else ever is.
        resume: whether that run is to be gone on with: its files stay.

    Raises:
        OutputError: another run's files are there, or the folder cannot be written.
    """

    def __init__(self, path: str | os.PathLike, overwrite: bool = False, resume: bool = False) -> None:
        self.path = pathlib.Path(path)
        try:
            self._prepare(overwrite, resume)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"cannot write to {self.path}: {error.strerror or error}") from None
        self._telemetry: TextIO | None = None

    def _prepare(self, overwrite: bool, resume: bool) -> None:
        if self.path.exists() and not self.path.is_dir():
            raise OutputError(f"{self.path} is a file, not a folder")
        old = [] if resume else self.run_files()
        if old and not overwrite:
            raise OutputError(f"{self.path} holds another run's files ({len(old)}, such as {old[0].name}): choose another "
                              "folder, --resume goes on with that run, or --overwrite removes them")
        for file in old:
            file.unlink()
        self.path.mkdir(parents=True, exist_ok=True)
        if not os.access(self.path, os.W_OK):
            raise OutputError(f"cannot write to {self.path}")

    def run_files(self) -> list[pathlib.Path]:
        """The files there that a run wrote."""
        files = [self.path / name for name in (MANIFEST, TELEMETRY, GEOMETRY)]
        for kind in (IMAGES, FRAMES, CHECKPOINTS):
            files += [f for f in sorted((self.path / kind).glob("*")) if NUMBERED.match(f.name)]
        return [f for f in files if f.is_file()] + sorted(self.path.glob("**/*.partial"))

    def write_manifest(self, content: dict) -> None:
        """Writes manifest.json."""
        write_whole(self.path / MANIFEST, (json.dumps(content, indent=2, default=str) + "\n").encode())

    def write_image(self, frame: int, data: bytes) -> None:
        """Writes images/NNNNN.png."""
        write_whole(self.path / IMAGES / f"{frame:05d}.png", data)

    def write_arrays(self, name: str, arrays: dict[str, np.ndarray]) -> None:
        """Writes arrays by name to a file of this name, such as "frames/00000.npz"."""
        write_whole(self.path / name, pack(arrays))

    def write_telemetry(self, records: list[dict]) -> None:
        """Replaces the telemetry by these records."""
        self.close()
        write_whole(self.path / TELEMETRY, "".join(json.dumps(r) + "\n" for r in records).encode())

    def append_telemetry(self, records: list[dict]) -> None:
        """Appends a JSON line a record; lines are whole after every call."""
        if self._telemetry is None:
            self._telemetry = open(self.path / TELEMETRY, "a", encoding="utf-8")
        try:
            self._telemetry.write("".join(json.dumps(r) + "\n" for r in records))
            self._telemetry.flush()
        except OSError as error:
            raise OutputError(f"cannot write {self.path / TELEMETRY}: {error.strerror or error}") from None

    def close(self) -> None:
        """Closes what is open."""
        if self._telemetry is not None:
            self._telemetry.close()
            self._telemetry = None


def write_whole(path: pathlib.Path, data: bytes) -> None:
    """Writes a file aside and renames it, so that it is whole or not there.

    Raises:
        OutputError: it cannot be written; what was there before stays.
    """
    aside = path.with_suffix(path.suffix + ".partial")
    try:
        path.parent.mkdir(exist_ok=True)
        aside.write_bytes(data)
        os.replace(aside, path)
    except OSError as error:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None


def pack(arrays: dict[str, np.ndarray]) -> bytes:
    """The bytes of an .npz file: the same for the same arrays."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as file:
        for name, array in arrays.items():
            with file.open(zipfile.ZipInfo(name + ".npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, np.asarray(array, order="C"), allow_pickle=False)
    return buffer.getvalue()


def unpack(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Arrays of an .npz file by name.

    Raises:
        OutputError: it is missing, truncated or damaged.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except FileNotFoundError:
        raise OutputError(f"{path} is missing") from None
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise OutputError(f"{path} is damaged: {error}") from None
