"""Taichi reads and launches this package's kernels, declares its fields and finds its attributes faster once this is imported.

Sources that Taichi draws for its messages, and looks up again and again, are replaced where the kernel, the class or the field
is the package's own. Those of others keep all of it: their source lines underlined in errors, and where their fields were
declared. Measured in docs/decisions/071-compile-once.md. A compiler that has not all parts that this needs stays as it is, and
notes of simulations say so; so does any with the environment variable TAICHI_CLOTH_PATCHES=0. `language.py` imports this
module, and with it the compiler, before any class with kernels is made.
"""

import functools
import sys
import textwrap
from types import SimpleNamespace

import numpy as np

from . import compiler, counting, launches, shared_kernels
from .launches import Bound, belongs, called, own

NAME = compiler.chosen().name
NEEDED = ("lang.impl:current_cfg", "lang.kernel_impl:AutodiffMode", "lang.kernel_impl:Kernel.materialize",
          "lang.kernel_impl:_BoundedDifferentiableMethod", "lang.kernel_impl:_process_args",
          "lang.ast.ast_transformer:ASTTransformer.build_Attribute", "types.ndarray_type:NdarrayType",
          "types.primitive_types:real_type_ids", "_lib:core.Program.launch_kernel", "lang.snode:get_addr",
          "lang.util:to_numpy_type")
LACKS = [place for place, found in zip(NEEDED, compiler.private(*NEEDED)) if found is None]
WANTED = compiler.PATCHED and not LACKS
NOTES = [f"compiler {NAME} has no {' nor '.join(LACKS)}: each simulation compiles all of its kernels, and launches are "
         "slower"] if compiler.PATCHED and LACKS else []
ti, [kernel_impl] = compiler.language(), compiler.private("lang.kernel_impl")


def _own_or_taichi(module: str | None) -> bool:
    return own(module) or belongs(module, NAME)


def _get_pos_info(original):
    """Location of a node, without its line underlined; worked out once for each of Taichi's own functions."""
    known: dict[tuple, str] = {}

    def position(context, node) -> str:
        function = context.func.func
        if own(function.__module__):
            return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {function.__name__}:\n'
        if not belongs(function.__module__, NAME):
            return original(context, node)
        key = function, node.lineno, node.col_offset, node.end_lineno, node.end_col_offset
        if key not in known:
            known[key] = original(context, node)
        return known[key]

    return position


def _inside_class(original):
    """Whether the frame below a level is a class's body; Taichi reads the source of the frame that holds it for that."""

    def inside(level_of_class_stackframe: int) -> bool:
        frame = sys._getframe(level_of_class_stackframe - 1)
        if not _own_or_taichi(frame.f_globals.get("__name__")):
            return original(level_of_class_stackframe + 1)
        return "__qualname__" in frame.f_locals

    return inside


def _cached(original):
    """Facts about a function, found out once."""
    known = functools.lru_cache(None)(original)
    return lambda function: (known if _own_or_taichi(function.__module__) else original)(function)


def _get_traceback(original):
    """Location of a field's declaration, in words; "" for fields of this package."""

    def traceback(stacklevel: int = 1) -> str:
        frame = sys._getframe(1)
        while frame.f_back is not None and belongs(frame.f_globals.get("__name__"), NAME):
            frame = frame.f_back
        return "" if own(frame.f_globals.get("__name__")) else original(stacklevel + 1)

    return traceback


def _data_oriented(original):
    """`ti.data_oriented`, which asks of every attribute that is got from an instance whether it is a kernel.

    It goes on doing so where a kernel is a property or static.
    """

    def data_oriented(cls):
        original(cls)
        inner = [getattr(member, "fget", getattr(member, "__func__", None)) for member in vars(cls).values()]
        if not own(cls.__module__) or any(hasattr(function, "_is_wrapped_kernel") for function in inner):
            return cls
        del cls.__getattribute__
        for name, member in list(vars(cls).items()):
            if getattr(member, "_is_classkernel", False):
                setattr(cls, name, Bound(member))
        return cls

    return data_oriented


def _swapped_in(original):
    """A look at fields, or a change of them, from Python: the numbers of their simulations are in them."""

    def look(self, *args, **kwargs):
        if counting.now is not None:
            counting.now.singles += 1
        launches.swap_in(field.share for field in (self, *args) if hasattr(field, "share"))
        return original(self, *args, **kwargs)

    return look


def _lines(_original):
    """`textwrap` as kernels' sources need it, line by line, with the same result."""
    dedent = functools.lru_cache(1024)(textwrap.dedent)
    return SimpleNamespace(fill=lambda line, **_: line.expandtabs(4).rstrip(), dedent=dedent)


def _viewed(original):
    """A launch with views of arrays, and Python's numbers: quadrants keeps weak references to its arguments. It warns of
    numbers that have none, and numpy changes the size of no array that has one."""

    def call(self, *args, **kwargs):
        return original(self, *(a.view() if isinstance(a, np.ndarray) else a.item() if isinstance(a, np.generic) else a
                                for a in args), **kwargs)

    return call


READ = (  # how sources are read and messages made: owner, name and the maker of the faster one, where a compiler has it
    ("lang.ast.ast_transformer_utils:ASTTransformerContext", "get_pos_info", _get_pos_info),
    ("lang.ast.ast_transformer_utils:ASTTransformerFuncContext", "_build_pos_info", _get_pos_info),
    ("lang.kernel_impl", "_inside_class", _inside_class), ("lang.impl", "get_traceback", _get_traceback),
    ("lang.kernel_impl", "getsourcelines", _cached), ("lang.kernel_impl", "getsourcefile", _cached),
    ("lang._func_base", "get_source_info_and_src", _cached), ("lang.kernel_impl", "textwrap", _lines),
    ("lang._func_base", "textwrap", _lines))
LAUNCH = (("", "data_oriented", _data_oriented), ("lang.kernel_impl:Kernel", "__call__", called),
          ("lang.field:Field", "_initialize_host_accessors", _swapped_in),
          *((place, f"_try_native_dense_{name}", _swapped_in)  # taichi_forge copies whole fields without a kernel
            for place in ("lang.field:ScalarField", "lang.matrix:MatrixField")
            for name in ("fill", "to_numpy", "from_numpy", "copy_from")))


def _apply(patches: tuple) -> None:
    for place, name, faster in patches:
        [owner] = compiler.private(place)
        if hasattr(owner, name):
            setattr(owner, name, faster(getattr(owner, name)))


_apply((("lang.kernel:Kernel", "__call__", _viewed),))  # quadrants has this module alone, and needs it
if compiler.PATCHED:
    _apply(READ + (LAUNCH if WANTED else ()))
if WANTED:
    shared_kernels.apply()
