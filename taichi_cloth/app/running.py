"""A run: simulates, draws, keeps every frame in a folder, shows its progress. For the command and for `tc.record`."""

import contextlib
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from ..backend.interrupts import noted
from ..backend.timing import compiling
from ..errors import ClothError, OutputError, SimulationError
from ..output.folder import FRAMES, RunFolder
from ..recording import record
from ..recording.resuming import run_of
from ..scene.scene import Scene
from ..simulation import Simulation
from ..step.records import StepRecord
from .progress import Pictures, progress
from .runoptions import RunOptions
from .summary import summary

Change = tuple[int, Callable[[Simulation], Simulation]]


def run(sim: Simulation, options: RunOptions, folder: RunFolder | None, manifest: dict,
        on_frame: Callable[[Simulation, int], None] | None = None, resumed: int | None = None, first: int | None = 0,
        began: float | None = None, said: Callable[[Exception], str] | None = None,
        before: Sequence[StepRecord] | None = None, changes: Iterable[Change] = ()) -> Simulation:
    """Runs a simulation and keeps its frames. However it ends, they are whole and the manifest names the cause.

    Returns the simulation, or the last that took its place.

    Args:
        folder: to be closed at the end; None keeps nothing.
        on_frame: the user's, called before a frame is kept.
        resumed: as in `Simulation.run`; first: frame that the folder has, None if it keeps none.
        began: when it did, by `time.perf_counter`; now if None.
        said: an exception of the user's code in words.
        before: steps that were made before; those of the log if None.
        changes: by frame, functions of the simulation that return another, which goes on from there.
    """
    frames = max(1, round(options.duration * options.fps))
    began, before = time.perf_counter() if began is None else began, sim.log if before is None else before
    with (_kept(sim, options, folder, manifest, resumed, first, began, said or _said, before) as writer,
          progress(frames, options.quicker, writer.pictures if writer else None) as show, noted(_ends_soon) as interrupted):
        def each(sim: Simulation, frame: int) -> None:
            if on_frame is not None:
                on_frame(sim, frame)
            if writer:
                writer.write(frame)
            show(sim, frame)
            if interrupted():
                raise KeyboardInterrupt

        for frame, change in changes:
            if frame >= frames:
                break
            if resumed is None or frame > resumed:
                sim.run(frame / options.fps, options.fps, each, resumed)
            sim, resumed = change(sim), frame
            if writer:
                writer.follow(sim)
        sim.run(options.duration, options.fps, each, resumed)
    return sim


