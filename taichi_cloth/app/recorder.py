"""Recording a simulation from Python: the folder that `taichi-cloth run` leaves, for one that a script or a notebook made."""

import contextlib
import os
import time
from collections.abc import Callable

from .. import checks
from ..errors import OutputError, SimulationError
from ..output.folder import RunFolder
from ..recording.recorded import Recording
from ..recording.resuming import run_of
from ..simulation import Simulation
from .runner import RunOptions, Writer, described, progress, summary


def record(sim: Simulation, out: str | os.PathLike, duration: float, fps: float = 30.0,
           on_frame: Callable[[Simulation, int], None] | None = None, overwrite: bool = False,
           checkpoint_every: int = 10, name: str = "python") -> Recording:
    """Runs a simulation from where it is, as `sim.run` does, and keeps every frame in a folder.

    Args:
        out: the folder; one with another run's files is refused.
        duration: [s]; fps: frames a second.
        on_frame: function (simulation, frame), called at the start and at every frame's time, before it is kept.
        overwrite: removes another run's files there, and nothing else.
        checkpoint_every: frames from one checkpoint to the next; 0 writes none.
        name: of the scene, for reports.

    Returns:
        The recording: to be drawn, played, exported, reported.

    Raises:
        SceneError: an impossible value.
        OutputError: the folder holds another run, or cannot be written.
        SimulationError: the simulation gave up; the frames so far are whole.
    """
    checks.instance("record: sim", sim, Simulation)
    folder_path = checks.path("record: out", out, OutputError)
    duration, fps = sim.checked_run(duration, fps)
    checks.maybe(on_frame, checks.function, "record: on_frame", "simulation", "frame")
    options = RunOptions(str(folder_path), duration, fps, overwrite=checks.flag("record: overwrite", overwrite),
                         checkpoint_every=checks.integer("record: checkpoint_every", checkpoint_every, least=0))
    manifest = {**described(sim, options), "scene": checks.name("record: name", name), "path": None, "source": None,
                "settings": {}}
    folder, started = RunFolder(folder_path, options.overwrite), time.perf_counter()
    outcome, writer = "interrupted", None
    try:
        folder.write_manifest({**manifest, "status": "running", "frames": [0, None]})
        writer = Writer(folder, sim, options, None, 0, run_of(manifest))
        with progress(options) as show:
            sim.run(duration, fps, _kept(writer, show, on_frame))
        writer.check()
        outcome = "finished"
    except Exception as error:
        outcome = f"{'gave up' if isinstance(error, SimulationError) else 'failed'}: {type(error).__name__}: {error}"
        raise
    finally:
        with contextlib.closing(folder), (contextlib.suppress(OutputError) if outcome.startswith("failed")
                                          else contextlib.nullcontext()):
            if writer:
                writer.finish()
            folder.write_manifest({**manifest, "status": outcome, "frames": writer.kept if writer else None,
                                   "simulated_s": sim.time, "wall_s": round(time.perf_counter() - started, 3),
                                   "summary": summary(sim), "output_seconds": writer.seconds if writer else {}})
    return Recording(folder_path)


def _kept(writer: Writer, show: Callable[[Simulation, int], None],
          on_frame: Callable[[Simulation, int], None] | None) -> Callable[[Simulation, int], None]:
    """A function of frames that calls the user's, keeps the frame and says how far it is."""
    def keep(sim: Simulation, frame: int) -> None:
        if on_frame is not None:
            on_frame(sim, frame)
        writer.write(frame)
        show(sim, frame)

    return keep
