"""PNG by zlib."""

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
    # filter 1 (difference to the pixel on the left) in every row
    rows = np.zeros((height, 1 + 3 * width), dtype=np.uint8)
    rows[:, 0] = 1
    rows[:, 1:4] = image[:, 0]
    rows[:, 4:] = (image[:, 1:] - image[:, :-1]).reshape(height, -1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows.tobytes(), level)) + _chunk(
        b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
