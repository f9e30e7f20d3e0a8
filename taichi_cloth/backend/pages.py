"""Memory of fields that nobody has written to, given back to the system: a page takes none until something is written.

Fields have room for more rows than they hold, so that kernels serve other meshes too, and Taichi fills all of it with zeros.
Memory of large arrays that are gone goes back, too.
"""

import ctypes
import functools
import mmap
import os
import sys

import numpy as np

LEAST = 1 << 16  # bytes that are worth a call
GIVES_BACK = sys.platform == "linux" and hasattr(mmap, "MADV_DONTNEED")  # there a page that was given back reads as zeros

MAP_FROM, KEEP_FREE = (-3, 1 << 20), (-1, 1 << 24)  # glibc's options of `malloc`, bytes
SET_BY_USER = "MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_", "GLIBC_TUNABLES"


@functools.cache
def map_large_arrays() -> bool:
    """Arrays of a megabyte and more are mapped one by one, and their memory goes back with them. Returns whether that is so.

    glibc maps those of 32 MB at last, after some large ones have gone, and keeps the memory of others. It is left as it is
    where the environment says how it should be.
    """
    if not GIVES_BACK or any(name in os.environ for name in SET_BY_USER):
        return False
    option = getattr(ctypes.CDLL(None), "mallopt", None)  # other libraries lack it
    return option is not None and all(option(*each) == 1 for each in (MAP_FROM, KEEP_FREE))


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
