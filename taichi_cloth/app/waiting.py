"""A word on what takes long before there is anything to show: on stderr, and only where it does."""

import contextlib
import sys
import threading
from collections.abc import Iterator

PATIENCE = 1.0  # s


@contextlib.contextmanager
def waiting(what: str) -> Iterator[None]:
    """Says what goes on, if it goes on for longer than `PATIENCE`."""
    timer = threading.Timer(PATIENCE, lambda: print(f"{what} ...", file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
