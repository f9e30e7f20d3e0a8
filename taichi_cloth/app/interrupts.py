"""Signals that ask a process to end: Ctrl-C, SIGTERM and SIGHUP are one and the same."""

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator

NAMES = ("SIGINT", "SIGTERM", "SIGHUP")


@contextlib.contextmanager
def handled(handler: Callable) -> Iterator[None]:
    """`handler(number, frame)` is called by those signals that are not ignored (as SIGHUP is under nohup); only Python's main
    thread may set that, elsewhere nothing changes."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)


def raised():
    """Within it those signals raise KeyboardInterrupt wherever they arrive."""
    return handled(signal.default_int_handler)


@contextlib.contextmanager
def after_this_frame() -> Iterator[Callable[[], bool]]:
    """Whether the process was asked to end: it is to, after its frame; asked again, it ends at once.

    Raised wherever it arrives, a KeyboardInterrupt is lost inside callbacks that may not raise.
    """
    asked: list[int] = []

    def ask(number: int, frame: object) -> None:
        if asked:
            raise KeyboardInterrupt
        asked.append(number)
        print("interrupted: ends after this frame; asked again, at once", file=sys.stderr, flush=True)

    with handled(ask):
        yield lambda: bool(asked)
