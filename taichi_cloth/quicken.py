"""Taichi reads kernels, declares fields and finds attributes faster once this is imported.

What it draws for its messages and looks up again and again is replaced. Measured in DESIGN.md; what of it another version of
Taichi lacks stays as it is there. Import it before any class with kernels is made, best before Taichi itself.
"""

import functools
import inspect
import sys
import textwrap
from types import SimpleNamespace

_getmodule, inspect.getmodule = inspect.getmodule, lambda *_, **__: None  # type: ignore[assignment]
try:  # it would go through all modules for the source of each of its own kernels
    import taichi as ti
    from taichi.lang import impl, kernel_impl
    from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext
finally:
    inspect.getmodule = _getmodule


def _position(context, node) -> str:
    """Where a node is, without its line underlined."""
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n'


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the frame below a level is a class's body; Taichi reads the source of the frame that holds it for that."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


class _Bound:
    """A kernel of a class, bound to an instance where it is got from one."""

    def __init__(self, kernel) -> None:
        self.kernel = kernel
        kernel._is_staticmethod = False

    def __get__(self, owner, cls=None):
        return self.kernel if owner is None else kernel_impl._BoundedDifferentiableMethod(owner, self.kernel)


def _data_oriented(cls, mark=ti.data_oriented):
    """`ti.data_oriented`, which asks of every attribute that is got from an instance whether it is a kernel.

    It goes on doing so where a kernel is a property or static.
    """
    mark(cls)
    inner = [getattr(member, "fget", getattr(member, "__func__", None)) for member in vars(cls).values()]
    if any(hasattr(function, "_is_wrapped_kernel") for function in inner):
        return cls
    del cls.__getattribute__
    for name, member in list(vars(cls).items()):
        if getattr(member, "_is_classkernel", False):
            setattr(cls, name, _Bound(member))
    return cls


def _quicken() -> None:
    ASTTransformerContext.get_pos_info = _position  # type: ignore[method-assign]
    for module, name, quick in (
            (kernel_impl, "_inside_class", _inside_class),
            (kernel_impl, "getsourcelines", functools.lru_cache(None)(kernel_impl.getsourcelines)),
            (kernel_impl, "getsourcefile", functools.lru_cache(None)(kernel_impl.getsourcefile)),
            (kernel_impl, "textwrap", SimpleNamespace(fill=lambda line, **_: line.expandtabs(4).rstrip(),
                                                      dedent=functools.lru_cache(None)(textwrap.dedent))),
            (ti, "data_oriented", _data_oriented),
            (impl, "get_traceback", lambda *_, **__: "")):  # of every field's declaration
        if hasattr(module, name):
            setattr(module, name, quick)


_quicken()
