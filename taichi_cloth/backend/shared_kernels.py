"""One compiled kernel for all objects from which it reads the same.

Taichi compiles a kernel of a class again for each instance. The result is decided by the values that the kernel reads of its
arguments while it is compiled: fields, numbers, functions. Each read is written down as a path from the argument
(`self.blocks.count` is 2). An object of which all of them read the same gets the kernel that was compiled then. If it
reads a value that cannot be written so, such as a numpy array, it is compiled for each object as before.

Only the package's kernels are shared. Another simulation has the same fields where they come from the pool (`field_pool.py`);
the same paths tell of which fields a launch needs the numbers (`shares`).
"""

import contextlib
import weakref
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import BackendError
from . import compiler

kernel_impl, ASTTransformer, Field, runtime = compiler.private(
    "lang.kernel_impl", "lang.ast.ast_transformer:ASTTransformer", "lang.field:Field", "lang.impl:get_runtime")
PACKAGE = __name__.split(".")[0]
PLAIN = (bool, int, float, str, bytes, type(None), np.number, np.bool_)
HARMLESS = (len, range, zip, enumerate, min, max, isinstance, int, float, bool, abs)  # functions that read no attributes

Step = str | tuple  # an attribute, or (key,) of a list or dictionary
Path = tuple[int | Step, ...]  # from an argument's number on


def _follow(args: Sequence, path: Path) -> Any:
    """The value that a path leads to."""
    value = args[path[0]]  # type: ignore[index]
    for step in path[1:]:
        value = getattr(value, step) if isinstance(step, str) else value[step[0]]  # type: ignore[index]
    return value


def _token(value: Any) -> tuple | None:
    """The mark of a value that a compiled kernel depends on, to be compared; None if that cannot be said."""
    if isinstance(value, PLAIN):
        return type(value), value
    if isinstance(value, Field):
        return Field, weakref.ref(value.share.slot if hasattr(value, "share") else value)
    if isinstance(value, (list, tuple)):
        return type(value), len(value)
    if isinstance(value, dict):
        return dict, tuple(value)
    if hasattr(value, "__func__") and getattr(value.__func__, "_is_taichi_function", False):
        return "method", value.__func__
    if isinstance(value, type) or getattr(value, "_is_taichi_function", False) or _of_taichi(type(value)):
        return "same", id(value), value
    if type(value).__module__.split(".")[0] == PACKAGE:
        return "object", type(value)
    return None


def _of_taichi(thing: Any) -> bool:
    return (getattr(thing, "__module__", None) or "").split(".")[0] == compiler.chosen().name


class Reads:
    """Values that a kernel reads of its arguments while it is compiled.

    Attributes:
        tokens: of each path that was read; same: paths that led to the value of another path.
        whole: whether all of it could be written down.
        beside: shares of fields to which no path leads, of the object that it was compiled for.
    """

    def __init__(self, args: Sequence, roots: Sequence[int]) -> None:
        self.tokens: dict[Path, tuple] = {}
        self.same: dict[Path, Path] = {}
        self.whole = True
        self.beside: list = []
        self._paths: dict[int, Path] = {}  # of objects, by their identity
        self._objects: list = []  # which live as long
        for k in roots:
            self._note((k,), args[k])

    def of(self, owner: Any, name: str, value: Any) -> None:
        """An attribute of an object was read."""
        path = self._paths.get(id(owner))
        self.whole &= not (isinstance(owner, Field) and name == "rows")  # which a field from the pool has others of
        if path is not None and path + (name,) not in self.tokens:
            self._note(path + (name,), value)
        elif path is None:
            self.beside += _shares(value.values() if isinstance(value, dict) else
                                   value if isinstance(value, (list, tuple)) else [value])

    def call(self, function: Any, args: Sequence) -> None:
        """A function was called. Reads of plain Python are not seen; Taichi's functions see none."""
        known = getattr(getattr(function, "__func__", function), "_is_taichi_function", False) or function in HARMLESS
        if not known and not _of_taichi(function) and any(id(a) in self._paths for a in args):
            self.whole = False

    def match(self, args: Sequence) -> bool:
        """Whether all of it reads the same of other arguments."""
        try:
            return (all(_token(_follow(args, path)) == token for path, token in self.tokens.items())
                    and all(_follow(args, path) is _follow(args, other) for path, other in self.same.items()))
        except (AttributeError, LookupError, TypeError):
            return False

    def shares(self, args: Sequence) -> list:
        """Fields from the pool that a launch with these arguments reads or writes."""
        return _shares(_follow(args, path) for path, token in self.tokens.items() if token[0] is Field) + self.beside

    def end(self) -> None:
        """The kernel is compiled: the values that were read need not live on."""
        self._paths, self._objects = {}, []

    def _note(self, path: Path, value: Any) -> None:
        token = _token(value)
        if token is None:
            self.whole = False
            return
        self.tokens[path] = token
        if not (isinstance(value, (list, tuple, dict)) or token[0] == "object"):
            return
        if id(value) in self._paths:
            self.same[path] = self._paths[id(value)]
            return
        self._paths[id(value)] = path
        self._objects.append(value)
        if isinstance(value, (list, tuple)):
            for k, item in enumerate(value):
                self._note(path + ((k,),), item)
        elif isinstance(value, dict):
            for key, item in value.items():
                self._note(path + ((key,),), item)


