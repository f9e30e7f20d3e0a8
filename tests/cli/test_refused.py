"""Wrong options of a scene are refused before Taichi is imported, and before anything is written."""

import pathlib
import subprocess
import sys

import pytest

PROGRAM = """
import sys
from taichi_cloth.app import cli
code = cli.main(sys.argv[1:])
sys.exit(code if "taichi" not in sys.modules else 99)
"""
OUT = ("--out", "o")


@pytest.mark.parametrize("words, said", [
    (("run", "hang", "--set", "stretch=-5", *OUT), "stretch k = -5.0 N/m: must be a positive number"),
    (("run", "hang", "--set", "fabric=denmi", *OUT), "did you mean 'denim'?"),
    (("run", "hang", "--set", "cels=5", *OUT), "did you mean 'cells'?"),
    (("check", "hang", "--set", "cells=0"), "cells = 0: must be a whole number of at least 1"),
    (("study", "hang", "--set", "cells=x", *OUT), "option cells='x' needs a whole number"),
    (("verify", "hang", "--set", "size=-1"), "size = -1.0 m: must be a positive number"),
])
def test_before_taichi_is_imported(tmp_path, words, said):
    done = subprocess.run([sys.executable, "-c", PROGRAM, *words], capture_output=True, text=True, timeout=60, check=False,
                          cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and said in done.stderr, (done.returncode, done.stderr)
    assert not list(pathlib.Path(tmp_path).iterdir())
