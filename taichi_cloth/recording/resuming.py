"""Resuming a run that ended early: from which checkpoint, and whether it is the same run."""

import hashlib
import json
import sys

from ..errors import OutputError, SceneError
from ..output.recording import Recording
from ..simulation import Simulation
from ..step.records import StepRecord

DECIDES = ("taichi_cloth", "scene", "source", "settings", "fps", "simulation", "runtime")


def resume(sim: Simulation, old: Recording, manifest: dict, last: int, from_frame: int | None, force: bool
           ) -> tuple[int, list[StepRecord]]:
    """Puts a new simulation where an earlier run's checkpoint was; the frame of that, and the steps up to it.

    Args:
        manifest: of the run that is to go on.
        last: the last frame that is wanted.
        from_frame: the last checkpoint up to this frame is taken, though the scene may have been edited.
        force: goes on though parameters have changed, or earlier frames are damaged.

    Raises:
        OutputError: there is no whole checkpoint, or frames before it are damaged.
        SceneError: the scene or its parameters are not that run's, or it is longer than the duration asked for.
    """
    lenient = force or from_frame is not None
    if not lenient:
        changes = differences({k: old.manifest.get(k) for k in DECIDES}, {k: manifest[k] for k in DECIDES})
        if changes:
            raise SceneError(f"{old.path} was run differently: {'; '.join(changes)}. --force goes on all the same, "
                             "--from-frame K from frame K, and `taichi-cloth take` in a folder of its own")
    there = old.manifest.get("frames")
    if from_frame is not None and there and there[1] is not None and from_frame > there[1]:
        raise SceneError(f"{old.path}: frame {from_frame} is not there; there are {there[0]} to {there[1]}")
    records, damage = old.whole_telemetry()
    if damage:
        old.notes.append(damage)
    frame, state = old.last_checkpoint(from_frame, None if lenient else run_of(manifest), len(records))
    if frame > last:
        raise SceneError(f"{old.path} is at frame {frame} already, and this request ends at frame {last}: --from-frame "
                         "goes back")
    if not force:
        _check_frames(old, frame)
    for note in old.notes:
        print(f"note: {note}", file=sys.stderr)
    known = len(sim.notes)
    sim.resume(state, edited=lenient)
    for said in sim.notes[known:]:
        print(f"note: {said}", file=sys.stderr)
    steps = [StepRecord(**r) for r in records[: int(state["records"])]]
    sim.recall(steps)
    return frame, steps


def kept_from(old: Recording | None, resumed: int | None, keeps: bool) -> int | None:
    """The first frame whose positions are in the folder of a run that goes on, or None if it keeps none."""
    if old is not None and resumed is not None and old.manifest.get("frames"):
        return int(old.manifest["frames"][0])
    return None if not keeps else 0 if resumed is None else resumed + 1


def run_of(manifest: dict) -> str:
    """Data that tell runs apart that must not go on with each other's checkpoints."""
    decisive = {k: manifest[k] for k in DECIDES}
    return hashlib.sha256(json.dumps(decisive, sort_keys=True, default=str).encode()).hexdigest()


def differences(a: object, b: object, name: str = "") -> list[str]:
    """Sentences on where two nested dicts differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        out = []
        for key in [*a, *(k for k in b if k not in a)]:
            out += differences(a.get(key), b.get(key), f"{name}.{key}" if name else str(key))
        return out
    same = a == b or (isinstance(a, (list, tuple)) and isinstance(b, (list, tuple)) and list(a) == list(b))
    return [] if same else [f"{name} was {a!r} and is {b!r}"]


def _check_frames(old: Recording, frame: int) -> None:
    """Files of the run up to a frame stay as they are: they must be whole."""
    first, last = old.manifest.get("frames") or (frame + 1, None)
    for k in range(first, min(frame, frame if last is None else last) + 1):
        try:
            old.frame(k)
        except OutputError as error:
            raise OutputError(f"{error}: --from-frame {max(k - 1, 0)} simulates it again, where there is a checkpoint before "
                              "it; --force goes on without it") from None
