"""PNG, still and animated, by zlib."""

import struct
import zlib

import numpy as np


class Picture(np.ndarray):
    """An array (height, width, 3 or 4), uint8 or uint16, that a notebook shows as the picture that it is."""

    def _repr_png_(self) -> bytes | None:
        try:
            return encode_png(self)
        except ValueError:  # a part of it, or a value computed from it
            return None


def encode_png(image: np.ndarray, level: int = 3) -> bytes:
    """A PNG file's bytes.

    Args:
        image: (height, width, 3) or with alpha (height, width, 4), uint8 or uint16, first row on top.
        level: of compression, 0 to 9.

    Raises:
        ValueError: another shape or type.
    """
    if image.dtype not in (np.uint8, np.uint16) or image.ndim != 3 or image.shape[2] not in (3, 4):
        raise ValueError("an image needs shape (height, width, 3 or 4) and type uint8 or uint16, not "
                         f"{image.shape} {image.dtype}")
    return _SIGNATURE + _header(image) + _chunk(b"IDAT", _compressed(image, level)) + _chunk(b"IEND", b"")


def encode_apng(images: list[np.ndarray], fps: float, level: int = 3) -> bytes:
    """An animated PNG's bytes, which plays for ever.

    Args:
        images: (h, w, c) each, as `encode_png` takes them, all of one size and type.
        fps: frames a second.
    """
    height, width = images[0].shape[:2]
    out = [_SIGNATURE, _header(images[0]), _chunk(b"acTL", struct.pack(">II", len(images), 0))]
    number = 0
    for k, image in enumerate(images):
        control = struct.pack(">IIIIIHHBB", number, width, height, 0, 0, round(1000 / fps), 1000, 0, 0)
        out.append(_chunk(b"fcTL", control))
        number += 1
        data = _compressed(image, level)
        if k == 0:
            out.append(_chunk(b"IDAT", data))
        else:
            out.append(_chunk(b"fdAT", struct.pack(">I", number) + data))
            number += 1
    return b"".join([*out, _chunk(b"IEND", b"")])


_SIGNATURE = b"\x89PNG\r\n\x1a\n"


def _header(image: np.ndarray) -> bytes:
    height, width, channels = image.shape
    return _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8 * image.itemsize, 2 if channels == 3 else 6, 0, 0, 0))


def _compressed(image: np.ndarray, level: int) -> bytes:
    height, each = image.shape[0], image.shape[2] * image.itemsize
    data = image.astype(">u2").view(np.uint8) if image.itemsize == 2 else image
    data = data.reshape(height, -1)
    # filter 1 (difference to the pixel on the left, byte by byte) in every row
    rows = np.empty((height, 1 + data.shape[1]), dtype=np.uint8)
    rows[:, 0] = 1
    rows[:, 1: 1 + each] = data[:, :each]
    rows[:, 1 + each:] = data[:, each:] - data[:, :-each]
    return zlib.compress(rows.tobytes(), level)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
