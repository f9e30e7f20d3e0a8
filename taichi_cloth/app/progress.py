"""Progress of a run: a bar on a terminal and in a notebook, plain lines elsewhere."""

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator

from ..backend.timing import compiling
from ..errors import many
from ..simulation import Simulation

Show = Callable[[Simulation, int], None]
BAR = 10  # letters wide
BUILDING, UNKNOWN = "building kernels", "no estimate yet"
FEW, LATELY = 3, 3  # frames that an estimate is made from, at least; part of those so far, the last ones, by which it may rise
EARLY = 5  # part of a run in which its estimate is said to be one of the rate so far: cloth that has not landed yet is quick
LONG = 300.0  # s that a run is to take for a note on a quicker one
PAUSE = 0.1  # s from one picture of a bar to the next, at least


@contextlib.contextmanager
def progress(frames: int, quicker: str = "") -> Iterator[Show]:
    """A function (simulation, frame) that shows how far a run of so many frames is.

    Args:
        quicker: how to make it quicker, which is said where it takes long.
    """
    from rich.console import Console

    console, left = Console(stderr=True), Left(frames, quicker)
    if console.is_jupyter:
        yield _in_notebook(frames, left)
        return
    if not sys.stderr.isatty():
        yield lambda sim, frame: _line(sim, frame, frames, left)
        return
    from rich.progress import BarColumn, Progress, TextColumn

    columns = (TextColumn("frame {task.completed}/{task.total}"), BarColumn(BAR), TextColumn("{task.fields[state]}"))
    room = console.width - len(f"frame {frames}/{frames}") - BAR - 2
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("", total=frames, state="")

        def building() -> None:
            if bar.tasks[0].fields["state"] != BUILDING:
                bar.update(task, state=BUILDING, refresh=True)

        with compiling.told(building):
            yield lambda sim, frame: bar.update(task, completed=frame, state=_state(sim, left(frame), room))


class Left:
    """Estimate of a run's remaining time, from its frames so far: by the mean of all, or of the last third where that is more.

    The first frame does not count, nor does the time of first launches of kernels. A frame that spent most of its time on
    these is reported as `BUILDING` instead. The first estimate of a long run comes with a note on how it is quicker.
    """

    def __init__(self, frames: int, quicker: str = "") -> None:
        self.frames, self.quicker = frames, quicker
        self.ends: list[float] = []  # times of the frames that count, and of the one before them, without kernels [s]
        self.seen, self.last, self.built = 0, 0.0, 0.0  # calls; time, and time spent on kernels, at the last of them [s]

    def __call__(self, frame: int) -> str:
        """In words, at the end of a frame; "" at the end of the last."""
        now, built = time.perf_counter(), compiling.seconds
        took, building = now - self.last, built - self.built
        self.last, self.built = now, built
        self.seen += 1
        if self.seen > 1:
            self.ends.append(now - built)
        if frame >= self.frames:
            return ""
        if self.ends and building > took / 2:
            return BUILDING
        if len(self.ends) <= FEW:
            return UNKNOWN
        seconds = self._rate() * (self.frames - frame)
        if self.quicker and seconds > LONG:
            print(f"note: this run takes about {in_words(seconds)} more; {self.quicker}", file=sys.stderr, flush=True)
        self.quicker = ""
        return f"about {in_words(seconds)} left" + (" at this rate" if EARLY * frame < self.frames else "")

    def _rate(self) -> float:
        """Seconds a frame."""
        count = len(self.ends) - 1
        lately = max(FEW, count // LATELY)
        return max((self.ends[-1] - self.ends[-1 - k]) / k for k in (count, lately))


def in_words(seconds: float) -> str:
    """A duration such as "40 s", "12 min" or "3 h 20 min"."""
    minutes = round(seconds / 60)
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"


class Bar:
    """A bar as a notebook shows it: the browser's own. Rich's would need ipywidgets."""

    def __init__(self, frame: int, frames: int, state: str) -> None:
        self.frame, self.frames, self.state = frame, frames, state

    def __repr__(self) -> str:
        return f"frame {self.frame}/{self.frames}  {self.state}"

    def _repr_html_(self) -> str:
        return f'<progress value="{self.frame}" max="{self.frames}"></progress> {html.escape(repr(self))}'


def _in_notebook(frames: int, left: Left) -> Show:
    from IPython.display import display

    handle = display(Bar(0, frames, BUILDING), display_id=True)
    drawn = 0.0

    def show(sim: Simulation, frame: int) -> None:
        nonlocal drawn
        more = left(frame)
        if frame == frames or time.perf_counter() - drawn > PAUSE:
            drawn = time.perf_counter()
            handle.update(Bar(frame, frames, _state(sim, more)))

    return show


def _line(sim: Simulation, frame: int, frames: int, left: Left) -> None:
    more, every = left(frame), max(1, frames // 10)
    if frame % every == 0 or frame == frames:
        print(f"frame {frame}/{frames}  {_state(sim, more)}", file=sys.stderr, flush=True)


def _state(sim: Simulation, left: str, room: int = 1000) -> str:
    """Simulated time, remaining time, repeated steps, size and CG iterations of the last step; as many as there is room
    for."""
    if not sim.last:
        return f"{BUILDING}, {UNKNOWN}"
    last, rejected = sim.last, sim.tally.rejections.total()
    parts = [f"{sim.time:.3f} s simulated", left, f"{many(rejected, 'step')} tried again" if rejected else "",
             f"step {last.h * 1e3:.3g} ms", many(last.iterations, "iteration")]
    parts = [part for part in parts if part]
    while len(", ".join(parts)) > room and len(parts) > 1:
        parts.pop()
    return ", ".join(parts)
