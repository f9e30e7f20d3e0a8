"""Memory of fields that nobody has written to, given back to the system: a page takes none until something is written.

Fields have room for more rows than they hold, so that kernels serve other meshes too, and Taichi fills all of it with zeros.
"""

import ctypes
import mmap
import sys

import numpy as np

LEAST = 1 << 16  # bytes that are worth a call
GIVES_BACK = sys.platform == "linux" and hasattr(mmap, "MADV_DONTNEED")  # there a page that was given back reads as zeros


def clear(numbers: np.ndarray) -> int:
    """Sets contiguous numbers in a field's memory to zero. Returns the bytes that were given back."""
    size = 0
    if GIVES_BACK and numbers.nbytes >= LEAST:
        first = -(-numbers.ctypes.data // mmap.PAGESIZE) * mmap.PAGESIZE
        size = (numbers.ctypes.data + numbers.nbytes) // mmap.PAGESIZE * mmap.PAGESIZE - first
        if ctypes.CDLL(None).madvise(ctypes.c_void_p(first), ctypes.c_size_t(size), mmap.MADV_DONTNEED):
            size = 0
    flat = numbers.reshape(-1).view(np.uint8)
    begin = (first - numbers.ctypes.data) if size else 0
    flat[:begin], flat[begin + size:] = 0, 0
    return size
