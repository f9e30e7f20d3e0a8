"""The other end of a page's process: starts it, sends it pictures, receives orders from it, and ends it."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

from ..errors import OutputError
from .pages import read, write
from .server import address_of, free_port, installed

if TYPE_CHECKING:  # a page starts before Taichi is imported
    from .session import Session
    from .teller import Teller

PATIENCE = 10.0  # s that a page gets to end


class Link:
    """A page in a process of its own.

    Args:
        host, port: see `view`.

    Attributes:
        address: where it is.

    Raises:
        OutputError: no viser, or no port.
    """

    def __init__(self, host: str, port: int | None) -> None:
        installed()
        self.asked, self.host = port, host
        here = str(pathlib.Path(__file__).parents[2])
        paths = os.pathsep.join([here, *filter(None, [os.environ.get("PYTHONPATH")])])
        self.process = subprocess.Popen([sys.executable, "-m", "taichi_cloth.live.pages", host, str(free_port(host, port))],
                                        stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={**os.environ, "PYTHONPATH": paths},
                                        start_new_session=True)  # a terminal's Ctrl-C is not for it

    def wait(self) -> str:
        """Its address, as soon as it is there.

        Raises:
            OutputError: it did not start, or its port was taken meanwhile.
        """
        message = read(self.process.stdout)  # type: ignore[arg-type]
        if message is None:
            raise OutputError("the page did not start: see the messages above")
        if self.asked not in (None, message[1]):
            raise OutputError(f"port {self.asked} of {self.host} was taken meanwhile: choose another with --port, or leave "
                              "it out")
        return address_of(self.host, message[1])

    def tell(self, message: Any) -> None:
        """Sends the page an `Opening` or a `Seen` to show."""
        write(self.process.stdin, message)  # type: ignore[arg-type]

    def listen(self, session: Session, teller: Teller) -> None:
        """Turns requests of the page into orders of the session, from now on; if the page goes, the session ends."""

        def hear() -> None:
            while (message := read(self.process.stdout)) is not None:  # type: ignore[arg-type]
                if message[0] == "ask":
                    session.ask(*message[1:])
                else:
                    teller.shown(session)
            session.ask("finish")

        threading.Thread(target=hear, daemon=True).start()

    def close(self) -> None:
        """The page ends."""
        try:
            self.process.stdin.close()  # type: ignore[union-attr]
            self.process.wait(PATIENCE)
        except (OSError, subprocess.TimeoutExpired):
            self.process.kill()
            self.process.wait()
