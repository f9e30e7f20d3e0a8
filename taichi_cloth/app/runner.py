"""A run from scene file to folder; and going on with one that ended early."""

import sys
import time

from ..errors import ClothError, ScriptError
from ..output.folder import RunFolder, hash_of_file
from ..output.recording import Recording
from ..recording.resuming import kept_from, resume
from ..simulation import Simulation
from .running import RunOptions, run
from .scenefile import SceneFile, said
from .summary import described

INSTEAD = "--resume goes on with that run, --overwrite removes them"


def simulate(scene_file: SceneFile, options: RunOptions) -> tuple[Simulation, float]:
    """Builds the scene, runs it, writes its folder; the simulation, and its time [s] where this began.

    Raises:
        ClothError: by what went wrong; the frames so far are whole.
    """
    scene, began = scene_file.make(options.settings), time.perf_counter()
    sim = Simulation(scene, **options.simulation)
    _print(sim.notes)
    manifest = _manifest(scene_file, sim, options)
    old = Recording(options.out) if options.resume and options.out else None
    last = round(options.duration * options.fps)
    resumed, before = resume(sim, old, manifest, last, options.from_frame, options.force) if old else (None, None)
    start = sim.time
    first = kept_from(old, resumed, options.frames)
    told = len(sim.notes)
    # only now, when nothing in the request is wrong any more, may an earlier run's files go
    folder = RunFolder(options.out, options.overwrite, resumed, INSTEAD) if options.out else None
    try:
        run(sim, options, folder, manifest, None, resumed, first, began, lambda error: said(error, scene_file.path),
            before)
    except ClothError:
        raise
    except Exception as error:
        raise ScriptError(f"scene {scene_file.name}: {said(error, scene_file.path)}") from error
    finally:
        _print(sim.notes[told:])
    return sim, start


def _print(notes: list[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def _manifest(scene_file: SceneFile, sim: Simulation, options: RunOptions) -> dict:
    resolved = {name: p.default for name, p in scene_file.options.items() if p.default is not p.empty}
    settings = scene_file.typed(options.settings)
    return {
        **described(sim, options.duration, options.fps, options.size), "scene": scene_file.name,
        "path": scene_file.path, "source": hash_of_file(scene_file.path),
        "settings": {k: v if isinstance(v, (int, float, bool)) else str(v) for k, v in {**resolved, **settings}.items()}}
