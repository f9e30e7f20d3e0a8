"""Signals that ask a process to end: Ctrl-C, SIGTERM and SIGHUP are one and the same."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from typing import Any

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")
Asked = Callable[[], bool]  # whether the process was asked to end


@contextlib.contextmanager
def handled(handler: Callable) -> Iterator[dict[int, Any]]:
    """`handler(number, frame)` is called by those signals that are not ignored (as SIGHUP is under nohup); only Python's main
    thread may set that, elsewhere nothing changes. Gives the handlers before, by number."""
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, handler)
    try:
        yield before
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextlib.contextmanager
def raised() -> Iterator[None]:
    """Within it those signals raise KeyboardInterrupt wherever they arrive.

    An exception that comes of it is one, too: an import, or an object that was half made, may end with any other.
    """
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        asked.append(number)
        raise KeyboardInterrupt

    with handled(ask):
        try:
            yield
        except Exception:
            if asked:
                raise KeyboardInterrupt from None
            raise


@contextlib.contextmanager
def noted(tell: Callable[[], object] = lambda: None) -> Iterator[Asked]:
    """Within it the first of those signals is noted, and `tell` called; the next does as it did before, or raises
    KeyboardInterrupt.

    Raised wherever it arrives, a KeyboardInterrupt is lost inside callbacks that may not raise.
    """
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            if callable(outer := before.get(number)):
                outer(number, frame)
            raise KeyboardInterrupt
        asked.append(number)
        tell()

    with handled(ask) as before:
        yield lambda: bool(asked)
