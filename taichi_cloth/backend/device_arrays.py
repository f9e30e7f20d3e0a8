"""Arrays in a device's memory, for kernels that would else have arrays of numpy copied there and back at each launch."""

import weakref
from typing import Any

import numpy as np

from . import compiler
from .language import ti
from .runtime import for_device

NAME = compiler.chosen().name
PARTS = compiler.private("lang.impl", "lang._ndarray", "lang.enums:Layout", "_lib:core")


def array(kind: type, *shape: int):
    """An array of zeros in the device's memory, of at least one. Taichi's own way takes 100 to 200 us, for a note of where it
    was made."""
    dtype = {np.int8: ti.i8, np.int32: ti.i32, np.float32: ti.f32, np.float64: ti.f64}[np.dtype(kind).type]
    if PARTS.count(None) or NAME != compiler.DEFAULT:
        return ti.ndarray(dtype, shape)
    impl, ndarray, Layout, core = PARTS
    out = ndarray.ScalarNdarray.__new__(ndarray.ScalarNdarray)
    ndarray.Ndarray.__init__(out)
    out.dtype = out.element_type = dtype
    out.arr = impl.get_runtime().prog.create_ndarray(dtype, shape, layout=Layout.NULL, zero_fill=True,
                                                     dbg_info=core.DebugInfo(""))
    out.shape = tuple(out.arr.shape)
    return out


class Copies:
    """Copies on a device of things of the host, for as long as these live."""

    def __init__(self) -> None:
        self._of: dict[int, Any] = {}

    def keep(self, host: Any, copy: Any) -> None:
        """The device has a copy of it from now on; nothing changes it."""
        self._of[id(host)] = copy
        weakref.finalize(host, self._of.pop, id(host), None).atexit = False

    def of(self, host: Any) -> Any:
        """The copy, or the thing itself."""
        return self._of.get(id(host), host)


@ti.data_oriented
class Mirror:
    """An array of numbers of the host as kernels take it: on a device a copy, written anew where it has changed."""

    def __init__(self) -> None:
        self._device, self._copy = for_device(), None
        self._last: np.ndarray | None = None

    def of(self, values: np.ndarray) -> Any:
        """The array (k,) or (k, m), or its copy."""
        if not self._device or not values.size:
            return values
        if self._last is None or not np.array_equal(values, self._last):
            if self._last is None or self._last.shape != values.shape:
                self._copy = array(values.dtype.type, *values.shape)
            self._last = values.copy()
            (self._take if values.ndim == 1 else self._take_rows)(self._last, self._copy)
        return self._copy

    @ti.kernel
    def _take(self, values: ti.types.ndarray(), to: ti.types.ndarray()):
        for k in range(values.shape[0]):
            to[k] = values[k]

    @ti.kernel
    def _take_rows(self, values: ti.types.ndarray(), to: ti.types.ndarray()):
        for k in range(values.shape[0]):
            for c in range(values.shape[1]):
                to[k, c] = values[k, c]
