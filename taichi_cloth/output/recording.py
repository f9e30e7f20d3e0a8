"""A finished, or interrupted, run's folder, read back."""

import json
import os
import pathlib

import numpy as np

from ..errors import OutputError
from .folder import CHECKPOINTS, FRAMES, GEOMETRY, MANIFEST, TELEMETRY, unpack


class Recording:
    """What a run left in its folder.

    Attributes:
        manifest: as it was written.
        notes: what was found damaged, and done about it.

    Raises:
        OutputError: the folder is no run's.
    """

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = pathlib.Path(path)
        self.notes: list[str] = []
        file = self.path / MANIFEST
        if not file.is_file():
            raise OutputError(f"{self.path} is no run's folder: it has no {MANIFEST}")
        try:
            self.manifest: dict = json.loads(file.read_text())
        except ValueError as error:
            raise OutputError(f"{file} is damaged: {error}") from None
        self._geometry: dict[str, np.ndarray] | None = None

    @property
    def geometry(self) -> dict[str, np.ndarray]:
        """What does not change; see `record.geometry`."""
        if self._geometry is None:
            self._geometry = unpack(self.path / GEOMETRY)
        return self._geometry

    def frames(self) -> list[int]:
        """Numbers of the frames with positions.

        Raises:
            OutputError: there are none.
        """
        numbers = self._numbers(FRAMES)
        if not numbers:
            raise OutputError(f"{self.path} has no frames: the run kept none (--no-frames) or ended before the first")
        return numbers

    def frame(self, number: int) -> dict[str, np.ndarray]:
        """What moves, at a frame; see `record.frame`."""
        return unpack(self.path / FRAMES / f"{number:05d}.npz")

    def telemetry(self) -> list[dict]:
        """A record a step; a last line that is not whole is left out."""
        file = self.path / TELEMETRY
        out = []
        for line in file.read_text().splitlines() if file.is_file() else []:
            try:
                out.append(json.loads(line))
            except ValueError:
                self.notes.append(f"{file}: line {len(out) + 1} is not whole and was left out with what follows")
                break
        return out

    def last_checkpoint(self, frame: int | None = None) -> tuple[int, dict[str, np.ndarray]]:
        """(frame, state) of the last whole checkpoint, not after `frame` where that is given.

        Raises:
            OutputError: there is none.
        """
        numbers = [k for k in self._numbers(CHECKPOINTS) if frame is None or k <= frame]
        for number in reversed(numbers):
            try:
                state = unpack(self.path / CHECKPOINTS / f"{number:05d}.npz")
            except OutputError as error:
                self.notes.append(f"{error}; the one before it is used")
                continue
            if frame is not None and number < frame:
                self.notes.append(f"frame {frame} has no checkpoint: the nearest before it is frame {number}")
            return number, state
        raise OutputError(f"{self.path} has no whole checkpoint" + (f" up to frame {frame}" if frame is not None else "")
                          + f" ({len(numbers)} damaged)" * bool(numbers))

    def _numbers(self, kind: str) -> list[int]:
        return sorted(int(f.stem) for f in (self.path / kind).glob("*.npz") if f.stem.isdigit())
