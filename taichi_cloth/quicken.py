"""Taichi reads and declares faster once this is imported: what it draws for its messages, and looks up again and again.

Measured in DESIGN.md; what of it another version of Taichi lacks stays as it is there.
"""

import functools
import sys
import textwrap
from types import SimpleNamespace

from taichi.lang import impl, kernel_impl
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext


def _position(context, node) -> str:
    """Where a node is, without its line underlined."""
    return f'File "{context.file}", line {node.lineno + context.lineno_offset}, in {context.func.func.__name__}:\n'


def _inside_class(level_of_class_stackframe: int) -> bool:
    """Whether the frame below a level is a class's body; Taichi reads the source of the frame that holds it for that."""
    return "__qualname__" in sys._getframe(level_of_class_stackframe - 1).f_locals


def _quicken() -> None:
    ASTTransformerContext.get_pos_info = _position  # type: ignore[method-assign]
    for module, name, quick in (
            (kernel_impl, "_inside_class", _inside_class),
            (kernel_impl, "getsourcelines", functools.lru_cache(None)(kernel_impl.getsourcelines)),
            (kernel_impl, "getsourcefile", functools.lru_cache(None)(kernel_impl.getsourcefile)),
            (kernel_impl, "textwrap", SimpleNamespace(fill=lambda line, **_: line.expandtabs(4).rstrip(),
                                                      dedent=functools.lru_cache(None)(textwrap.dedent))),
            (impl, "get_traceback", lambda *_, **__: "")):  # of every field's declaration
        if hasattr(module, name):
            setattr(module, name, quick)


_quicken()
