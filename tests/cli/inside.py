"""Commands and scripts in the tests' own process, where kernels are compiled already."""

import contextlib
import io
import pathlib
import runpy
import subprocess
from collections.abc import Callable

import pytest

from taichi_cloth.app.cli import main

ROOT = pathlib.Path(__file__).parents[2]
# of `python -c`: the command in another process, by the same kernels as in that of the tests
AS_HERE = f"""import sys
sys.path[:0] = [{str(ROOT)!r}, {str(ROOT / "tests")!r}]
from conftest import many_blocks
from taichi_cloth.app.cli import main
many_blocks()
sys.exit(main(sys.argv[1:]))"""


def call(*args: object) -> subprocess.CompletedProcess:
    """`taichi-cloth` with these arguments, from the root of the checkout."""
    words = [str(a) for a in args]
    return _caught("taichi-cloth", words, lambda: main(words))


def call_script(path: pathlib.Path, *args: object) -> subprocess.CompletedProcess:
    """`python path` with these arguments: as the main module, with its own folder among those of modules."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(path.parent))
        return _caught(str(path), [str(a) for a in args], lambda: runpy.run_path(str(path), run_name="__main__"))


def _caught(name: str, words: list[str], does: Callable[[], object]) -> subprocess.CompletedProcess:
    """What it returned or exited with, and what it printed."""
    said, errors = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
        patch.chdir(ROOT)
        patch.setattr("sys.argv", [name, *words])
        try:
            code = does()
            code = code if isinstance(code, int) else 0
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
            errors.write(end.code if isinstance(end.code, str) else "")
    return subprocess.CompletedProcess([name, *words], code, said.getvalue(), errors.getvalue())
