"""How far a run is: a bar on a terminal and in a notebook, plain lines elsewhere."""

import contextlib
import html
import sys
import time
from collections.abc import Callable, Iterator

from ..simulation import Simulation

Show = Callable[[Simulation, int], None]
PAUSE = 0.1  # s from one picture of a bar to the next, at least


@contextlib.contextmanager
def progress(frames: int) -> Iterator[Show]:
    """A function (simulation, frame) that shows how far a run of so many frames is."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_jupyter:
        yield _in_notebook(frames)
        return
    if not sys.stderr.isatty():
        yield lambda sim, frame: _line(sim, frame, frames)
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("frame {task.completed}/{task.total}"), BarColumn(), TimeRemainingColumn(),
               TextColumn("{task.fields[state]}"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("", total=frames, state="")
        yield lambda sim, frame: bar.update(task, completed=frame, state=_state(sim))


class Bar:
    """A bar as a notebook shows it: the browser's own. Rich's would need ipywidgets."""

    def __init__(self, frame: int, frames: int, state: str) -> None:
        self.frame, self.frames, self.state = frame, frames, state

    def __repr__(self) -> str:
        return f"frame {self.frame}/{self.frames}  {self.state}"

    def _repr_html_(self) -> str:
        return f'<progress value="{self.frame}" max="{self.frames}"></progress> {html.escape(repr(self))}'


def _in_notebook(frames: int) -> Show:
    from IPython.display import display

    handle = display(Bar(0, frames, "compiling"), display_id=True)
    drawn = 0.0

    def show(sim: Simulation, frame: int) -> None:
        nonlocal drawn
        if frame == frames or time.perf_counter() - drawn > PAUSE:
            drawn = time.perf_counter()
            handle.update(Bar(frame, frames, _state(sim)))

    return show


def _line(sim: Simulation, frame: int, frames: int) -> None:
    every = max(1, frames // 10)
    if frame % every == 0 or frame == frames:
        print(f"frame {frame}/{frames}  {_state(sim)}", file=sys.stderr, flush=True)


def _state(sim: Simulation) -> str:
    if not sim.last:
        return "compiling"
    last, rejected = sim.last, sim.tally.rejections.total()
    return f"t {sim.time:.3f} s  h {last.h * 1e3:.2f} ms  CG {last.iterations}  rejected {rejected}"
