"""Recording a simulation from Python: the folder that `taichi-cloth run` leaves, for one that a script or a notebook made."""

import os
import sys
import time
from collections.abc import Callable

from .. import checks
from ..errors import OutputError
from ..output.folder import RunFolder
from ..recording.recorded import Recording
from ..scene.reading import only_described
from ..simulation import Simulation
from .running import run
from .runoptions import RunOptions
from .summary import describe, described


def record(sim: Simulation, out: str | os.PathLike, duration: float, fps: float = 30.0,
           on_frame: Callable[[Simulation, int], None] | None = None, overwrite: bool = False,
           checkpoint_every: int = 10, name: str = "python") -> Recording:
    """Runs a simulation from where it is, as `sim.run` does, and keeps every frame in a folder.

    Progress, and the last lines of `taichi-cloth run`, go to the standard error.

    Args:
        out: the folder; one with another run's files is refused.
        duration: [s]; fps: frames a second.
        on_frame: function (simulation, frame), called at the start and at every frame's time, before it is kept.
        overwrite: removes another run's files there, and nothing else.
        checkpoint_every: frames from one checkpoint to the next; 0 writes none.
        name: of the scene, for reports.

    Returns:
        The recording: to be drawn, exported, reported, and played: `recording.play().save("run.html")` is a page that needs
        nothing else, `.show()` opens it in a browser.

    Raises:
        SceneError: an impossible value.
        OutputError: the folder holds another run, or cannot be written.
        SimulationError: the simulation gave up; the frames so far are whole.
    """
    only_described("tc.record")
    checks.instance("record: sim", sim, Simulation)
    folder_path = checks.path("record: out", out, OutputError)
    duration, fps = sim.checked_run(duration, fps)
    checks.maybe(on_frame, checks.function, "record: on_frame", "simulation", "frame")
    options = RunOptions(str(folder_path), duration, fps, overwrite=checks.flag("record: overwrite", overwrite),
                         checkpoint_every=checks.integer("record: checkpoint_every", checkpoint_every, least=0))
    manifest = {**described(sim, duration, fps, None), "scene": checks.name("record: name", name), "path": None,
                "source": None, "settings": {}, "begins": sim.time}
    began, start = time.perf_counter(), sim.time
    run(sim, options, RunFolder(folder_path, options.overwrite), manifest, on_frame, began=began)
    recording = Recording(folder_path)
    spent = recording.manifest.get("output_seconds")
    print(describe(sim, time.perf_counter() - began, start, str(folder_path), spent=spent), file=sys.stderr)
    return recording
