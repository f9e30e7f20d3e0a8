"""OpenEXR images of single scanlines' blocks, compressed by zlib. [openexr.com, "OpenEXR File Layout"]"""

import struct
import zlib

import numpy as np

BLOCK = 16  # rows that ZIP compresses together
KINDS = {"<u4": 0, "<f4": 2}  # pixel types UINT and FLOAT


def encode_exr(channels: dict[str, np.ndarray]) -> bytes:
    """A file's bytes.

    Args:
        channels: (height, width) by name, such as "R" or "depth.Z"; f32, or uint32 for numbers of objects.

    Raises:
        ValueError: different shapes.
    """
    names = sorted(channels, key=lambda name: name.encode())  # the order that the format wants
    data = [np.ascontiguousarray(c, dtype="<u4" if c.dtype.kind in "iu" else "<f4") for c in (channels[n] for n in names)]
    if len({c.shape for c in data}) != 1:
        raise ValueError(f"channels of different shapes: { {n: channels[n].shape for n in names} }")
    height, width = data[0].shape
    listed = b"".join(name.encode() + b"\0" + struct.pack("<iB3xii", KINDS[c.dtype.str], 0, 1, 1)
                      for name, c in zip(names, data)) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    head = b"\x76\x2f\x31\x01" + struct.pack("<i", 2 | (0x400 if any(len(n) > 31 for n in names) else 0))
    for name, kind, value in (("channels", "chlist", listed), ("compression", "compression", b"\x03"),
                              ("dataWindow", "box2i", window), ("displayWindow", "box2i", window),
                              ("lineOrder", "lineOrder", b"\0"), ("pixelAspectRatio", "float", struct.pack("<f", 1)),
                              ("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0)),
                              ("screenWindowWidth", "float", struct.pack("<f", 1))):
        head += name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(value)) + value
    head += b"\0"
    blocks = [_block(row, [c[row: row + BLOCK] for c in data]) for row in range(0, height, BLOCK)]
    starts = np.cumsum([len(head) + 8 * len(blocks)] + [len(b) for b in blocks])[:-1]
    return head + starts.astype("<u8").tobytes() + b"".join(blocks)


def _block(row: int, parts: list[np.ndarray]) -> bytes:
    """Rows from `row` on: row by row, channel by channel; halves apart, differences, zlib; as it is where that is shorter."""
    raw = np.frombuffer(b"".join(part[k].tobytes() for k in range(len(parts[0])) for part in parts), dtype=np.uint8)
    apart = np.concatenate([raw[::2], raw[1::2]])
    apart[1:] = apart[1:] - apart[:-1] + np.uint8(128)
    small = zlib.compress(apart.tobytes(), 4)
    data = small if len(small) < len(raw) else raw.tobytes()
    return struct.pack("<ii", row, len(data)) + data
