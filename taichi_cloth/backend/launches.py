"""Launches of this package's kernels without Taichi's look-ups at each of them.

The compiled kernel that suits the arguments, and the way to hand each over, are the same from launch to launch. A launch of
three arrays takes 50 us by Taichi's own way, most of it in Python, and 20 by this. Arguments that are not plain (a matrix, an
array that is not contiguous, a number of the wrong kind) go Taichi's way, and so does everything while Taichi differentiates
or checks bounds.
"""

import functools
import time
from collections.abc import Iterable
from typing import Any

import numpy as np

from . import compiler, counting
from .timing import compiling

PACKAGE = __name__.split(".")[0]
impl, kernel_impl, ndarray_type, primitive_types, Ndarray = compiler.private(
    "lang.impl", "lang.kernel_impl", "types.ndarray_type", "types.primitive_types", "lang._ndarray:ScalarNdarray")
LARGEST = np.iinfo(np.int32).max  # numbers of an array that Taichi can tell apart
SWAPS = [0]  # how often numbers of a simulation were swapped out of its fields: see field_pool.py
REALS, INTEGERS = (float, int, np.floating, np.integer), (int, np.integer)


class Launcher:
    """Launches one kernel.

    Attributes:
        plain: whether all of its arguments are templates, numbers and arrays of numbers.
    """

    def __init__(self, kernel) -> None:
        self.kernel = kernel
        self._templates = kernel.template_slot_locations
        others = [k for k in range(len(kernel.arguments)) if k not in self._templates]
        kinds = [_kind(kernel.arguments[k].annotation) for k in others]
        self.plain = all(kinds) and kernel.autodiff_mode == kernel_impl.AutodiffMode.NONE
        self._handed = [(k, (slot,), kind) for slot, (k, kind) in enumerate(zip(others, kinds))]
        self._compiled: dict = {}  # Taichi's, which is another one after each start of Taichi
        self._known: dict[tuple, tuple] = {}  # launches by arguments

    def forget(self) -> None:
        """Compiled kernels may be invalid from now on."""
        self._known.clear()

    def launch(self, args: tuple, slow) -> Any:
        """Launches it; `slow` does it Taichi's way."""
        kernel, runtime = self.kernel, self.kernel.runtime
        if len(args) != len(kernel.arguments):
            return slow(kernel, *args)  # which says so
        if counting.now is not None:
            counting.now.launch(kernel.func.__qualname__, args, kernel.return_type is not None)
        plain = self.plain and not runtime.target_tape and not runtime.fwd_mode_manager
        features = self._features(args) if plain else None
        if features is None:
            if SWAPS[0]:
                self.swap_in(args)
            return slow(kernel, *args)
        if self._compiled is not kernel.compiled_kernels:
            self._compiled = kernel.compiled_kernels
            self.forget()
        known = self._known.get(features)
        if known is None:
            began = compiling.start()
            shares = self.swap_in(args)
            out = slow(kernel, *args)
            self._learn(features, args, shares)
            compiling.seconds += time.perf_counter() - began
            return out
        made, data, shares = known
        swap_in(shares)
        context = made.make_launch_context()
        for k, slot, kind in self._handed:
            arg = args[k]
            if kind == "array" and type(arg) is np.ndarray:
                address = arg.__array_interface__["data"][0]
                context.set_arg_external_array_with_shape(slot, address, arg.nbytes, arg.shape, 0)
            elif kind == "array":
                context.set_arg_ndarray(slot, arg.arr)
            elif kind == "real":
                context.set_arg_float(slot, float(arg))
            else:
                context.set_arg_int(slot, int(arg))
        if data is not None:
            runtime.prog.launch_kernel(data, context)
        else:
            runtime.prog.compile_and_launch_kernel(runtime.prog.config(), runtime.prog.get_device_caps(), made, context)
        if kernel.return_type is None:
            return None
        runtime.prog.synchronize()
        out = [kernel.construct_kernel_ret(context, kind, (k,)) for k, kind in enumerate(kernel.return_type)]
        return out[0] if len(out) == 1 else out

    def _features(self, args: tuple) -> tuple | None:
        """The key that decides which compiled kernel it is; None if an argument is not plain."""
        extract, arguments = self.kernel.mapper.extract_arg, self.kernel.arguments
        out = [extract(args[k], arguments[k].annotation, arguments[k].name) for k in self._templates]
        for k, _, kind in self._handed:
            arg = args[k]
            if kind == "array":
                if type(arg) is not np.ndarray:
                    if Ndarray is None or type(arg) is not Ndarray or arg.grad is not None:
                        return None
                    out += Ndarray, id(arg.dtype), len(arg.shape)
                    continue
                if not arg.flags.c_contiguous or arg.size > LARGEST:
                    return None
                out += arg.dtype, arg.ndim
            elif not isinstance(arg, REALS if kind == "real" else INTEGERS):
                return None
        return tuple(out)

    def swap_in(self, args: tuple) -> list:
        """The numbers of all fields that a launch needs lie in them; one share of each simulation that it is for."""
        key = self.kernel.ensure_compiled(*args)
        reads = getattr(self.kernel, "reads_by_key", {}).get(key)  # none where it was compiled before this package was there
        shares = {} if reads is None else {id(share.lease): share for share in reads.shares(args)}
        swap_in(shares.values())
        return list(shares.values())

    def _learn(self, features: tuple, args: tuple, shares: list) -> None:
        """The last launch is used again for the same arguments."""
        kernel, prog = self.kernel, self.kernel.runtime.prog
        if not kernel.has_print and not impl.current_cfg().debug:
            made = kernel.compiled_kernels[kernel.ensure_compiled(*args)]
            self._known[features] = made, _compiled(prog, made), shares