def _ends_soon() -> None:
    print("interrupted: ends after this frame; asked again, at once", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _kept(sim: Simulation, options: RunOptions, folder: RunFolder | None, manifest: dict, resumed: int | None,
          first: int | None, began: float, said: Callable[[Exception], str], before: Sequence[StepRecord]
          ) -> Iterator["Writer | None"]:
    """The writer of frames; the folder's manifest gets the outcome of the run."""
    if folder is None:
        yield None
        return
    outcome, writer, earlier = "interrupted", None, len(before)
    try:
        folder.write_manifest({**manifest, "status": "running", "frames": None if first is None else [first, None]})
        writer = Writer(folder, sim, options, resumed, first, run_of(manifest), before)
        yield writer
        writer.check()
        outcome = "finished"
    except Exception as error:
        known = str(error) if isinstance(error, ClothError) else said(error)
        outcome = f"{'gave up' if isinstance(error, SimulationError) else 'failed'}: {known}"
        raise
    finally:
        with contextlib.closing(folder), (contextlib.suppress(OutputError) if outcome.startswith("failed")
                                          else contextlib.nullcontext()):
            if writer:
                writer.finish(outcome)
                sim = writer.sim
                sim.watchers.remove(writer.steps.append)
            folder.write_manifest({**manifest, "status": outcome, "frames": writer.kept if writer else None,
                                   "simulated_s": sim.time, "wall_s": round(time.perf_counter() - began, 3),
                                   "steps_before": earlier, "summary": summary(sim),
                                   "output_seconds": writer.seconds if writer else {}})


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


class Writer:
    """Writes a run's frames, pictures, telemetry and checkpoints, and counts the time that this takes.

    Attributes:
        seconds: wall time of drawing and of writing, without first launches of kernels; pictures: those that it draws.
    """

    def __init__(self, folder: RunFolder, sim: Simulation, options: RunOptions, resumed: int | None, first: int | None,
                 run: str, before: Iterable[StepRecord]) -> None:
        self.folder, self.sim, self.options, self.run = folder, sim, options, run
        self.first, self.last = first, resumed
        self.seconds = {"draw": 0.0, "write": 0.0}
        self.steps: list[StepRecord] = []  # that are not written yet
        self.geometry = record.geometry(sim)
        folder.write_telemetry([asdict(r) for r in before])
        folder.write_geometry(self.geometry)
        self.artist = _artist(self.geometry, options, sim.scene) if options.size else None
        self.written: int | None = None  # the last frame
        self.kept_state: int | None = resumed  # the frame of the last checkpoint
        self.time = sim.time  # at the last frame [s]
        self.framing = None if self.artist is None else _framing(self.artist)
        self.pictures = Pictures(options.drawn if self.artist else ())
        sim.watchers.append(self.steps.append)

    def write(self, frame: int) -> None:
        """The frame at which the simulation now is."""
        arrays, files = self._timed("draw", lambda: self._drawn(frame))
        self._timed("write", lambda: self._write(frame, arrays, files))

    def _timed(self, part: str, does: Callable[[], Any]) -> Any:
        """What a call returns; the seconds that it takes are added to a part's."""
        begun, built = time.perf_counter(), compiling.seconds
        out = does()
        self.seconds[part] += time.perf_counter() - begun - (compiling.seconds - built)
        return out

    def _write(self, frame: int, arrays: dict[str, np.ndarray], files: dict[str, bytes]) -> None:
        sim, folder = self.sim, self.folder
        for ending, data in files.items():
            folder.write_image(frame, data, ending)
        if self.options.frames:
            folder.write_frame(frame, arrays)
            self.last = frame
        self.flush()
        self.written, self.time = frame, sim.time
        every = self.options.checkpoint_every
        if every and frame % every == 0:
            self._keep_state()

    def follow(self, sim: Simulation) -> None:
        """Another simulation goes on with the run; its cloth may be of another fabric."""
        self.sim, self.geometry = sim, record.geometry(sim)
        sim.watchers.append(self.steps.append)
        self.folder.write_geometry(self.geometry)

    def _keep_state(self) -> None:
        """A checkpoint of the last frame, where the simulation is."""
        if self.written is not None:
            self.folder.write_checkpoint(self.written, self.sim.checkpoint(), self.run)
            self.kept_state = self.written

    def _drawn(self, frame: int) -> tuple[dict[str, np.ndarray], dict[str, bytes]]:
        """(the frame's arrays, its pictures by their files' endings)."""
        arrays = record.frame(self.sim)
        return arrays, self._draw(arrays, frame)

    def _draw(self, arrays: dict[str, np.ndarray], frame: int) -> dict[str, bytes]:
        if self.artist is None or self.framing is None or frame not in self.options.drawn:
            return {}
        from ..recording.drawing import Extras, files_of

        with self.pictures.timed():
            self.framing.see(arrays)
            return files_of(self.artist, arrays, frame, Extras(*self.options.passes))[1]

    def flush(self) -> None:
        """Telemetry of the steps since the last time."""
        self.folder.append_telemetry([asdict(r) for r in self.steps])
        self.steps.clear()

    @property
    def kept(self) -> list[int] | None:
        """First and last frame whose positions are in the folder."""
        return None if self.first is None or self.last is None or self.last < self.first else [self.first, self.last]

    def check(self) -> None:
        """All frames are still there.

        Raises:
            OutputError: some were removed while the run went on.
        """
        missing = self.folder.missing_frames(*self.kept) if self.kept else []
        if missing:
            raise OutputError(f"{self.folder.path / FRAMES}: {len(missing)} frames were removed while the run went on, the "
                              f"first is {missing[0]}")

    def finish(self, outcome: str) -> None:
        """The last steps, and a checkpoint where the run ended at a frame, from which it may go on."""
        self.flush()
        whole = outcome in ("finished", "interrupted") and self.sim.time == self.time
        if whole and self.options.checkpoint_every and self.written != self.kept_state:
            self._keep_state()
        note = self.framing.note(self.folder.path) if self.framing else None
        if note:
            print(f"note: {note}", file=sys.stderr)
        self.seconds = {k: round(v, 4) for k, v in self.seconds.items()}


def _artist(geometry: dict[str, np.ndarray], options: RunOptions, scene: Scene):
    """The artist of the run's frames."""
    from ..output.look import Look
    from ..output.picture import Artist
    from ..recording.expected import expected
    from ..recording.playback import heat_of

    assert options.size is not None
    look = dict(options.look)
    if look.get("heat"):
        look["heat"] = heat_of(look["heat"][0], geometry, look["heat"][1])
    first, last = (k / options.fps for k in (min(options.drawn), max(options.drawn)))
    return Artist(geometry, options.size, Look(**look), lambda: expected(scene, options.duration),
                  lambda: expected(scene, last, first))


def _framing(artist):
    """The counter of pictures that cut cloth off."""
    from ..recording.drawing import Framing

    return Framing(artist)
