"""Blender as a process of its own: how it is told to run a script, and the reason of a failure.

Its module bpy is one Blender a process, has its own numpy, and may be a Blender somebody works in. TAICHI_CLOTH_BLENDER in the
environment names another program.
"""

from __future__ import annotations

import importlib.util
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile

import numpy as np

from ..errors import MeshError
from . import npz

ABSENT = ("neither its module bpy nor the program `blender` is here: pip install 'taichi-cloth[blender]' (Python 3.11 for "
          "Blender 4.2 to 5.0), or the program on the PATH or named by TAICHI_CLOTH_BLENDER")


def command(script: pathlib.Path) -> list[str] | None:
    """The command line that runs a script in Blender, up to the script's arguments; None if there is no Blender.

    Tried are the program that the environment names, Python with bpy, and the program on the PATH.
    """
    named = os.environ.get("TAICHI_CLOTH_BLENDER")
    if not named and importlib.util.find_spec("bpy") is not None:
        return [sys.executable, str(script), "--"]
    program = shutil.which(named or "blender")
    if program:
        return [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python", str(script), "--"]
    return None


def run(words: list[str]) -> subprocess.CompletedProcess:
    """Runs it to its end."""
    return subprocess.run(words, capture_output=True, text=True, errors="replace", check=False)


def arrays(script: pathlib.Path, path: pathlib.Path, choices: str, kind: str) -> dict[str, np.ndarray]:
    """The arrays that a script makes of a file.

    Args:
        kind: of file, for the error of a machine without Blender.

    Raises:
        MeshError: Blender is not here, or cannot read the file.
    """
    words = command(script)
    if words is None:
        raise MeshError(f"{kind} is read by Blender, and {ABSENT}. Files in glTF, USD and OBJ need none of it")
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "made.npz"
        done = run([*words, str(path.absolute()), str(out), choices])
        if done.returncode or not out.is_file():
            raise MeshError(f"cannot be read: {reason(done)}")
        return npz.read(out)


def reason(done: subprocess.CompletedProcess) -> str:
    """The failure in a line."""
    if done.returncode < 0:
        return f"Blender was ended by {signal.Signals(-done.returncode).name}"
    lines = [line.strip() for line in (done.stderr + done.stdout).splitlines() if "Error" in line]
    return f"Blender says: {(lines or ['nothing'])[-1][:300]}"
