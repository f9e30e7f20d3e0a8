"""One process a folder: a lock that the system takes away when its process ends, however that happens."""

import contextlib
import os
import pathlib

from ..errors import OutputError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]
    import msvcrt

LOCK = "run.lock"


class Lock:
    """Holds a folder until `release`.

    Raises:
        OutputError: another process holds it.
    """

    def __init__(self, folder: pathlib.Path) -> None:
        self.path = folder / LOCK
        while True:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT, 0o644)
            try:
                _hold(self._file)
            except OSError:
                os.close(self._file)
                raise OutputError(f"{folder} is being written by another run: wait until it has ended, or choose another "
                                  "folder") from None
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(self._file), os.stat(self.path)):
                    return
            os.close(self._file)  # who had it removed it meanwhile

    def release(self) -> None:
        """Lets go of the folder."""
        with contextlib.suppress(OSError):  # the folder may be gone; elsewhere open files cannot be removed
            self.path.unlink()
        os.close(self._file)


def _hold(file: int) -> None:
    if fcntl is not None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    else:
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
