"""Wall time by part of a step, as in the paper's Table 1."""

import contextlib
import functools
import time
from collections.abc import Callable, Iterator


class Clock:
    """Adds up seconds by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    @contextlib.contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Times a part; the parts of one name add up."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start


class Stopwatch:
    """Wall time of an object's methods, see `timed`.

    Attributes:
        tell: is called when it starts, where somebody shows that.
    """

    def __init__(self) -> None:
        self.seconds, self.runs = 0.0, False
        self.tell: Callable[[], None] | None = None

    def start(self) -> float:
        """When it starts, by `time.perf_counter` [s]."""
        if self.tell is not None:
            self.tell()
        return time.perf_counter()

    @contextlib.contextmanager
    def told(self, tell: Callable[[], None]) -> Iterator[None]:
        """Within it a function is called whenever it starts."""
        self.tell = tell
        try:
            yield
        finally:
            self.tell = None


compiling = Stopwatch()  # first launches of kernels: they compile, or read kernels that were compiled before


def timed(method):
    """Adds a method's wall time to the `watch` of its object; those it calls in turn are not counted again."""

    @functools.wraps(method)
    def inner(self, *args):
        watch = self.watch
        if watch.runs:
            return method(self, *args)
        watch.runs, began = True, time.perf_counter()
        try:
            return method(self, *args)
        finally:
            watch.runs = False
            watch.seconds += time.perf_counter() - began

    return inner
