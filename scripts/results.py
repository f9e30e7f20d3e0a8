"""JSON files of benchmarks: rows with what they ran on, for `bench_compare.py`."""

import json
import pathlib
import platform

import numpy as np

import taichi_cloth


def write(path: str | None, rows: list[dict], **more: object) -> None:
    """Writes rows, and what else there is to say, to a file; nothing where `path` is None."""
    if path:
        about = {"machine": platform.processor() or platform.machine(), "python": platform.python_version(),
                 "numpy": np.__version__, "taichi_cloth": taichi_cloth.__version__}
        pathlib.Path(path).write_text(json.dumps({**about, **more, "rows": rows}, indent=1) + "\n")
