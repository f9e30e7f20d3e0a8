"""The package that shows pages, and the port that one is shown at."""

from __future__ import annotations

import contextlib
import importlib.util
import os
import socket
from collections.abc import Iterator

import rich

from .. import checks
from ..errors import OutputError

FIRST, TRIES = 8080, 100  # ports that are looked at where none is asked for
HOST = "127.0.0.1"  # this machine alone


def installed() -> None:
    """Nothing, where viser is.

    Raises:
        OutputError: it is not.
    """
    try:
        there = importlib.util.find_spec("viser") is not None
    except ValueError:
        there = False
    if not there:
        raise OutputError("a page needs the package viser: pip install 'taichi-cloth[view]'")


def free_port(host: str, port: int | None) -> int:
    """A port that can be listened at: the one asked for, or the first of some that is free.

    Raises:
        OutputError: it is not free, or none is, or there is no such host.
    """
    if port is not None:
        checks.integer("--port", port, least=1, most=65535, error=OutputError)
    try:
        family = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][0]
    except (OSError, UnicodeError):
        raise OutputError(f"--host {host!r}: there is no such host; {HOST} is this machine") from None
    trouble = ""
    for one in range(FIRST, FIRST + TRIES) if port is None else (port,):
        try:
            with socket.create_server((host, one), family=family):
                return one
        except OSError as error:
            trouble = os.strerror(error.errno) if error.errno else str(error)
    if port is not None:
        raise OutputError(f"port {port} of {host} cannot be had ({trouble}): choose another with --port, or leave it out")
    raise OutputError(f"none of the ports {FIRST} to {FIRST + TRIES - 1} of {host} can be had ({trouble}): choose one with "
                      "--port")


def started(host: str, port: int):
    """viser's server, at the port or the next one that is free."""
    import viser  # type: ignore[import-not-found]

    with _quiet():
        return viser.ViserServer(host=host, port=port, verbose=False)


def address_of(host: str, port: int) -> str:
    """Address of a page."""
    shown = "localhost" if host in ("0.0.0.0", "::", "") else host
    return f"http://{f'[{shown}]' if ':' in shown else shown}:{port}"


def stop(server) -> None:
    """The server is over."""
    with _quiet():
        server.stop()


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Within it viser says nothing of its own."""
    console = rich.get_console()
    was, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = was
