"""Ruff and a type checker over the package."""

import os
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]


KEPT = "--cache-dir=" + (".mypy_cache" if os.access(ROOT, os.W_OK) else os.devnull)  # a checkout may be read-only
TOOLS = [("ruff", "check", "--no-cache", "."), pytest.param(("mypy", KEPT), marks=pytest.mark.slow)]


@pytest.mark.parametrize("tool", TOOLS)
def test_clean(tool):
    done = subprocess.run([sys.executable, "-m", *tool], cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
