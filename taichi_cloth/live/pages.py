"""The process of a page: viser's server. Pictures come as pickles through its standard input, orders go out as pickles.

Taichi keeps Python's lock while kernels are compiled and run, so a page in the simulation's process would stand still.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
from typing import Any, BinaryIO

from .page import Page
from .seen import Building, Opening
from .server import started, stop


def main(host: str, port: int) -> None:
    """Until its standard input ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of other packages is no message
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the simulation's process ends this one
    lock = threading.Lock()

    def tell(*message: Any) -> None:
        with lock:
            write(out, message)

    server, page = started(host, port), None
    server.on_client_connect(lambda client: tell("ask", "watch", (), "watch"))
    tell("at", server.get_port())
    while (message := read(sys.stdin.buffer)) is not None:
        if isinstance(message, Opening):
            page = Page(server, message, lambda name, values, key: tell("ask", name, values, key))
        elif page is None:
            continue
        elif isinstance(message, Building):
            page.building()
        else:
            page.show(message)
            tell("shown")
    stop(server)


def write(stream: BinaryIO, message: Any) -> None:
    """A message, or nothing where nobody reads any more."""
    try:
        pickle.dump(message, stream, protocol=pickle.HIGHEST_PROTOCOL)
        stream.flush()
    except (BrokenPipeError, ValueError):
        pass


def read(stream: BinaryIO) -> Any:
    """The next message; None at the end."""
    try:
        return pickle.load(stream)
    except (EOFError, ValueError, pickle.UnpicklingError):
        return None


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
