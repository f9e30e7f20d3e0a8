"""Options of a run. No Taichi: the command line reads its flags before that is imported."""

import functools
from dataclasses import dataclass, field

# than to choose another folder, where one holds a run's files
INSTEAD = "--resume goes on with that run, --overwrite removes them"
INSTEAD_OF_TAKE = "--overwrite removes them (`taichi-cloth run` of its scene goes on with it, with --resume)"


@dataclass(frozen=True)
class RunOptions:
    """Options of a run on the command line.

    Attributes:
        out: folder, or None to write nothing.
        size: of the pictures [pixels], or None for no pictures.
        simulation: arguments of `Simulation`.
        settings: options of the scene's build.
        look: as `look_flags.look_of` gives it.
        pictures: which frames are drawn, as `drawing.numbers_in` reads it; "" is all.
        passes: as `look_flags.passes_of` gives it.
        checkpoint_every: frames; 0 writes none.
        frames: whether positions are kept, for rendering again and for export.
        resume: goes on with the run in `out`; from its last whole checkpoint, or from that of frame `from_frame` or the
            last one before it.
        quicker: sentence on how the command would take less time; "" if none is known.
        force: goes on though the scene or its parameters have changed.
    """

    out: str | None
    duration: float
    fps: float
    size: tuple[int, int] | None = None
    overwrite: bool = False
    settings: dict = field(default_factory=dict)
    simulation: dict = field(default_factory=dict)
    look: dict = field(default_factory=dict)
    pictures: str = ""
    passes: tuple[tuple[str, ...], str] = ((), "npy")
    checkpoint_every: int = 10
    frames: bool = True
    resume: bool = False
    from_frame: int | None = None
    force: bool = False
    quicker: str = ""

    @functools.cached_property
    def drawn(self) -> set[int]:
        """Numbers of the frames that are drawn."""
        from ..recording.drawing import numbers_in

        there = range(round(self.duration * self.fps) + 1)
        return set(numbers_in(self.pictures, there) if self.pictures else there)
