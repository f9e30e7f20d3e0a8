"""Numbers that kernels give back to the host of a device.

An array that a kernel writes is allocated there, copied to it, copied back and freed, and the host waits twice. Numbers
that a kernel returns come in one wait.
"""

import numpy as np

from .language import ti
from .runtime import Runtime

ROOM = 32  # numbers that come back at once: a compiler unrolls them


@ti.data_oriented
class Answer:
    """Numbers in a device's memory.

    Args:
        count: of the numbers.

    Attributes:
        numbers: (count,) or more, an argument of kernels that write it; numbers of `Runtime.sums`.
    """

    def __init__(self, count: int, runtime: Runtime) -> None:
        self.count, self._take = count, self._take_f32 if runtime.sums == "f32" else self._take_f64
        self.numbers = ti.ndarray(ti.f32 if runtime.sums == "f32" else ti.f64, shape=-(-count // ROOM) * ROOM)

    def read(self) -> np.ndarray:
        """(count,) float64; the host waits once for each `ROOM` of them."""
        parts = [self._take(self.numbers, first) for first in range(0, self.count, ROOM)]
        return np.array([part[k] for part in parts for k in range(ROOM)])[: self.count]

    @ti.kernel
    def _take_f64(self, numbers: ti.types.ndarray(), first: int) -> ti.types.vector(ROOM, ti.f64):
        return ti.Vector([numbers[first + k] for k in ti.static(range(ROOM))])

    @ti.kernel
    def _take_f32(self, numbers: ti.types.ndarray(), first: int) -> ti.types.vector(ROOM, ti.f32):
        return ti.Vector([numbers[first + k] for k in ti.static(range(ROOM))])
