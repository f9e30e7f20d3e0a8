"""Arrays by name in one file, numpy's .npz, that says when it is damaged: sizes are checked before anything is read."""

import hashlib
import io
import math
import pathlib
import zipfile
import zlib

import numpy as np

CHECKSUM = "checksum"  # the array with the digest of all the others
DEFLATED = 1100  # times that zlib can make data smaller, at the very most


class DamagedError(ValueError):
    """A file that is no whole .npz; the message says what is wrong with it, not which it is."""


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
        DamagedError: it is not what was written.
    """
    arrays = read(path)
    if CHECKSUM not in arrays:
        raise DamagedError("it has no checksum")
    if str(arrays.pop(CHECKSUM)) != digest(arrays):
        raise DamagedError("its checksum is not that of its content")
    return arrays


def read(path: str | pathlib.Path) -> dict[str, np.ndarray]:
    """Arrays of any .npz file by name.

    Raises:
        FileNotFoundError: it is missing.
        DamagedError: it is cut off or damaged, or its arrays are larger than the file can hold.
    """
    path = pathlib.Path(path)
    try:
        size = path.stat().st_size
        with zipfile.ZipFile(path) as file:
            return {entry.filename.removesuffix(".npy"): _array(file, entry, size) for entry in file.infolist()}
    except FileNotFoundError:
        raise
    except (DamagedError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise DamagedError(str(error) or type(error).__name__) from None
    except Exception as error:  # zipfile and numpy say it in many ways
        raise DamagedError(f"{type(error).__name__}: {error}") from None


def digest(arrays: dict[str, np.ndarray]) -> str:
    """Of names, types, shapes and content."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name], order="C")
        total.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        total.update(array.tobytes())
    return total.hexdigest()


def _array(file: zipfile.ZipFile, entry: zipfile.ZipInfo, size: int) -> np.ndarray:
    """One array, whose sizes in the zip's directory and in its own header agree with the file's."""
    most = entry.compress_size * (1 if entry.compress_type == zipfile.ZIP_STORED else DEFLATED)
    if entry.compress_size > size or entry.file_size > most:
        raise DamagedError(f"{entry.filename} says {entry.file_size} bytes, and the file has {size}")
    with file.open(entry) as stream:
        data = io.BytesIO(stream.read(entry.file_size + 1))
    version = np.lib.format.read_magic(data)
    reader = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, _, dtype = reader(data)
    needed, there = math.prod(shape) * dtype.itemsize, len(data.getbuffer()) - data.tell()
    if dtype.hasobject or min(shape, default=0) < 0 or needed != there:
        raise DamagedError(f"{entry.filename} of shape {shape} and type {dtype} needs {needed} bytes, and has {there}")
    data.seek(0)
    return np.lib.format.read_array(data, allow_pickle=False)