@dataclass(frozen=True, eq=False)
class Variant:
    """Sources of a compiled kernel: reads, and Taichi's keys of its other arguments."""

    reads: Reads
    features: tuple


_compiling: list[Reads] = []


@contextlib.contextmanager
def _watched(reads: Reads) -> Iterator[None]:
    _compiling.append(reads)
    try:
        yield
    finally:
        _compiling.pop()
        reads.end()


def _build_attribute(original):
    def build(ctx, node):
        out = original(ctx, node)
        if _compiling and hasattr(node.value, "ptr"):
            _compiling[-1].of(node.value.ptr, node.attr, node.ptr)
        return out

    return staticmethod(build)


def _build_call(original):
    def build(ctx, node):
        out = original(ctx, node)
        if _compiling:
            args = [getattr(a, "ptr", None) for a in [*node.args, *(k.value for k in node.keywords)]]
            _compiling[-1].call(getattr(node.func, "ptr", None), args)
        return out

    return staticmethod(build)


def _materialize(original):
    """`Kernel.materialize`, which looks for a kernel that was compiled for another object first.

    A kernel that is not the package's own, such as one of a user's force, is not shared; its reads are kept too.
    """

    def materialize(self, key=None, args=None, arg_features=None, **more):
        if key is None or key in self.compiled_kernels:
            return original(self, key, args, arg_features, **more)
        self.reads_by_key = getattr(self, "reads_by_key", {})
        roots = self.template_slot_locations
        self.runtime.materialize()
        features = tuple(f for k, f in enumerate(arg_features) if k not in roots)
        for variant in [k for k in self.compiled_kernels if isinstance(k, Variant)]:
            if variant.features == features and variant.reads.match(args):
                self.compiled_kernels[key], self.reads_by_key[key] = self.compiled_kernels[variant], variant.reads
                return None
        reads = Reads(args, roots)
        reads.beside += _shares(_enclosed(self.func))
        with _watched(reads):
            original(self, key, args, arg_features, **more)
        self.reads_by_key[key] = reads
        if reads.whole and _shareable(self):
            self.compiled_kernels[Variant(reads, features)] = self.compiled_kernels[key]
        return None

    return materialize


def look_again() -> None:
    """An object has got other fields than it had: each kernel looks anew for one that was compiled from such objects.

    Raises:
        BackendError: the compiler does not tell of its kernels.
    """
    if runtime is None:
        raise BackendError(f"more room is needed for contacts, and compiler {compiler.chosen().name} has no "
                           "lang.impl:get_runtime to compile kernels anew: use another compiler")
    for kernel in list(runtime().kernels):
        if not hasattr(kernel, "compiled_kernels"):  # of quadrants, which knows launches by the addresses of kernels
            kernel.reset()
            kernel.launch_context_buffer_cache = type(kernel.launch_context_buffer_cache)()
            continue
        if hasattr(kernel, "launcher"):
            kernel.launcher.forget()
        for key in [k for k in kernel.compiled_kernels if not isinstance(k, Variant)]:
            del kernel.compiled_kernels[key]


def _shareable(kernel) -> bool:
    return kernel.func.__module__.split(".")[0] == PACKAGE and not kernel.func.__closure__


def _shares(values: Iterable) -> list:
    """Shares of the values that are fields from the pool."""
    return [value.share for value in values if isinstance(value, Field) and hasattr(value, "share")]


def _enclosed(function) -> list:
    """Values that a function finds outside of itself: in those around it, and in its module."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return cells + [function.__globals__[name] for name in function.__code__.co_names if name in function.__globals__]


def apply() -> None:
    """From now on kernels of this package are shared."""
    ASTTransformer.build_Attribute = _build_attribute(ASTTransformer.build_Attribute)
    ASTTransformer.build_Call = _build_call(ASTTransformer.build_Call)
    kernel_impl.Kernel.materialize = _materialize(kernel_impl.Kernel.materialize)
