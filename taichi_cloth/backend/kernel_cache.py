"""Where a compiler keeps compiled kernels from process to process, and whether it can; each of them apart from the others."""

import functools
import os
import tempfile
import warnings
from typing import Any

from . import compiler

MOST = 1 << 29  # bytes of compiled kernels that are kept: some hundred scenes
VARIABLE = "TI_OFFLINE_CACHE_FILE_PATH"  # of the environment: another folder than the compiler's own


def options(keep: bool) -> dict[str, Any]:
    """Arguments of `ti.init` on the cache of kernels; forks of Taichi have a folder of theirs in it.

    Taichi makes the folder even if it keeps nothing (`keep` False). If it cannot, it fails at its second start, or as the
    process ends: then it gets another folder.
    """
    folder = _folder(compiler.chosen().name)
    if _writable(folder):
        return {"offline_cache": keep, "offline_cache_max_size_of_files": MOST, "offline_cache_file_path": folder}
    return {"offline_cache": False, "offline_cache_file_path": tempfile.gettempdir()}


def _folder(name: str) -> str:
    """The folder of a compiler: Taichi has the one that it always had."""
    [usual] = compiler.private("lang.impl:default_cfg")
    own = usual().offline_cache_file_path if usual else os.path.expanduser("~/.cache/taichi_cloth/kernels")
    folder = os.environ.get(VARIABLE) or own
    return folder if name == compiler.DEFAULT else os.path.join(folder, name)


@functools.cache
def _writable(folder: str) -> bool:
    """Whether files can be made in a folder, which is made if it is not there; says so once where not."""
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError as error:
        warnings.warn(f"compiled kernels cannot be kept in {folder} ({error.strerror}), and are compiled anew in every "
                      f"process: set {VARIABLE} to a folder that can be written to", stacklevel=2)
        return False
