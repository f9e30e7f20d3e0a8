"""A message on stderr about long work before the first frame, if it does take long."""

import contextlib
import sys
import threading
from collections.abc import Iterator

PATIENCE = 1.0  # s


@contextlib.contextmanager
def waiting(what: str) -> Iterator[None]:
    """Prints `what`, the name of the work, if it takes longer than `PATIENCE`."""
    timer = threading.Timer(PATIENCE, lambda: print(f"{what} ...", file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