def _compiled(prog, made):
    """Code of a kernel, as it is launched; None by a compiler that looks it up at each launch."""
    if hasattr(prog, "compile_and_launch_kernel"):
        return None
    return prog.compile_kernel(prog.config(), prog.get_device_caps(), made)


def _kind(annotation) -> str:
    """How an argument is handed over; "" if that is not plain."""
    if isinstance(annotation, ndarray_type.NdarrayType):
        return "array" if annotation.dtype is None or id(annotation.dtype) in primitive_types.type_ids else ""
    if id(annotation) in primitive_types.real_type_ids:
        return "real"
    return "integer" if annotation in (int, primitive_types.i32) else ""


def swap_in(shares: Iterable) -> None:
    """The numbers of the simulations that have these shares of fields lie in their fields: see `field_pool.py`."""
    for share in shares:
        if share.lease is not None and share.lease.swapped_out:
            share.lease.swap_in()


def of(kernel) -> Launcher:
    """A kernel's launcher."""
    if not hasattr(kernel, "launcher"):
        kernel.launcher = Launcher(kernel)
    return kernel.launcher


@functools.lru_cache(1024)  # asked for every node of a kernel's tree
def belongs(module: str | None, package: str) -> bool:
    """Whether a module of this name belongs to a package."""
    return module is not None and module.split(".")[0] == package


def own(module: str | None) -> bool:
    """Whether it is one of this package."""
    return belongs(module, PACKAGE)


class Bound:
    """A kernel of a class, bound to an instance where it is got from one."""

    def __init__(self, kernel) -> None:
        self.kernel = kernel
        kernel._is_staticmethod = False

    def __get__(self, owner, cls=None):
        return self.kernel if owner is None else kernel_impl._BoundedDifferentiableMethod(owner, self.kernel)


def called(original):
    """A kernel's launch, with the numbers of its simulation in the fields."""

    def call(self, *args, **kwargs):
        if kwargs:
            args = tuple(kernel_impl._process_args(self, args, kwargs))
        if own(self.func.__module__):
            return of(self).launch(args, original)
        if SWAPS[0]:
            of(self).swap_in(args)
        return original(self, *args)

    return call
