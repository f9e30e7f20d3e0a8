"""Progress of a run: a bar on a terminal and in a notebook, plain lines elsewhere."""

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterable, Iterator

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
def progress(frames: int, quicker: str = "", pictures: "Pictures | None" = None) -> Iterator[Show]:
    """A function (simulation, frame) that shows how far a run of so many frames is.

    Args:
        quicker: how to make it quicker, which is said where it takes long.
        pictures: those that it draws.
    """
    from rich.console import Console

    console, left = Console(stderr=True), Left(frames, quicker, pictures)
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


class Pictures:
    """Pictures of a run, and the time that they take.

    Args:
        frames: numbers of those that are drawn.

    Attributes:
        took: of each picture so far, without first launches of kernels [s].
    """

    def __init__(self, frames: Iterable[int] = ()) -> None:
        self.frames = set(frames)
        self.took: list[float] = []

    @contextlib.contextmanager
    def timed(self) -> Iterator[None]:
        """Times one."""
        began, built = time.perf_counter(), compiling.seconds
        yield
        self.took.append(time.perf_counter() - began - (compiling.seconds - built))

    def left(self, frame: int) -> int:
        """How many come after a frame."""
        return sum(k > frame for k in self.frames)


class Left:
    """Estimate of a run's remaining time, from its frames and its pictures so far: by the mean of all, or of the last third
    where that is more.

    The first frame and the first picture do not count, nor does the time of first launches of kernels. A frame that spent most
    of its time on these is reported as `BUILDING` instead. The first estimate of a long run comes with a note on how it is
    quicker. Before the first picture the estimate is of the frames alone, and says so.
    """

    def __init__(self, frames: int, quicker: str = "", pictures: Pictures | None = None) -> None:
        self.frames, self.quicker, self.pictures = frames, quicker, pictures or Pictures()
        self.ends: list[float] = []  # of the frames that count, and of the one before them, without kernels and pictures [s]
        self.seen, self.last, self.built = 0, 0.0, 0.0  # calls; time, and time spent on kernels, at the last of them [s]

    def __call__(self, frame: int) -> str:
        """In words, at the end of a frame; "" at the end of the last."""
        now, built = time.perf_counter(), compiling.seconds
        took, building = now - self.last, built - self.built
        self.last, self.built = now, built
        self.seen += 1
        if self.seen > 1:
            self.ends.append(now - built - sum(self.pictures.took))
        if frame >= self.frames:
            return ""
        if self.ends and building > took / 2:
            return BUILDING
        if len(self.ends) <= FEW:
            return UNKNOWN
        to_draw, each = self.pictures.left(frame), self.pictures.took
        unknown = f" and {many(to_draw, 'picture')}" if to_draw and not each else ""
        seconds = self._rate() * (self.frames - frame) + (_dearest(each[1:] or each) * to_draw if each else 0.0)
        if self.quicker and seconds > LONG:
            print(f"note: this run takes about {in_words(seconds)} more; {self.quicker}", file=sys.stderr, flush=True)
        self.quicker = ""
        return f"about {in_words(seconds)}{unknown} left" + (" at this rate" if EARLY * frame < self.frames else "")

    def _rate(self) -> float:
        """Seconds a frame, without its picture."""
        return _dearest([b - a for a, b in zip(self.ends, self.ends[1:])])


def _dearest(seconds: list[float]) -> float:
    """The mean of all, or of the last third where that is more."""
    lately = max(FEW, len(seconds) // LATELY)
    return max(sum(part) / len(part) for part in (seconds, seconds[-lately:]))


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
