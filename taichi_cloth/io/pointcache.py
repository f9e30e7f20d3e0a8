"""Point caches: positions by frames, whose triangles are in another file. PC2 and MDD."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..errors import MeshError

SUFFIXES = (".pc2", ".mdd")


class Cache(NamedTuple):
    """A point cache.

    Attributes:
        x: (frames, n, 3) positions, in the file's unit.
        fps: frames a second where the file has times, else None.
        first: number of its first frame; every: frames from one to the next.
    """

    x: np.ndarray
    fps: float | None
    first: float
    every: float


def read(path: Path) -> Cache:
    """A point cache, by its suffix.

    Raises:
        MeshError: it cannot be read, is damaged, or its times make no frames.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror or error}") from None
    return _mdd(path, data) if path.suffix.lower() == ".mdd" else _pc2(path, data)


def _pc2(path: Path, data: bytes) -> Cache:
    """A header of 32 bytes, then float32 triples; the lowest byte comes first."""
    if len(data) < 32 or data[:12] != b"POINTCACHE2\0":
        raise MeshError(f"{path}: is not a PC2 point cache")
    count, first, every, frames = struct.unpack("<iffi", data[16:32])
    _refuse_length(path, len(data), 32 + 12 * count * frames, frames, count)
    if not (math.isfinite(first) and 0 < every < math.inf):
        raise MeshError(f"{path}: its header says that it starts at frame {first:g} and has one every {every:g} frames")
    return Cache(_triples(data, "<f4", 32, frames, count), None, first, every)


def _mdd(path: Path, data: bytes) -> Cache:
    """Numbers of frames and points, times [s], then float32 triples; the highest byte comes first."""
    if len(data) < 8:
        raise MeshError(f"{path}: is not an MDD point cache")
    frames, count = struct.unpack(">ii", data[:8])
    _refuse_length(path, len(data), 8 + 4 * frames + 12 * count * frames, frames, count)
    t = np.frombuffer(data, ">f4", frames, 8).astype(np.float64)
    x = _triples(data, ">f4", 8 + 4 * frames, frames, count)
    if frames == 1:
        return Cache(x, None, 0.0, 1.0)
    step = (t[-1] - t[0]) / (frames - 1)
    if not (np.isfinite(t).all() and step > 0 and np.abs(np.diff(t) - step).max() < 0.1 * step):
        raise MeshError(f"{path}: its frames are at uneven times, from {t[0]:g} to {t[-1]:g} s")
    return Cache(x, float(1 / step), float(t[0] / step), 1.0)


def _refuse_length(path: Path, there: int, said: int, frames: int, count: int) -> None:
    if min(count, frames) < 1 or there != said:
        raise MeshError(f"{path}: is {there} bytes long, its header says {frames} frames of {count} points")


def _triples(data: bytes, kind: str, offset: int, frames: int, count: int) -> np.ndarray:
    return np.frombuffer(data, kind, offset=offset).reshape(frames, count, 3).astype(np.float64)
