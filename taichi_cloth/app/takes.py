"""A take: a recorded run that goes on from one of its frames in a folder of its own, with other options, blended in.

The frames up to there are the run's, by hard links where the file system has them. From then on every frame of the blend has
a scene of its own, with options between the old ones and the new. It goes on from the state at the end of the frame before.
"""

import functools
import os
import pathlib
import shutil
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

from ..errors import ClothError, OutputError, SceneError
from ..output.folder import CHECKPOINTS, FRAMES, RunFolder, numbered
from ..output.recording import Recording
from ..recording.resuming import run_of
from ..scene.blending import blend
from ..scene.scene import Scene
from ..simulation import Simulation
from .running import Change
from .scenefile import SceneFile

Ends = Callable[[], tuple[Scene, Scene]]


@dataclass(frozen=True)
class Take:
    """Origin of a take, as its manifest keeps it.

    Attributes:
        parent: folder of the run that it goes on from, as seen from the take's own.
        started: when that run was.
        frame: the last one that they have in common.
        blend: over how many frames options become the new ones.
        was: options of the scene up to then, those that were not left to the scene.
        files: how the run's frames came into this folder, "linked" or "copied".
    """

    parent: str
    started: str
    frame: int
    blend: int
    was: dict
    files: str = ""

    @classmethod
    def of(cls, old: Recording | None, from_frame: int | None) -> "Take | None":
        """The take of a resumed run; None if the run is no take, or is resumed before all options were new."""
        said = None if old is None else old.manifest.get("take")
        if not said:
            return None
        take = cls(**said)
        return take if from_frame is None or from_frame >= take.frame + take.blend else None

    def share(self, frame: int) -> float:
        """Part of the change that is reached from a frame to the next, 0 to 1."""
        return min(max((frame - self.frame + 1) / max(self.blend, 1), 0.0), 1.0)

    def scene(self, scene_file: SceneFile, settings: dict[str, object], frame: int, ends: Ends | None = None) -> Scene:
        """The scene from a frame to the next; ends: makes the scenes that it is between, anew if None."""
        share = self.share(frame)
        if share in (0.0, 1.0):
            return scene_file.make(settings if share else self.was)
        first, last = (scene_file.settings(of) for of in (self.was, settings))
        between = {name: a + share * (b - a) for name, b in last.items()
                   if isinstance(b, float) and isinstance(a := first.get(name), float)}
        was, becomes = ends() if ends else (scene_file.make(first), scene_file.make(last))
        return blend(scene_file.make(last | between), was, becomes, share)

    def changes(self, scene_file: SceneFile, settings: dict[str, object], simulation: dict[str, Any], resumed: int
                ) -> list[Change]:
        """The frames from `resumed` on at which the scene changes, each with the function that makes the next simulation."""
        frames = range(max(self.frame, resumed + 1), self.frame + max(self.blend, 1))
        if not frames or scene_file.settings(settings) == scene_file.settings(self.was):
            return []

        @functools.cache
        def ends() -> tuple[Scene, Scene]:
            first, last = (scene_file.make(scene_file.settings(of)) for of in (self.was, settings))
            return first, last

        def change(frame: int) -> Callable[[Simulation], Simulation]:
            return lambda sim: _going_on(sim, self.scene(scene_file, settings, frame, ends), simulation)

        return [(k, change(k)) for k in frames]

    def check_same(self, scene_file: SceneFile, settings: dict[str, object], resumed: int) -> None:
        """Refuses options that change meshes, where the scene changes after frame `resumed`.

        Raises:
            SceneError: it names them.
        """
        was, becomes = (scene_file.settings(of) for of in (self.was, settings))
        changed = [name for name, value in becomes.items() if value != was.get(name)]
        if not changed or self.share(resumed) == 1.0 and resumed > self.frame:
            return
        first, last = (_sizes(scene_file.make(of)) for of in (self.was, settings))
        if first == last:
            return
        alone = [name for name in changed if _differs(scene_file, self.was | {name: becomes[name]}, first)]
        blamed = "with " + ", ".join(f"{name}={becomes[name]}" for name in alone or changed)
        for (name, count), (_, other) in zip(first, last):
            if count != other:
                raise SceneError(f"take: {name!r} has {count} vertices up to frame {self.frame} and {other} {blamed}: a run "
                                 "goes on with the mesh that it has")
        if len(first) != len(last):
            raise SceneError(f"take: the scene has {len(first)} cloths up to frame {self.frame}, and {len(last)} {blamed}: a "
                             "run goes on with those that it has")


def _sizes(scene: Scene) -> list[tuple[str, int]]:
    """Cloths by name, with their number of vertices."""
    return [(c.name, c.mesh.vertex_count) for c in scene.cloths]


def _differs(scene_file: SceneFile, settings: dict[str, object], first: list[tuple[str, int]]) -> bool:
    """Whether a scene has other cloths, or cannot be."""
    try:
        return _sizes(scene_file.make(settings)) != first
    except ClothError:
        return True


def _going_on(sim: Simulation, scene: Scene, options: dict[str, Any]) -> Simulation:
    """A simulation of another scene that goes on where one is, and counts on; that one is closed."""
    new = Simulation(scene, **options)
    new.resume(sim.checkpoint(), edited=True)
    new.count_on(sim)
    for note in new.notes:
        if note not in sim.notes:
            print(f"note: {note}", file=sys.stderr)
    sim.close()
    return new


def bring(take: Take, parent: Recording, folder: RunFolder, frame: int, manifest: dict) -> Take:
    """Brings the run's frames and checkpoints up to `frame` into a take's folder; the take, with how.

    The last checkpoint becomes the take's own, so that `--resume` goes on from it.

    Raises:
        OutputError: a file cannot be written.
    """
    first = (parent.manifest.get("frames") or [frame + 1])[0]
    states = [k for k in parent.numbers(CHECKPOINTS) if k < frame]
    files = [numbered(FRAMES, k) for k in range(first, frame + 1)] + [numbered(CHECKPOINTS, k) for k in states]
    how = {_bring(parent.path / name, folder.path / name) for name in files} or {"linked"}
    state = parent.last_checkpoint(frame)[1]
    folder.write_checkpoint(frame, state, run_of(manifest))
    return Take(**{**asdict(take), "files": max(how, key=["linked", "copied"].index)})


def _bring(source: pathlib.Path, to: pathlib.Path) -> str:
    try:
        to.parent.mkdir(exist_ok=True)
        try:
            os.link(source, to)
            return "linked"
        except OSError:  # another file system, or one without links
            shutil.copyfile(source, to)
            return "copied"
    except OSError as error:
        raise OutputError(f"cannot write {to}: {error.strerror or error}") from None
