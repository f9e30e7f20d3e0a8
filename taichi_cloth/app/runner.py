"""A run from scene file to folder; and going on with one that ended early."""

import sys
import time
from dataclasses import asdict

from ..errors import ClothError, OutputError, ScriptError
from ..output.folder import RunFolder, hash_of_file
from ..output.recording import Recording
from ..recording.resuming import kept_from, resume
from ..scene.scene import Scene
from ..simulation import Simulation
from .running import run
from .runoptions import INSTEAD, INSTEAD_OF_TAKE, RunOptions
from .scenefile import SceneFile, plain, said
from .summary import described
from .takes import Take, bring


def simulate(scene_file: SceneFile, options: RunOptions, take: Take | None = None, parent: Recording | None = None,
             built: Scene | None = None) -> tuple[Simulation, float]:
    """Builds the scene, runs it, writes its folder; the simulation, and its time [s] where this began.

    Args:
        take, parent: how, and from which run, the new run in this folder goes on.
        built: the scene with these options, where it is at hand; a take has others.

    Raises:
        ClothError: the scene, the options, the run or its folder failed; the frames so far are whole.
    """
    old = parent or (Recording(options.out) if options.resume and options.out else None)
    take = take or Take.of(old, options.from_frame)
    at = Recording(old.path).last_checkpoint(options.from_frame)[0] if old and take else 0
    if take:
        take.check_same(scene_file, options.settings, at)
    scene = take.scene(scene_file, options.settings, at) if take else built or scene_file.make(options.settings)
    began = time.perf_counter()
    sim = Simulation(scene, **options.simulation)
    _print(sim.notes)
    manifest = _manifest(scene_file, sim, options)
    last = round(options.duration * options.fps)
    resumed, before = resume(sim, old, manifest, last, options.from_frame, options.force) if old else (None, None)
    start = sim.time
    if take and resumed is not None and take.share(at) != take.share(resumed):
        raise OutputError(f"{options.out}: the checkpoint of frame {at} is of another run, or its telemetry is damaged: take "
                          "it again")
    changes = take.changes(scene_file, options.settings, options.simulation, resumed or 0) if take else []
    first = kept_from(old, resumed, options.frames)
    told = len(sim.notes)
    # only now, when nothing in the request is wrong any more, may an earlier run's files go
    folder = _folder(options, take, parent, resumed, manifest)
    if resumed is not None:
        print(f"going on from frame {resumed}, t = {start:g} s", file=sys.stderr)
    try:
        sim = run(sim, options, folder, manifest, None, resumed, first, began, lambda error: said(error, scene_file.path),
                  before, changes)
    except ClothError:
        raise
    except Exception as error:
        raise ScriptError(f"scene {scene_file.name}: {said(error, scene_file.path)}") from error
    finally:
        _print(sim.notes[told:])
    return sim, start


def _folder(options: RunOptions, take: Take | None, parent: Recording | None, resumed: int | None, manifest: dict
            ) -> RunFolder | None:
    """The folder of the run, with the frames that a take begins with; the manifest names their run."""
    if options.out is None:
        return None
    folder = RunFolder(options.out, options.overwrite, None if parent else resumed, INSTEAD_OF_TAKE if parent else INSTEAD)
    try:
        if take and parent and resumed is not None:
            take = bring(take, parent, folder, resumed, manifest)
    except BaseException:
        folder.close()
        raise
    if take:
        manifest["take"] = asdict(take)
    return folder


def _print(notes: list[str]) -> None:
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def _manifest(scene_file: SceneFile, sim: Simulation, options: RunOptions) -> dict:
    return {
        **described(sim, options.duration, options.fps, options.size), "scene": scene_file.name,
        "path": scene_file.path, "source": hash_of_file(scene_file.path),
        "settings": {name: plain(value) for name, value in scene_file.settings(options.settings).items()}}
