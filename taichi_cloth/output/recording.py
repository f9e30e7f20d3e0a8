"""A finished, or interrupted, run's folder, read back; damaged parts are named, and never used."""

import os
import pathlib

import numpy as np

from .. import checks
from ..errors import OutputError, near
from ..io import npz
from ..io.jsonfile import parse_json
from ..renamed import StepNumbers
from .folder import CHECKPOINTS, FORMAT, FRAMES, GEOMETRY, MANIFEST, TELEMETRY, manifest_sum, numbered, read_line


class Recording:
    """A run in its folder.

    Attributes:
        manifest: as it was written.
        notes: damage that was found, and repairs.
        speed: seconds of the run in a second of its frames.

    Raises:
        OutputError: the folder is no run's, or its manifest is damaged.
    """

    speed = 1.0

    def __init__(self, path: str | os.PathLike) -> None:
        self.path = checks.path("recording: path", path, OutputError)
        self.notes: list[str] = []
        file = self.path / MANIFEST
        if not file.is_file():
            raise OutputError(f"{self.path} is not a run's folder: it has no {MANIFEST}{near(self.path)}")
        try:
            self.manifest: dict = parse_json(file.read_bytes())
            if self.manifest.pop("checksum", "") != manifest_sum(self.manifest):
                raise ValueError("its checksum is not that of its content")
        except (OSError, ValueError, AttributeError, TypeError) as error:
            raise OutputError(f"{file} is damaged: {error}") from None
        self._geometry: dict[str, np.ndarray] | None = None

    @property
    def geometry(self) -> dict[str, np.ndarray]:
        """Constant data; see `record.geometry`."""
        if self._geometry is None:
            self._geometry = self._arrays(GEOMETRY)
        return self._geometry

    @property
    def kept(self) -> tuple[int, int] | None:
        """First and last frame whose positions the run kept; None if it kept none, or did not end by itself."""
        kept = self.manifest.get("frames")
        return tuple(kept) if kept and kept[1] is not None else None

    def frames(self) -> list[int]:
        """Numbers of the frames with positions.

        Raises:
            OutputError: there are none, or some are missing.
        """
        there = self.numbers(FRAMES)
        if not there:
            raise OutputError(f"{self.path} has no frames: the run kept none (--no-frames) or ended before the first")
        first, last = self.kept or ((self.manifest.get("frames") or [there[0]])[0], there[-1])
        numbers = list(range(first, last + 1))
        missing = sorted(set(numbers) - set(there))
        if missing:
            raise OutputError(f"{self.path / numbered(FRAMES, missing[0])} is missing, {len(missing)} of {len(numbers)} are: "
                              "--from-frame simulates from an earlier one again")
        return numbers

    def time(self, frame: int) -> float:
        """Time of a frame [s]: recording began at frame 0."""
        return float(self.manifest.get("begins", 0.0)) + frame / self.fps

    @property
    def fps(self) -> float:
        """Frames a second."""
        return float(self.manifest.get("fps", 24))

    def frame(self, number: int) -> dict[str, np.ndarray]:
        """Moving data of a frame; see `record.frame`."""
        return self._arrays(numbered(FRAMES, number))

    def telemetry(self) -> list[dict]:
        """A record a step; a last line that was not finished is left out.

        Raises:
            OutputError: a line is damaged, or lines are missing.
        """
        records, damage = self.whole_telemetry()
        steps = self.manifest.get("summary", {}).get("steps", len(records))
        if damage or len(records) != steps:
            raise OutputError(damage or f"{self.path / TELEMETRY} is damaged: it has {len(records)} lines of {steps}")
        return records

    def whole_telemetry(self) -> tuple[list[dict], str]:
        """The records up to the first line that is damaged, and a sentence about that, or ""."""
        file = self.path / TELEMETRY
        try:
            data = file.read_bytes() if file.is_file() else b""
        except OSError as error:
            return [], f"{file} cannot be read: {error.strerror or error}"
        *lines, rest = data.split(b"\n")
        out: list[dict] = []
        total = 0
        for line in lines:
            try:
                record, total = read_line(line, total)
            except ValueError as error:
                return out, f"{file} is damaged in line {len(out) + 1}: {error}"
            out.append(StepNumbers.of_any_version(record))
        if rest:
            self.notes.append(f"{file}: line {len(out) + 1} is not whole and was left out")
        return out, ""

    def last_checkpoint(self, frame: int | None = None, run: str | None = None,
                        records: int | None = None) -> tuple[int, dict[str, np.ndarray]]:
        """(frame, state) of the last whole checkpoint.

        Args:
            frame: it is not after this one.
            run: it is of this run; see `RunFolder.write_checkpoint`.
            records: it is not after this number of steps.

        Raises:
            OutputError: there is none.
        """
        numbers = [k for k in self.numbers(CHECKPOINTS) if frame is None or k <= frame]
        for number in reversed(numbers):
            path = self.path / numbered(CHECKPOINTS, number)
            try:
                state = _checkpoint(path, self._arrays(numbered(CHECKPOINTS, number)), run)
                if records is not None and int(state["records"]) > records:
                    raise OutputError(f"{path} is of step {int(state['records'])}, and {TELEMETRY} has {records} whole lines")
            except OutputError as error:
                self.notes.append(f"{error}; the one before it is used")
                continue
            if frame is not None and number < frame:
                self.notes.append(f"frame {frame} has no checkpoint: the nearest before it is frame {number}")
            return number, state
        reasons = "".join(f"; {note.removesuffix('; the one before it is used')}" for note in self.notes)
        up_to = f" up to frame {frame}" if frame is not None else ""
        raise OutputError(f"{self.path} has no whole checkpoint{up_to}{reasons}")

    def _arrays(self, name: str) -> dict[str, np.ndarray]:
        """The value that was written under this name."""
        path = self.path / name
        try:
            arrays = npz.unpack(path)
        except FileNotFoundError:
            raise OutputError(f"{path} is missing") from None
        except npz.DamagedError as error:
            raise OutputError(f"{path} is damaged: {error}") from None
        written = str(arrays.pop("name", "nothing known"))
        if written != name:
            raise OutputError(f"{path} is damaged: it is {written}")
        return arrays

    def numbers(self, kind: str) -> list[int]:
        """Numbers of the files of a kind, `FRAMES` or `CHECKPOINTS`, whether they are whole or not."""
        return sorted(int(f.stem) for f in (self.path / kind).glob("*.npz") if f.stem.isascii() and f.stem.isdigit())


def _checkpoint(path: pathlib.Path, state: dict[str, np.ndarray], run: str | None) -> dict[str, np.ndarray]:
    """The state in a checkpoint's arrays, of this version and this run."""
    form, of = int(state.pop("format", np.array(1))), str(state.pop("run", ""))
    if form != FORMAT:
        raise OutputError(f"{path} is of another version: its format is {form}, not {FORMAT}")
    if run is not None and of != run:
        raise OutputError(f"{path} is of another run, or of this one before it was edited: --from-frame takes it all the same")
    return state
