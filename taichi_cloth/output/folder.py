"""The folder of a run: manifest, telemetry, geometry, frames, checkpoints, images.

Files are written aside and renamed, so that each is whole, whenever the process ends. Each says when it is damaged: arrays and
the manifest by a checksum, each line of telemetry by one of all lines up to it.

    manifest.json         the run, how it ended
    telemetry.jsonl       a line a step
    geometry.npz          constant data: faces, uv, colours, solids, camera
    frames/00000.npz      moving data: positions, velocities, contact forces
    checkpoints/00010.npz all that a run needs to go on from there
    images/00000.png      and other pictures of a frame, such as 00000.exr
    run.lock              while a process writes there
"""

import contextlib
import hashlib
import json
import os
import pathlib
import re
import zlib
from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from ..errors import OutputError
from ..io.npz import pack
from ..io.sequence import natural
from .lock import Lock

MANIFEST, TELEMETRY, GEOMETRY = "manifest.json", "telemetry.jsonl", "geometry.npz"
IMAGES, FRAMES, CHECKPOINTS = "images", "frames", "checkpoints"
NUMBERED = re.compile(r"(\d{5,})(\.[a-z]+)?\.(png|npz|exr|npy)$")
FORMAT = 2  # of checkpoints


class RunFolder:
    """The folder that a run writes, locked while it does.

    Args:
        path: made where it does not exist.
        overwrite: whether another run's files there may be removed; nothing else ever is.
        resumed: the frame from which that run is gone on with: its files up to then stay.
        instead: another remedy than choosing another folder, where one holds another run's files.

    Raises:
        OutputError: another run's files are there, another process writes there, or the folder cannot be written.
    """

    def __init__(self, path: str | os.PathLike, overwrite: bool = False, resumed: int | None = None,
                 instead: str = "overwrite=True removes them") -> None:
        self.path = pathlib.Path(path)
        self._telemetry: BinaryIO | None = None
        self._sum = 0
        self._made = {self.path}
        try:
            self._prepare(overwrite, resumed, instead)
        except OutputError:
            raise
        except OSError as error:
            raise OutputError(f"cannot write to {self.path}: {error.strerror or error}") from None

    def _prepare(self, overwrite: bool, resumed: int | None, instead: str) -> None:
        if resumed is None:
            old = free_for_a_run(self.path, overwrite, instead)
        else:
            old = [f for f in of_frames(self.path) if _number(f) > resumed]
        self.path.mkdir(parents=True, exist_ok=True)
        if not os.access(self.path, os.W_OK):
            raise OutputError(f"cannot write to {self.path}")
        self._lock = Lock(self.path)
        for file in old:
            file.unlink()

    def write_manifest(self, content: dict) -> None:
        """Writes manifest.json."""
        content = json.loads(json.dumps(content, default=str))
        text = json.dumps(content | {"checksum": manifest_sum(content)}, indent=2)
        self._write(self.path / MANIFEST, (text + "\n").encode())

    def write_image(self, frame: int, data: bytes, ending: str = ".png") -> None:
        """Writes images/NNNNN.png, or a file of another ending: .exr, .depth.npy."""
        self._write(self.path / IMAGES / f"{frame:05d}{ending}", data)

    def write_geometry(self, arrays: dict[str, np.ndarray]) -> None:
        """Writes geometry.npz."""
        self._write_arrays(GEOMETRY, arrays)

    def write_frame(self, frame: int, arrays: dict[str, np.ndarray]) -> None:
        """Writes frames/NNNNN.npz."""
        self._write_arrays(numbered(FRAMES, frame), arrays)

    def write_checkpoint(self, frame: int, state: dict[str, np.ndarray], run: str) -> None:
        """Writes checkpoints/NNNNN.npz; `run` tells apart runs that must not go on with each other's."""
        self._write_arrays(numbered(CHECKPOINTS, frame), state | {"format": np.array(FORMAT), "run": np.array(run)})

    def write_telemetry(self, records: list[dict]) -> None:
        """Replaces the telemetry by these records."""
        self._close_telemetry()
        self._sum = 0
        self._write(self.path / TELEMETRY, self._lines(records))

    def append_telemetry(self, records: list[dict]) -> None:
        """Appends a JSON line a record; lines are whole after every call."""
        try:
            if self._telemetry is None:
                self._telemetry = open(self.path / TELEMETRY, "ab")
            self._telemetry.write(self._lines(records))
            self._telemetry.flush()
        except OSError as error:
            raise OutputError(f"cannot write {self.path / TELEMETRY}: {error.strerror or error}") from None

    def missing_frames(self, first: int, last: int) -> list[int]:
        """Those from `first` to `last` that are not there (any more)."""
        return [k for k in range(first, last + 1) if not (self.path / numbered(FRAMES, k)).is_file()]

    def close(self) -> None:
        """Closes open files, and lets others write there."""
        self._close_telemetry()
        self._lock.release()

    def _lines(self, records: list[dict]) -> bytes:
        lines = []
        for record in records:
            body = json.dumps(record).encode()
            self._sum = zlib.crc32(body, self._sum)
            lines.append(body[:-1] + b', "checksum": "%08x"}\n' % self._sum)
        return b"".join(lines)

    def _close_telemetry(self) -> None:
        if self._telemetry is not None:
            with contextlib.suppress(OSError):  # a failed write was reported then
                self._telemetry.close()
            self._telemetry = None

    def _write_arrays(self, name: str, arrays: dict[str, np.ndarray]) -> None:
        """With its own name in it: a file that was put in another's place is told by that."""
        self._write(self.path / name, pack(arrays | {"name": np.array(name)}))

    def _write(self, path: pathlib.Path, data: bytes) -> None:
        """A folder that vanishes while the run goes on is not made again: its files are lost, which must be said."""
        if path.parent in self._made and not path.parent.is_dir():
            raise OutputError(f"cannot write {path}: {path.parent} was removed while the run went on")
        write_whole(path, data)
        self._made.add(path.parent)


