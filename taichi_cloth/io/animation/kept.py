"""Arrays that took long to make from a file, kept in a folder of the user's for the next time."""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from .. import npz

MOST = 1 << 31  # bytes that are kept, as many as a few long films of figures have; the files used longest ago go first
VARIABLE = "TAICHI_CLOTH_CACHE"  # of the environment: another folder


def folder() -> Path:
    """The folder in which they are kept."""
    said = os.environ.get(VARIABLE)
    return Path(said) if said else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "taichi_cloth"


def arrays(path: Path, how: str, make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """The result of `make` for a file, or for one of the same bytes before; `how`: all that it depends on besides."""
    key = hashlib.sha256(how.encode() + b"\0" + path.suffix.lower().encode() + path.read_bytes()).hexdigest()
    place = folder() / f"{key[:32]}.npz"
    with contextlib.suppress(OSError, npz.DamagedError):  # not there, or damaged: it is made
        found = npz.unpack(place)
        place.touch()
        return found
    made = make()
    with contextlib.suppress(OSError):  # where nothing can be written, nothing is kept
        place.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=place.parent, suffix=".part", delete=False) as file:
            file.write(npz.pack(made))
        os.replace(file.name, place)
        _forget(place.parent)
    return made


def _forget(place: Path) -> None:
    """Removes the files that were used longest ago, beyond `MOST` bytes."""
    files = sorted(place.glob("*.npz"), key=lambda file: file.stat().st_mtime, reverse=True)
    total = 0
    for file in files:
        total += file.stat().st_size
        if total > MOST:
            file.unlink()
