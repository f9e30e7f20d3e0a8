"""PNG, still and animated, by zlib."""

import struct
import zlib

import numpy as np


def encode_png(image: np.ndarray, level: int = 3) -> bytes:
    """A PNG file's bytes.

    Args:
        image: (height, width, 3) uint8, first row on top.
        level: of compression, 0 to 9.

    Raises:
        ValueError: another shape or type.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"an image needs shape (height, width, 3) and type uint8, not {image.shape} {image.dtype}")
    height, width = image.shape[:2]
    return _SIGNATURE + _header(height, width) + _chunk(b"IDAT", _compressed(image, level)) + _chunk(b"IEND", b"")


def encode_apng(images: list[np.ndarray], fps: float, level: int = 3) -> bytes:
    """An animated PNG's bytes, which plays for ever.

    Args:
        images: (height, width, 3) uint8, all of one size.
        fps: frames a second.
    """
    height, width = images[0].shape[:2]
    out = [_SIGNATURE, _header(height, width), _chunk(b"acTL", struct.pack(">II", len(images), 0))]
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


def _header(height: int, width: int) -> bytes:
    return _chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))


def _compressed(image: np.ndarray, level: int) -> bytes:
    height, width = image.shape[:2]
    # filter 1 (difference to the pixel on the left) in every row
    rows = np.zeros((height, 1 + 3 * width), dtype=np.uint8)
    rows[:, 0] = 1
    rows[:, 1:4] = image[:, 0]
    rows[:, 4:] = (image[:, 1:] - image[:, :-1]).reshape(height, -1)
    return zlib.compress(rows.tobytes(), level)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
