"""Arrays by name in one file, numpy's .npz, that says when it is damaged: sizes are checked before anything is read."""

import hashlib
import io
import math
import os
import pathlib
import zipfile
import zlib
from collections.abc import Callable
from typing import IO

import numpy as np

CHECKSUM = "checksum"  # the array with the digest of all the others
DEFLATED = 1100  # times that zlib can make data smaller, at the very most
EXPANDS, SMALL = 100, 1 << 26  # times a file's size that arrays of more than so many bytes may be: garments are 3 to 14 times
Shapes = dict[str, tuple[int, ...]]


class DamagedError(ValueError):
    """A file that is no whole .npz; the message names the fault, not the file."""


def pack(arrays: dict[str, np.ndarray]) -> bytes:
    """The bytes of an .npz file: the same for the same arrays; one more array, `checksum`, is the digest of them."""
    buffer = io.BytesIO()
    arrays = {name: np.asarray(array, order="C") for name, array in arrays.items()}
    with zipfile.ZipFile(buffer, "w") as file:
        for name, array in (arrays | {CHECKSUM: np.array(digest(arrays))}).items():
            with file.open(zipfile.ZipInfo(name + ".npy"), "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)
    return buffer.getvalue()


def unpack(path: str | pathlib.Path) -> dict[str, np.ndarray]:
    """Arrays of a file that `pack` made.

    Raises:
        FileNotFoundError: it is missing.
        DamagedError: it is not the file that was written.
    """
    arrays = read(path)
    if CHECKSUM not in arrays:
        raise DamagedError("it has no checksum")
    if str(arrays.pop(CHECKSUM)) != digest(arrays):
        raise DamagedError("its checksum is not that of its content")
    return arrays


def read(path: str | pathlib.Path, fits: Callable[[Shapes], None] | None = None) -> dict[str, np.ndarray]:
    """Arrays of any .npz file by name.

    Args:
        fits: is called with the arrays' shapes before any is read; raises a DamagedError where they do not go together.

    Raises:
        FileNotFoundError: it is missing.
        DamagedError: it is cut off or damaged, or its arrays are larger than the file, or this machine, can hold.
    """
    path = pathlib.Path(path)
    try:
        size = path.stat().st_size
        with zipfile.ZipFile(path) as file:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in file.infolist()}
            _refuse_sizes(list(entries.values()), size)
            if fits is not None:
                fits({name: _shape(file, entry) for name, entry in entries.items()})
            return {name: _array(file, entry) for name, entry in entries.items()}
    except FileNotFoundError:
        raise
    except (DamagedError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedError(str(error) or type(error).__name__) from None
    except Exception as error:  # zipfile and numpy say it in many ways
        raise DamagedError(f"{type(error).__name__}: {error}") from None


def digest(arrays: dict[str, np.ndarray]) -> str:
    """Hash of the names, types, shapes and content of arrays."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def _refuse_sizes(entries: list[zipfile.ZipInfo], size: int) -> None:
    """Refuses, by the zip's directory alone, arrays that cannot be in a file of so many bytes, or in this machine's memory."""
    for entry in entries:
        most = entry.compress_size * (1 if entry.compress_type == zipfile.ZIP_STORED else DEFLATED)
        if entry.compress_size > size or entry.file_size > most:
            raise DamagedError(f"{entry.filename} says {entry.file_size} bytes, and the file has {size}")
    total = sum(entry.file_size for entry in entries)
    if total > max(EXPANDS * size, SMALL):
        raise DamagedError(f"it has {size:,} bytes, and its arrays are {total:,}: no data are packed as tightly; where "
                           "these are, save them with numpy.savez")
    if total > memory():
        raise DamagedError(f"its arrays are {total:,} bytes, more than this machine has")


def memory() -> float:
    """Bytes of this machine; infinity where it does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return math.inf


def _shape(file: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[int, ...]:
    """An array's shape as its header says it, if it is as large as its entry."""
    with file.open(entry) as stream:
        return _header(stream, entry)


def _header(stream: IO[bytes], entry: zipfile.ZipInfo) -> tuple[int, ...]:
    """The same, of an entry that is being read."""
    version = np.lib.format.read_magic(stream)
    reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = reader(stream)
    needed, there = math.prod(shape) * dtype.itemsize, entry.file_size - stream.tell()
    if dtype.hasobject or min(shape, default=0) < 0 or needed != there:
        raise DamagedError(f"{entry.filename} of shape {shape} and type {dtype} needs {needed} bytes, and has {there}")
    return shape


def _array(file: zipfile.ZipFile, entry: zipfile.ZipInfo) -> np.ndarray:
    """One array, if its entry is as large as its header says."""
    with file.open(entry) as stream:
        data = io.BytesIO(stream.read(entry.file_size + 1))
    if len(data.getbuffer()) != entry.file_size:
        raise DamagedError(f"{entry.filename} says {entry.file_size} bytes, and has {len(data.getbuffer())}")
    _header(data, entry)
    data.seek(0)
    return np.lib.format.read_array(data, allow_pickle=False)