def free_for_a_run(path: pathlib.Path, overwrite: bool, instead: str) -> list[pathlib.Path]:
    """The files there that another run wrote; none unless they may be removed. Nothing is written yet.

    Raises:
        OutputError: they may not be removed, or the path is a file.
    """
    if path.exists() and not path.is_dir():
        raise OutputError(f"{path} is a file, not a folder")
    files = [path / name for name in (MANIFEST, TELEMETRY, GEOMETRY)] + of_frames(path)
    old = [f for f in files if f.is_file()] + sorted(path.glob("**/*.partial"))
    if old and not overwrite:
        raise OutputError(f"{path} holds another run's files ({len(old)}, such as {old[0].name}): choose another folder, or "
                          f"{instead}")
    return old


def of_frames(path: pathlib.Path) -> list[pathlib.Path]:
    """The files of single frames in a run's folder."""
    return [f for kind in (IMAGES, FRAMES, CHECKPOINTS)
            for f in sorted((path / kind).glob("*"), key=lambda file: natural(file.name))
            if NUMBERED.match(f.name) and f.is_file()]


def numbered(kind: str, frame: int) -> str:
    """Name of the file of a frame's arrays, such as "frames/00003.npz"."""
    return f"{kind}/{frame:05d}.npz"


def _number(file: pathlib.Path) -> int:
    """The frame that a file is of."""
    return int(file.name.split(".")[0])


def read_line(line: bytes, total: int) -> tuple[dict, int]:
    """A record of telemetry and the checksum of all lines up to it, from a line and the checksum up to that.

    Raises:
        ValueError: the line is not the one that was written, or not the next one.
    """
    body, _, end = line.rpartition(b', "checksum": "')
    body += b"}"
    total = zlib.crc32(body, total)
    if end != b'%08x"}' % total:
        raise ValueError("its checksum is not that of its content and of the lines before it")
    return json.loads(body), total


def manifest_sum(content: dict) -> str:
    """Checksum of a manifest's content."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def hash_of_file(path: str | os.PathLike) -> str:
    """Hash of a file's content, to tell whether it was edited; "" if there is no file."""
    file = pathlib.Path(path)
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16] if file.is_file() else ""


@contextlib.contextmanager
def written_aside(path: pathlib.Path, suffix: str = ".partial") -> Iterator[pathlib.Path]:
    """A path to write to, of the same name with `suffix`, that takes the place of `path` where all went well.

    Raises:
        OutputError: it cannot be written; an older file stays as it was.
    """
    aside = path.with_name(path.name + suffix)
    try:
        yield aside
        os.replace(aside, path)
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            aside.unlink(missing_ok=True)


def write_whole(path: pathlib.Path, data: bytes) -> None:
    """Writes a file aside and renames it, so that it is whole or not there.

    Raises:
        OutputError: it cannot be written; an older file stays as it was.
    """
    with written_aside(path) as aside:
        path.parent.mkdir(exist_ok=True)
        aside.write_bytes(data)
