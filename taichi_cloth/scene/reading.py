"""Scene files while they are read: their own code describes a scene, and does not run one."""

import ast
import contextlib
import os
import traceback
from collections.abc import Iterator

from ..errors import SceneError

_files: list[str] = []  # that are being read, the last one innermost


@contextlib.contextmanager
def reading(file: str) -> Iterator[None]:
    """Within it the code of a scene file is run."""
    _files.append(file)
    try:
        yield
    finally:
        _files.pop()


def only_described(call: str) -> None:
    """To be called by what runs or shows a simulation.

    Raises:
        SceneError: a scene file that is being read called it, beside its functions.
    """
    if _files:
        file, own = _files[-1], os.path.abspath(_files[-1])
        line = next((f", line {p.lineno}" for p in traceback.extract_stack() if os.path.abspath(p.filename) == own), "")
        raise SceneError(f"{file}{line}: calls {call} while it is read. {instead(file)}, and {call} below `if __name__ == "
                         "\"__main__\":`, where this command does not go")


def instead(file: str) -> str:
    """How a script that runs by itself is run, and how this command runs a scene."""
    return (f"A script that runs by itself is run by `python {file}`; for this command put the scene in `def build() -> "
            "tc.Scene:`, which returns it")


def builds(source: str) -> bool:
    """Whether the code of a scene file may name a `build`; code that cannot be read may."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return True
    return any((isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)) and node.name == "build")
               or (isinstance(node, ast.alias) and (node.asname or node.name) in ("build", "*"))
               or (isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and node.id == "build")
               or (isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("globals", "exec"))
               for node in ast.walk(tree))
