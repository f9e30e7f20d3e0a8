"""Where an evaluation writes its numbers: a row for each block, to be added up over all of the cloth.

On the CPU rows are as few as threads, and numpy adds them up. On a device there are thousands. They stay there, and the host
reads sums and largest numbers alone.
"""

import numpy as np

from ..backend.language import ti
from ..backend.runtime import Runtime
from ..backend.sums import GROUPS

LEAST = -1e30  # less than any number of a report


class HostReport:
    """Rows of a few blocks.

    Attributes:
        rows: (blocks, columns), an argument of kernels.
    """

    def __init__(self, blocks: int, columns: int, runtime: Runtime) -> None:
        self.rows: np.ndarray = np.zeros((blocks, columns), dtype=runtime.exchange)

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """(sums of the columns, largest numbers in them)"""
        return self.rows.sum(axis=0, dtype=np.float64), self.rows.max(axis=0)


@ti.data_oriented
class Report:
    """The same for thousands of blocks: see `HostReport`."""

    def __init__(self, blocks: int, columns: int, runtime: Runtime) -> None:
        self.sum_type = ti.f32 if runtime.sums == "f32" else ti.f64
        self.rows = ti.ndarray(self.sum_type, shape=(blocks, columns))
        self._part = ti.ndarray(self.sum_type, shape=(2 * GROUPS, columns))  # sums of groups, then largest numbers
        self._out: np.ndarray = np.zeros((2, columns), dtype=runtime.exchange)

    def columns(self) -> tuple[np.ndarray, np.ndarray]:
        """See `HostReport`."""
        self._join(self.rows, self._part, self._out)
        return self._out[0].astype(np.float64), self._out[1].copy()

    @ti.kernel
    def _join(self, rows: ti.types.ndarray(), part: ti.types.ndarray(), out: ti.types.ndarray()):
        for at in range(ti.static(GROUPS) * rows.shape[1]):
            group, column = at // rows.shape[1], at % rows.shape[1]
            total, most = ti.cast(0, self.sum_type), ti.cast(ti.static(LEAST), self.sum_type)
            for row in range(rows.shape[0] * group // GROUPS, rows.shape[0] * (group + 1) // GROUPS):
                total += rows[row, column]
                most = ti.max(most, rows[row, column])
            part[group, column], part[GROUPS + group, column] = total, most
        for column in range(rows.shape[1]):
            total, most = ti.cast(0, self.sum_type), ti.cast(ti.static(LEAST), self.sum_type)
            for group in range(ti.static(GROUPS)):
                total += part[group, column]
                most = ti.max(most, part[GROUPS + group, column])
            out[0, column], out[1, column] = total, most
