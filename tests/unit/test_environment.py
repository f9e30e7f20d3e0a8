"""What a user's environment lacks, or has set for other programs, neither stops Taichi nor chooses how it runs."""

import os
import pathlib
import subprocess
import sys

import pytest

from taichi_cloth.backend import runtime
from taichi_cloth.backend.language import ti

ROOT = pathlib.Path(__file__).parents[2]
CODE = """
import taichi_cloth
from taichi_cloth.backend import runtime

runtime.start("cpu", "f64", 1)
from taichi_cloth.backend.language import ti

@ti.kernel
def twice(x: float) -> float:
    return 2 * x

assert twice(3.0) == 6.0
runtime.start("cpu", "f32", 1)
assert twice(3.0) == 6.0
"""


@pytest.mark.restarts
def test_ti_arch_does_not_choose_the_arch(monkeypatch):
    """To Taichi it comes before the arch that a program asks for."""
    monkeypatch.setenv("TI_ARCH", "vulkan")
    assert runtime.available("cpu")
    runtime.start("cpu", "f32", 1)
    runtime.start("cpu", "f64", 1)
    assert ti.cfg.arch == ti.cpu and os.environ["TI_ARCH"] == "vulkan"


def test_kernels_that_cannot_be_kept_are_compiled_anew(tmp_path):
    """Nor is there a home: Taichi would end the process without one, and as it exits where it cannot write its cache."""
    script = tmp_path / "twice.py"
    script.write_text(CODE)
    there = {**os.environ, "PYTHONPATH": str(ROOT), "TI_OFFLINE_CACHE_FILE_PATH": str(script / "cache")}
    done = subprocess.run([sys.executable, str(script)], env={k: v for k, v in there.items() if k != "HOME"},
                          capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(f"compiled kernels cannot be kept in {script / 'cache'}") == 1, done.stderr
